"""Assumptions of a fit: unknown delays, biases, currents and coloured noise come back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.assumptions import Assumptions
from uuvsim_cosim.studies.identification.fit import fit
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.identify import Identified, identify
from uuvsim_cosim.studies.identification.logs import read_log
from uuvsim_cosim.studies.identification.parameters import wanted_parameters
from uuvsim_cosim.studies.identification.shooting import Shooting
from uuvsim_cosim.studies.identification.signals import Lookup, grid_of

Array = NDArray[np.float64]
TRUE = {"D_q_11": 21.0, "M_A_11": 7.0, "D_q_33": 30.0, "M_A_66": 0.15}
NOISE = np.array([0.02] * 3 + [0.005] * 3 + [0.01] * 3 + [0.01] * 3)
CURRENT = (0.2, -0.1, 0.0)


def forces(t: Array | float) -> Array:
    """Smooth forces in surge, heave and yaw."""
    tau = np.zeros((*np.shape(t), 6))
    tau[..., 0] = 8.0 * np.sin(0.9 * np.asarray(t)) + 6.0 * np.sin(3.1 * np.asarray(t) + 1.0)
    tau[..., 2] = 6.0 * np.sin(0.5 * np.asarray(t) + 2.0) + 4.0 * np.sin(2.3 * np.asarray(t))
    tau[..., 5] = 0.4 * np.sin(1.3 * np.asarray(t)) + 0.3 * np.sin(4.1 * np.asarray(t) + 2.0)
    return tau


def flown(
    seed: int = 1,
    delay: float = 0.0,
    v_c: tuple[float, ...] = (0.0, 0.0, 0.0),
    colour: float = 0.0,
    until: float = 12.0,
) -> Signals:
    """A BlueROV2 with other numbers than its set, flown by smooth forces, at 20 Hz with noise."""
    t = np.round(np.arange(0.0, until, 0.05), 9)
    made = simulate(
        declare("bluerov2", surface=False), at=[float(s) for s in t], h=0.025,
        tau=lambda s: forces(s - delay), inputs={"v_c": list(v_c)},
        parameters={**TRUE, "eta_0": [0.0, 0, 20, 0, 0, 0]},
    )  # fmt: skip
    noise = np.random.default_rng(seed).normal(size=(len(t), 12))
    for k in range(1, len(t)):
        noise[k] = colour * noise[k - 1] + np.sqrt(1 - colour**2) * noise[k]
    noise *= NOISE
    values = {"eta": made["eta"] + noise[:, :6], "nu": made["nu"] + noise[:, 6:], "tau": forces(t)}
    return Signals(t, np.arange(len(t)), values, {}, metadata={"file": "dive.csv"})


def fitted(signals: Signals, **assumed: object) -> Identified:
    return identify(
        signals, "model:bluerov2", list(TRUE), proposals=False,
        assumed=Assumptions(**assumed),  # type: ignore[arg-type]
    )  # fmt: skip


def away(found: Identified, **true: float) -> float:
    """The largest error, in half widths of 95 % intervals."""
    return max(abs(found[n].value - v) / found[n].half_width for n, v in (TRUE | true).items())


def test_smooth_forces_read_as_held_are_wrong_and_named() -> None:
    data = flown()
    right, wrong = fitted(data, inputs="smooth"), fitted(data)
    assert away(right) < 1.6
    assert right.warning is None
    assert away(wrong) > 3.0
    assert wrong.warning is not None
    assert "not white: Ljung-Box Q = " in wrong.warning
    assert "first estimate, --inputs linear or smooth lowers the sum of squares" in wrong.warning


def test_an_unknown_delay_comes_back_and_a_known_one_is_used() -> None:
    data = flown(delay=0.04)
    found = fitted(data, inputs="smooth", unknown=("delay",))
    assert away(found, delay=0.04) < 1.6
    assert found["delay"].half_width < 0.002
    assert found["delay"].nuisance
    assert away(fitted(data, inputs="smooth", delay=0.04)) < 1.6
    ignored = fitted(data, inputs="smooth")
    assert away(ignored) > 3.0
    assert "--unknown delay lowers the sum of squares" in (ignored.warning or "")


def test_a_constant_current_comes_back() -> None:
    data = flown(v_c=CURRENT)
    found = fitted(data, inputs="smooth", unknown=("current",))
    assert away(found, current_N=CURRENT[0], current_E=CURRENT[1]) < 1.6
    assert "--unknown current" in (fitted(data, inputs="smooth").warning or "")


def test_biases_of_sensors_come_back() -> None:
    data = flown()
    values = {n: np.array(data[n]) for n in data}
    values["nu"][:, 5] += 0.03
    values["eta"][:, 4] += 0.02
    biased = Signals(data.time, data.ticks, values, {}, metadata=data.metadata)
    found = fitted(biased, inputs="smooth", unknown=("bias",))
    assert away(found, bias_r=0.03, bias_theta=0.02, bias_q=0.0, bias_u=0.0) < 1.6
    warning = fitted(biased, inputs="smooth").warning or ""
    assert "--unknown bias_theta,bias_r lowers" in warning


@pytest.mark.parametrize("residuals", ["ar1", "robust"])
def test_intervals_hold_with_coloured_noise(residuals: str) -> None:
    """Of 32 intervals of eight recordings 27 or more hold: by the binomial law in 99 of 100."""
    z = []
    for seed in range(8):
        found = fitted(flown(seed, colour=0.8, until=10.0), inputs="smooth", residuals=residuals)
        z += [1.96 * (found[n].value - v) / found[n].half_width for n, v in TRUE.items()]
        assert (found.warning is None) == (residuals == "ar1")
    assert np.sum(np.abs(z) < 1.96) >= 27
    narrow = fitted(flown(0, colour=0.8), inputs="smooth", residuals="white")
    assert "intervals are too narrow" in (narrow.warning or "")


def test_autoregressive_residuals_are_fitted_more_exactly_than_widened_ones() -> None:
    data = flown(colour=0.9)
    exact, wide = (fitted(data, inputs="smooth", residuals=r) for r in ("ar1", "robust"))
    for name in TRUE:
        assert exact[name].half_width < wide[name].half_width


def test_innovations_are_differences_across_windows_too_each_once() -> None:
    plan = flatten(System("s").add("hull", "model:bluerov2"))
    box = GreyBox(plan, 0, wanted_parameters(plan, 0, list(TRUE)), exact=False)
    grid = grid_of(box, Lookup(flown(colour=0.8), {}), h=None, first=0.0, last=None)
    problem = Shooting(box, grid)
    found = fit(box, grid, problem=problem, residuals="ar1")
    assert found.point is not None
    assert found.noise is not None
    assert len(found.point.starts) == 4
    squares = 0.0
    told = problem.series(problem.innovations(found.point, found.noise))
    for j, (r, e) in enumerate(zip(problem.series(found.point.residual), told, strict=True)):
        rho = found.noise.rho[j]
        assert rho == pytest.approx(0.8, abs=0.15)
        assert e[1:] == pytest.approx(r[1:] - rho * r[:-1], abs=1e-4, nan_ok=True)
        first = np.sqrt(1 - rho**2) * r[0]
        squares += (first**2 + np.nansum(e[1:] ** 2)) / found.noise.sigma[j] ** 2
    assert np.sum(found.point.rows[..., -1] ** 2) == pytest.approx(squares, rel=1e-6)


@pytest.mark.parametrize("names", [
    {"D_q_11": 1.62, "M_A_11": 0.93, "D_q_22": 131.0, "M_A_22": 35.5},
    {"D_q_66": 9.4, "M_A_66": 4.88, "D_q_44": 0.13, "M_A_44": 0.0704},
])  # fmt: skip
def test_presteros_trajectory_gives_its_own_parameters_back(names: dict[str, float]) -> None:
    """From starts that are wrong by a third: forces are sums of sines, sampled at 10 Hz."""
    from uuvsim_cosim.studies.identification.identify import system_of

    folder = content("models", "vehicles", "remus100", "reference")
    system = system_of("model:remus100@prestero_2001?surface=false").with_mismatches("warn")
    for name, value in names.items():
        system = system.set(f"hull.{name}", 1.35 * value)
    found = identify(
        read_log(folder / "prestero_2001_multisine.csv"), system, list(names), proposals=False,
        assumed=Assumptions("smooth"),
    )  # fmt: skip
    for name, value in names.items():
        assert found[name].value == pytest.approx(value, rel=1e-4)
        assert abs(found[name].value - value) < found[name].half_width
    assert found.warning is None  # what is left is the error of the solution, and no noise
    assert any(n.startswith("integrated in steps of 0.0") for n in found.notes)


def test_rows_that_repeat_a_command_are_no_samples_of_it() -> None:
    """A log holds commands at the times of other messages, and states their own times."""
    data = flown()
    tau = np.array(data["tau"])
    own = np.arange(0, len(tau), 4)
    held = tau[np.repeat(own, 4)[: len(tau)]]
    values = {"eta": data["eta"], "nu": data["nu"], "tau": held}

    def of(metadata: dict[str, object]) -> Identified:
        return fitted(Signals(data.time, data.ticks, values, {}, metadata=metadata),
                      inputs="smooth")  # fmt: skip

    assert away(of({"sampled": {"tau": data.time[own]}})) < 2.0
    assert away(of({})) > 3.0


def test_assumptions_that_do_not_exist_are_refused() -> None:
    with pytest.raises(InputInvalid, match=r"--inputs cubic.*held, linear, smooth"):
        Assumptions("cubic")
    with pytest.raises(InputInvalid, match=r"--residuals red.*robust, ar1, white"):
        Assumptions(residuals="red")
    with pytest.raises(InputInvalid, match=r"--unknown mass.*current, bias or single ones: delay"):
        Assumptions(unknown=("mass",))
    with pytest.raises(InputInvalid, match=r"--delay 4.*-0.3 to 1 s"):
        Assumptions(delay=4.0)
    with pytest.raises(InputInvalid, match=r"--unknown bias_p: p is not measured"):
        Assumptions(unknown=("bias_p",)).unknowns(["u", "v"])
    some = Assumptions(unknown=("bias",)).unknowns(["u", "N", "D"])
    assert [f.name for f in some] == ["bias_u"]


def test_the_command_reports_what_it_assumes_and_warns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    data = flown(delay=0.04)
    names = ["time", *(f"{n}[{i}]" for n in ("eta", "nu", "tau") for i in range(1, 7))]
    table = np.column_stack([data.time, data["eta"], data["nu"], data["tau"]])
    np.savetxt("dive.csv", table, delimiter=",", header=",".join(names), comments="")
    words = ["identify", "dive.csv", "--system", "model:bluerov2", "-p", ",".join(TRUE)]
    words += ["--no-proposals", "--inputs", "smooth"]
    assert not status_of(words)
    said = capsys.readouterr().out
    assert "assumed: commands and forces are smooth between samples (--inputs smooth), and" in said
    assert "warning: the residuals of" in said
    assert not status_of([*words, "--unknown", "delay,bias_r", "--residuals", "ar1"])
    said = capsys.readouterr().out
    assert "their delay is fitted" in said
    assert "assumed: biases of r are fitted" in said
    assert "\nbias_r " in said
    assert "warning" not in said
    assert not status_of([*words, "--delay", "40 ms"])
    assert "they act 40 ms later" in capsys.readouterr().out
    assert status_of([*words, "--unknown", "mass"]) == 2
    assert "--unknown mass" in capsys.readouterr().err
