"""The reference evaluation: stages, ticks, sampled signals, and what it refuses."""

from fractions import Fraction
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, ParameterInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.checks.reference_trajectory import read_reference
from uuvsim_cosim.models.declaration import safe_math
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.philox import normals, philox
from uuvsim_cosim.models.guidance.sampled_signal import Signal

CSV = content("models", "vehicles", "bluerov2_heavy", "reference") / "wu_2018_const_surge.csv"


def integrator() -> Model:
    m = Model("integrator")
    u = m.input("u", unit="m/s")
    x = m.state("x", unit="m")
    m.der(x, u)
    m.output("y", x, unit="m")
    return m


def test_a_function_of_time_is_evaluated_inside_the_stages() -> None:
    """Simpson's rule integrates a cubic exactly; a held input would not."""
    r = simulate(integrator(), until=1, h=0.25, inputs={"u": lambda t: 4 * t**3})
    assert r["y"][-1] == pytest.approx(1.0, abs=1e-15)


def test_a_jump_on_the_grid_belongs_to_the_step_that_follows() -> None:
    r = simulate(integrator(), until=1, h=0.1, inputs={"u": lambda t: 1.0 if t >= 0.3 else 0.0})
    assert r["y"][-1] == pytest.approx(0.7, abs=1e-15)


def test_ticks_between_steps_cut_the_integration() -> None:
    m = integrator()
    x = m.variables["x"].symbol
    clock = m.clock("c", "1/3")
    held = m.discrete("held", unit="m")
    m.update(clock, held, x)
    r = simulate(m, until=1, h=0.5, inputs={"u": 1.0})
    np.testing.assert_allclose(r["held"], [0.0, 1 / 3, 2 / 3], atol=1e-15)
    assert clock.period == Fraction(1, 3)


def test_a_value_that_is_not_finite_names_component_and_time() -> None:
    with pytest.raises(ComponentFailed, match=r"'integrator' failed at t = 0\.5 s"):
        simulate(integrator(), until=1, h=0.5, inputs={"u": lambda t: np.nan if t > 0.2 else 0.0})


def test_an_input_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="no input 'tau'; expected u"):
        simulate(integrator(), until=1, tau=[1.0])


def test_until_or_at_is_needed() -> None:
    with pytest.raises(ParameterInvalid, match="expected until or at"):
        simulate(integrator())


# ---- signals between samples --------------------------------------------------------------------

T = np.round(np.arange(0, 10.05, 0.1), 9)
BETWEEN = np.linspace(0.013, 9.987, 997)


@pytest.mark.parametrize("w", [0.5, 1.0, 2.0])
def test_a_sampled_sine_is_continued_smoothly(w: float) -> None:
    signal = Signal(T, np.sin(w * T))
    error = [signal(t) - np.sin(w * t) for t in BETWEEN]
    assert np.abs(error).max() < 2e-5
    assert np.abs(error[50:-50]).max() < 1e-6


def test_a_jump_stays_a_jump() -> None:
    f = lambda t: np.where(t < 4, 0.0, np.where(t < 7, 5.0, -2.0))  # noqa: E731
    signal = Signal(T, f(T))
    np.testing.assert_array_equal([signal(t) for t in BETWEEN], f(BETWEEN))


def test_a_jump_between_smooth_parts_does_not_ring() -> None:
    f = lambda t: np.where(t < 4, np.sin(t), 6 + np.cos(t))  # noqa: E731
    signal = Signal(T, f(T))
    np.testing.assert_allclose([signal(t) for t in BETWEEN], f(BETWEEN), atol=1e-5)


def test_a_ramp_starts_with_a_kink() -> None:
    f = lambda t: np.clip(t - 3, 0, 2)  # noqa: E731
    signal = Signal(T, f(T))
    np.testing.assert_allclose([signal(t) for t in BETWEEN], f(BETWEEN), atol=1e-12)


def test_a_held_signal_is_a_staircase() -> None:
    signal = Signal(T, T, held=True)
    assert signal(0.199) == 0.1
    assert signal(11.0) == 10.0


# ---- reference files ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("phi_rad", "roll_deg", "expected t_s, N_m"),
        ("0.1,0.00117948868396", "0.1,zero", ":7: N_m = 'zero'; expected a number"),
        ("0.1,0.00117948868396", "0.1", ":7: 18 values; expected 19"),
        ("\n0.2,", "\n0.05,", "rising times"),
    ],
)
def test_a_malformed_reference_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(CSV.read_text().replace(old, new, 1))
    with pytest.raises(InputInvalid, match=message):
        read_reference(path)


def test_a_missing_reference_is_refused() -> None:
    with pytest.raises(InputInvalid, match="cannot be read"):
        read_reference(Path("nowhere.csv"))


# ---- guarded functions --------------------------------------------------------------------------


def test_the_guarded_norm_has_a_finite_gradient_at_zero() -> None:
    x = ca.SX.sym("x", 3)
    f = ca.Function("f", [x], [safe_math.norm(x), ca.jacobian(safe_math.norm(x), x)])
    assert [np.array(v).ravel().tolist() for v in f([0, 0, 0])] == [[0.0], [0.0, 0.0, 0.0]]
    assert float(f([3, 0, 4])[0]) == 5.0


def test_saturation_keeps_nan() -> None:
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [safe_math.saturate(x, 1.0)])
    assert [float(f(v)) for v in (-3, 0.5, 3)] == [-1.0, 0.5, 1.0]
    assert np.isnan(float(f(np.nan)))


# ---- random draws -------------------------------------------------------------------------------


def test_philox_gives_the_known_answers_of_its_authors() -> None:
    """Random123's kat_vectors for philox4x32-10: counter and key all zero, and all one."""
    ones = 0xFFFFFFFF
    zero = philox((0, 0, 0, 0), (0, 0))
    assert zero == (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)
    assert philox((ones,) * 4, (ones,) * 2) == (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)


def test_a_draw_does_not_depend_on_how_many_are_asked_for() -> None:
    seed = np.array([-5.0, 7.0])
    np.testing.assert_array_equal(normals(seed, 1, 2, 5)[:2], normals(seed, 1, 2, 2))


def test_draws_are_standard_normal() -> None:
    x = np.concatenate([normals(np.array([1.0, 2.0]), 0, k, 4) for k in range(5000)])
    assert abs(x.mean()) < 0.02
    assert x.std() == pytest.approx(1.0, abs=0.02)
    assert (x**4).mean() == pytest.approx(3.0, abs=0.2)
