"""Instantiation of an FMU as WebAssembly in this process, without files, network and processes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep
from uuvsim_cosim.errors import FmuError, InputInvalid
from uuvsim_cosim.fmus.codegen.toolchain import WASM32, host
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.export.component_binary import modules_of
from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.fmu_library import FmuLibrary
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.isolation.grants import Grants
from uuvsim_cosim.fmus.isolation.isolated import check_watchdog
from uuvsim_cosim.fmus.sandbox.component_library import ComponentLibrary
from uuvsim_cosim.fmus.sandbox.engine import require_wasmtime
from uuvsim_cosim.fmus.sandbox.host import Host
from uuvsim_cosim.fmus.sandbox.library import SandboxLibrary
from uuvsim_cosim.fmus.sandbox.sources import NoWebAssembly, module_of_sources
from uuvsim_cosim.fmus.scheduled_execution.component import component_of

__all__ = ["component_path", "instantiate_sandboxed", "only_web_assembly"]

_MARK = b"uuv_guest_fmi3"  # a function that modules of this package export


def only_web_assembly(archive: FmuArchive) -> bool:
    """Return whether an FMU has WebAssembly, but neither sources nor a binary for this machine."""
    here = {host().fmi2, host().fmi3} & {*archive.binaries}
    return archive.sources is None and not here and component_path(archive) is not None


def component_path(archive: FmuArchive) -> Path | None:
    """Return the component of an unpacked FMU; None if it has none."""
    file = archive.folder / "binaries" / WASM32.fmi3 / f"{archive.model_identifier}.wasm"
    return file if archive.description.kind == "FMI 3.0" and file.is_file() else None


def _library(archive: FmuArchive) -> tuple[Callable[..., FmuLibrary], Path]:
    """Return the kind of library, and its file.

    A component whose module has FMI's functions in C, as those of this package, is used as this
    module, because calls are faster then.
    """
    if archive.interface == "ScheduledExecution":
        read = "it cannot run as WebAssembly: it has Scheduled Execution only"
        raise NoWebAssembly(archive.path, read, "Co-Simulation or Model Exchange")
    component = component_path(archive)
    if component is None:
        return SandboxLibrary, module_of_sources(archive)
    data = component.read_bytes()
    modules = modules_of(data)
    if modules is None:
        raise FmuError(archive.path, f"{component.name} is no component", "one of FMI-LS-WASM")
    if not modules or _MARK not in modules[0]:
        return ComponentLibrary, component
    module = cache_dir("compiled", content_hash([data])) / component.name
    if not intact(module):
        keep(module, modules[0])
    return SandboxLibrary, module


def instantiate_sandboxed(
    archive: FmuArchive,
    path: str,
    *,
    watchdog: float | None = None,
    grants: Iterable[str] = (),
    logging_on: bool = True,
) -> Component:
    """Instantiate an FMU's WebAssembly, or its C sources compiled to it, as the component `path`.

    A call that takes longer than `watchdog` [s] is interrupted. `grants` may only contain
    ``memory:SIZE``, of which a module has at most 4 GiB. Raises NoWebAssembly for an FMU that
    cannot, ToolchainError without wasmtime, and InputInvalid for other grants.
    """
    require_wasmtime()
    if watchdog is not None:
        check_watchdog(watchdog)
    granted = Grants.of(grants)
    if granted != Grants(memory=granted.memory):
        raise InputInvalid(
            f"grants {path}", ", ".join(grants), "memory:SIZE only, or isolation in a process"
        )
    outside = Host(granted.memory)
    kind, file = _library(archive)
    library = partial(kind, file, watchdog, outside)
    version = Fmu2 if archive.description.kind == "FMI 2.0" else Fmu3
    fmu = version(archive, path, logging_on=logging_on, library=library)
    outside.note = fmu.remark
    for text in outside.notes:
        fmu.remark(text)
    return component_of(fmu)
