"""The source `axes:RUN`: a pilot whose axes are those of a recording, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.http import manual_axes
from uuvsim_cosim.bridge.http.manual_axes import ManualAxes
from uuvsim_cosim.bridge.http.recorded_axes import RecordedAxesSource, with_recorded_axes
from uuvsim_cosim.errors import InputInvalid, RecordingError, SystemInvalid
from uuvsim_cosim.orchestrator.running.library import load


def recorded(folder: Path, path: str = "helm", every: int = 1) -> Path:
    """Record a run of 0.5 s in which a page asks for surge."""
    system = uuv.System("alone", "0.1").add(path, "keyboard:")
    axes = manual_axes._known[path] = ManualAxes(path, clock=lambda: 0.0)
    axes.update("page", {"surge": 0.5, "yaw": -0.25})
    uuv.run(system, until=0.5, out=folder, backend="native", record_every=every)
    del manual_axes._known[path]
    return folder


def test_the_axes_are_those_of_the_recording_and_then_zero(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run")
    swaps = {"helm": f"axes:{run}"}
    system = uuv.System("alone", "0.1").add("helm", "keyboard:")
    with_recorded_axes(lambda: system, swaps)
    again = uuv.run(
        system.replace("helm", swaps["helm"]), until=1.0, out=tmp_path / "again", backend="native"
    )
    before = uuv.read_signals(run)
    after = uuv.read_signals(again.folder)
    for name in before:
        assert before[name].tobytes() == after[name][: len(before.time)].tobytes()
    assert after["helm.axes"][1].tolist() == [0.5, 0.0, 0.0, -0.25]
    assert after["helm.axes"][-1].tolist() == [0.0] * 4


def test_a_recording_without_these_axes_is_refused(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run")
    with pytest.raises(RecordingError, match=r"has no signal other\.axes"):
        RecordedAxesSource(run).instantiate("other")
    sparse = recorded(tmp_path / "sparse", every=2)
    with pytest.raises(RecordingError, match="does not contain every step"):
        RecordedAxesSource(sparse).instantiate("helm")
    system = uuv.System("alone", "0.1").add("helm", "keyboard:")
    swaps = {"helm": f"axes:{tmp_path / 'none'}"}
    with_recorded_axes(lambda: system, swaps)
    with pytest.raises(SystemInvalid, match="no such recording"):
        system.replace("helm", swaps["helm"])


def test_a_component_whose_inputs_are_piloted_has_no_recorded_axes(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="are not recorded as axes"):
        with_recorded_axes(lambda: load("pool_tracking"), {"quarry.pilot": f"axes:{tmp_path}"})
