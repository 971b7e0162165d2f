"""Sources of components: FMUs, Python classes, declarations, sums, tables, nested systems."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol
from urllib.parse import parse_qsl

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.importer.input_csv import Series, read_input_csv
from uuvsim_cosim.models.declaration.files_read import (
    Stamp,
    kept_until_changed,
    noted_result,
    shared_until_changed,
    stamp,
)
from uuvsim_cosim.orchestrator.python.component import PythonComponent, load_python_component
from uuvsim_cosim.orchestrator.system.elements import Structure
from uuvsim_cosim.orchestrator.system.formats import read_structure

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.codegen.lowering import Lowered
    from uuvsim_cosim.fmus.codegen.native import Native
    from uuvsim_cosim.fmus.importer.read_description import FmuArchive
    from uuvsim_cosim.fmus.instantiation.instantiate import Isolation
    from uuvsim_cosim.fmus.tracing.trace import Trace
    from uuvsim_cosim.models.declaration.model import Model

__all__ = [
    "Backend",
    "FmuSource",
    "FunctionSource",
    "ModelSource",
    "PythonSource",
    "Source",
    "SystemSource",
    "TableSource",
    "sum_source",
]

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


_classes: dict[tuple[str, Stamp], Description] = {}  # of Python classes
_systems: dict[tuple[str, Stamp], Structure] = {}
_archives: dict[tuple[str, Stamp], FmuArchive] = {}


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
        return _archive(self).description

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

    def with_event_mode(self, path: str) -> Component:
        """Make an instance in this process that uses Event Mode."""
        from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

        return instantiate_fmu(replace(_archive(self), events=True), path)

    def limited(
        self, path: str, way: Isolation, watchdog: float | None, grants: Iterable[str]
    ) -> Component:
        """Make an instance as WebAssembly, or in a process that is a sandbox."""
        from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_limited

        return instantiate_limited(_archive(self), path, way, watchdog=watchdog, grants=grants)

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
        key = (self.text, stamp(Path(where)) if where.endswith(".py") else None)
        if key not in _classes:
            _classes[key] = self.instantiate("description").description
        return _classes[key]

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make an instance of the class."""
        return load_python_component(self.text, path)


@dataclass
class _Declared:
    """A declaration, with its description and its C code, which are made at the first use."""

    model: Model
    _natives: dict[str, Native] = field(default_factory=dict)  # the first one of each compiler

    @cached_property
    def description(self) -> Description:
        from uuvsim_cosim.fmus.codegen.describe import describe

        return describe(self.model)

    @cached_property
    def lowered(self) -> Lowered:
        from uuvsim_cosim.fmus.codegen.lowering import lower

        return lower(self.model)

    def native(self, path: str) -> Native:
        """Make a native component; the first one loads the library, which the others share."""
        from uuvsim_cosim.fmus.codegen.native import Native
        from uuvsim_cosim.fmus.codegen.toolchain import compiler

        identity = compiler()[1]
        first = self._natives.get(identity)
        if first is not None:
            return first.another(path)
        made = self._natives[identity] = Native(self.lowered, path)
        return made


@shared_until_changed
def _declared(source: ModelSource) -> _Declared:
    return _Declared(source.declaration())


@kept_until_changed
def _description(text: str) -> Description:
    """Return the description of a declaration of this package; most runs need no more of it."""
    return _declared(_of_text(text)).description


@kept_until_changed
def _fmu(text: str) -> Path:
    """Return the FMU of a declaration; the text begins with the compiler's identity."""
    from uuvsim_cosim.fmus.export.fmu_file import build_fmu

    return noted_result(build_fmu(_of_text(text.partition("\n")[2]).lowered(), fmi=3))


