import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import CFmu
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, RecordingError
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.running.mission import duration, path_of, with_waypoints
from uuvsim_cosim.orchestrator.running.run import Interrupted, run
from uuvsim_cosim.orchestrator.running.run_folder import lock_run_folder
from uuvsim_cosim.orchestrator.system.system import System

PARTS = '''
class Tap:
    """Opens at once."""
    inputs = {}
    outputs = {"flow": "m/s"}
    parameters = {"opening": (2.0, "m/s"), "bursts": (1e9, "s")}
    def step(self, t, dt, u):
        return {"flow": float("nan") if t >= self.bursts else self.opening}

class Tank:
    """Fills."""
    inputs = {"flow": "m/s"}
    outputs = {"level": "m"}
    def __init__(self):
        self.level = 0.0
    def step(self, t, dt, u):
        self.level += dt * u["flow"]
        return {"level": self.level}

class Pilot:
    """Knows a path."""
    inputs = {}
    outputs = {"done": "1"}
    parameters = {"waypoints": ([[0.0, 0, 5]] * 4, "m"), "count": (2.0, "1"), "speed": (0.5, "m/s")}
    def step(self, t, dt, u):
        return {"done": 0.0}
'''


@pytest.fixture
def tank(tmp_path: Path) -> System:
    (tmp_path / "parts.py").write_text(PARTS)
    return (
        System("tank", "0.1", base=tmp_path)
        .add("tap", "parts.py:Tap")
        .add("tank", "parts.py:Tank")
        .connect("tap.flow", "tank.flow")
    )


def test_a_run_leaves_signals_provenance_and_the_system(tank: System, tmp_path: Path) -> None:
    done = run(tank, until=2.0, out=tmp_path / "r", seed=5, about={"changes": {"set": {"a": "b"}}})
    assert sorted(p.name for p in done.folder.iterdir()) == [
        "run.json", "signals.parquet", "system.ssd",
    ]  # fmt: skip
    told = json.loads((done.folder / "run.json").read_text())
    assert (told["system"], told["seed"], told["time"], told["steps"]) == ("tank", 5, 2.0, 20)
    assert told["changes"] == {"set": {"a": "b"}}
    assert done.signals()["tank.level"][-1] == pytest.approx(2 * (2.0 - 0.1))  # one step of delay


def test_the_system_beside_the_recording_runs_again_alike(tank: System, tmp_path: Path) -> None:
    first = run(tank.set("tap.opening", 3.0), until=1.0, out=tmp_path / "a")
    again = run(load(first.folder / "system.ssd"), until=1.0, out=tmp_path / "b")
    np.testing.assert_array_equal(first.signals()["tank.level"], again.signals()["tank.level"])


def test_a_second_run_goes_beside_the_first(tank: System, tmp_path: Path) -> None:
    first = run(tank, until=0.5, out=tmp_path / "r")
    second = run(tank, until=0.5, out=tmp_path / "r")
    assert (first.asked, second.asked) == (None, tmp_path / "r")
    assert second.folder == tmp_path / "r-2"


@pytest.mark.parametrize("until", [0.0, -1.0, float("nan"), float("inf")])
def test_until_must_be_a_positive_time(tank: System, tmp_path: Path, until: float) -> None:
    with pytest.raises(InputInvalid, match="until"):
        run(tank, until=until, out=tmp_path / "r")
    assert not (tmp_path / "r").exists()


def test_a_failed_component_leaves_the_recording_up_to_then(tank: System, tmp_path: Path) -> None:
    with pytest.raises(ComponentFailed, match="tap") as raised:
        run(tank.set("tap.bursts", 1.0), until=5.0, out=tmp_path / "r")
    assert raised.value.recording == tmp_path / "r"
    assert 0.8 <= read_signals(tmp_path / "r").time[-1] <= 1.2
    assert "tap" in json.loads((tmp_path / "r" / "run.json").read_text())["interrupted"]


def test_an_interrupted_run_leaves_a_closed_recording(tank: System, tmp_path: Path) -> None:
    def ctrl_c(stage: str, done: float, total: float) -> None:
        if stage == "simulating" and done >= 1.0:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as raised:
        run(tank, until=1e6, out=tmp_path / "r", progress=ctrl_c)
    assert raised.value.run.recording.is_file()
    assert raised.value.run.time == raised.value.run.signals().time[-1]


