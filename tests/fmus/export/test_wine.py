"""The win64 binary, run under Wine where that is installed, against the one of this machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fmus.by_wine import NEEDS_WINE, stepped
from uuvsim_cosim.fmus.codegen.lowering import lower
from uuvsim_cosim.fmus.export.fmu_file import build_fmu, compile_fmu
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain

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


def test_rays_over_a_seabed_have_the_bits_of_the_linux_binary(tmp_path: Path) -> None:
    i, j = np.mgrid[0:60, 0:60]
    z = (5.0 + np.sin(i / 3.0) + 0.7 * np.cos(j / 2.0)).astype(np.float32)
    save_terrain(Terrain(z=z, spacing=0.5, origin=(-15.0, -15.0)), tmp_path / "bed.npz")
    model = declare("altimeter", scene=str(tmp_path / "bed.npz"), period="0.03")
    fmu = read_fmu(build_fmu(model, fmi=3, target=tmp_path))
    eta, altitude = (fmu.description.variables[n] for n in ("eta", "altitude"))
    x = instantiate_fmu(fmu, "it")
    x.enter_initialization_mode(0.0, None)
    x.exit_initialization_mode()
    expected = []
    for k in range(4 * STEPS):  # the hull dives and turns level
        x.set(eta, 0.01 * k - 0.25 * np.arange(6.0))
        x.do_step(k * 0.03, 0.03)
        expected += [f"{b:016x}" for b in np.ravel(x.get(altitude)).view(np.uint64)]
    x.free()
    assert len(set(expected)) > STEPS, "the bed was heard"
    token, e, a = fmu.description.token, eta.value_references[0], altitude.value_references[0]
    library = compile_fmu(lower(model), "win64")
    assert stepped(tmp_path, library, [token, e, 6, a, 1, 4 * STEPS]) == expected


def test_an_archive_holds_both_platforms(declared: dict[str, Callable[[], Model]]) -> None:
    import zipfile

    path = build_fmu(declared["lag"](), fmi=2, platforms=("linux64", "win64"))
    names = zipfile.ZipFile(path).namelist()
    assert {"binaries/linux64/lag.so", "binaries/win64/lag.dll"} <= set(names)
