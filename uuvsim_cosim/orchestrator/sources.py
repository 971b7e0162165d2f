"""What a source string stands for: something that can be described, and made a live component.

=============================  ====================================================
``hull.fmu``                   an FMU
``my.py:MyController``         a Python class in a file, or ``package.module:Class``
``model:vehicle?id=…&set=…``   a declaration of this package, with its options
``lqr``, ``remus100@…``        the same by its bare name, options allowed; ``mpc_ipopt`` is Python
``vehicle.ssd``, ``.ssp``      a nested system
``current.csv``                a table whose columns over time are outputs
``<scheme>:…``                 what an entry point of group ``uuvsim_cosim.sources`` names
=============================  ====================================================
"""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.read_description import FmuArchive
    from uuvsim_cosim.fmus.trace import Trace
    from uuvsim_cosim.models.model import Model
    from uuvsim_cosim.orchestrator.system import System

__all__ = ["Backend", "FmuSource", "ModelSource", "PythonSource", "Source", "SystemSource",
           "anchored",
    "register", "resolve"]  # fmt: skip

Backend = Literal["fmu", "native"]
ENTRY_POINTS = "uuvsim_cosim.sources"


class Source(Protocol):
    """A resolved source; `text` resolves to the same thing from any folder."""

    @property
    def text(self) -> str:
        """Give the source string, with absolute paths."""

    @property
    def kind(self) -> str:
        """Give one word for tables and diagrams: FMU, model, Python, …."""

    def describe(self) -> Description:
        """Give the interface, without running anything foreign if that can be."""

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make a live component."""


Factory = Callable[[str, Path], Source]
_factories: dict[str, Factory] = {}
_descriptions: dict[tuple[str, int], Description] = {}
_systems: dict[tuple[str, int], System] = {}
_archives: dict[tuple[str, int], FmuArchive] = {}


def register(scheme: str, factory: Factory) -> None:
    """Let ``<scheme>:…`` be resolved by `factory`, as an entry point would."""
    _factories[scheme] = factory


def resolve(source: str, base: Path | None = None) -> Source:
    """Find out what a source string stands for; relative files lie in `base`."""
    base = Path() if base is None else base
    scheme, colon, _ = source.partition(":")
    if colon and scheme == "model":
        return ModelSource(source)
    if colon and scheme == "function":
        from uuvsim_cosim.orchestrator.osp_functions import FunctionSource

        return FunctionSource(source)
    if colon and (factory := _factory(scheme)) is not None:
        return factory(source, base)
    suffix = Path(source.partition("#")[0]).suffix.lower()
    if suffix == ".fmu":
        return FmuSource(_file(source, base, "an FMU"))
    if suffix == ".csv":
        from uuvsim_cosim.orchestrator.table_source import TableSource

        return TableSource(_file(source, base, "a table"))
    if suffix in (".ssd", ".ssp"):
        file, _, variant = source.partition("#")
        return SystemSource(_file(file, base, "a system"), variant)
    target, colon, name = source.rpartition(":")
    if colon and name.isidentifier():
        if target.endswith(".py"):
            return PythonSource(f"{_file(target, base, 'a Python file')}:{name}")
        if re.fullmatch(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", target):
            return PythonSource(source)
    if (bare := _BARE.fullmatch(source)) is not None:
        return _named(source, bare[1])
    raise InputInvalid(
        f"source {source!r} is of no known kind; expected a .fmu, .ssd, .ssp or .csv file, "
        f"FILE.py:Class, package.module:Class, model:NAME?option=value"
        + "".join(f", {s}:…" for s in _schemes())
    )


def anchored(source: str, base: Path | None) -> str:
    """Give a source whose file is found from the current folder by its absolute path.

    So that what a user names is looked for where the user is, not beside a system that ships.
    The bare name of a model becomes what it stands for.
    """
    if (bare := _BARE.fullmatch(source)) is not None and _is_known(bare[1], source):
        return _named(source, bare[1]).text
    file, colon, name = source, "", ""
    if Path(source.partition("#")[0]).suffix.lower() not in _SUFFIXES:
        file, colon, name = source.rpartition(":")
    elif "#" in source:
        file, colon, name = source.partition("#")
    path = Path(file).expanduser()
    if base is None or not file or path.is_absolute() or not path.is_file():
        return source
    return f"{path.absolute()}{colon}{name}"


@dataclass(frozen=True)
class FmuSource:
    """An FMU in a file."""

    path: Path
    kind: str = "FMU"

    @property
    def text(self) -> str:
        """Give the absolute path."""
        return str(self.path)

    def describe(self) -> Description:
        """Read the model description; cached until the file changes."""
        return _cached(self.path, str(self.path), lambda: _read_fmu(self.path))

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Load the binary and make an instance."""
        from uuvsim_cosim.fmus.instantiate import instantiate_fmu

        return instantiate_fmu(_archive(self.path), path)

    def traced(self, path: str, trace: Trace) -> Component:
        """Make an instance in this process that writes each of its calls."""
        from uuvsim_cosim.fmus.trace import instantiate_traced

        return instantiate_traced(_archive(self.path), path, trace)


