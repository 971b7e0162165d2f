"""Recordings: complete, readable after any end, and exported as they were."""

import os
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, InputInvalid, RecordingError
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import rows_of
from uuvsim_cosim.orchestrator.recording.export import export
from uuvsim_cosim.orchestrator.recording.recorder import Recorder
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

Run = Callable[..., Path]


@pytest.fixture
def run(wired: Any, fmi3: Any, python: Any, tmp_path: Path) -> Run:
    def record(steps: int = 50, **options: Any) -> Path:
        start = {"a": {"u": 1.25, "string_in": np.array(["hot", "cold"], object), "int8_in": -3}}
        w = wired({"a": fmi3, "rov.b": python}, ["a.y -> rov.b.u", "a.w -> rov.b.v"], start=start)
        recorder = Recorder(tmp_path / "run", provenance={"system": "two", "seed": 7}, **options)
        with Master(*w, observers=[recorder]) as master:
            master.initialize()
            master.step(steps)
        return tmp_path / "run"

    return record


def test_a_recording_holds_every_output_with_its_unit(run: Run) -> None:
    signals = read_signals(run())
    assert signals.time.tolist() == [k / 100 for k in range(51)]
    assert signals.ticks.tolist() == list(range(51))
    assert signals["a.y"].shape == (51,)
    assert signals["rov.b.w"].shape == (51, 3)
    assert signals.units["a.y"] == "cm"
    assert signals["a.int8_out"].dtype == np.int64
    assert signals["a.int8_out"].tolist() == [0] + [-3] * 50
    assert signals["a.boolean_out"].dtype == bool
    assert signals["a.uint64_out"].dtype == np.uint64
    assert signals["a.string_out"][:2].tolist() == [["", ""], ["hot", "cold"]]
    y = 0.0
    for value in signals["a.y"]:
        assert value == y
        y += 0.01 * (1.25 - y) / 0.5


def test_a_recording_says_where_it_came_from(run: Run) -> None:
    metadata = read_signals(run()).metadata
    assert metadata["system"] == "two"
    assert metadata["seed"] == 7
    assert metadata["schema_version"] == 1
    assert metadata["generator"].startswith("uuvsim-cosim ")
    assert len(metadata["plan"]) == 32
    assert metadata["started"].endswith("+00:00")


def test_only_the_parquet_file_remains(run: Run) -> None:
    assert [p.name for p in run().iterdir()] == ["signals.parquet"]


def test_many_small_batches_become_even_row_groups(run: Run) -> None:
    import pyarrow.parquet as pq

    folder = run(steps=40_000, flush_seconds=0.0)
    with pq.ParquetFile(folder / "signals.parquet") as file:
        rows = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
    assert sum(rows) == 40_001
    assert max(rows) == 16384
    assert len(rows) <= 5


@pytest.mark.parametrize("flush_seconds", [0.0, 1e9])
def test_rows_are_whole_however_they_are_emitted_and_flushed(
    flush_seconds: float, wired: Any, fmi3: Any, tmp_path: Path
) -> None:
    w = wired({"a": fmi3}, start={"a": {"u": 1.0}})
    recorder = Recorder(tmp_path / "run", flush_seconds=flush_seconds)
    with Master(*w, observers=[recorder]) as master:
        master.initialize()
        for _ in range(30):
            master.step()
        room = rows_of(master.recorded)
        master.set("a", "string_in", np.array(["hot", "cold"], object))
        master.step(2 * room + 7)
        for _ in range(30):
            master.step()
    signals = read_signals(tmp_path / "run")
    assert signals.ticks.tolist() == list(range(2 * room + 68))
    assert signals["a.string_out"][30].tolist() == ["", ""]
    assert set(signals["a.string_out"][31:, 1]) == {"cold"}
    expected = np.zeros(len(signals.ticks))
    for k in range(1, len(expected)):
        expected[k] = expected[k - 1] + 0.01 * (1.0 - expected[k - 1]) / 0.5
    assert (signals["a.y"] == expected).all()


