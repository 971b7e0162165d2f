"""Identification: known parameters come back from noisy data, and what data cannot tell is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.envs.randomisation.distributions import Normal
from uuvsim_cosim.envs.randomisation.published import published
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.checks.checks import checks_of
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import parameter_set, vehicle_sets
from uuvsim_cosim.models.guidance.sampled_signal import Signal
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.exclusions import Excluded
from uuvsim_cosim.studies.identification.experiment import ambiguities
from uuvsim_cosim.studies.identification.fit import fit
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.identify import Identified, Number, identify, unanswered
from uuvsim_cosim.studies.identification.parameters import wanted_parameters
from uuvsim_cosim.studies.identification.save import address_of, save_as
from uuvsim_cosim.studies.identification.signals import Lookup, _measured, grid_of

Array = NDArray[np.float64]
TRUE = {"D_q_11": 21.0, "M_A_11": 7.0, "D_q_33": 30.0}
NOISE = np.array([0.02] * 3 + [0.005] * 3 + [0.01] * 3 + [0.01] * 3)


def forces(t: Array) -> Array:
    """Surge and heave in steps: nothing turns the vehicle about z."""
    zero = np.zeros_like(t)
    surge, heave = 14.0 * np.sign(np.sin(0.9 * t)), 8.0 * np.sign(np.sin(0.5 * t + 1))
    return np.stack([surge, zero, heave, zero, zero, zero], axis=1)


def recorded(seed: int = 1, until: float = 16.0) -> Signals:
    """A BlueROV2 with other numbers than its set, flown by forces, measured with noise."""
    t = np.arange(0.0, until, 0.1)
    t = np.round(t, 9)
    held = [Signal(t, c, True) for c in forces(t).T]
    made = simulate(
        declare("bluerov2", surface=False),
        at=[float(s) for s in t],
        h=0.05,
        tau=lambda s: [f(s) for f in held],
        parameters={**TRUE, "eta_0": [0.0, 0, 20, 0, 0, 0]},
    )
    noise = np.random.default_rng(seed).normal(size=(len(t), 12)) * NOISE
    values = {
        "eta": made["eta"] + noise[:, :6],
        "nu": made["nu"] + noise[:, 6:],
        "tau": forces(t),
    }
    return Signals(t, np.arange(len(t)), values, {}, metadata={"file": "dive.csv"})


@pytest.fixture(scope="module")
def found() -> Identified:
    return identify(recorded(), "model:bluerov2", [*TRUE, "D_q_66"])


def test_known_parameters_come_back_within_their_intervals(found: Identified) -> None:
    assert found.converged
    for name, value in TRUE.items():
        number = found[name]
        assert number.start != value
        assert abs(number.value - value) < 1.5 * number.half_width, name
        assert number.half_width < 0.15 * value, name


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Of 21 intervals of seven recordings 17 or more hold: by the binomial law in 99.7 of 100."""
    z = []
    for seed in range(7):
        got = identify(recorded(20 + seed, 4.0), "model:bluerov2", list(TRUE), proposals=False)
        z += [1.96 * (got[n].value - v) / got[n].half_width for n, v in TRUE.items()]
    assert np.sum(np.abs(z) < 1.96) >= 17
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.35  # nor are they wider than need be