def _of_text(text: str) -> ModelSource:
    return FunctionSource(text) if text.startswith("function:") else ModelSource(text)


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
        if type(self) not in (ModelSource, FunctionSource):  # its text alone does not name it
            return _declared(self).description
        return _description(self.text)

    def fmu(self) -> Path:
        """Return the declaration as an FMU in the cache, built if necessary; see `build_fmu`."""
        from uuvsim_cosim.fmus.codegen.toolchain import compiler

        if type(self) not in (ModelSource, FunctionSource):
            from uuvsim_cosim.fmus.export.fmu_file import build_fmu

            return build_fmu(self.lowered(), fmi=3)
        return _fmu(f"{compiler()[1]}\n{self.text}")

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Compile the declaration: exported as an FMU and loaded, or native in this process."""
        if backend == "native":
            return _declared(self).native(path)
        return FmuSource(self.fmu()).instantiate(path)


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
        key = (self.text, stamp(self.path))
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

    key = (fmu.text, stamp(fmu.path))
    if key not in _archives or not _archives[key].folder.is_dir():
        structure = dict(fmu.options)
        interface = structure.pop("interface", None)
        _archives[key] = read_fmu(fmu.path, interface, structure)
    return _archives[key]


_LIMIT = 10_000


def sum_source(inputs: int, dimension: int = 1) -> str:
    """Return the source of a sum of `inputs` vectors of `dimension` elements."""
    return f"function:sum?inputs={inputs}&dimension={dimension}"


@dataclass(frozen=True)
class FunctionSource(ModelSource):
    """Sum of signals: ``function:sum?inputs=3&dimension=2`` is y_j = u_1j + u_2j + u_3j.

    A sum is a component of this package, so it runs natively, is packed as an FMU, and is fused.
    """

    def declaration(self) -> Model:
        """Return the declaration of the function."""
        name, _, query = self.text.removeprefix("function:").partition("?")
        options = dict(parse_qsl(query, keep_blank_values=True))
        given = [options.pop("inputs", ""), options.pop("dimension", "1")]
        inputs, dimension = (int(t) if t.isdecimal() and len(t) < 6 else 0 for t in given)
        if name != "sum" or options or not 0 < inputs * dimension <= _LIMIT:
            raise InputInvalid(f"function {self.text!r}", "'function:sum?inputs=3'")
        from uuvsim_cosim.models.declaration.model import Model

        m = Model(f"sum_{inputs}_{dimension}")
        shape = inputs * dimension if inputs * dimension > 1 else ()
        u = m.input("u", shape, unit="1", description="vectors, one after the other")
        y = u[:dimension]
        for i in range(1, inputs):
            y = y + u[i * dimension : (i + 1) * dimension]
        m.output("y", y, unit="1", description="their sum")
        return m


@dataclass(frozen=True)
class TableSource:
    """A table whose first column is the time [s]; the others are Float64 outputs without units.

    Between two times outputs are interpolated linearly; before the first and after the last they
    are held. Of two rows at one time the later one is used.
    """

    path: Path
    kind: str = "table"
    is_recorded: ClassVar[bool] = True

    @property
    def text(self) -> str:
        """Return the absolute path."""
        return str(self.path)

    def describe(self) -> Description:
        """Read the file for its columns; raises InputInvalid by line and column."""
        return self.instantiate("description").description

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make a component whose outputs are the columns; the stepping loop calls Python for it."""
        series = _series(self.path)

        class Table:
            """Columns of a file over time."""

            inputs: ClassVar[dict[str, object]] = {}
            outputs: ClassVar[dict[str, object]] = dict.fromkeys(s.variable.name for s in series)

            def initialize(self, t: float) -> dict[str, float]:
                return {s.variable.name: float(s.at(t)) for s in series}

            def step(self, t: float, dt: float, u: dict[str, object]) -> dict[str, float]:
                return self.initialize(t + dt)

        Table.__name__ = Table.__qualname__ = self.path.stem
        return PythonComponent(Table, path)


def _series(path: Path) -> list[Series]:
    """Read the columns, named by the file itself."""
    import csv

    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = next((row for row in csv.reader(file) if any(row)), [])
    except (OSError, UnicodeDecodeError, csv.Error):
        header = []  # `read_input_csv` reports it
    names = [name.strip() for name in header[1:]]
    if header and not names:
        raise InputInvalid(path, f"only the column {header[0]!r}", "time and others")
    unnamed = next((c for c, name in enumerate(names, 2) if not name), None)
    if unnamed is not None:
        raise InputInvalid(f"{path}, line 1, column {unnamed}", "no name", "one")
    variables = {
        name: Variable(name, "Float64", "input", "continuous") for name in dict.fromkeys(names)
    }
    return read_input_csv(path, Description(path.stem, "python", variables))
