"""Components of FMI-LS-WASM through the component model, as those of other tools: the same bits."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import FOREIGN, SourceFmu, write_archive
from tests.fmus.conftest import lag
from tests.fmus.sandbox.test_sandbox import begun, outputs, stepped
from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus import build_fmu, instantiate_fmu
from uuvsim_cosim.fmus.check.check_fmu import examine
from uuvsim_cosim.fmus.check.inspect_fmu import reliance
from uuvsim_cosim.fmus.component import BindingKind
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import (
    Isolation,
    instantiate_here,
    instantiate_limited,
)
from uuvsim_cosim.fmus.sandbox import sandbox
from uuvsim_cosim.fmus.sandbox.extend import add_web_assembly
from uuvsim_cosim.fmus.sandbox.sandbox import instantiate_sandboxed

pytest.importorskip("wasmtime")
LOOPS, LOGS, DIVIDES = 1, 11, 3


@pytest.fixture
def as_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Treat components of this package as those of other tools."""
    monkeypatch.setattr(sandbox, "_MARK", b"no module has this")


@pytest.mark.usefixtures("as_of_others")
def test_a_component_has_the_bits_of_native_code() -> None:
    archive = read_fmu(build_fmu(uuv.declare("bluerov2"), platforms=["host", "wasm32"]))
    native, other = instantiate_here(archive, "a"), instantiate_sandboxed(archive, "a")
    assert other.binding().kind is BindingKind.CALLBACK
    tau = [3.0, -2.0, 1.0, 0.1, 0.2, -0.3]
    rows = [stepped(begun(c, tau=tau), 30) for c in (native, other)]
    assert rows[0] == rows[1]
    state = other.get_fmu_state()
    data = other.serialize_fmu_state(state)
    expected = stepped(other, 5, 30)
    other.set_fmu_state(state)
    assert stepped(other, 5, 30) == expected
    other.set_fmu_state(other.deserialize_fmu_state(data))
    assert stepped(other, 5, 30) == expected
    other.free()


@pytest.mark.usefixtures("as_of_others")
def test_every_kind_of_value_goes_through_a_component(
    source_fmu: SourceFmu, tmp_path: Path
) -> None:
    archive = read_fmu(add_web_assembly(source_fmu("first_order_fmi3.c"), tmp_path))
    pair = [begun(make(archive, "a")) for make in (instantiate_here, instantiate_sandboxed)]
    for variable in archive.description.of("input"):
        value = np.asarray(pair[0].get(variable), object)
        if variable.type == "String":
            value = np.full_like(value, "naïve ≥ 3")
        elif variable.type == "Binary":
            value = np.full_like(value, b"\x00\x01two")
        elif variable.type != "Clock":
            value = np.asarray(value + 1 if variable.type != "Boolean" else ~value.astype(bool))
        if variable.type not in ("String", "Binary"):
            value = value.astype(np.asarray(pair[0].get(variable)).dtype)
        given = value if variable.shape else value.item()
        for component in pair:
            component.set(variable, given)
    rows = [stepped(c, 3) for c in pair]
    assert rows[0] == rows[1]


@pytest.mark.usefixtures("as_of_others")
def test_model_exchange_goes_through_a_component(source_fmu: SourceFmu, tmp_path: Path) -> None:
    archive = read_fmu(add_web_assembly(source_fmu("ball_fmi3.c"), tmp_path))
    native, other = instantiate_here(archive, "a"), instantiate_sandboxed(archive, "a")
    rows = [stepped(begun(c), 100) for c in (native, other)]
    assert rows[0] == rows[1]


@pytest.mark.usefixtures("as_of_others")
def test_directional_derivatives_and_messages_of_a_component() -> None:
    archive = read_fmu(build_fmu(lag(), platforms=["host", "wasm32"]))
    found = []
    for make in (instantiate_here, instantiate_sandboxed):
        component = begun(make(archive, "a"))
        unknowns, knowns = archive.description.of("output"), archive.description.of("input")
        found.append(component.directional_derivative(unknowns, knowns, [2.0]).tolist())
        with pytest.raises(ComponentFailed, match="fixed parameter"):
            begun(make(archive, "a")).set(archive.description.variables["T"], 1.0)
    assert found[0] == found[1]