@pytest.mark.parametrize("fault", [1, 2])
def test_a_chain_that_fails_and_goes_on_is_recorded_once(
    fault: int, wired: Any, fmi3: Any, tmp_path: Path
) -> None:
    def ready(folder: str) -> Master:
        chain = ["a.y -> b.u", "b.y -> c.u"]
        w = wired(dict.fromkeys("abc", fmi3), chain, start={"a": {"u": 1.0}})
        return Master(*w, observers=[Recorder(tmp_path / folder)])

    with ready("plain") as master:
        master.initialize()
        master.step(100)
    with ready("failed") as master:
        master.initialize()
        master.step(30)
        kept = master.snapshot()
        master.set("b", "fault", fault)
        master.set("b", "fault_time", 0.5)
        with pytest.raises(ComponentFailed):
            master.step(100)
        master.restart("b", kept)
        master.step(70)
    plain, failed = (read_signals(tmp_path / f) for f in ("plain", "failed"))
    assert failed.ticks.tolist() == plain.ticks.tolist()
    assert all((failed[f"{p}.y"] == plain[f"{p}.y"]).all() for p in "abc")


def test_messages_of_fmus_are_in_the_recording(wired: Any, fmi3: Any, tmp_path: Path) -> None:
    from uuvsim_cosim.errors import ComponentFailed

    w = wired({"a": fmi3}, start={"a": {"fault": 2, "fault_time": 0.05}})
    with Master(*w, observers=[Recorder(tmp_path)]) as master:
        master.initialize()
        with pytest.raises(ComponentFailed):
            master.step(100)
        master.free()
    signals = read_signals(tmp_path)
    assert len(signals.time) == 6
    assert [m[0] for m in signals.metadata["messages"]] == ["a"]
    assert "too hot" in signals.metadata["messages"][0][2]


KILLED = """
import os, sys
from uuvsim_cosim.orchestrator.master.core_tables import tables_of
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.recording.recorder import Recorder
from fractions import Fraction

class Ramp:
    inputs = {}
    outputs = {"y": "m"}
    def step(self, t, dt, u):
        if t > 5.0:
            os.kill(os.getpid(), 9)
        return {"y": t + dt}

described = PythonComponent(Ramp, "a").description
plan = Plan(Fraction(1, 100), (PlannedComponent("a", "a", described),), (),
            (Group("jacobi", (0,)),), ((0,),))
with Master(plan, lambda p: PythonComponent(Ramp, p.path),
            observers=[Recorder(sys.argv[1], flush_seconds=0.0)]) as master:
    master.initialize()
    while True:
        master.step(10)
"""


