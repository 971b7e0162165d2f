"""A component added to an FMU with C sources."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from tests.conftest import FOREIGN, SourceFmu, Uuvsim
from uuvsim_cosim.errors import FmuError, InputInvalid
from uuvsim_cosim.fmus.sandbox.extend import add_web_assembly

pytest.importorskip("wasmtime")


def test_the_command_adds_a_component_and_keeps_the_rest(
    source_fmu: SourceFmu, tmp_path: Path, uuvsim: Uuvsim
) -> None:
    fmu = source_fmu("first_order_fmi3.c")
    status, _, err = uuvsim("fmu", "build", str(fmu), "--platform", "wasm32", "-o", str(tmp_path))
    assert (status, err) == (0, "")
    with zipfile.ZipFile(fmu) as before, zipfile.ZipFile(tmp_path / fmu.name) as after:
        added = {*after.namelist()} - {*before.namelist()}
        assert all(after.read(name) == before.read(name) for name in before.namelist())
    assert added == {
        "binaries/wasm32-wasip2/first_order.wasm", "extra/org.modelica.fmi-ls-wasm/manifest.xml",
    }  # fmt: skip


def test_an_fmu_is_not_built_for_another_platform(source_fmu: SourceFmu, uuvsim: Uuvsim) -> None:
    fmu = source_fmu("first_order_fmi3.c")
    status, _, err = uuvsim("fmu", "build", str(fmu), "--platform", "win64")
    assert status == 2
    assert "is an FMU already; expected wasm32" in err


def test_fmus_that_cannot_be_extended_are_refused(
    source_fmu: SourceFmu, first_order_fmi3: Path, tmp_path: Path
) -> None:
    fmu = source_fmu("first_order_fmi3.c")
    with pytest.raises(InputInvalid, match="the FMU itself; expected another file"):
        add_web_assembly(fmu, fmu)
    with pytest.raises(FmuError, match=r"FMI 2\.0, for which the layered standard has no"):
        add_web_assembly(source_fmu("first_order_fmi2.c"), tmp_path)
    with pytest.raises(FmuError, match="no C sources that are listed"):
        add_web_assembly(first_order_fmi3, tmp_path)
    code = b'#include <sys/stat.h>\nint x(void) { return mkdir("a", 0); }\n'
    code += (FOREIGN / "runaway_fmi3.c").read_bytes()
    makes = source_fmu("runaway_fmi3.c", "hostile", "hostile_fmi3.xml", code)
    with pytest.raises(
        FmuError,
        match=r"sources print or open files \(WASI's .*path_create.*--isolate wasm` runs these",
    ):
        add_web_assembly(makes, tmp_path)
