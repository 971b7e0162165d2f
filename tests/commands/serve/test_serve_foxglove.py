"""`uuvsim serve --foxglove`: where it listens, who may do what, and refusals."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.bridge.foxglove.client import connected
from tests.bridge.guarded import access_file
from tests.conftest import Start
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.orchestrator.recording.export import export
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

PARTS = Path(__file__).parents[2] / "bridge" / "parts.py"
ANY = ["--port", "0", "--tcp-port", "0", "--http-port", "0"]
FOXGLOVE = ["--foxglove", "--foxglove-port", "0"]
BRIEF = ["--until", "1", "--real-time", "50"]


@pytest.fixture
def sums(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    write_ssd(uuv.System("sums", "0.1").add("sum", f"{PARTS}:Sum"), tmp_path / "sums.ssd")
    return "sums.ssd"


def test_a_client_of_a_served_system_gets_a_signal(sums: str, start: Start) -> None:
    command = [sys.executable, "-m", "uuvsim_cosim", "serve", sums, "--no-record", *ANY, *FOXGLOVE]
    serving = start(command, stdout=subprocess.PIPE)
    assert serving.stdout is not None
    [port] = next(
        found
        for text in serving.stdout
        if (found := re.findall(r"Foxglove  ws://127\.0\.0\.1:(\d+); every program on this", text))
    )
    with connected(int(port)) as client:
        client.subscribe("/sum")
        first = client.message("/sum")
        assert client.message("/sum", lambda m: m["at"] > first["at"])["data"]["s"] == 0.0
    serving.send_signal(signal.SIGINT)
    serving.communicate()
    assert serving.returncode == 0


def test_the_answer_has_addresses_and_topics(sums: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of(["serve", sums, "--no-record", *ANY, *FOXGLOVE, *BRIEF, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["foxglove"]
    assert found["addresses"][0].startswith("ws://127.0.0.1:")
    assert found["topics"] == ["/sum", "/tf"]


@pytest.mark.parametrize("recording", ["run", "run.mcap"])
def test_a_recording_is_shown_like_a_running_system(
    sums: str, recording: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["serve", sums, *BRIEF, "-o", "run", *ANY]) == 0
    export("run", "run.mcap")
    capsys.readouterr()
    assert status_of(["serve", recording, *ANY, *FOXGLOVE, *BRIEF, "--json"]) == 0
    assert "/sum" in json.loads(capsys.readouterr().out)["foxglove"]["topics"]


def test_with_an_access_file_it_says_why_nothing_can_be_set(
    sums: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(access_file(Path.cwd()))
    options = ["--no-record", *ANY, *FOXGLOVE, *BRIEF, "--access", file]
    assert status_of(["serve", sums, *options]) == 0
    said = capsys.readouterr().out
    assert "every program on this machine can read it, without token" in said
    assert "note: Foxglove's clients cannot log in; with --access they may only read" in said


def test_a_port_in_use_is_named_before_anything_is_built(
    sums: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert status_of(["serve", sums, *ANY, "--foxglove", "--foxglove-port", port]) == 2
    said = capsys.readouterr()
    assert re.search(rf"port {port} on 127\.0\.0\.1 is in use; .* by --foxglove-port \d+", said.err)
    assert said.out == ""
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--foxglove-port", "8765"], "--foxglove-port; expected --foxglove beside it"),
        (["--foxglove", "--foxglove-port", "-1"], "--foxglove-port -1: expected a port"),
        ([*FOXGLOVE, "--host", "0.0.0.0"], "0.0.0.0 is reachable from other machines"),
    ],
)
def test_wrong_options_are_refused(
    sums: str, options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["serve", sums, "--no-record", *ANY, *options]) == 2
    assert words in capsys.readouterr().err


def test_without_the_package_the_extra_is_named(
    sums: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    assert status_of(["serve", sums, *ANY, *FOXGLOVE]) == 2
    assert "pip install 'uuvsim-cosim[foxglove]'" in capsys.readouterr().err
    assert not Path("runs").exists()
