"""Resolution of a source string to a source, which can be described and instantiated.

=============================  ====================================================
``hull.fmu``                   an FMU; ``hull.fmu#interface=ModelExchange&n=2`` chooses its
                               interface and sets structural parameters
``my.py:MyController``         a Python class in a file, or ``package.module:Class``
``model:vehicle?id=…&set=…``   a declaration of this package, with its options
``lqr``, ``remus100@…``        the same by its bare name, options allowed; ``mpc_ipopt`` is Python
``vehicle.ssd``, ``.ssp``      a nested system
``current.csv``                a table whose columns over time are outputs
``<scheme>:…``                 a source of an entry point of group ``uuvsim_cosim.sources``
=============================  ====================================================
"""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from urllib.parse import parse_qs, quote, unquote, urlsplit

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import did_you_mean
from uuvsim_cosim.models.declaration.parameter_files import vehicle_ids
from uuvsim_cosim.orchestrator.system.elements import Structure
from uuvsim_cosim.orchestrator.system.sources import (
    FmuSource,
    FunctionSource,
    ModelSource,
    PythonSource,
    Source,
    SystemSource,
    TableSource,
)

__all__ = [
    "REMARK",
    "anchored",
    "described_by",
    "is_recorded",
    "is_vehicle_path",
    "nested_structure",
    "proxy_file",
    "register",
    "remarks_of",
    "resolve",
    "with_vehicle_paths",
]

ENTRY_POINTS = "uuvsim_cosim.sources"

Factory = Callable[[str, Path], Source]
_factories: dict[str, Factory] = {}


def register(scheme: str, factory: Factory) -> None:
    """Let ``<scheme>:…`` be resolved by `factory`, as an entry point would."""
    _factories[scheme] = factory


def resolve(source: str, base: Path | None = None) -> Source:
    """Return the source that a source string names; relative files are in `base`."""
    base = Path() if base is None else base
    scheme, colon, _ = source.partition(":")
    if colon and scheme == "model":
        return ModelSource(with_vehicle_paths(source, lambda path: _beside(path, base)))
    if colon and scheme == "function":
        return FunctionSource(source)
    if colon and scheme not in _factories:
        for entry in importlib.metadata.entry_points(group=ENTRY_POINTS, name=scheme):
            _factories[scheme] = entry.load()
    if colon and scheme in _factories:
        return _factories[scheme](source, base)
    suffix = Path(source.partition("#")[0]).suffix.lower()
    if suffix == ".fmu":
        file, _, options = source.partition("#")
        path = _file(file, base, "an FMU")
        pairs = [part.partition("=") for part in options.split("&") if part]
        if any(not (name and equals and value) for name, equals, value in pairs):
            raise InputInvalid(
                f"source {source!r}: expected FILE.fmu#interface=ModelExchange, or names and "
                "values of structural parameters"
            )
        return FmuSource(path, tuple((name, value) for name, _, value in pairs))
    if suffix == ".csv":
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
    schemes = {e.name for e in importlib.metadata.entry_points(group=ENTRY_POINTS)}
    raise InputInvalid(
        f"source {source!r} is of an unknown kind; expected a .fmu, .ssd, .ssp or .csv file, "
        f"FILE.py:Class, package.module:Class, model:NAME?option=value"
        + "".join(f", {s}:…" for s in sorted(schemes | set(_factories)))
    )


def is_recorded(source: str, base: Path | None = None) -> bool:
    """Return whether a source has recorded values over time, and so reads no inputs."""
    return bool(getattr(resolve(source, base), "is_recorded", False))


def remarks_of(source: str, base: Path | None = None) -> tuple[str, ...]:
    """Return what a source of an entry point assumed when it was read, its `remarks`."""
    factory = _factories.get(source.partition(":")[0])
    found = None if factory is None else factory(source, Path() if base is None else base)
    return tuple(getattr(found, "remarks", ()))


def described_by(source: str, base: Path | None, start: Mapping[str, object]) -> Source:
    """Resolve the source of a component whose start values may set structural parameters."""
    found = resolve(source, base)
    return found.structured(start) if isinstance(found, FmuSource) else found


def anchored(source: str, base: Path | None) -> str:
    """Return a source with the absolute path of its file, if the current folder has that file.

    So a file that a user names is found in the user's folder, not beside a shipped system. The
    bare name of a model is replaced by its full source.
    """
    if (bare := _BARE.fullmatch(source)) is not None and _is_known(bare[1], source):
        source = _named(source, bare[1]).text
    if source.startswith("model:") and base is not None:
        return with_vehicle_paths(source, lambda path: _beside(path, Path(), base))
    if bare is not None:
        return source
    file, colon, name = source, "", ""
    if Path(source.partition("#")[0]).suffix.lower() not in _SUFFIXES:
        file, colon, name = source.rpartition(":")
        if not file.endswith(".py"):  # a scheme may have the name of a file: ardusub:?timeout=5
            return source
    elif "#" in source:
        file, colon, name = source.partition("#")
    path = Path(file).expanduser()
    if base is None or not file or path.is_absolute() or not path.is_file():
        return source
    return f"{path.absolute()}{colon}{name}"


