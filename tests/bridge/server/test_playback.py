"""A recording is replayed as live: same values, same calls, nothing can be set."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.server.playback import Playback, is_recording
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.orchestrator.recording.export import export
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of 2 s, with its .mcap inside."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    with Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum"), record=folder) as service:
        service.step(ME, 10, {"sum.a": 0.3})
        service.step(ME, 10, {"sum.a": -0.7, "sum.b": 0.1})
    export(folder, folder / "run.mcap")
    return folder


@pytest.fixture(scope="module")
def signals(run: Path) -> Signals:
    return read_signals(run)


@pytest.fixture(params=["folder", "mcap"])
def service(request: pytest.FixtureRequest, run: Path) -> Iterator[Conductor]:
    with Conductor(run / "run.mcap" if request.param == "mcap" else run) as service:
        yield service


def test_an_mcap_file_reads_back_as_what_was_exported(run: Path, signals: Signals) -> None:
    back = read_signals(run / "run.mcap")
    assert set(back) == set(signals)
    assert all(np.array_equal(back[name], signals[name]) for name in signals)
    assert np.array_equal(back.time, signals.time)
    assert np.array_equal(back.ticks, signals.ticks)
    assert (back.units, back.element_units) == (signals.units, signals.element_units)
    assert back.metadata == signals.metadata


def test_every_type_reads_back_from_mcap(tmp_path: Path) -> None:
    from uuvsim_cosim.orchestrator.recording.mcap import read_mcap, write_mcap

    texts, blobs = np.empty(3, object), np.empty(3, object)
    texts[:], blobs[:] = ["a", "", "ü"], [b"\0\xff", b"", b"x"]
    values = {
        "c.f": np.array([0.1, np.nan, -1e300]),
        "c.i": np.array([-(2**62), 0, 1]),
        "c.u": np.array([2**64 - 1, 0, 1], np.uint64),
        "c.b": np.array([True, False, True]),
        "c.m": np.array([[1.0, 2.0]] * 3),
        "c.text": texts,
        "c.blob": blobs,
    }
    ticks = np.array([2**32 - 1, 2**32, 2**32 + 1])
    units = dict.fromkeys(values, "1")
    about = {"tick": "1/100", "messages": []}
    write_mcap(Signals(ticks / 100, ticks, values, units, {}, about), tmp_path / "r.mcap")
    back = read_mcap(tmp_path / "r.mcap")
    for name, array in values.items():
        assert back[name].dtype == array.dtype
        assert np.array_equal(back[name], array, equal_nan=array.dtype.kind == "f")
    assert np.array_equal(back.ticks - back.ticks[0], [0, 1, 2])


def test_a_replay_gives_what_was_recorded(service: Conductor, signals: Signals) -> None:
    for k in (1, 2, 9, 8):
        moment, values = service.step(ME, k, None, ["sum.s", "sum.both"])
        assert values["sum.s"] == signals["sum.s"][moment.tick]
        assert np.array_equal(values["sum.both"], signals["sum.both"][moment.tick])
        assert moment.time == signals.time[moment.tick]


def test_a_run_of_a_replay_gives_its_rows(service: Conductor, signals: Signals) -> None:
    given = service.run(ME, until=2.0, record=["sum.s", "sum.both[2]"])
    assert np.array_equal(given["time"], signals.time)
    assert np.array_equal(given["sum.s"], signals["sum.s"])
    assert np.array_equal(given["sum.both[2]"], signals["sum.both"][:, 1])


def test_a_replay_ends_where_the_recording_does(service: Conductor) -> None:
    for ahead in (lambda: service.step(ME, 21), lambda: service.run(ME, until=2.1)):
        with pytest.raises(InputInvalid, match=r"expected at most 2 s, where the recording ends"):
            ahead()
    assert service.step(ME, 20)[0].time == 2.0  # a refusal leaves it as it was
    assert service.reset(ME).tick == 0


def test_one_goes_back_to_a_snapshot_and_to_a_time(service: Conductor, signals: Signals) -> None:
    service.step(ME, 7)
    kept = service.snapshot(ME)
    assert service.restore(ME, "t=1.5").tick == 15
    assert service.get(ME, ["sum.s"])["sum.s"] == signals["sum.s"][15]
    assert service.restore(ME, kept).tick == 7
    for wrong in ("t=9", "t=-1", "t=nan", "t=x"):
        with pytest.raises(InputInvalid, match=r"expected t=0 to t=2"):
            service.restore(ME, wrong)


def test_nothing_of_a_recording_can_be_changed(service: Conductor) -> None:
    with pytest.raises(InputInvalid, match="replays a recording"):
        service.set(ME, {"sum.s": 1.0})
    with pytest.raises(InputInvalid, match="replays a recording"):
        service.replace(ME, "sum", f"{PARTS}:Sum")
    with pytest.raises(InputInvalid, match="replays a recording"):
        service.reset(ME, seed=1)
    with pytest.raises(InputInvalid, match=r"sum\.s"):
        service.get(ME, ["sum.t"])
    assert not any(info.settable for info in service.schema())


def test_a_subscriber_sees_a_replay_as_it_sees_a_run(run: Path, signals: Signals) -> None:
    with Bridge(run / "run.mcap", port=0) as bridge, connect(port=bridge.port) as client:
        assert client.system == "sums"
        blocks = client.subscribe("sum.s")
        assert bridge.stream.wait_until_wanted("sum", PATIENCE)
        client.run(factor=50.0)
        for block in blocks:
            assert block["sum.s"] == signals["sum.s"][block.tick]
            if block.tick == 20:
                break
        assert client.pause().time == 2.0


def test_a_file_cut_off_or_of_another_kind_is_refused_in_a_sentence(
    run: Path, tmp_path: Path
) -> None:
    whole = (run / "run.mcap").read_bytes()
    for cut in (0, 7, 100, len(whole) // 2, len(whole) - 9):
        (tmp_path / "cut.mcap").write_bytes(whole[:cut])
        with pytest.raises(RecordingError, match="is incomplete or damaged"):
            Playback(tmp_path / "cut.mcap")
    damaged = bytearray(whole)
    damaged[len(whole) // 3] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(damaged)
    with pytest.raises(RecordingError, match="is incomplete or damaged"):
        Playback(tmp_path / "bad.mcap")


def test_an_mcap_file_of_another_program_is_refused(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "other.mcap").open("wb") as out:
        writer = Writer(out)
        writer.start(profile="ros2", library="other")
        writer.finish()
    with pytest.raises(RecordingError, match=r"of 'other'; expected one that `uuvsim export"):
        Playback(tmp_path / "other.mcap")
    with pytest.raises(RecordingError, match="no recording here"):
        Playback(tmp_path / "none.mcap")
    assert not is_recording("bluerov2_hold")
