"""A win64 DLL, stepped under Wine by a little program that loads it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.cache import cache_dir
from uuvsim_cosim.fmus.export.fmu_file import fmi_headers

WINE = shutil.which("wine64") or shutil.which("/usr/lib/wine/wine64")
NEEDS_WINE = pytest.mark.skipif(WINE is None, reason="wine64 is not installed; the DLL was not run")

HERE = Path(__file__).parent
ZIG = [sys.executable, "-m", "ziglang"]
TARGET = ["cc", "-target", "x86_64-windows-gnu", "-O2"]


def stepped(folder: Path, dll: Path, arguments: Sequence[Any]) -> list[str]:
    """Step a DLL of FMI 3.0 by 0.03 s, and give the bits of an output after each step.

    `arguments`: token, reference and size of the input, of the output, and the number of steps.
    """
    done = subprocess.run(
        [str(WINE), str(_program(folder)), f"Z:{dll}", *map(str, arguments)],
        env={**os.environ, "WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, (done.returncode, done.stderr)
    return done.stdout.split()


def _program(folder: Path) -> Path:
    program = folder / "step_by_dll.exe"
    if program.is_file():
        return program
    parts = []
    for name in ("step_by_dll", "windows_program"):
        parts.append(str(folder / f"{name}.obj"))
        _run([*TARGET, f"-I{fmi_headers()}", "-c", str(HERE / f"{name}.c"), "-o", parts[-1]])
    for name in ("windows_program", "windows_loading"):
        parts.append(str(folder / f"{name}.lib"))
        _run(["dlltool", "-m", "i386:x86-64", "-d", str(HERE / f"{name}.def"), "-l", parts[-1]])
    _run([*TARGET, "-nostdlib", "-Wl,--entry,mainCRTStartup", *parts, "-o", str(program)])
    return program


def _run(line: Sequence[str]) -> None:
    zig = {k: str(cache_dir("zig")) for k in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    done = subprocess.run(
        [*ZIG, *line], env={**os.environ, **zig}, check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