def test_the_fit_is_a_minimum_of_the_simulated_trajectory(found: Identified) -> None:
    """A simulation of all 16 s from one state, by CasADi, has its least residuals there."""
    data = recorded()
    plan = flatten(System("s").add("hull", "model:bluerov2"))
    box = GreyBox(plan, 0, wanted_parameters(plan, 0, [*TRUE, "D_q_66"]), exact=False)
    grid = grid_of(box, Lookup(data, {}), h=None, first=0.0, last=None)
    best = fit(box, grid)
    flown = box.step(grid.h, sloped=True).mapaccum("flown", grid.w.shape[1])

    def cost(theta: Array) -> float:
        columns = np.repeat(theta[:, None], grid.w.shape[1], 1)
        x = np.hstack([best.x_0[:, None], np.array(flown(best.x_0, grid.w, columns))])
        n_w = len(grid.w) // 2
        w = np.hstack([grid.w[:n_w], grid.w[:n_w, -1:]])
        y = np.array(box.h.map(x.shape[1])(x, w, np.repeat(theta[:, None], x.shape[1], 1)))
        return 0.5 * float(np.nansum(((y - grid.y) / best.sigma[:, None]) ** 2))

    error = np.sqrt(np.diag(best.covariance))
    least = cost(best.theta)
    for j in range(3):  # three are determined; D_q_66 is not
        for sign in (-1.0, 1.0):
            step = sign * 0.3 * error[j] * np.eye(4)[j]
            assert cost(best.theta + step) > least


def test_ctrl_c_keeps_the_best_values_so_far() -> None:
    def stop(iteration: int, residual: float) -> None:
        if iteration == 3:
            raise KeyboardInterrupt

    got = identify(
        recorded(until=8.0), "model:bluerov2", list(TRUE), proposals=False, progress=stop
    )
    assert (got.converged, got.status, got.iterations) == (False, "interrupted", 3)
    for name, value in TRUE.items():  # three steps lead near the values
        assert got[name].value == pytest.approx(value, rel=0.1)


def test_what_the_recording_determines_is_reported_before_the_fit() -> None:
    texts: list[str] = []

    def stop(iteration: int, residual: float) -> None:
        assert texts
        raise KeyboardInterrupt

    identify(
        recorded(), "model:bluerov2", [*TRUE, "D_q_66"], proposals=False, report=texts.append,
        progress=stop,
    )  # fmt: skip
    assert len(texts) == 2
    for name in TRUE:
        assert f"hull.{name} (±" in texts[0]
    assert texts[1].startswith("before the fit: the recording does not determine hull.D_q_66")


def test_parts_that_are_left_out_do_not_count() -> None:
    """Damage from 6 to 9 s: without the part it has no effect, and with it the fit is wrong."""
    data = recorded()
    damaged = {name: np.array(data[name]) for name in data}
    inside = (data.time >= 6.0) & (data.time <= 9.0)
    damaged["nu"][inside] += 1.0
    damaged["eta"][inside] = 0.0

    def fitted(metadata: dict[str, object]) -> Identified:
        signals = Signals(data.time, data.ticks, damaged, {}, metadata=metadata)
        return identify(signals, "model:bluerov2", list(TRUE), proposals=False)

    got = fitted({"excluded": (Excluded(5.9, 9.1, "a test"),)})
    assert "left out: 5.9 to 9.1 s: a test" in got.notes
    for name, value in TRUE.items():
        assert abs(got[name].value - value) < 1.6 * got[name].half_width, name
    assert max(got.residuals.values()) < 0.03  # each run has an initial state of its own
    wrong = fitted({})
    assert any(abs(wrong[n].value - v) > 0.2 * v or wrong[n].half_width > 0.2 * v
               for n, v in TRUE.items())  # fmt: skip
    with pytest.raises(InputInvalid, match=r"no part from 0 to 15.9 s is fitted: 0.0 to 20.0 s: a"):
        fitted({"excluded": (Excluded(0.0, 20.0, "a test"),)})


def test_residuals_are_as_large_as_the_noise(found: Identified) -> None:
    assert list(found.residuals.values()) == pytest.approx(NOISE, rel=0.15)


def test_a_parameter_that_nothing_excites_is_named(found: Identified) -> None:
    assert any(text.startswith("the data do not determine hull.D_q_66") for text in found.open)
    assert not any("D_q_11" in text for text in found.open)


