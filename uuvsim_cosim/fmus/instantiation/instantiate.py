"""Instantiation of an .fmu as a component, in this process or in its own process."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.fmu_binary import lives_here
from uuvsim_cosim.fmus.importer.fmu_library import library_of
from uuvsim_cosim.fmus.importer.message_log import logger_library
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.importer.versions import version_of
from uuvsim_cosim.fmus.isolation.confinement import rules_of
from uuvsim_cosim.fmus.isolation.grants import Grants
from uuvsim_cosim.fmus.isolation.guard import guard_library
from uuvsim_cosim.fmus.isolation.isolated import Isolated
from uuvsim_cosim.fmus.sandbox.sandbox import instantiate_sandboxed, only_web_assembly
from uuvsim_cosim.fmus.sandbox.sources import NoWebAssembly
from uuvsim_cosim.fmus.scheduled_execution.component import component_of

__all__ = [
    "Isolation",
    "instantiate_fmu",
    "instantiate_isolated",
    "instantiate_limited",
    "needs_own_process",
]

# "preferred": as WebAssembly if the FMU can, otherwise in a separate process.
Isolation = Literal["process", "wasm", "preferred"]


def instantiate_fmu(
    fmu: Path | FmuArchive,
    path: str,
    *,
    isolate: bool = False,
    watchdog: float | None = None,
    logging_on: bool = True,
    grants: Iterable[str] = (),
    wait: bool = True,
) -> Component:
    """Instantiate an `fmu`, a file or one that was read, as the component `path`.

    It gets its own process if `isolate` is set, or if it cannot be in this process: a second
    instance of an FMU that allows only one, or an FMU made of a Python module whose name is in use.
    An isolated component that does not answer within `watchdog` [s] fails. With `isolate`, the
    process is a sandbox: the FMU may read its own files and those of the system, and `grants`, such
    as ``["files:/data", "network"]``, permit more (see `Grants`). Without `logging_on`, the FMU is
    asked not to log. An FMU that has WebAssembly, and nothing for this machine, runs as such (see
    `instantiate_sandboxed`). Without `wait`, the first call waits until an isolated FMU has
    started. Raises FmuError for an FMU that cannot be read or loaded.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.fmus import build_fmu, instantiate_fmu
    >>> battery = instantiate_fmu(build_fmu(uuv.declare("battery")), "battery")
    >>> battery.enter_initialization_mode(0.0, None)
    >>> battery.exit_initialization_mode()
    >>> f"{battery.get(battery.description.variables['voltage']):.2f} V"
    '16.80 V'
    >>> battery.free()
    """
    archive = fmu if isinstance(fmu, FmuArchive) else read_fmu(fmu)
    if isolate:
        return instantiate_isolated(
            archive, path, watchdog=watchdog, logging_on=logging_on, grants=grants, wait=wait
        )
    if only_web_assembly(archive):
        return instantiate_sandboxed(
            archive, path, watchdog=watchdog, grants=grants, logging_on=logging_on
        )
    library_of(archive)
    if needs_own_process(archive):
        arguments = (archive, path, logging_on)
        return Isolated(
            path, archive.description, instantiate_here, arguments, watchdog=watchdog, wait=wait
        )
    return instantiate_here(archive, path, logging_on)


def instantiate_isolated(
    archive: FmuArchive,
    path: str,
    *,
    watchdog: float | None = None,
    logging_on: bool = True,
    grants: Iterable[str] = (),
    wait: bool = True,
) -> Isolated:
    """Instantiate an FMU in a process that is a sandbox; see `instantiate_fmu`."""
    library_of(archive)  # compile sources here, as the watchdog would not wait for the compiler
    granted = Grants.of(grants)
    rules = None if granted.all else rules_of(granted, archive.folder)
    if rules is not None:  # the child cannot compile
        guard_library()
        logger_library()
    return Isolated(
        path,
        archive.description,
        instantiate_here,
        (archive, path, logging_on),
        watchdog=watchdog,
        wait=wait,
        rules=rules,
    )


def instantiate_limited(
    archive: FmuArchive,
    path: str,
    way: Isolation,
    *,
    watchdog: float | None = None,
    grants: Iterable[str] = (),
) -> Component:
    """Instantiate an FMU as WebAssembly or in a process that is a sandbox, by its `way`.

    An FMU that has nothing but WebAssembly is WebAssembly in every way. If "preferred" takes the
    process, the component's `lacking` has the reason. It does not wait for the start of a process.
    """
    why = ""
    if way != "process" or only_web_assembly(archive):
        try:
            return instantiate_sandboxed(archive, path, watchdog=watchdog, grants=grants)
        except NoWebAssembly as error:
            if way == "wasm" or only_web_assembly(archive):
                raise
            why = error.why
    made = instantiate_isolated(archive, path, watchdog=watchdog, grants=grants, wait=False)
    if why:
        made.lacking.append(f"{path} ({why}) is no WebAssembly: it has its own process")
    return made


def instantiate_here(archive: FmuArchive, path: str, logging_on: bool = True) -> Component:
    """Instantiate an FMU in this process; as WebAssembly if it has nothing else."""
    if only_web_assembly(archive):
        return instantiate_sandboxed(archive, path, logging_on=logging_on)
    fmu = version_of(archive)(archive, path, logging_on=logging_on)
    return component_of(fmu)


def needs_own_process(archive: FmuArchive) -> bool:
    """Return whether a (further) instance cannot be in this process.

    That is so for the second instance of an FMU that may exist once per process, and for an FMU
    made of a Python module whose name another module of this process has already.
    """
    if archive.description.can_be_instantiated_only_once and lives_here(archive):
        return True
    # pythonfmu and pythonfmu3 import resources/<module>.py by its bare name: a second module of
    # the same name would silently run the code of the first.
    resources = archive.folder / "resources"
    try:
        name = (resources / "slavemodule.txt").read_text(errors="replace").split("\n", 1)[0]
    except OSError:
        return False
    loaded = sys.modules.get(name.strip())
    if loaded is None:
        return name.strip() in sys.stdlib_module_names
    return Path(getattr(loaded, "__file__", None) or "").parent != resources
