"""The win64 binary, run under Wine where that is installed, against the one of this machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.cache import cache_dir
from uuvsim_cosim.fmus.export import build_fmu, compile_fmu, fmi_headers
from uuvsim_cosim.fmus.lowering import lower
from uuvsim_cosim.models.model import Model

WINE = shutil.which("wine64") or shutil.which("/usr/lib/wine/wine64")
STEPS = 40

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(WINE is None, reason="wine64 is not installed; the DLL was not run"),
]


@pytest.fixture(scope="module")
def stepper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile the little program that loads a DLL."""
    program = tmp_path_factory.mktemp("stepper") / "step_by_dll.exe"
    source = Path(__file__).with_name("step_by_dll.c")
    zig = {k: str(cache_dir("zig")) for k in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", "-O2"]
    subprocess.run(
        [*command, f"-I{fmi_headers()}", str(source), "-o", str(program)],
        env={**os.environ, **zig},
        check=True,
        capture_output=True,
    )
    return program


@pytest.mark.parametrize(("name", "output"), [("lag", "y"), ("linear", "y"), ("noisy", "reading")])
def test_the_windows_binary_gives_the_bits_of_the_linux_binary(
    instance: Callable[[str, int], Any],
    declared: dict[str, Callable[[], Model]],
    stepper: Path,
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    output: str,
) -> None:
    x = instance(name, 3).start()
    u, y = x.variables["u"], x.variables[output]
    expected = []
    for k in range(STEPS):
        x.set("u", 0.01 * k - 0.25 * np.arange(u.size))
        x.step(k * 0.03, 0.03)
        expected += [f"{b:016x}" for b in np.ravel(x.get(output)).view(np.uint64)]
    lowered = lower(declared[name]())
    library = compile_fmu(lowered, "win64")
    arguments = [u.value_references[0], u.size, y.value_references[0], y.size, STEPS]
    prefix = tmp_path_factory.getbasetemp() / "wine"
    done = subprocess.run(
        [str(WINE), str(stepper), f"Z:{library}", lowered.token, *map(str, arguments)],
        env={**os.environ, "WINEPREFIX": str(prefix), "WINEDEBUG": "-all"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, (done.returncode, done.stderr)
    assert done.stdout.split() == expected


def test_an_archive_holds_both_platforms(declared: dict[str, Callable[[], Model]]) -> None:
    import zipfile

    path = build_fmu(declared["lag"](), fmi=2, platforms=("linux64", "win64"))
    names = zipfile.ZipFile(path).namelist()
    assert {"binaries/linux64/lag.so", "binaries/win64/lag.dll"} <= set(names)