def test_a_killed_run_can_be_read_up_to_its_last_flush(tmp_path: Path) -> None:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)], env=env, check=False, capture_output=True
    )
    assert done.returncode == -9, done.stderr.decode()
    assert [p.name for p in tmp_path.iterdir()] == ["signals.arrows"]
    signals = read_signals(tmp_path)
    assert signals.ticks.tolist() == list(range(501))
    assert signals["a.y"][-1] == pytest.approx(5.0)
    whole = (tmp_path / "signals.arrows").read_bytes()
    (tmp_path / "cut.arrows").write_bytes(whole[: len(whole) // 2])
    cut = read_signals(tmp_path / "cut.arrows")
    assert 0 < len(cut.time) < 501
    assert np.array_equal(cut["a.y"], signals["a.y"][: len(cut.time)])


def test_a_folder_that_cannot_be_written_is_refused_before_the_first_step(
    wired: Any, fmi3: Any, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    with (
        Master(*wired({"a": fmi3}), observers=[Recorder(tmp_path / "file" / "run")]) as master,
        pytest.raises(RecordingError, match=r"signals.arrows: Not a directory; expected a folder"),
    ):
        master.initialize()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux' /dev/full")
def test_a_full_disk_stops_the_run_with_a_sentence(wired: Any, fmi3: Any, tmp_path: Path) -> None:
    (tmp_path / "signals.arrows").symlink_to("/dev/full")
    w = wired({"a": fmi3})
    with (
        Master(*w, observers=[Recorder(tmp_path, flush_seconds=0.0)]) as master,
        pytest.raises(RecordingError, match=r"No space left on device; expected"),
    ):
        master.initialize()


def test_a_disk_that_fills_up_leaves_what_was_written(
    wired: Any, fmi3: Any, tmp_path: Path
) -> None:
    recorder = Recorder(tmp_path, flush_seconds=0.0)
    with Master(*wired({"a": fmi3}), observers=[recorder]) as master:
        master.initialize()
        master.step(10)
        stream = recorder._file

        class Full:
            def write_batch(self, *a: Any, **k: Any) -> None:
                raise OSError(28, "No space left on device")

        recorder._writer = Full()
        with pytest.raises(RecordingError, match=r"No space left on device"):
            master.step(10)
        assert stream.closed
        master.free()
    assert read_signals(tmp_path).ticks.tolist() == list(range(11))


def test_an_unknown_signal_names_its_neighbours(run: Run) -> None:
    signals = read_signals(run())
    assert "a.z" not in signals
    with pytest.raises(InputInvalid, match=r"no signal 'rov.b.x'.*rov\.b\.[yw]"):
        signals["rov.b.x"]


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no recording here"):
        read_signals(tmp_path)
    for name in ("signals.arrows", "signals.parquet"):
        (tmp_path / name).write_bytes(b"noise, not a recording")
        with pytest.raises(RecordingError, match="is no recording, or damaged"):
            read_signals(tmp_path / name)


def test_csv_has_names_then_units_then_exact_numbers(run: Run, tmp_path: Path) -> None:
    folder = run()
    signals = read_signals(folder)
    lines = export(folder, tmp_path / "run.csv").read_text().splitlines()
    names, units = lines[0].split(","), lines[1].split(",")
    assert names[0] == "time"
    assert units[names.index("rov.b.y")] == "cm"
    column = [float(line.split(",")[names.index("rov.b.y")]) for line in lines[2:]]
    assert column == signals["rov.b.y"].tolist()
    assert "rov.b.w[3]" in names
    assert not list(tmp_path.glob("*.part"))


def test_mat_has_nested_structs(run: Run, tmp_path: Path) -> None:
    from scipy.io import loadmat

    folder = run()
    signals = read_signals(folder)
    mat = loadmat(export(folder, tmp_path / "run.mat"), simplify_cells=True)
    assert np.array_equal(mat["signals"]["rov"]["b"]["y"], signals["rov.b.y"])
    assert mat["signals"]["rov"]["b"]["w"].shape == (51, 3)
    assert mat["units"]["a"]["y"] == "cm"
    assert np.array_equal(mat["time"], signals.time)
    exact = loadmat(tmp_path / "run.mat")["signals"][0, 0]["rov"][0, 0]["b"][0, 0]
    assert (exact["y"].shape, exact["w"].shape) == ((51, 1), (51, 3))  # rows are times


def test_mcap_has_a_channel_for_each_component(run: Run, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    folder = run()
    signals = read_signals(folder)
    with export(folder, tmp_path / "run.mcap").open("rb") as file:
        seen = list(make_reader(file).iter_messages(topics=["/rov/b"]))
    assert len(seen) == 51
    schema, _, message = seen[7]
    assert schema is not None
    assert "float64 y  # [cm]" in schema.data.decode().splitlines()
    assert message.log_time == 70_000_000
    row = [line.split()[1] for line in schema.data.decode().splitlines()].index("y")
    assert struct.unpack_from("<d", message.data, 4 + 8 * row) == (signals["rov.b.y"][7],)


def test_an_unknown_format_is_refused(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"expected .csv, .mat, .mcap"):
        export(run(), tmp_path / "run.xls")
    with pytest.raises(RecordingError, match="cannot be written"):
        export(run(), tmp_path / "no" / "folder.csv")


def test_texts_and_binaries_of_an_fmu_are_recorded(first_order_fmi3: Path, tmp_path: Path) -> None:
    from uuvsim_cosim.orchestrator.running.run import run
    from uuvsim_cosim.orchestrator.system.system import System

    system = System("one").add("f", str(first_order_fmi3))
    outputs = system.describe("f").of("output")
    assert {"String", "Binary"} <= {v.type for v in outputs}
    signals = run(system, until=0.05, out=tmp_path / "r").signals()
    for v in outputs:
        assert f"f.{v.name}" in signals
    blob = next(v.name for v in outputs if v.type == "Binary")
    assert isinstance(signals[f"f.{blob}"][-1], bytes)


def test_a_full_disk_ends_a_run_with_one_sentence(
    wired: Any, native: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path / "r", flush_seconds=0.0)
    with Master(*wired({"a": native}), observers=[recorder]) as master:
        master.initialize()

        def full() -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(recorder._file, "flush", full, raising=False)
        with pytest.raises(RecordingError, match="No space left on device"):
            master.step(40_000)
