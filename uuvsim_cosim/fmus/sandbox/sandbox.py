"""Instantiation of an FMU as WebAssembly in this process, without files, network and processes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.isolation.grants import Grants
from uuvsim_cosim.fmus.isolation.isolated import check_watchdog
from uuvsim_cosim.fmus.model_exchange.component import ModelExchange
from uuvsim_cosim.fmus.sandbox.host import Host
from uuvsim_cosim.fmus.sandbox.library import SandboxLibrary
from uuvsim_cosim.fmus.sandbox.sources import module_of_sources

__all__ = ["can_be_sandboxed", "instantiate_sandboxed"]


def can_be_sandboxed(archive: FmuArchive) -> bool:
    """Return whether an FMU comes with what a sandbox of WebAssembly can run."""
    return archive.sources is not None


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
    ``memory:SIZE``, of which a module has at most 4 GiB. Raises FmuError for an FMU that has
    neither, ToolchainError without wasmtime, and InputInvalid for other grants.
    """
    if watchdog is not None:
        check_watchdog(watchdog)
    granted = Grants.of(grants)
    if granted != Grants(memory=granted.memory):
        raise InputInvalid(
            f"grants {path}", ", ".join(grants), "memory:SIZE only, or isolation in a process"
        )
    host = Host(granted.memory)
    library = partial(SandboxLibrary, module_of_sources(archive), watchdog, host)
    version = Fmu2 if archive.description.kind == "FMI 2.0" else Fmu3
    fmu = version(archive, path, logging_on=logging_on, library=library)
    host.note = fmu.remark
    for text in host.notes:
        fmu.remark(text)
    return ModelExchange(fmu) if archive.interface == "ModelExchange" else fmu
