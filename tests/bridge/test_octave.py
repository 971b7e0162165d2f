"""The MATLAB client, run in GNU Octave against a live co-simulation; never yet in MATLAB."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.conductor import Conductor
from uuvsim_cosim.bridge.tcp_door import TcpDoor

sys.path.insert(0, str(Path(__file__).parent))

from doors import Peer
from in_octave import MATLAB, NEEDS_OCTAVE, OCTAVE, PLAIN, octave, said

pytestmark = NEEDS_OCTAVE


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """Serve one hull, whose forces a client may set."""
    hull = uuv.System("hull_alone", "0.01").add("hull", "model:bluerov2_heavy")
    conductor = Conductor(hull)
    with TcpDoor(conductor, 0) as door:
        yield door.port
    conductor.close()


def test_the_clients_own_suite_passes_in_octave(port: int) -> None:
    words = said(f"suite({port})", 300)
    assert "FAILED" not in words, words
    assert "29 of 29 passed" in words, words


def test_octave_and_python_step_in_lockstep(port: int) -> None:
    count = 200
    with Peer(port) as owner:
        owner.ask({"call": "reset"})
    with Peer(port, lockstep=True, lag=60, name="python") as peer:
        peer.ask({"call": "layout", "inputs": [], "outputs": ["hull.nu"]})
        with octave(f"lockstep({port}, {count})") as process:
            while "octave" not in str(peer.ask({"call": "describe"})[0]["system"]["clients"]):
                assert process.poll() is None, process.communicate()[0]
            for k in range(count):
                numbers = peer.ask(None, [1])[1]
                assert numbers[0] == k + 1
            words, _ = process.communicate(timeout=60)
    assert words.split()[:2] == ["tick", str(count)], words
    assert [float(x) for x in words.split()[3:]] == [numbers[2], numbers[7]]


def test_a_client_that_ends_without_a_word_holds_nobody_up(port: int) -> None:
    with octave(
        f"s = uuvsim.connect('port', {port}, 'lockstep', true, 'lag', 60); disp('in'); "
        "fflush(stdout); kill(getpid(), 9);"
    ) as process:
        process.communicate(timeout=60)
    with Peer(port) as peer:
        while "octave" in str(peer.ask({"call": "describe"})[0]["system"]["clients"]):
            pass  # the door has not yet heard that the connection closed
        answer, _ = peer.ask({"call": "step"})
        assert answer["ok"], answer


def test_the_command_prints_a_line_that_octave_takes() -> None:
    line = [sys.executable, "-m", "uuvsim_cosim", "matlab"]
    printed = subprocess.run(line, capture_output=True, text=True, check=True).stdout
    assert OCTAVE is not None
    code = f"{printed.strip()}; try, uuvsim.connect('prt', 1), catch e, disp(e.identifier), end"
    found = subprocess.run([OCTAVE, *PLAIN, code], capture_output=True, text=True, check=True)
    assert found.stdout == "uuvsim:option\n"


def test_the_packages_functions_all_have_a_first_help_line() -> None:
    for file in sorted([*(MATLAB / "+uuvsim").glob("*.m"), *(MATLAB / "examples").glob("*.m")]):
        lines = file.read_text(encoding="utf-8").splitlines()
        assert lines[1].lstrip().startswith("% "), file.name


def test_the_answer_of_an_interrupted_call_is_not_taken_for_the_next_ones(port: int) -> None:
    assert OCTAVE is not None
    with subprocess.Popen(
        [OCTAVE, *PLAIN[:-1], "--no-line-editing", "--interactive"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        process.stdin.write(
            f"addpath('{MATLAB}'); s = uuvsim.connect('port', {port}); s.run(1e9, {{'hull.nu'}});\n"
        )
        process.stdin.flush()
        with Peer(port) as peer:
            while not peer.ask({"call": "describe"})[0]["running"]:
                assert process.poll() is None
            process.send_signal(signal.SIGINT)
            words, _ = process.communicate("s.get('hull.nu')\nclear s\nexit\n", timeout=60)
            while peer.ask({"call": "describe"})[0]["running"]:
                pass  # what nobody waits for ends
            peer.ask({"call": "reset"})
    assert "was interrupted, and its answer never read" in words, words
