"""The systems that ship: files equal builders, and what their loops may and may not read."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.loop_delays import loop_delays
from uuvsim_cosim.orchestrator.running.library import available
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.shipped.shipped import BUILDERS
from uuvsim_cosim.orchestrator.ssp.ssd import format_ssd

ON_BOARD = {"navigation", "guidance", "controller", "allocation"}
SENSORS = {"imu", "dvl", "pressure", "compass", "usbl"}


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_a_shipped_file_is_its_builder_written_out(name: str) -> None:
    assert uuv.load(name) == BUILDERS[name]()
    there = Path("orchestrator", "systems", name, f"{name}.ssd")
    from uuvsim_cosim.content import content

    assert content(*there.parts).read_bytes() == format_ssd(BUILDERS[name]())


def test_every_builder_ships() -> None:
    assert set(available()) == set(BUILDERS)


def test_nothing_on_board_of_the_survey_reads_the_truth() -> None:
    system = uuv.load("bluerov2_survey")
    sources = {
        wire.source.element for wire in system.checked.wires if wire.target.element in ON_BOARD
    }
    assert sources <= ON_BOARD | SENSORS


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_no_control_loop_is_slower_than_50_ms(name: str) -> None:
    assert max(loop.delay for loop in loop_delays(flatten(uuv.load(name)))) <= 0.05


@pytest.fixture(scope="module")
def fmu_run(tmp_path_factory: pytest.TempPathFactory) -> uuv.Signals:
    out = tmp_path_factory.mktemp("fmu") / "run"
    return run(uuv.load("bluerov2_survey"), until=20, seed=3, out=out).signals()


@pytest.mark.parametrize(("backend", "seed", "same"), [("native", 3, True), ("native", 4, False)])
def test_the_survey_has_the_same_bits_as_fmus_and_natively_and_others_for_another_seed(
    fmu_run: uuv.Signals, tmp_path: Path, backend: str, seed: int, same: bool
) -> None:
    other = run(
        uuv.load("bluerov2_survey"),
        until=20,
        seed=seed,
        backend=backend,  # type: ignore[arg-type]
        out=tmp_path / "run",
    ).signals()
    assert set(fmu_run) == set(other)
    equal = all(np.array_equal(fmu_run[n], other[n], equal_nan=True) for n in fmu_run)
    assert equal is same


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_the_survey_stays_on_its_lines_and_knows_where_it_is(tmp_path: Path, seed: int) -> None:
    signals = run(uuv.load("bluerov2_survey"), seed=seed, out=tmp_path / "run").signals()
    settled = signals.time > 30.0
    eta, estimate = signals["hull.eta"][settled], signals["navigation.eta"][settled]
    wanted = signals["guidance.eta_d"][settled]
    assert np.sqrt(np.mean(np.sum((eta - wanted)[:, :2] ** 2, axis=1))) < 0.5
    error = (estimate - eta)[:, :3]
    sigma = signals["navigation.sigma"][settled, :3]
    assert np.sqrt(np.mean(error**2)) < 0.2
    assert np.mean(np.abs(error) < 3 * sigma) > 0.97
    assert bool(signals["guidance.done"][-1])
    assert np.linalg.norm(eta[-1, :3] - wanted[-1, :3]) < 0.5


def test_a_slower_controller_makes_the_loop_slower() -> None:
    slower = uuv.load("bluerov2_survey").replace("controller", "model:controller", rate="0.04")
    assert float(max(loop.delay for loop in loop_delays(flatten(slower)))) == pytest.approx(0.09)


def test_a_file_that_a_user_names_is_looked_for_where_the_user_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gains.py").write_text("KP = 3.0\n")
    (tmp_path / "law.py").write_text(
        "from gains import KP\n\n"
        'ETA = (6, ("m", "m", "m", "rad", "rad", "rad"))\n'
        'NU = (6, ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s"))\n\n\n'
        "class Law:\n"
        '    inputs = {"eta_d": ETA, "nu_d": NU, "eta": ETA, "nu": NU}\n'
        '    outputs = {"tau_d": (6, ("N", "N", "N", "N.m", "N.m", "N.m"))}\n\n'
        "    def step(self, t, dt, u):\n"
        '        return {"tau_d": [KP, 0, 0, 0, 0, 0]}\n'
    )
    monkeypatch.chdir(tmp_path)
    system = uuv.load("bluerov2_hold").replace("controller", "law.py:Law")
    signals = run(system, until=1, out=tmp_path / "out").signals()
    assert signals["controller.tau_d"][-1, 0] == 3.0
    assert signals.units["hull.eta"] == "m, rad"


def test_the_way_of_the_survey_that_maps_keeps_its_altitude_above_the_terrain() -> None:
    """Its depths are those of the chart's terrain; a vehicle on it never comes near the seabed."""
    from uuvsim_cosim.orchestrator.shipped.shipped import ALTITUDE, WAYPOINTS
    from uuvsim_cosim.scene.shared.ray_casting import Caster

    way, caster = np.array(WAYPOINTS), Caster("tacoma")
    above = caster.height(way[:, 0], way[:, 1]) - way[:, 2]
    np.testing.assert_allclose(above, ALTITUDE, atol=0.02)
    for a, b in pairwise(way):
        leg = a + np.linspace(0, 1, 50)[:, None] * (b - a)
        assert np.ptp(caster.height(leg[:, 0], leg[:, 1]) - leg[:, 2]) < 0.5


def test_nothing_on_board_of_the_survey_that_maps_reads_the_truth() -> None:
    system = uuv.load("seabed_mapping")
    sources = {w.source.element for w in system.checked.wires if w.target.element in ON_BOARD}
    assert sources <= ON_BOARD | SENSORS
