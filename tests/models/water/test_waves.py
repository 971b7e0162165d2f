"""Waves: orbits of linear theory, the sea's variance, and what they do to a hull."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.hull.vehicle import hull
from uuvsim_cosim.models.water.waves import waves

REGULAR = {"H_s": 0.6, "T_p": 4.0, "direction": 0.7, "phase": 0.3}
OMEGA, G = np.pi / 2, 9.80665
K = OMEGA**2 / G


def at(N: float, E: float, D: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return zeta, v and a of the regular wave by its stream of formulae, typed anew."""
    theta = K * (N * np.cos(0.7) + E * np.sin(0.7)) - OMEGA * t + 0.3
    v = 0.3 * OMEGA * np.exp(-K * D)
    level = np.array([np.cos(0.7), np.sin(0.7)])
    velocity = np.column_stack([np.outer(v * np.cos(theta), level), -v * np.sin(theta)])
    a = OMEGA * np.column_stack([np.outer(v * np.sin(theta), level), v * np.cos(theta)])
    return 0.3 * np.cos(theta), velocity, a


def test_a_regular_wave_is_that_of_linear_theory() -> None:
    inputs = {"eta": [3.0, -2.0, 1.5, 0, 0, 0], "v": [0.1, 0.2, 0.0]}
    r = simulate(waves(1), until=4.0, h=0.1, inputs=inputs, parameters=REGULAR)
    zeta, v, a = at(3.0, -2.0, 1.5, r.t)
    np.testing.assert_allclose(r["zeta"], zeta, atol=1e-12)
    np.testing.assert_allclose(r["v_c"], v + np.array([0.1, 0.2, 0.0]), atol=1e-12)
    np.testing.assert_allclose(r["a_c"], a, atol=1e-12)


def test_the_surface_rises_as_the_water_at_it_does_and_a_is_the_rate_of_v() -> None:
    r = simulate(waves(1), until=4.0, h=1e-3, parameters=REGULAR)
    rising = np.gradient(r["zeta"], 1e-3)[1:-1]
    np.testing.assert_allclose(-r["v_c"][1:-1, 2], rising, atol=1e-6)
    np.testing.assert_allclose(np.gradient(r["v_c"], 1e-3, axis=0)[1:-1], r["a_c"][1:-1], atol=1e-5)


def test_the_water_keeps_its_volume() -> None:
    """dv_N/dN + dv_D/dD = 0."""
    step, v = 1e-4, {}
    for name, N, D in (("N", step, 1.0), ("n", -step, 1.0), ("D", 0, 1 + step), ("d", 0, 1 - step)):
        inputs, still = {"eta": [N, 0, D, 0, 0, 0]}, REGULAR | {"direction": 0.0}
        v[name] = simulate(waves(1), at=[0.4], inputs=inputs, parameters=still)["v_c"][0]
    assert v["N"][0] - v["n"][0] + v["D"][2] - v["d"][2] == pytest.approx(0.0, abs=1e-10)


def test_half_a_wavelength_down_a_twenty_third_is_left() -> None:
    deep = np.pi / K
    r = simulate(waves(1), at=[0.0], inputs={"eta": [0, 0, deep, 0, 0, 0]}, parameters=REGULAR)
    assert np.linalg.norm(r["v_c"][0]) == pytest.approx(0.3 * OMEGA * np.exp(-np.pi), rel=1e-12)


def test_a_sea_has_the_significant_height_that_was_asked_and_draws_its_phases() -> None:
    seas = []
    for seed in (1, 2):
        given = {"H_s": 2.0, "T_p": 6.0, "seed": [seed, 0]}
        r = simulate(waves(24), until=800.0, h=1.0, parameters=given)
        seas.append(r["zeta"][2:])
        assert 4.0 * np.std(r["zeta"]) == pytest.approx(2.0, rel=0.03)
    assert np.abs(np.corrcoef(*seas)[0, 1]) < 0.3


def test_a_neutral_sphere_moves_with_the_water() -> None:
    """(m + M_A) nu_dot = (rho nabla + M_A) a_c:  a sphere of water goes where the water goes."""
    ball = {"m": 10.0, "W": 98.0, "B": 98.0, "M_A_11": 5.0, "M_A_22": 5.0, "M_A_33": 5.0}
    ball |= {f"I_b_{i}{i}": 1.0 for i in (1, 2, 3)}
    model = hull("ball", ball, surface=False, waves=True)
    _, v_0, _ = at(0.0, 0.0, 3.0, np.array([0.0]))
    r = simulate(
        model,
        until=8.0,
        h=0.01,
        inputs={"a_c": lambda t: at(0.0, 0.0, 3.0, np.array([t]))[2][0]},
        parameters={"nu_0": [*v_0[0], 0, 0, 0], "eta_0": [0, 0, 3, 0, 0, 0]},
    )
    np.testing.assert_allclose(r["nu"][:, :3], at(0.0, 0.0, 3.0, r.t)[1], atol=1e-7)


def test_the_force_on_a_held_sphere_is_three_halves_of_froude_and_krylovs() -> None:
    """It is rho nabla (1 + C_m) a with C_m = 1/2, at a sphere of any weight and attitude."""
    ball = {"m": 7.0, "W": 68.6, "B": 98.0, "M_A_11": 5.0, "M_A_22": 5.0, "M_A_33": 5.0}
    ball |= {f"I_b_{i}{i}": 1.0 for i in (1, 2, 3)}
    model = hull("ball", ball, surface=False, waves=True)
    a = np.array([0.3, -0.2, 0.5])
    rows = [
        simulate(model, at=[0.0], inputs={"a_c": x}, parameters={"eta_0": [0, 0, 5, 0.4, 0.3, 1.0]})
        for x in (a, 0 * a)
    ]
    force = 12.0 * (rows[0]["nu_dot"] - rows[1]["nu_dot"])[0, :3]
    assert np.linalg.norm(force) == pytest.approx(1.5 * 10.0 * np.linalg.norm(a), rel=1e-12)


