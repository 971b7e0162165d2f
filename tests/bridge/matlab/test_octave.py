"""The MATLAB client, run in GNU Octave against a live co-simulation; never yet in MATLAB."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.bridge.in_octave import MATLAB, NEEDS_OCTAVE, OCTAVE, PLAIN, octave, said
from tests.bridge.peer import Peer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer

pytestmark = NEEDS_OCTAVE


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """Serve one hull, whose forces a client may set."""
    hull = uuv.System("hull_alone", "0.01").add("hull", "model:bluerov2_heavy")
    conductor = Conductor(hull)
    with TcpServer(conductor, 0) as endpoint:
        yield endpoint.port
    conductor.close()


def test_the_clients_own_suite_passes_in_octave(port: int) -> None:
    words = said(f"suite({port})")
    assert "FAILED" not in words, words
    assert "31 of 31 passed" in words, words


_INTEGERS = """
s = uuvsim.connect('port', %d);
large = {intmin('int64'), int64(-9007199254740993), int64(9007199254740993), intmax('int64')};
for k = 1:numel(large)
  s.set('a.int64_in', large{k}, 'a.uint64_in', intmax('uint64') - uint64(k));
  y = s.step([], 0.1, {'a.int64_out', 'a.uint64_out', 'a.y', 'a.int32_out'});
  assert(isequal(class(y.a.int64_out), 'int64') && y.a.int64_out == large{k});
  assert(isequal(class(y.a.uint64_out), 'uint64'));
  assert(y.a.uint64_out == intmax('uint64') - uint64(k));
  assert(isa(y.a.y, 'double') && isa(y.a.int32_out, 'double'));
  assert(isequal(s.get('a.int64_out'), large{k}));
  y = s.step(struct('a', struct('int64_in', large{k} / 2, 'int32_in', [1 2])), 0.1);
  assert(isequal(y.a.int64_out, large{k} / 2));
  y = s.step({'a.int64_in', 7, 'a.uint64_in', uint64(18446744073709551615)}, 0.1);
  assert(y.a.int64_out == 7 && y.a.uint64_out == intmax('uint64'));
end
r = s.run(0.3, {'a.uint64_out', 'a.y'});
assert(isequal(r.a.uint64_out, repmat(intmax('uint64'), 4, 1)) && isa(r.a.y, 'double'));
try, s.step({'a.int64_in', 0.5}, 0.1), catch e, disp(e.message), end
try, s.set('a.uint64_in', int64(-1)), catch e, disp(e.message), end
s.layout({'a.int64_in'}, {'a.uint64_out'});
try, s.step(3, 0.1), catch e, disp(e.message), end
s.set('a.uint64_in', 5);
assert(isequal(s.step(3, 0.1), 5));
disp('exact')
"""


def test_integers_of_64_bits_are_exact_in_octave(first_order_fmi3: Path) -> None:
    system = uuv.System("types", "0.1").add("a", str(first_order_fmi3))
    with Conductor(system, backend="fmu") as conductor, TcpServer(conductor, 0) as endpoint:
        words = said(_INTEGERS % endpoint.port).splitlines()
    assert "0.5 was given; expected whole numbers of int64" in words[0]
    assert "an integer was given that does not fit UInt64" in words[1]
    assert "18446744073709551615 is not exact as float64" in words[2]
    assert words[3:] == ["exact"]


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
            words, _ = process.communicate()
    assert words.split()[:2] == ["tick", str(count)], words
    assert [float(x) for x in words.split()[3:]] == [numbers[2], numbers[7]]


def test_a_client_that_ends_without_a_word_holds_nobody_up(port: int) -> None:
    with octave(
        f"s = uuvsim.connect('port', {port}, 'lockstep', true, 'lag', 60); disp('in'); "
        "fflush(stdout); kill(getpid(), 9);"
    ) as process:
        process.communicate()
    with Peer(port) as peer:
        while "octave" in str(peer.ask({"call": "describe"})[0]["system"]["clients"]):
            pass  # the endpoint has not yet heard that the connection closed
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
            f"addpath('{MATLAB}'); s = uuvsim.connect('port', {port}); s.run(9e4, {{'hull.nu'}});\n"
        )
        process.stdin.flush()
        with Peer(port) as peer:
            while not peer.ask({"call": "describe"})[0]["running"]:
                assert process.poll() is None
            process.send_signal(signal.SIGINT)
            words, _ = process.communicate("s.get('hull.nu')\nclear s\nexit\n")
            while peer.ask({"call": "describe"})[0]["running"]:
                pass  # what nobody waits for ends
            peer.ask({"call": "reset"})
    assert "was interrupted, and its answer never read" in words, words