def test_the_manoeuvre_proposed_excites_what_the_data_left_out(found: Identified) -> None:
    best, k = found.proposals[0], [n.name for n in found.numbers].index("hull.D_q_66")
    assert "yaw" in best.name or "sines" in best.name
    assert best.half_widths[k] < 0.1 * found["D_q_66"].half_width
    assert [p.gain for p in found.proposals] == sorted(
        (p.gain for p in found.proposals), reverse=True
    )
    assert np.all(best.reached < 3.0)


def test_what_no_manoeuvre_tells_is_said(found: Identified) -> None:
    names, wide = ["a", "b"], np.array([9.0, 9.0])
    numbers = [Number(n, 1.0, -8.0, 10.0, 1.0, "1", (), False) for n in names]
    best = replace(found.proposals[0], half_widths=wide)
    assert any("determines a, b" in text for text in unanswered(numbers, [best]))
    assert not unanswered(numbers, [replace(best, half_widths=0.01 * wide)])


def test_two_that_act_alike_are_told_to_be_inseparable() -> None:
    scaled = np.array([[100.0, -99.99, 0.0], [-99.99, 100.0, 0.0], [0.0, 0.0, 400.0]])
    said = ambiguities(["a", "b", "c"], scaled)
    assert any(text.startswith("the data cannot separate a and b") for text in said)
    assert not any("c" in text.split(":")[0].split("separate")[-1] for text in said)


