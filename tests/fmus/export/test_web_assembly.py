"""FMUs with a component of FMI-LS-WASM: where it is, what it exports, and what is refused."""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from uuvsim_cosim.errors import InputInvalid, ToolchainError
from uuvsim_cosim.fmus import build_fmu, read_description
from uuvsim_cosim.fmus.export import component_binary, web_assembly
from uuvsim_cosim.fmus.export.component_binary import component_of, modules_of
from uuvsim_cosim.fmus.export.component_interface import CO_SIMULATION, MODEL_EXCHANGE

wasmtime = pytest.importorskip("wasmtime")
COMPONENT = "binaries/wasm32-wasip2/battery.wasm"
LS = "{http://fmi-standard.org/fmi-ls-manifest}fmi-ls"


@pytest.fixture(scope="module")
def battery() -> Path:
    return build_fmu(uuv.declare("battery"), platforms=["host", "wasm32"])


def test_the_archive_has_the_layout_of_the_layered_standard(battery: Path) -> None:
    with zipfile.ZipFile(battery) as archive:
        assert COMPONENT in archive.namelist()
        manifest = fromstring(archive.read("extra/org.modelica.fmi-ls-wasm/manifest.xml"))
    assert manifest.tag == "fmiLayeredStandardManifest"
    assert manifest.get(f"{LS}-name") == "org.modelica.fmi-ls-wasm"
    assert manifest.get(f"{LS}-version") == "0.1.0"
    assert read_description(battery).name == "battery"


def test_the_component_is_valid_and_exports_the_interfaces_of_both_kinds(battery: Path) -> None:
    from wasmtime.component import Component

    with zipfile.ZipFile(battery) as archive:
        data = archive.read(COMPONENT)
    engine = wasmtime.Engine()
    found = Component(engine, data).type
    assert set(found.exports(engine)) == {
        "fmi:fmi3/common@3.0.0", "fmi:fmi3/co-simulation@3.0.0", "fmi:fmi3/model-exchange@3.0.0",
    }  # fmt: skip
    assert set(found.imports(engine)) == {"fmi:fmi3/types@3.0.0", "fmi:fmi3/callbacks@3.0.0"}


def test_the_module_in_a_component_is_the_one_that_it_was_made_of() -> None:
    module = b"\0asm\x01\0\0\0" + bytes([0, 200, 1, 1, 97]) + bytes(198)
    for interfaces in ([CO_SIMULATION], [CO_SIMULATION, MODEL_EXCHANGE]):
        component = component_of(module, interfaces)
        assert component == component_of(module, interfaces)
        found = modules_of(component)
        assert found is not None
        assert found[0] == module
        assert len(found) == 3
    assert modules_of(module) is None


def test_a_whole_system_is_a_component_for_co_simulation(tmp_path: Path) -> None:
    from wasmtime.component import Component

    from uuvsim_cosim.kernels.system_fmu.system_fmu import build_system_fmu

    system = uuv.System("pack", "0.01").add("battery", "model:battery")
    fmu = build_system_fmu(system, fmi=3, platforms=["wasm32"], target=tmp_path)
    engine = wasmtime.Engine()
    with zipfile.ZipFile(fmu) as archive:
        found = Component(engine, archive.read("binaries/wasm32-wasip2/pack.wasm")).type
    assert "fmi:fmi3/model-exchange@3.0.0" not in found.exports(engine)


def test_fmi_2_is_refused(uuvsim: Uuvsim) -> None:
    with pytest.raises(
        InputInvalid, match=r"FMI 2\.0, for which .* no WebAssembly; expected FMI 3"
    ):
        build_fmu(uuv.declare("battery"), fmi=2, platforms=["wasm32"])
    status, _, err = uuvsim("fmu", "build", "battery", "--fmi", "2", "--platform", "wasm32")
    assert status == 2
    assert "expected FMI 3.0: --fmi 3" in err


def test_without_wasmtime_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object) -> bytes:
        raise ImportError("wasmtime")

    monkeypatch.setattr(web_assembly, "component_of", missing)
    monkeypatch.setattr(web_assembly, "intact", lambda _: False)
    assert component_binary.component_of is not missing
    with pytest.raises(ToolchainError, match=r"pip install 'uuvsim-cosim\[sandbox\]'"):
        build_fmu(uuv.declare("battery"), platforms=["wasm32"])


def test_a_client_of_a_server_is_refused(uuvsim: Uuvsim) -> None:
    status, _, err = uuvsim("fmu", "client", "bluerov2_hold", "--fmi", "3", "--platform", "wasm32")
    assert status == 2
    assert "the client of a server, which needs sockets" in err
