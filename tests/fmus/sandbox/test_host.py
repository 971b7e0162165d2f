"""Imports of a module: those that the sandbox has are defined, others are listed and refused."""

from __future__ import annotations

import pytest
import wasmtime

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.sandbox.host import Host, define_imports


def imports_of(*names: str) -> tuple[object, list[object]]:
    engine = wasmtime.Engine()
    lines = "".join('(import "{}" "{}" (func))'.format(*name.split(".")) for name in names)
    return wasmtime.Linker(engine), wasmtime.Module(engine, f"(module {lines})").imports


def test_unknown_imports_are_listed() -> None:
    linker, imports = imports_of("env.system", "wasi_snapshot_preview1.sock_open", "uuv.spawn")
    with pytest.raises(FmuError, match=r"x\.fmu: its WebAssembly imports env\.system, uuv\.spawn,"):
        define_imports(linker, Host(1 << 20), imports, "x.fmu")  # type: ignore[arg-type]


def test_each_refusal_is_noted_once() -> None:
    host = Host(1 << 20)
    for name in ("a", "b", "a"):
        host.refused(name, f"it tried to call {name}()")
    assert host.notes == [
        f"it tried to call {name}(), which WebAssembly refuses" for name in ("a", "b")
    ]