def test_thrusters_are_fitted_through_their_wrench_with_the_delays_of_communication(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Recorded by a master: commands pass a shaft, a wrench and two communication steps."""
    source = "model:thruster"
    system = (
        System("two", tick="0.02")
        .add("hull", "model:bluerov2")
        .add("wrench", "model:wrench?vehicle=bluerov2")
    )
    for i in range(1, 7):
        system = system.add(
            f"thruster_{i}", source, {"K_n": 3e-4, "u": 0.5 if i in (3, 4) else 0.3}
        )
        system = system.connect(f"thruster_{i}.thrust", f"wrench.thrust[{i}]")
    system = system.connect("wrench.tau", "hull.tau").set("hull.eta_0", [0, 0, 20, 0, 0, 0])
    signals = run(system, until=2.4, out=tmp_path / "run", backend="native").signals()
    u = np.tile([0.3, 0.3, 0.5, 0.5, 0.3, 0.3], (len(signals.time), 1))
    values = {n: signals[n] for n in ("hull.eta", "hull.nu")}
    values |= {f"thruster_{i + 1}.u": u[:, i] for i in range(6)}
    data = Signals(signals.time, signals.ticks, values, {}, metadata={"tick": 0.02})
    fresh = system
    for i in range(1, 7):
        fresh = fresh.set(f"thruster_{i}.K_n", 4e-4)
    got = identify(data, fresh, ["thruster_*.K_n"], proposals=False)
    assert got["thruster_*.K_n"].value == pytest.approx(3e-4, rel=5e-3)
    assert len(got["thruster_*.K_n"].places) == 6
    monkeypatch.chdir(tmp_path)
    (saved,) = save_as(got, "my_rov@a_fit")
    assert saved.source == "model:thruster?vehicle=my_rov@a_fit"
    K_n = declare("thruster", vehicle="my_rov@a_fit").variables["K_n"]
    assert K_n.start == pytest.approx(got["thruster_*.K_n"].value)
    assert "95 % interval" in saved.file.read_text()
    assert vehicle_sets("my_rov") == vehicle_sets("bluerov2")  # nothing was fitted of the hull


def test_a_log_of_many_commands_gives_each_thruster_its_own() -> None:
    system = (
        System("two").add("hull", "model:bluerov2").add("wrench", "model:wrench?vehicle=bluerov2")
    )
    for i in range(1, 7):
        system = system.add(f"t_{i}", "model:thruster")
        system = system.connect(f"t_{i}.thrust", f"wrench.thrust[{i}]")
    plan = flatten(system.connect("wrench.tau", "hull.tau"))
    t = np.arange(0.0, 3.0, 0.1)
    u = np.tile(np.arange(6) / 10, (len(t), 1))
    data = Signals(t, np.arange(len(t)), {"nu": np.zeros((len(t), 6)), "u": u}, {})
    box = GreyBox(plan, 0, wanted_parameters(plan, 0, ["t_3.K_n", "t_5.K_n"]), exact=False)

    def fed(mapped: dict[str, str]) -> dict[str, float]:
        grid = grid_of(box, Lookup(data, mapped), h=None, first=0.0, last=None)
        labels = [box.label(f) for f in box.feeds]
        return {n: float(w[0]) for n, w in zip(labels, grid.w, strict=False)}

    assert [fed({})[n] for n in ("t_3.u", "t_5.u")] == pytest.approx([0.2, 0.4])
    assert fed({"t_3.u": "u[6]"})["t_3.u"] == pytest.approx(0.5)
    with pytest.raises(InputInvalid, match=r"u\[7\]: expected u\[1\] to u\[6\]"):
        fed({"t_3.u": "u[7]"})
    with pytest.raises(
        InputInvalid, match=r"u has 6 elements, and t_3.u has 1; expected a signal of size 1"
    ):
        fed({"t_3.u": "u"})


def test_what_lacks_or_is_not_there_is_named_with_near_names() -> None:
    data = recorded(until=6.0)
    few = Signals(data.time, data.ticks, {"eta": data["eta"], "hull.taw": data["tau"]}, {})
    with pytest.raises(InputInvalid, match=r"lacks hull.tau \(recorded: .*taw"):
        identify(few, "model:bluerov2", ["m"])
    blind = Signals(data.time, data.ticks, {"tau": data["tau"]}, {})
    with pytest.raises(InputInvalid, match=r"lacks hull.eta or hull.nu"):
        identify(blind, "model:bluerov2", ["m"])
    with pytest.raises(InputInvalid, match=r"no parameter 'D_q_12'; expected .*D_q_11"):
        identify(data, "model:bluerov2", ["D_q_12", "m"])
    with pytest.raises(InputInvalid, match=r"named twice"):
        identify(data, "model:bluerov2", ["m", "hull.m"])
    with pytest.raises(InputInvalid, match=r"--map: there is no signal 'x'"):
        identify(data, "model:bluerov2", ["m"], mapped={"hull.tau": "x"})
    with pytest.raises(InputInvalid, match=r"has no hull"):
        identify(data, System("s").add("t", "model:thruster"), ["t.K_n"])
    with pytest.raises(InputInvalid, match=r"expected 20 to"):
        identify(data, "model:bluerov2", ["m"], first=5.0)
    empty = Signals(data.time, data.ticks, {**data.values_by_name, "tau": data["tau"] * np.nan}, {})
    with pytest.raises(InputInvalid, match=r"tau\[1\], which drives .* holds no number"):
        identify(empty, "model:bluerov2", ["m"])


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_speeds_that_no_trajectory_follows_are_refused() -> None:
    data = recorded(until=9.0)
    turned = {**data.values_by_name, "nu": data["nu"] * ([100.0] * 3 + [1.0] * 3)}  # cm/s
    with pytest.raises(InputInvalid, match="the fit diverged"):
        identify(Signals(data.time, data.ticks, turned, {}), "model:bluerov2", ["D_q_11", "M_A_11"])


def test_angles_or_rates_in_degrees_are_refused() -> None:
    data = recorded(until=6.0)
    turning = {name: np.array(data[name]) for name in data}
    turning["eta"][:, 5] = 0.1 * np.sin(data.time)
    turning["nu"][:, 5] = 0.1 * np.cos(data.time)

    def fitted(signal: str, column: int) -> None:
        values = {name: value.copy() for name, value in turning.items()}
        values[signal][:, column] *= 180.0 / np.pi
        identify(Signals(data.time, data.ticks, values, {}), "model:bluerov2", ["m"])

    turning["eta"][:, 4] = 0.2 * np.sin(data.time)
    with pytest.raises(InputInvalid, match=r"eta\[5\] \(pitch\) reaches 11.*a line of units"):
        fitted("eta", 4)
    with pytest.raises(InputInvalid, match=r"57.* times the yaw rate, as if eta\[6\] were in deg"):
        fitted("eta", 5)
    with pytest.raises(InputInvalid, match=r"0.017.* the yaw rate, as if nu\[6\] were in degrees"):
        fitted("nu", 5)


def test_a_fit_becomes_a_set_that_runs_and_that_randomisation_draws_from(
    found: Identified, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (saved,) = save_as(found, "my_rov@my_fit")
    assert saved.source == "model:my_rov@my_fit"
    assert vehicle_sets("my_rov") == ["wu_2018", "bluerov2_gz", "my_fit"]
    q = parameter_set("my_rov", "my_fit").quantities
    assert q["D_q_11"].value == pytest.approx(found["D_q_11"].value)
    assert "identified from dive.csv on" in q["D_q_11"].source
    assert "95 % interval" in q["D_q_11"].source
    assert "(set wu_2018)" in q["D_q_66"].source  # the data said nothing of it: as it was
    assert all(c.holds for c in checks_of("my_rov@my_fit"))
    drawn = {v.name: v.distribution for v in published("my_rov@my_fit").parameters}
    errors = drawn["hull.D_q_11"]
    assert isinstance(errors, Normal)
    std = found["D_q_11"].half_width / 1.96
    assert (errors.mean, errors.std) == pytest.approx((found["D_q_11"].value, std), rel=1e-4)
    with pytest.raises(InputInvalid, match="has a set of this name"):
        save_as(found, "my_rov@my_fit")
    with pytest.raises(InputInvalid, match="expected lower case"):
        save_as(found, "my_rov@My Fit")
    assert saved.file.read_text().count("my_fit:") == 1


def test_addresses_of_a_hulls_source_are_understood() -> None:
    assert address_of("model:bluerov2@wu_2018") == ("bluerov2", "wu_2018")
    assert address_of("model:bluerov2?surface=false") == ("bluerov2", None)
    assert address_of("model:vehicle?id=bluerov2&set=wu_2018") == ("bluerov2", "wu_2018")


def test_the_command_prints_intervals_and_writes_the_set_and_the_manoeuvre(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    data = recorded(until=8.0)
    names = ["time", *(f"{n}[{i}]" for n in ("eta", "nu", "tau") for i in range(1, 7))]
    table = np.column_stack([data.time, data["eta"], data["nu"], data["tau"]])
    np.savetxt("dive.csv", table, delimiter=",", header=",".join(names), comments="")
    arguments = ["identify", "dive.csv", "--system", "model:bluerov2", "-p", "D_q_11,M_A_11"]
    assert not status_of([*arguments, "--save-as", "my_rov@fit", "--manoeuvre", "next.csv"])
    said = capsys.readouterr().out
    assert "± (95 %)" in said
    assert "use it as model:my_rov@fit\nfly it with  uuvsim run hold --vehicle my_rov@fit\n" in said
    assert Path("next.csv").read_text().splitlines()[1].startswith("time,tau[1]")
    assert status_of([*arguments, "--map", "hull.tau=taw"]) == 2
    assert "there is no signal 'taw'" in capsys.readouterr().err
    assert status_of(["identify", "none.csv", "--system", "model:bluerov2", "-p", "m"]) == 2


def test_a_signal_without_any_number_measures_nothing() -> None:
    t, grid = np.arange(0.0, 1.0, 0.1), np.arange(0.0, 1.0, 0.2)
    measured = _measured(t, np.full(10, np.nan), grid, 0.2, False)
    assert measured.shape == (5,)
    assert np.isnan(measured).all()