def test_a_run_refused_before_its_first_step_leaves_nothing(tank: System, tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(PARTS.replace("self.level = 0.0", "raise OSError('no')"))
    with pytest.raises(InputInvalid, match=r"parts\.py:15: OSError: no: in __init__"):
        run(tank, until=1.0, out=tmp_path / "new" / "r")
    assert not (tmp_path / "new").exists()


def test_record_every_thins_the_recording(tank: System, tmp_path: Path) -> None:
    done = run(tank, until=1.0, out=tmp_path / "r", record_every=5)
    np.testing.assert_allclose(done.signals().time, [0.0, 0.5, 1.0])


def test_progress_ends_at_the_end(tank: System, tmp_path: Path) -> None:
    told: list[tuple[str, float, float]] = []
    run(tank, until=3.0, out=tmp_path / "r", progress=lambda *a: told.append(a))
    assert told[-1] == ("simulating", 3.0, 3.0)


def test_a_folder_is_claimed_only_if_it_is_free(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert lock_run_folder(tmp_path / "empty").path == tmp_path / "empty"
    (tmp_path / "file").write_text("")
    with pytest.raises(InputInvalid, match="is a file"):
        lock_run_folder(tmp_path / "file")
    with pytest.raises(InputInvalid, match="cannot be made"):
        lock_run_folder(tmp_path / "file" / "below")


def test_runs_that_begin_at_once_claim_folders_of_their_own(tmp_path: Path) -> None:
    barrier = threading.Barrier(8)

    def begin(_: int) -> Path:
        barrier.wait()
        return lock_run_folder(tmp_path / "runs" / "two").path

    with ThreadPoolExecutor(8) as threads:
        claimed = list(threads.map(begin, range(8)))
    numbered = ["two", *(f"two-{n}" for n in range(2, 9))]
    assert sorted(p.name for p in claimed) == numbered


def test_a_claim_lasts_until_it_is_discarded(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    first = lock_run_folder(tmp_path / "r")
    assert lock_run_folder(tmp_path / "r").path == tmp_path / "r-2"
    first.discard()
    assert lock_run_folder(tmp_path / "r").path == tmp_path / "r"


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
def test_a_watchdog_that_is_no_time_is_refused(
    seconds: float, tank: System, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = rf"watchdog {seconds:g}: expected more than 0 seconds"
    with pytest.raises(InputInvalid, match=wanted):
        run(tank, until=1.0, out=tmp_path / "r", watchdog=seconds)
    assert status_of(["run", "bluerov2_hold", "--watchdog", str(seconds)]) == 2
    assert f"--{wanted}" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


def test_discarding_removes_only_what_was_made(tmp_path: Path) -> None:
    made = lock_run_folder(tmp_path / "a" / "b")
    (made.path / "system.ssd").write_text("x")
    (tmp_path / "a" / "mine.txt").write_text("mine")
    made.discard()
    assert os.listdir(tmp_path / "a") == ["mine.txt"]


def test_waypoints_fill_the_guidances_table_and_set_how_long_a_run_takes(tank: System) -> None:
    system = tank.add("pilot", "parts.py:Pilot")
    flown = with_waypoints(system, np.array([[0, 0, 5], [30, 0, 5], [30, 40, 5.0]]))
    path = path_of(flatten(flown))
    np.testing.assert_array_equal(path, [[0, 0, 5], [30, 0, 5], [30, 40, 5]])
    seconds = (5 + 30 + 40) / 0.5 + 3 * 12 + 45
    assert duration(flatten(flown)) == 10 * np.ceil(seconds / 10)
    assert duration(flatten(tank)) == 60.0


def test_more_waypoints_than_the_guidance_holds_are_refused(tank: System) -> None:
    system = tank.add("pilot", "parts.py:Pilot")
    with pytest.raises(InputInvalid, match="at most 4"):
        with_waypoints(system, np.zeros((5, 3)))
    with pytest.raises(InputInvalid, match="0 components"):
        with_waypoints(tank, np.zeros((3, 3)))


def test_an_end_between_two_steps_is_refused_with_both_numbers(
    tank: System, tmp_path: Path
) -> None:
    with pytest.raises(InputInvalid, match=r"until: 0\.0153 s .* steps of 0\.1 s, such as 0\.1"):
        run(tank, until=0.0153, out=tmp_path / "r")
    assert not (tmp_path / "r").exists()


def test_a_recording_that_the_disk_cannot_hold_is_refused_before_it_begins(
    tank: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from types import SimpleNamespace

    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=1000))
    with pytest.raises(InputInvalid, match=r"would take about .* GB, .*--record-every"):
        run(tank, until=1e7, out=tmp_path / "r")
    assert not (tmp_path / "r").exists()


def test_a_disk_that_fills_up_is_an_error_that_keeps_what_was_written(
    tank: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("uuvsim_cosim.orchestrator.running.run.write_run_json", full)
    with pytest.raises(RecordingError, match=r"run\.json: No space left.*free space on the disk"):
        run(tank, until=1.0, out=tmp_path / "r")
    assert (tmp_path / "r" / "signals.parquet").is_file()


CRASHES = '''
import os, time, ctypes
class Kills:
    """Ends its process."""
    inputs = {}
    outputs = {"y": "1"}
    def step(self, t, dt, u):
        if t >= 0.5:
            os.kill(os.getpid(), 9)
        return {"y": t}

class Reads(Kills):
    """Reads from nowhere."""
    def step(self, t, dt, u):
        if t >= 0.5:
            ctypes.string_at(0)
        return {"y": t}

class Hangs(Kills):
    """Never comes back."""
    def step(self, t, dt, u):
        while t >= 0.5:
            pass
        return {"y": t}
'''


@pytest.mark.parametrize(
    ("name", "reason"), [("Kills", "signal 9"), ("Reads", "signal 11"), ("Hangs", "within 2.0 s")]
)
def test_the_death_of_an_isolated_component_is_an_error_that_leaves_the_recording(
    name: str, reason: str, tmp_path: Path
) -> None:
    (tmp_path / "bad.py").write_text(CRASHES)
    system = System("bad", "0.1", base=tmp_path).add("part", f"bad.py:{name}")
    with pytest.raises(ComponentFailed, match=rf"'part' failed at t = 0\.5 s.*{reason}"):
        run(system, until=2.0, out=tmp_path / "r", isolate=["part"], watchdog=2.0)
    assert read_signals(tmp_path / "r")["part.y"][-1] == pytest.approx(0.4)


def test_a_run_in_real_time_says_how_punctual_it_was(tank: System, tmp_path: Path) -> None:
    done = run(tank, until=1.0, out=tmp_path / "r", real_time=100.0)
    assert done.punctuality is not None
    assert done.punctuality.steps == 10
    assert json.loads((done.folder / "run.json").read_text())["real_time"]["factor"] == 100.0


def test_a_run_ends_where_its_system_ends(tank: System, tmp_path: Path) -> None:
    ends = replace(tank, stop_time=0.25)
    assert run(ends, out=tmp_path / "a").time == 0.3  # the first step that reaches it
    assert run(ends, out=tmp_path / "b", until=0.1).time == 0.1


def test_a_component_that_asks_to_end_ends_the_run(first_order_fmi3: Path, tmp_path: Path) -> None:
    asks = {"fault": 7, "fault_time": 0.05}
    system = System("s", "0.01").add("a", str(first_order_fmi3), start=asks)
    done = run(system, until=1.0, out=tmp_path / "r")
    assert done.time == 0.06
    assert done.warnings[-1] == "a asks to end the simulation at t = 0.06 s"
    assert not done.interrupted
    assert len(done.signals().time) == 7


@pytest.mark.parametrize("isolate", [(), ("*",)])
@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("version", [2, 3])
def test_the_step_that_asks_to_end_is_recorded_of_all_components(
    version: int, every: int, isolate: tuple[str, ...], c_fmu: CFmu, tmp_path: Path
) -> None:
    fmu = str(c_fmu(version, edits=[('max="6"', 'max="10"')] if version == 2 else []))
    asks = {"fault": 7, "fault_time": 0.5, "u": 1.0, "T": 0.5}
    system = System("s", "0.1").add("before", fmu, start={"u": 1.0, "T": 0.5})
    system = system.add("asks", fmu, start=asks).add("after", fmu, start={"T": 0.5})
    system = system.connect("asks.y", "after.u")
    if every > 1:
        slow = {**asks, "fault_time": 0.6}
        system = system.set("asks.fault_time", 2.0).add("slow", fmu, start=slow, rate="0.3")
    done = run(system, until=2.0, out=tmp_path / "r", isolate=isolate)
    steps = 6 if every == 1 else 9
    assert done.warnings[-1].endswith(f"asks to end the simulation at t = {steps / 10:g} s")
    found = done.signals()
    assert found.time.tolist() == [k / 10 for k in range(steps + 1)]
    y = 1 - 0.8 ** np.arange(steps + 1)
    np.testing.assert_allclose(found["before.y"], y, rtol=1e-12)
    np.testing.assert_allclose(found["asks.y"], y, rtol=1e-12)
    follows = [0.0]
    for k in range(steps):
        follows.append(0.8 * follows[-1] + 0.2 * y[k])
    np.testing.assert_allclose(found["after.y"], follows, rtol=1e-12, atol=1e-15)


def test_a_run_starts_where_its_system_does(tank: System, tmp_path: Path) -> None:
    late = replace(tank, start_time=5.0, stop_time=6.0)
    done = run(late, out=tmp_path / "a")
    assert (done.start, done.time, done.steps) == (5.0, 6.0, 10)
    assert done.signals().time.tolist()[:2] == [5.0, 5.1]
    again = run(load(done.folder / "system.ssd"), out=tmp_path / "b")
    np.testing.assert_array_equal(again.signals().time, done.signals().time)
    earlier = run(late, out=tmp_path / "c", start_time=0.2, until=1.0)
    assert earlier.signals().time[0] == 0.2
    assert json.loads((earlier.folder / "run.json").read_text())["start"] == 0.2


@pytest.mark.parametrize(
    ("start", "until", "message"),
    [
        (5.0, 4.0, "until: 4 s was read, but the run begins at 5 s"),
        (0.05, 4.0, "start_time: 0.05 s is no multiple of the tick of 0.1 s"),
        (-1.0, 4.0, "start_time: -1 s was read; expected 0 or more"),
    ],
)
def test_a_start_that_cannot_be_is_refused(
    tank: System, tmp_path: Path, start: float, until: float, message: str
) -> None:
    with pytest.raises(InputInvalid, match=message):
        run(tank, out=tmp_path / "r", start_time=start, until=until)
    assert not (tmp_path / "r").exists()