@pytest.mark.usefixtures("as_of_others")
@pytest.mark.parametrize(
    ("act", "reason"),
    [(LOOPS, "it did not answer in time and was interrupted"), (DIVIDES, "integer divide by zero")],
)
def test_a_component_that_misbehaves_fails_with_a_reason(
    source_fmu: SourceFmu, tmp_path: Path, act: int, reason: str
) -> None:
    lines = (FOREIGN / "runaway_fmi3.c").read_text().splitlines()
    code = "\n".join(x for x in lines if "case READS" not in x and "case PRINTS" not in x)
    fmu = source_fmu("runaway_fmi3.c", "hostile", "hostile_fmi3.xml", code.encode())
    archive = read_fmu(add_web_assembly(fmu, tmp_path))
    bad = begun(instantiate_sandboxed(archive, "bad", watchdog=0.2), act=act)
    bad.do_step(0.0, 0.01)
    with pytest.raises(ComponentFailed, match=rf"fmi3DoStep returned fatal: .*{reason}"):
        bad.do_step(0.01, 0.01)
    bad.free()


def without_others(built: Path, folder: Path) -> Path:
    """Return an FMU whose only binary is WebAssembly."""
    with zipfile.ZipFile(built) as zipped:
        kept = {
            n: zipped.read(n) for n in zipped.namelist()
            if not n.startswith(("sources/", "binaries/x86", "binaries/aarch"))
        }  # fmt: skip
    return write_archive(folder / "lag.fmu", kept)


def test_check_and_inspect_run_an_fmu_with_nothing_but_a_component(tmp_path: Path) -> None:
    fmu = without_others(build_fmu(lag(), platforms=["host", "wasm32"]), tmp_path)
    looks = {look.check: look for look in examine(fmu)}
    assert [look for look in looks.values() if look.result == "finding"] == []
    assert looks["run"].result == looks["determinism"].result == "ok"
    assert "its WebAssembly was run; there: wasm32-wasip2" in looks["binary"].text
    assert reliance(read_fmu(fmu))["run"] == "yes, as WebAssembly, by the extra 'sandbox'"


def test_an_fmu_with_nothing_but_a_component_runs_without_isolation(tmp_path: Path) -> None:
    built = build_fmu(lag(), platforms=["host", "wasm32"])
    archive = read_fmu(without_others(built, tmp_path))
    assert archive.binaries == ("wasm32-wasip2",)
    native = begun(instantiate_here(read_fmu(built), "a"), u=1.0)
    alone = begun(instantiate_fmu(archive, "a"), u=1.0)
    assert stepped(alone, 20) == stepped(native, 20)
    assert outputs(alone) == outputs(native)


def test_an_fmu_with_nothing_but_a_component_is_isolated_by_it_in_every_way(tmp_path: Path) -> None:
    built = build_fmu(lag(), platforms=["host", "wasm32"])
    archive = read_fmu(without_others(built, tmp_path))
    expected = stepped(begun(instantiate_here(read_fmu(built), "a"), u=1.0), 20)
    for way in get_args(Isolation):
        limited = begun(instantiate_limited(archive, "a", way), u=1.0)
        assert stepped(limited, 20) == expected


@pytest.mark.parametrize("data", [b"", b"\0asm\x01\0\0\0", b"\0asm\x0d\0\x01\0\xff"])
def test_a_file_that_is_no_component_is_refused(tmp_path: Path, data: bytes) -> None:
    with zipfile.ZipFile(build_fmu(lag())) as zipped:
        members = {"modelDescription.xml": zipped.read("modelDescription.xml")}
    members["binaries/wasm32-wasip2/lag.wasm"] = data
    archive = read_fmu(write_archive(tmp_path / "bad.fmu", members))
    with pytest.raises(FmuError, match=r"component|cannot start"):
        instantiate_sandboxed(archive, "bad")