@dataclass(frozen=True)
class PythonSource:
    """A Python class with `inputs`, `outputs` and ``step(t, dt, u)``; `text` is ``where:Class``."""

    text: str
    kind: str = "Python"

    def describe(self) -> Description:
        """Give the interface that the class declares; cached until its file changes."""
        where = self.text.rpartition(":")[0]
        path = Path(where) if where.endswith(".py") else None
        return _cached(path, self.text, lambda: self.instantiate("description").description)

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make an instance of the class."""
        from uuvsim_cosim.orchestrator.python_component import load_python_component

        return load_python_component(self.text, path)


@dataclass(frozen=True)
class ModelSource:
    """A declaration of this package: ``model:<name>?<option>=<value>&…``."""

    text: str
    kind: str = "model"

    def declare(self) -> Model:
        """Give the declaration."""
        from uuvsim_cosim.models.library import declare_source

        return declare_source(self.text)

    def describe(self) -> Description:
        """Describe the declaration; needs no compiler."""
        from uuvsim_cosim.fmus.describe import describe

        return _cached(None, self.text, lambda: describe(self.declare()))

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Compile the declaration: exported as an FMU and loaded, or native in this process."""
        if backend == "native":
            from uuvsim_cosim.fmus.native import Native

            return Native(self.declare(), path)
        from uuvsim_cosim.fmus.export import build_fmu

        return FmuSource(build_fmu(self.declare(), fmi=3)).instantiate(path)


@dataclass(frozen=True)
class SystemSource:
    """A nested system in an .ssd or .ssp file, of which `variant` is one."""

    path: Path
    variant: str = ""
    kind: str = "system"

    @property
    def text(self) -> str:
        """Give the absolute path, with the variant."""
        return f"{self.path}#{self.variant}" if self.variant else str(self.path)

    def system(self) -> System:
        """Read the system; cached until the file changes."""
        from uuvsim_cosim.orchestrator.library import load

        key = (self.text, _mtime(self.path))
        if key not in _systems:
            _systems[key] = load(self.text)
        return _systems[key]

    def describe(self) -> Description:
        """Describe the connectors that the system exposes."""
        return self.system().interface()

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Refuse: a system is flattened, not instantiated."""
        raise InputInvalid(f"{self.text}: a system is not one component; expected flatten() first")


# ---- adapters to what is written elsewhere --------------------------------------------------


def _read_fmu(path: Path) -> Description:
    from uuvsim_cosim.fmus.read_description import read_description

    return read_description(path)


def _archive(fmu: Path) -> FmuArchive:
    """Read an FMU once, until it changes: a further instance unpacks and checks nothing."""
    from uuvsim_cosim.fmus.read_description import read_fmu

    key = (str(fmu), _mtime(fmu))
    if key not in _archives or not _archives[key].folder.is_dir():
        _archives[key] = read_fmu(fmu)
    return _archives[key]


# ---- inside ---------------------------------------------------------------------------------

_SUFFIXES = (".fmu", ".ssd", ".ssp", ".csv")
_BARE = re.compile(r"([A-Za-z_][\w-]*(?:@\w+)?)(?:\?.*)?")


def _is_known(name: str, source: str) -> bool:
    from uuvsim_cosim.models.library import ALIASES, IN_PROCESS, LIBRARY
    from uuvsim_cosim.models.parameters import is_vehicle

    id = name.partition("@")[0]
    return source in IN_PROCESS or id in LIBRARY or id in ALIASES or is_vehicle(id)


def _named(source: str, name: str) -> Source:
    """Find a model by its bare name; near names for one that does not exist."""
    from uuvsim_cosim.models.library import ALIASES, IN_PROCESS, available

    if source in IN_PROCESS:
        return PythonSource(IN_PROCESS[source])
    if name in IN_PROCESS:
        raise InputInvalid(
            f"{name} is a Python component and takes no options; expected {name!r} alone, its "
            f"parameters set by name, or a class of your own derived from {IN_PROCESS[name]}"
        )
    if _is_known(name, source):
        return ModelSource(f"model:{source}")
    known = [*available(), *ALIASES, *IN_PROCESS]
    close = get_close_matches(name, known, n=3, cutoff=0.5)
    hint = f" (did you mean {', '.join(close)}?)" if close else ""
    raise InputInvalid(
        f"there is no model {name!r}{hint}; expected one that `uuvsim models` lists, a .fmu, "
        ".ssd or .ssp file, FILE.py:Class or package.module:Class"
    )


def _file(name: str, base: Path, what: str) -> Path:
    path = (base / Path(name.removeprefix("file:")).expanduser()).absolute()
    if path.is_file():
        return path
    there = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
    close = get_close_matches(path.name, there, n=3)
    hint = f"; close by: {', '.join(close)}" if close else ""
    raise InputInvalid(f"{path}: no such file; expected {what}{hint}")


def _mtime(path: Path) -> int:
    return path.stat().st_mtime_ns


def _cached(path: Path | None, text: str, read: Callable[[], Description]) -> Description:
    key = (text, 0 if path is None else _mtime(path))
    if key not in _descriptions:
        _descriptions[key] = read()
    return _descriptions[key]


def _schemes() -> list[str]:
    named = {e.name for e in importlib.metadata.entry_points(group=ENTRY_POINTS)}
    return sorted(named | set(_factories))


def _factory(scheme: str) -> Factory | None:
    if scheme not in _factories:
        for entry in importlib.metadata.entry_points(group=ENTRY_POINTS, name=scheme):
            _factories[scheme] = entry.load()
    return _factories.get(scheme)
