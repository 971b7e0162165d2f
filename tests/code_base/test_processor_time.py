"""Time limits of tests count processor time, and a test that waits forever fails too."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CONFTEST = """
import pytest
from tests.processor_time import Watch

WATCH = Watch(limit=1.0, idle=1.0, grace=0.5)

@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    with WATCH.over(item.nodeid):
        return (yield)
"""
BURNS = """
import subprocess, sys, threading

def burn(seconds):
    import time
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

def test_itself():
    burn(60)

def test_its_child():
    subprocess.run([sys.executable, "-c", "while True: pass"])

def test_a_lock():
    threading.Lock().acquire() and threading.Event().wait()

def test_a_child_that_waits():
    subprocess.run([sys.executable, "-c", "import threading; threading.Event().wait()"])

def test_within_the_limit():
    burn(0.3)
"""


def test_a_test_that_works_or_waits_too_long_fails_and_the_next_one_runs(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_burns.py").write_text(BURNS)
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {ROOT}\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert "4 failed, 1 passed" in done.stdout
    assert done.stdout.count("it used more than 1 s of processor time") >= 2
    assert done.stdout.count("it waits: almost no processor time in 1 s") >= 2


def test_a_test_can_be_interrupted_where_the_suite_ignores_interruptions(tmp_path: Path) -> None:
    ignoring = "import signal, pytest, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    run = f"sys.exit(pytest.main(['-q', {str(Path(__file__))!r}, '-k', 'arrives']))"
    done = subprocess.run(
        [sys.executable, "-c", ignoring + run], capture_output=True, text=True, check=False,
        cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_an_interruption_arrives_in_a_test_and_in_a_process_that_it_starts() -> None:
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    script = "import signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "True"
