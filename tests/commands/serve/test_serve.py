"""`uuvsim serve`: it says where it listens, and ends with its recording complete."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.conftest import Start
from uuvsim_cosim.bridge.http.keyboard import source
from uuvsim_cosim.bridge.zenoh.session import _half_open
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.commands.serve import serve
from uuvsim_cosim.orchestrator.recording.export import export
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd
from uuvsim_cosim.orchestrator.system.resolve import register

PARTS = Path(__file__).parents[2] / "bridge" / "parts.py"
ANY = ("--port", "0", "--tcp-port", "0", "--http-port", "0")


@pytest.fixture
def sums(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    write_ssd(uuv.System("sums", "0.1").add("sum", f"{PARTS}:Sum"), tmp_path / "sums.ssd")
    return "sums.ssd"


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_when_interrupted_with_the_recording_complete(
    sums: str, ending: signal.Signals, start: Start
) -> None:
    command = [sys.executable, "-m", "uuvsim_cosim", "serve", sums, "--paused", *ANY]
    serving = start(command, stdout=subprocess.PIPE)
    assert serving.stdout is not None
    said = [serving.stdout.readline() for _ in range(5)]
    port = int(re.findall(r"port=(\d+)", said[1])[0])
    with uuv.connect(port=port) as client:
        client.step(5, {"sum.a": 1.0})
    serving.send_signal(ending)
    out, _ = serving.communicate()
    assert serving.returncode == 0
    assert "interrupted at t = 0.5 s" in out
    assert uuv.read_signals(Path("runs/sums-0"))["sum.s"][-1] == pytest.approx(0.5)


def test_it_ends_at_the_time_that_is_asked_for(
    sums: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["serve", sums, "--until", "1", "--real-time", "20", "-o", "out", *ANY]) == 0
    assert "recording  out" in capsys.readouterr().out
    assert uuv.read_signals(Path("out")).time[-1] == 1.0


def test_a_port_in_use_is_said_and_nothing_is_left_open(
    sums: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert status_of(["serve", sums, "--no-record", *ANY[2:], "--port", str(port)]) == 2
    assert re.search(rf"port {port} .* is in use; expected a free one", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--until", "-1"], "more than 0 seconds"),
        (["--real-time", "0"], "factor of more than 0"),
        (["--fail-safe", "panic"], "drop, pause, go-on"),
        (["--replace", "smu=x.fmu"], "sum"),
    ],
)
def test_a_wrong_option_is_refused_in_words(
    sums: str, options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["serve", sums, "--no-record", *ANY, *options]) == 2
    assert words in capsys.readouterr().err


def test_a_component_that_fails_ends_a_serve_with_an_end(
    sums: str, capsys: pytest.CaptureFixture[str]
) -> None:
    swap = f"sum={PARTS}:Fails"
    options = ["--until", "9", "--real-time", "50", "--replace", swap, "-o", "out"]
    assert status_of(["serve", sums, *ANY, *options]) == 3
    assert "the well is dry" in capsys.readouterr().err
    assert len(uuv.read_signals(Path("out")).time) == 6


def test_a_recording_is_served_as_live(sums: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of(["serve", sums, "--until", "1", "--real-time", "50", "-o", "run", *ANY]) == 0
    export("run", "run.mcap")
    for recording in ("run", "run.mcap"):
        capsys.readouterr()
        options = ["--until", "0.5", "--real-time", "50", *ANY]
        assert status_of(["serve", recording, *options]) == 0
        said = capsys.readouterr().out
        assert "sums is served on this machine" in said
        assert "recording  " not in said
    assert status_of(["serve", "run", "--until", "3", *ANY]) == 2
    assert "at most 1 s, where the recording ends" in capsys.readouterr().err
    assert status_of(["serve", "run.mcap", "--set", "sum.k=2", "--seed", "3", *ANY]) == 2
    assert "expected it without --set, --seed" in capsys.readouterr().err


def test_where_the_pilots_page_is_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    register("keyboard", source)
    write_ssd(uuv.System("alone", "0.1").add("helm", "keyboard:"), tmp_path / "alone.ssd")
    options = ["--replace", "helm=keyboard", "--until", "0.1", "--no-record", *ANY]
    assert status_of(["serve", "alone.ssd", *options]) == 0
    assert re.search(r"Pilot  http://127\.0\.0\.1:\d+/pilot", capsys.readouterr().out)


def test_a_mission_is_served_with_the_vehicle_that_flies_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rexrov = ["serve", "hold", "--vehicle", "rexrov", "--until", "0.1", "--real-time", "20", *ANY]
    assert status_of(rexrov) == 0
    assert "recording  runs/rexrov_hold-0" in capsys.readouterr().out
    other = [*rexrov, "--replace", "hull=model:bluerov2_heavy"]
    assert status_of(other) == 2
    assert "made for rexrov, but hull is bluerov2_heavy" in capsys.readouterr().err
    assert status_of([*other, "--force"]) == 0
    assert "made for rexrov, but hull is bluerov2_heavy" in capsys.readouterr().out


@pytest.mark.parametrize("option", ["--port", "--tcp-port", "--http-port"])
def test_a_port_that_cannot_be_had_leaves_nothing_behind(
    sums: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        for port, words in ((taken.getsockname()[1], "is in use"), (80000, "1 to 65535")):
            at = ANY.index(option)
            options = [*ANY[:at], option, str(port), *ANY[at + 2 :]]
            assert status_of(["serve", sums, *options]) == 2
            said = capsys.readouterr()
            assert words in said.err
            assert said.out == ""
    assert not Path("runs").exists()


def test_two_transports_do_not_share_a_port(sums: str, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--port", "0", "--tcp-port", "7448", "--http-port", "7448"]
    assert status_of(["serve", sums, "--no-record", *options]) == 2
    assert "expected another" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("limits", "raised"),
    [((256, 4096), [4096]), ((256, -1), [8192]), ((1024, 1 << 20), [8192]), ((20_000, 20_000), [])],
)
def test_serving_makes_room_for_connections_that_others_hold_open(
    limits: tuple[int, int], raised: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    resource = pytest.importorskip("resource")
    made: list[int] = []
    monkeypatch.setattr(resource, "RLIM_INFINITY", -1)
    monkeypatch.setattr(resource, "getrlimit", lambda _: limits)
    monkeypatch.setattr(resource, "setrlimit", lambda _, pair: made.append(pair[0]))
    serve._raise_limit_of_files()
    assert made == raised
    assert _half_open() == min(4096, limits[0] // 2)