def test_a_floating_hull_rides_a_long_wave() -> None:
    """Slow against its own period, it rises with the surface; the water at it moves alike."""
    model = declare("sphere", surface="volumes", waves=True, values={"D_l_33": 300.0, "m": 25.0})
    T = 40.0

    def zeta(t: float) -> float:
        return float(np.sin(2 * np.pi * t / T))

    start = {"eta_0": [0, 0, 0.05, 0, 0, 0]}
    r = simulate(model, until=80.0, h=0.02, inputs={"zeta": zeta}, parameters=start)
    settled = r.t > 40.0
    D = r["eta"][settled, 2] + np.array([zeta(t) for t in r.t[settled]])
    assert np.ptp(D) < 0.1, "of a wave of 2 m"


@pytest.mark.parametrize("components", [0, "many", -3, "1.5"])
def test_a_number_of_components_that_is_none_is_refused(components: object) -> None:
    with pytest.raises(InputInvalid, match="whole number from 1"):
        waves(components)  # type: ignore[arg-type]


# ---- shoal water and directional seas ----------------------------------------------------------


def orbit(h: float, d: float, t: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return v and a of the regular wave along N over a bottom."""
    inputs, given = {"eta": [0, 0, d, 0, 0, 0]}, REGULAR | {"direction": 0.0, "phase": 0.0, "h": h}
    r = simulate(waves(1, bottom=True), at=[t], inputs=inputs, parameters=given)
    return r["v_c"][0], r["a_c"][0]


def number(h: float) -> float:
    """Solve omega² = g k tanh(k h) anew, by bisection."""
    low, high = 1e-6, 50.0
    for _ in range(200):
        k = 0.5 * (low + high)
        low, high = (k, high) if G * k * np.tanh(k * h) < OMEGA**2 else (low, k)
    return k


@pytest.mark.parametrize("h", [0.3, 1.0, 5.0, 12.0, 200.0])
def test_waves_over_a_bottom_obey_its_dispersion_and_profile(h: float) -> None:
    k = number(h)
    for d in (0.0, 0.4 * h):
        v, _ = orbit(h, d)
        assert v[0] == pytest.approx(0.3 * OMEGA * np.cosh(k * (h - d)) / np.sinh(k * h), rel=1e-9)
        v, a = orbit(h, d, t=1.0)  # a quarter of the period later, at sin theta = -1
        rising = 0.3 * OMEGA * np.sinh(k * (h - d)) / np.sinh(k * h)
        assert v[2] == pytest.approx(rising, rel=1e-9)
        assert a[0] == pytest.approx(-OMEGA * orbit(h, d)[0][0], rel=1e-9)


def test_at_the_bottom_the_water_moves_along_it_and_in_shoal_water_alike_at_all_depths() -> None:
    assert orbit(5.0, 5.0, 1.0)[0][2] == pytest.approx(0.0, abs=1e-15)
    top, bed = (orbit(0.05, d)[0][0] for d in (0.0, 0.05))
    assert top == pytest.approx(bed, rel=0.02)
    assert top == pytest.approx(0.3 * np.sqrt(G / 0.05), rel=0.01)


def test_over_deep_water_a_bottom_changes_nothing() -> None:
    inputs, given = {"eta": [3.0, -2.0, 1.5, 0, 0, 0]}, dict(REGULAR)
    deep = simulate(waves(1), until=4.0, h=0.5, inputs=inputs, parameters=given)
    given |= {"h": 100.0}
    far = simulate(waves(1, bottom="true"), until=4.0, h=0.5, inputs=inputs, parameters=given)
    for name in ("v_c", "a_c", "zeta"):
        np.testing.assert_allclose(far[name], deep[name], atol=1e-12)


def test_a_directional_sea_keeps_its_energy_and_has_the_spread_that_was_asked() -> None:
    """Var zeta = H_s²/16, mean 0; v_h across over along is tan² of cos^2s's deviation."""
    r = simulate(
        waves(48, spreading=2), until=1500.0, h=1.0,
        parameters={"H_s": 2.0, "T_p": 6.0, "direction": 0.0, "seed": [3, 0]},
    )  # fmt: skip
    zeta, v, a = (r[name][2:] for name in ("zeta", "v_c", "a_c"))
    assert np.var(zeta) == pytest.approx(2.0**2 / 16.0, rel=0.06)
    for x in (zeta, v, a):
        assert np.abs(x.mean(axis=0)).max() < 0.02
    s = 2.0  # E[cos 2 theta] of cos^2s(theta/2) is s (s - 1) / ((s + 1) (s + 2))
    second = s * (s - 1) / ((s + 1) * (s + 2))
    across, along = np.var(v[:, 1]), np.var(v[:, 0])
    assert (along - across) / (along + across) == pytest.approx(second, abs=0.12)


@pytest.mark.parametrize("s", [0.0, -1, 1e5])
def test_a_spreading_that_is_none_is_refused(s: float) -> None:
    with pytest.raises(InputInvalid, match=r"spreading=.*; expected more than 0"):
        waves(4, spreading=s)
