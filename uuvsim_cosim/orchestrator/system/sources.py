"""Sources of components: FMUs, Python classes, declarations of this package, nested systems."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.orchestrator.python.component import load_python_component
from uuvsim_cosim.orchestrator.system.elements import Structure
from uuvsim_cosim.orchestrator.system.formats import read_structure

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.codegen.lowering import Lowered
    from uuvsim_cosim.fmus.importer.read_description import FmuArchive
    from uuvsim_cosim.fmus.tracing.trace import Trace
    from uuvsim_cosim.models.declaration.model import Model

__all__ = ["Backend", "FmuSource", "ModelSource", "PythonSource", "Source", "SystemSource"]

Backend = Literal["fmu", "native"]


class Source(Protocol):
    """A resolved source; its `text` resolves to the same source from any folder."""

    @property
    def text(self) -> str:
        """Return the source string, with absolute paths."""

    @property
    def kind(self) -> str:
        """Return one word for tables and diagrams: FMU, model, Python, …."""

    def describe(self) -> Description:
        """Return the interface, if possible without running code of the source."""

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Instantiate the component `path`."""


_descriptions: dict[tuple[str, int], Description] = {}
_systems: dict[tuple[str, int], Structure] = {}
_archives: dict[tuple[str, int], FmuArchive] = {}


@dataclass(frozen=True)
class FmuSource:
    """An FMU in a file."""

    path: Path
    options: tuple[tuple[str, str], ...] = ()  # interface, and structural parameters as text
    kind: str = "FMU"

    @property
    def text(self) -> str:
        """Return the absolute path, with the options."""
        options = "&".join(f"{name}={value}" for name, value in self.options)
        return f"{self.path}#{options}" if options else str(self.path)

    def describe(self) -> Description:
        """Read the model description; cached until the file changes."""
        return _cached(self.path, self.text, lambda: _archive(self).description)

    def structured(self, start: Mapping[str, object]) -> FmuSource:
        """Return the source with the structural parameters that are among start values."""
        import numpy as np

        variables = self.describe().variables
        found: dict[str, str] = {}  # values as texts
        for name, value in start.items():
            if name in variables and variables[name].causality == "structuralParameter":
                flat = np.asarray(getattr(value, "value", value)).ravel().tolist()
                texts = [str(x).lower() if isinstance(x, bool) else str(x) for x in flat]
                found[name] = ",".join(texts)
        options = {**dict(self.options), **found}
        return replace(self, options=tuple(options.items())) if found else self

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Load the binary and make an instance."""
        from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

        return instantiate_fmu(_archive(self), path)

    def traced(self, path: str, trace: Trace) -> Component:
        """Make an instance in this process that writes each of its calls."""
        from uuvsim_cosim.fmus.tracing.trace import instantiate_traced

        return instantiate_traced(_archive(self), path, trace)


@dataclass(frozen=True)
class PythonSource:
    """A Python class with `inputs`, `outputs` and ``step(t, dt, u)``; `text` is ``where:Class``."""

    text: str
    kind: str = "Python"

    def describe(self) -> Description:
        """Return the interface that the class declares; cached until its file changes."""
        where = self.text.rpartition(":")[0]
        path = Path(where) if where.endswith(".py") else None
        return _cached(path, self.text, lambda: self.instantiate("description").description)

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make an instance of the class."""
        return load_python_component(self.text, path)


@dataclass
class _Declared:
    """A declaration, with its description and its C code, which are made at the first use."""

    model: Model

    @cached_property
    def description(self) -> Description:
        from uuvsim_cosim.fmus.codegen.describe import describe

        return describe(self.model)

    @cached_property
    def lowered(self) -> Lowered:
        from uuvsim_cosim.fmus.codegen.lowering import lower

        return lower(self.model)


@shared_until_changed
def _declared(source: ModelSource) -> _Declared:
    return _Declared(source.declaration())


@dataclass(frozen=True)
class ModelSource:
    """A declaration of this package: ``model:<name>?<option>=<value>&…``."""

    text: str
    kind: str = "model"

    def declare(self) -> Model:
        """Return the declaration, the same object until a file that it reads changes."""
        return _declared(self).model

    def declaration(self) -> Model:
        """Make a new declaration; subclasses for other declarations override this."""
        from uuvsim_cosim.models.declaration.library import declare_source

        return declare_source(self.text)

    def lowered(self) -> Lowered:
        """Return the declaration with its generated C, shared like the declaration."""
        return _declared(self).lowered

    def describe(self) -> Description:
        """Describe the declaration; needs no compiler."""
        return _declared(self).description

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Compile the declaration: exported as an FMU and loaded, or native in this process."""
        if backend == "native":
            from uuvsim_cosim.fmus.codegen.native import Native

            return Native(self.lowered(), path)
        from uuvsim_cosim.fmus.export.fmu_file import build_fmu

        return FmuSource(build_fmu(self.lowered(), fmi=3)).instantiate(path)


@dataclass(frozen=True)
class SystemSource:
    """A nested system in an .ssd or .ssp file, of which `variant` is one."""

    path: Path
    variant: str = ""
    kind: str = "system"

    @property
    def text(self) -> str:
        """Return the absolute path, with the variant."""
        return f"{self.path}#{self.variant}" if self.variant else str(self.path)

    def system(self) -> Structure:
        """Read the system; cached until the file changes."""
        key = (self.text, _mtime(self.path))
        if key not in _systems:
            _systems[key] = read_structure(self.path, self.variant)
        return _systems[key]

    def describe(self) -> Description:
        """Describe the connectors that the system exposes."""
        return self.system().interface()

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Raise InputInvalid: a system is flattened, not instantiated."""
        raise InputInvalid(self.text, "a system is not one component", "flatten() first")


# ---- inside -----------------------------------------------------------------------------------


def _archive(fmu: FmuSource) -> FmuArchive:
    """Read an FMU once until it changes, so that other instances need no unpacking and checks."""
    from uuvsim_cosim.fmus.importer.read_description import read_fmu

    key = (fmu.text, _mtime(fmu.path))
    if key not in _archives or not _archives[key].folder.is_dir():
        structure = dict(fmu.options)
        interface = structure.pop("interface", None)
        _archives[key] = read_fmu(fmu.path, interface, structure)
    return _archives[key]


def _mtime(path: Path) -> int:
    return path.stat().st_mtime_ns


def _cached(path: Path | None, text: str, read: Callable[[], Description]) -> Description:
    key = (text, 0 if path is None else _mtime(path))
    if key not in _descriptions:
        _descriptions[key] = read()
    return _descriptions[key]