def with_vehicle_paths(source: str, changed: Callable[[str], str]) -> str:
    """Return a ``model:`` source with its vehicles that are paths replaced by `changed` of them.

    A vehicle is the name of the source, ``model:folder@set``, or an option `id` or `vehicle`.
    """
    name, mark, query = source.removeprefix("model:").partition("?")
    parts = [("", name), *(p.partition("=")[::2] for p in query.split("&") if mark)]
    texts = []
    for key, value in parts:
        path, at, set_ = unquote(value).partition("@")
        new = changed(path) if key in ("", "id", "vehicle") and path else path
        text = value if new == path else quote(f"{new}{at}{set_}", safe="/:@~ ")
        texts.append(f"{key}={text}" if key else text)
    return f"model:{texts[0]}{mark}{'&'.join(texts[1:])}"


def _beside(path: str, folder: Path, other: Path | None = None) -> str:
    """Return the path of a vehicle in a `folder`, absolute; as it stands if it is not there.

    It stands, too, if the folder is the current one, or the `other` one.
    """
    there = folder / path
    if Path(path).is_absolute() or not is_vehicle_path(there):
        return path
    same = Path() if other is None else other
    if folder.absolute() == same.absolute() or path in vehicle_ids():
        return path
    return str(there.absolute())


def is_vehicle_path(path: Path) -> bool:
    """Return whether a path leads to a vehicle's folder, or to its file of parameters."""
    if path.suffix in (".yaml", ".yml"):
        return path.is_file()
    return (path / "parameters.yaml").is_file()


def nested_structure(source: str | Structure, base: Path | None) -> Structure | None:
    """Return the nested system of a source; None if it is a component."""
    if not isinstance(source, str):
        return source
    if not source.partition("#")[0].lower().endswith((".ssd", ".ssp")):
        return None
    found = resolve(source, base)
    return found.system() if isinstance(found, SystemSource) else None


# ---- inside ---------------------------------------------------------------------------------

_SUFFIXES = (".fmu", ".ssd", ".ssp", ".csv")
_BARE = re.compile(r"([A-Za-z_][\w-]*(?:@\w+)?)(?:\?.*)?")


def _is_known(name: str, source: str) -> bool:
    from uuvsim_cosim.models.declaration.library import ALIASES, IN_PROCESS, LIBRARY
    from uuvsim_cosim.models.declaration.parameter_files import is_vehicle

    id = name.partition("@")[0]
    return source in IN_PROCESS or id in LIBRARY or id in ALIASES or is_vehicle(id)


def _named(source: str, name: str) -> Source:
    """Return the source of a model's bare name; raises InputInvalid with similar names."""
    from uuvsim_cosim.models.declaration.library import ALIASES, IN_PROCESS, available

    if source in IN_PROCESS:
        return PythonSource(IN_PROCESS[source])
    if name in IN_PROCESS:
        raise InputInvalid(
            f"{name} is a Python component and takes no options",
            (
                f"{name!r} alone, its parameters set by name, or a class of your "
                f"own derived from {IN_PROCESS[name]}"
            ),
        )
    if _is_known(name, source):
        return ModelSource(f"model:{source}")
    known = [*available(), *ALIASES, *IN_PROCESS]
    raise InputInvalid(
        f"there is no model {name!r}{did_you_mean(name, known)}",
        (
            "one that `uuvsim models` lists, a .fmu, .ssd or .ssp file, "
            "FILE.py:Class or package.module:Class"
        ),
    )


def _file(name: str, base: Path, what: str) -> Path:
    path = (base / Path(name.removeprefix("file:")).expanduser()).absolute()
    if path.is_file():
        return path
    files = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
    raise InputInvalid(path, f"no such file{did_you_mean(path.name, files)}", what)


REMARK = "the file of proxyfmu is read; --isolate runs it in a separate process"


def proxy_file(source: str) -> str | None:
    """Return the file that a proxyfmu URI names, None for any other source.

    Raises InputInvalid for one on another machine, or without a file.
    """
    if not source.lower().startswith("proxyfmu:"):
        return None
    parts = urlsplit(source)
    file = parse_qs(parts.query).get("file", [""])[0]
    if (parts.hostname or "localhost") not in ("localhost", "127.0.0.1") or not file:
        raise InputInvalid(
            f"source {source!r}",
            "an FMU, or proxyfmu://localhost?file=…: nothing is run on other machines",
        )
    return unquote(file.replace("file:///", "/"))
