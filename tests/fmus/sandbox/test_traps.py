"""A trap of WebAssembly is no crash of the process; a crash of native code still is one."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from uuvsim_cosim.orchestrator.system.system import System

pytest.importorskip("wasmtime")

ABORTS, DIVIDES, OUTSIDE, RECURSES, NULL_CALL = 2, 3, 4, 5, 10
SEGFAULT = 9


def run(system: System, folder: Path) -> subprocess.CompletedProcess[str]:
    system.write(folder / "s.ssd")
    command = ["run", str(folder / "s.ssd"), "--until", "0.1", "--isolate", "bad=wasm"]
    return subprocess.run(
        [sys.executable, "-m", "uuvsim_cosim", *command, "-o", str(folder / "r")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("act", [ABORTS, DIVIDES, OUTSIDE, RECURSES, NULL_CALL])
def test_a_trap_is_reported_as_the_failure_of_the_component_only(
    runaway: Path, tmp_path: Path, act: int
) -> None:
    done = run(System("s", "0.01").add("bad", str(runaway), start={"act": act}), tmp_path)
    assert done.returncode == 3
    assert "component 'bad' failed at t = 0.01 s: fmi3DoStep returned fatal: it" in done.stderr
    assert "crashed" not in done.stderr


def test_a_crash_of_native_code_beside_webassembly_is_named(
    runaway: Path, first_order_fmi3: Path, tmp_path: Path
) -> None:
    start = {"fault": SEGFAULT, "fault_time": 0.05}
    system = System("s", "0.01").add("bad", str(runaway))
    done = run(system.add("native", str(first_order_fmi3), start=start), tmp_path)
    assert done.returncode == -signal.SIGSEGV
    assert "component 'native' crashed in fmi3DoStep (SIGSEGV)" in done.stderr
