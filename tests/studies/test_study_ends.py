"""Processes that simulate runs end with the study, whichever way it ends."""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import Start
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies import Study
from uuvsim_cosim.studies.simulate_runs import Script

pytestmark = pytest.mark.skipif(os.name != "posix", reason="named pipes")

# A run that never ends, and that holds the pipe's end as long as its process is there.
HELD = '''
import os

class Endless:
    """Says which process it is in, and goes on."""
    inputs = {}
    outputs = {"y": "m"}
    parameters = {"wanted": (1.0, "m")}
    pipe = None

    def step(self, t, dt, u):
        if Endless.pipe is None and t > 1.0:
            Endless.pipe = os.open(os.path.join(os.path.dirname(__file__), "pipe"), os.O_WRONLY)
            os.write(Endless.pipe, f"{os.getpid()}\\n".encode())
        return {"y": 1.0}
'''
STUDY = (
    "system: s.ssd\nduration: 10000000 s\nevery: 1000000 s\nseeds: 2\nmetrics: {y: max(held.y)}\n"
)


class Watched:
    """The reading end of the pipe."""

    def __init__(self, path: Path) -> None:
        os.mkfifo(path)
        self.end = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        self.workers: list[int] = []

    def read(self) -> bytes:
        """Return what comes; b"" where nobody holds the other end any more."""
        select.select([self.end], [], [])
        return os.read(self.end, 4096)

    def wait_for(self, n: int) -> None:
        """Wait until n workers are amid a run."""
        while len(self.workers) < n:
            self.workers += map(int, self.read().split())


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[Watched]:
    (tmp_path / "held.py").write_text(HELD)
    (tmp_path / "s.yaml").write_text(STUDY)
    System("s", "0.1", base=tmp_path).add("held", "held.py:Endless").write(tmp_path / "s.ssd")
    found = Watched(tmp_path / "pipe")
    yield found
    for worker in found.workers:
        with contextlib.suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
    os.close(found.end)


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGKILL, -9)]
)
def test_workers_end_with_a_study_that_a_signal_ends(
    watched: Watched, tmp_path: Path, number: signal.Signals, status: int, start: Start
) -> None:
    command = [sys.executable, "-m", "uuvsim_cosim.cli", "study", "s.yaml", "-o", "out", "-j", "2"]
    process = start(command, cwd=tmp_path, stderr=subprocess.PIPE)
    watched.wait_for(2)
    process.send_signal(number)
    said = process.communicate()[1]
    assert process.returncode == status
    if number != signal.SIGKILL:
        assert said.count("0 of 2 runs are kept") == 1
    assert watched.read() == b""


def test_a_study_in_its_own_process_ends_amid_a_run(
    watched: Watched, tmp_path: Path, start: Start
) -> None:
    command = [sys.executable, "-m", "uuvsim_cosim.cli", "study", "s.yaml", "-o", "out", "-j", "1"]
    process = start(command, cwd=tmp_path, stderr=subprocess.PIPE)
    watched.wait_for(1)
    process.terminate()
    assert "0 of 2 runs are kept" in process.communicate()[1]
    assert process.returncode == 143


def test_a_worker_ends_amid_a_run_where_its_input_ends(
    watched: Watched, tmp_path: Path, start: Start
) -> None:
    script: Script = Study.read(tmp_path / "s.yaml").script
    # No process number is given: so nothing but the input's end can tell it.
    worker = start(
        [sys.executable, "-m", "uuvsim_cosim.studies.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=False,
    )
    assert worker.stdin is not None
    pickle.dump(script, worker.stdin)
    pickle.dump(([0], {}), worker.stdin)
    worker.stdin.flush()
    watched.wait_for(1)
    worker.stdin.close()
    assert worker.wait() == 0
    assert watched.read() == b""
