"""The win64 binary, run under Wine where that is installed, against the one of this machine."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.fmus.export import build_fmu, compile_fmu
from uuvsim_cosim.fmus.lowering import lower
from uuvsim_cosim.models.model import Model

sys.path.insert(0, str(Path(__file__).parent))

from by_wine import NEEDS_WINE, stepped

STEPS = 40

pytestmark = [pytest.mark.slow, NEEDS_WINE]


@pytest.mark.parametrize(("name", "output"), [("lag", "y"), ("linear", "y"), ("noisy", "reading")])
def test_the_windows_binary_gives_the_bits_of_the_linux_binary(
    instance: Callable[[str, int], Any],
    declared: dict[str, Callable[[], Model]],
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
    folder = tmp_path_factory.getbasetemp()
    assert stepped(folder, library, [lowered.token, *arguments]) == expected


def test_an_archive_holds_both_platforms(declared: dict[str, Callable[[], Model]]) -> None:
    import zipfile

    path = build_fmu(declared["lag"](), fmi=2, platforms=("linux64", "win64"))
    names = zipfile.ZipFile(path).namelist()
    assert {"binaries/linux64/lag.so", "binaries/win64/lag.dll"} <= set(names)
