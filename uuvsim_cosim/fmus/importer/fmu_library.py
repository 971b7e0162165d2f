"""The shared library of an FMU for this platform; its functions are bound at their first use."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import os
import re
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.codegen.toolchain import Signatures, host
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.importer.source_code import compiled
from uuvsim_cosim.fmus.isolation.confinement import loads
from uuvsim_cosim.fmus.isolation.guard import Guarded

__all__ = ["FmuLibrary", "library_of"]


_addresses: dict[ctypes.CDLL, dict[str, int]] = {}
_finalized_at_exit: set[Path] = set()
_FMI1 = re.compile(rb"\0((?:[A-Za-z_]\w*_)?fmi)Instantiate(?:Slave|Model)\0")


class FmuLibrary:
    """A loaded library; `signatures` maps names without prefix to (result, arguments)."""

    addressable = True  # C may call the functions; if not, every call must go through `function`
    component = b""  # the path of the instance that calls, for `Guarded`

    def __init__(self, archive: FmuArchive, prefix: str, signatures: Signatures) -> None:
        self.archive = archive
        self.file = library_of(archive)
        self._prefix = prefix
        self._signatures = signatures
        self._bound: dict[str, Guarded] = {}
        loads()
        try:
            self._c = _loaded(self.file, self.file.stat().st_ino)
        except OSError as error:
            raise FmuError(
                archive.path,
                f"its library {self.file.name} cannot be loaded ({error})",
                "one that this machine can load",
            ) from None
        # The libraries of pythonfmu and pythonfmu3 clear a global from a destructor that runs after
        # that global's own: freed memory is written, and the process may abort at its end. If the
        # same function is called earlier, it is harmless, and so is the destructor then.
        finalize = getattr(self._c, "finalizePythonInterpreter", None)
        if finalize is not None and self.file not in _finalized_at_exit:
            _finalized_at_exit.add(self.file)
            finalize.restype, finalize.argtypes = None, ()
            atexit.register(finalize)

    def function(self, name: str) -> Callable[..., Any]:
        """Bind a function at its first use; raises FmuError if the FMU does not export it."""
        bound = self._bound.get(name)
        if bound is None:
            full = f"{self._prefix}{name}".encode()
            bound = self._bound[name] = Guarded(self._raw(name), self.component, full)
        return bound

    def _raw(self, name: str) -> Any:
        """Find a function; in compiled sources, the model's name may precede its own."""
        of_sources = "" if self.archive.sources is None else f"{self.archive.model_identifier}_"
        for prefix in ("", of_sources):
            with contextlib.suppress(AttributeError):
                found = self._c[f"{prefix}{self._prefix}{name}"]
                found.restype, found.argtypes = self._signatures[name]
                return found
        raise FmuError(
            f"{self.archive.path}: does not export {self._prefix}{name}, which is needed"
            f"{self._other_prefix()}"
        )

    def _other_prefix(self) -> str:
        """Return the prefix of the functions that an FMU of FMI 1.0 exports, if it is wrong."""
        if self.archive.description.kind != "FMI 1.0":
            return ""
        found = {m[1].decode() for m in _FMI1.finditer(self.file.read_bytes())}
        if not found or self._prefix in found:
            return ""
        return (
            f"; its functions begin with {' and '.join(sorted(found))} instead, but FMI 1.0 "
            f"begins them with the modelIdentifier {self.archive.model_identifier!r}"
        )

    def has(self, name: str) -> bool:
        """Return whether the FMU exports a function."""
        try:
            self.function(name)
        except FmuError:
            return False
        return True

    def addresses(self) -> dict[str, int]:
        """Return the addresses of all functions that the FMU exports, by name without prefix.

        ``FindValues`` and ``DoSteps`` are those of an FMU of this package (see `Binding`).
        """
        if self._c not in _addresses:
            found = {name: self._raw(name) for name in self._signatures if self.has(name)}
            with contextlib.suppress(AttributeError):
                found["FindValues"] = self._c["uuv_values_1"]
                found["DoSteps"] = self._c[f"uuv_{self._prefix}_steps_1"]
            _addresses[self._c] = {
                name: ctypes.cast(f, ctypes.c_void_p).value or 0 for name, f in found.items()
            }
        return dict(_addresses[self._c])


@cache
def _loaded(file: Path, inode: int) -> ctypes.CDLL:
    """Load a library once; it stays loaded until the process ends."""
    if sys.platform == "win32":  # let the library find those in its folder
        with os.add_dll_directory(str(file.parent)):
            return ctypes.CDLL(str(file))
    return ctypes.CDLL(str(file))


def library_of(archive: FmuArchive) -> Path:
    """Find the binary for this platform, or compile the sources; raises FmuError."""
    machine = host()
    folders = [machine.fmi3]
    if archive.description.kind != "FMI 3.0":
        folders.insert(0, machine.fmi2)
        if machine.suffix == ".dylib":
            folders.append("darwin64")  # universal binaries
    for folder in folders:
        file = archive.folder / "binaries" / folder / (archive.model_identifier + machine.suffix)
        if file.is_file():
            return file
    if archive.sources is not None:
        return compiled(archive.path, archive.folder, archive.model_identifier, archive.sources)
    there = ", ".join(archive.binaries) or "none, and no sources that are listed"
    raise FmuError(f"{archive.path}: no binary for this platform, {folders[0]}; there are: {there}")
