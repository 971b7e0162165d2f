"""Values that clients set are noted beside the recording, with which the run repeats."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.scenarios.scenario import Change, read_scenario
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME, OTHER = Client("me", "local"), Client("other", "local")


def system() -> System:
    return System("sums", "0.1").add("sum", f"{PARTS}:Sum")


def noted(folder: Path) -> list[tuple[float, str, object]]:
    events = read_scenario(folder / "changes.yaml").events
    return [(e.at, e.variable, e.value) for e in events if isinstance(e, Change)]


def test_a_run_repeats_to_the_bit_by_the_changes_of_its_clients(tmp_path: Path) -> None:
    with Conductor(system(), record=tmp_path / "run") as service:
        service.set(ME, {"sum.a": 0.3})
        service.step(ME, 3)
        service.step(ME, 4, {"sum.b": 1e-7})
        service.set(ME, {"sum.a": -2})
        service.run(ME, until=2.0)
    served = uuv.read_signals(tmp_path / "run")
    repeated = run(system(), until=2.0, out=tmp_path / "again", backend="native",
                   scenario=tmp_path / "run" / "changes.yaml").signals()  # fmt: skip
    assert served["sum.s"][-1] != 0.0
    for name in served:
        np.testing.assert_array_equal(served[name], repeated[name])


def test_a_value_that_is_set_again_is_noted_once_and_each_recording_has_its_own_changes(
    tmp_path: Path,
) -> None:
    with Conductor(system(), record=tmp_path / "run") as service:
        for value in (0.5, 0.5, 0.25):
            service.step(ME, 1, {"sum.a": value})
        service.reset(ME)
        service.step(ME, 1, {"sum.a": 0.25})
    assert noted(tmp_path / "run") == [(0.0, "sum.a", 0.5), (0.2, "sum.a", 0.25)]
    assert noted(tmp_path / "run-2") == [(0.0, "sum.a", 0.25)]


def test_a_change_is_in_the_file_when_the_call_returns_so_that_no_kill_loses_it(
    tmp_path: Path,
) -> None:
    with Conductor(system(), record=tmp_path / "run") as service:
        for k, value in enumerate((0.5, 0.25)):
            service.set(ME, {"sum.a": value})
            assert noted(tmp_path / "run")[k:] == [(0.1 * k, "sum.a", value)]
            service.step(ME, 1)


def test_changes_of_clients_in_lockstep_are_noted_at_their_step(tmp_path: Path) -> None:
    with Conductor(system(), record=tmp_path / "run") as service:
        a, b = (service.join(c, lockstep=True, lag=60.0) for c in (ME, OTHER))
        service.ask("step", a, 2, {"sum.a": 1.0}, ())
        service.step(b, 2)
        service.ask("step", a, 1, None, ())
        service.step(b, 1, {"sum.b": 4.0})
    assert noted(tmp_path / "run") == [(0.0, "sum.a", 1.0), (0.2, "sum.b", 4.0)]


def test_a_run_without_changes_or_without_a_recording_has_no_such_file(tmp_path: Path) -> None:
    with Conductor(system(), record=tmp_path / "run") as service:
        service.step(ME, 1)
    with Conductor(system()) as service:
        service.step(ME, 1, {"sum.a": 1.0})
    assert not list(tmp_path.rglob("changes.yaml"))


def test_a_file_that_cannot_be_written_is_reported_once_and_the_run_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with Conductor(system(), record=tmp_path / "run") as service:
        (tmp_path / "run" / "changes.yaml").mkdir()
        with caplog.at_level(logging.WARNING, "uuvsim_cosim.changes"):
            for value in (1.0, 2.0):
                service.step(ME, 1, {"sum.a": value})
    assert [r.getMessage().rpartition("; ")[2] for r in caplog.records] == [
        "further changes are not noted"
    ]
    assert len(uuv.read_signals(tmp_path / "run").time) == 3
