"""Checks of YAML files: the JSON schema of a file, and the deeper checks of the code that reads it.

The schema finds every key and value of a wrong form. The readers know the system, the vehicle and
the units, and have messages with close names. A mistake that both find is reported once, with the
reader's message.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from fnmatch import fnmatch
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.declaration.modeline import PATTERNS, schema_in, schemas
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import line_of, schema_mistakes
from uuvsim_cosim.models.declaration.yaml_text import YamlText

__all__ = ["Mistake", "mistakes_in", "schema_of", "yaml_files"]

EXPECTED = "a YAML file (.yaml or .yml)"
MOST_BYTES = 5_000_000  # of a file that is checked
_OTHER = re.compile(r"(.+?\.ya?ml):(?:(\d+):)? (.*)", re.S)
_UNKNOWN = re.compile(r"([^:]+): unknown; expected one such as (.*)")
_MISSING = re.compile(r"([^:]+): (?:has no (\w+);|'(\w+)' is a required property;|(\w+) missing;)")
_PLACE = re.compile(r"([\w.*-]+(?:\[[^\]]*\])?): ")


class Mistake(NamedTuple):
    """One mistake: the file, the line from 1, and the message."""

    file: Path
    line: int
    message: str


def yaml_files(named: list[Path]) -> dict[Path, bool]:
    """Return the YAML files at paths, or else here, and whether each was named itself.

    Raises InputInvalid for other files, and for named paths without a YAML file. Folders are
    searched, except for those whose name begins with a dot and for `node_modules`.
    """
    found: dict[Path, bool] = {}
    for path in named or [Path()]:
        if path.is_file():
            if path.suffix.lower() not in (".yaml", ".yml"):
                raise InputInvalid(path, f"a file {path.suffix or 'without ending'}", EXPECTED)
            found[path] = True
        elif not path.is_dir():
            raise InputInvalid(path, "no such file or folder", f"{EXPECTED}, or a folder with some")
        else:
            for file in sorted(path.rglob("*")):
                parts = file.relative_to(path).parts
                hidden = any(part.startswith(".") or part == "node_modules" for part in parts)
                if file.suffix in (".yaml", ".yml") and not hidden and file.is_file():
                    found.setdefault(file, False)
    if named and not found:
        paths = ", ".join(map(str, named))
        raise InputInvalid(paths, "no YAML files", "a folder with .yaml or .yml files")
    return found


def schema_of(file: Path, text: str, data: object) -> str | None:
    """Return the name of a file's schema, by its modeline, its name or its keys; else None."""
    if (named := schema_in(text)) is not None:
        return named
    for schema, patterns in PATTERNS.items():
        if any(fnmatch(file.name, pattern) for pattern in patterns):
            return schema
    keys = {str(key) for key in data} if isinstance(data, Mapping) else set()
    best = max(schemas(), key=lambda name: _fit(name, keys))
    return best if _fit(best, keys) > 0 else None


def _fit(schema: str, keys: set[str]) -> float:
    """Return how well top-level keys fit a schema, 0 to 2; 0 if too few are known."""
    rules = _rules(schema)
    known, needed = set(rules.get("properties", ())), set(rules.get("required", ()))
    share = len(keys & known) / max(len(keys), 1)
    if share < 0.6 or (len(keys & known) < 3 and not (needed and needed <= keys)):
        return 0.0
    return share + len(keys & needed) / max(len(needed), 1)


def _rules(schema: str) -> Any:
    return json.loads(schemas()[schema].read_text(encoding="utf-8"))


def mistakes_in(file: Path, is_named: bool = True) -> list[Mistake] | None:
    """Return the mistakes in a file by line; also those of files that its reader reads with it.

    None for a file of another program; if the user named it, that is a mistake as well.
    """
    if (size := file.stat().st_size) > MOST_BYTES:
        read = f"{size / 1e6:.1f} MB, too large for a file of settings"
        return [Mistake(file, 1, f"{read}; expected at most {MOST_BYTES / 1e6:g} MB")]
    try:
        data = YamlText(file).data
        text = file.read_text(encoding="utf-8")
    except InputInvalid as error:
        return list(_of_error(file, None, error))
    schema = schema_of(file, text, data)
    if schema is None and not is_named:
        return None
    if schema not in schemas():
        read = "its form is not known" if schema is None else f"there is no schema {schema!r}"
        names = expected_names(schema or "", schemas())
        return [Mistake(file, 1, f"{read}; expected a first line such as `# yaml-language-server: "
                         f"$schema=.schema/study.schema.json`, with {names}")]  # fmt: skip
    deeper: list[Mistake] = []
    try:
        if (read_file := _reader(schema, file, data)) is not None:
            read_file()
    except UuvsimError as error:
        deeper = list(_of_error(file, data, error))
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        pass  # the form of the file is wrong, and the schema reports that
    seen = {(m.line, _last_key(m.message)) for m in deeper if m.file == file}
    formal = [
        Mistake(file, line, message)
        for line, message in schema_mistakes(data, _rules(schema))
        if (line, _last_key(message)) not in seen
    ]
    if formal:  # a message without a line repeats one of the schema
        deeper = [m for m in deeper if m.line > 0]
    found = _without_consequences([*formal, *deeper])
    return sorted({m._replace(line=max(m.line, 1)) for m in found})


def _without_consequences(mistakes: list[Mistake]) -> Iterator[Mistake]:
    """Yield the mistakes except for keys that are missing because they are misspelt beside."""
    meant: set[tuple[str, str]] = set()  # (place, name that is close to an unknown one)
    for m in mistakes:
        if (unknown := _UNKNOWN.match(m.message)) is not None:
            place = unknown[1].rpartition(".")[0] or "the file"
            meant |= {(place, name) for name in unknown[2].split(", ")}
    for m in mistakes:
        lacking = _MISSING.match(m.message)
        name = "" if lacking is None else lacking[2] or lacking[3] or lacking[4]
        if lacking is None or (lacking[1], name) not in meant:
            yield m


def _reader(schema: str, file: Path, data: Any) -> Callable[[], object] | None:
    """Return the call that reads a file as a simulation does; None if only the schema applies."""
    if schema in ("vehicle", "thrusters", "fins", "control", "published", "checks") or (
        file.name == "propeller.yaml"
    ):
        return partial(_read_in_folder, schema, file)
    if schema == "preset" and data["kind"] != "controller":  # which all controllers share
        return partial(_declare, str(data["kind"]), file)
    if schema == "study":
        from uuvsim_cosim.studies.yaml_file import read_study

        return partial(read_study, file)
    if schema == "training" and find_spec("torch") is not None:
        from uuvsim_cosim.learn.training.config import read_config

        return partial(read_config, file)
    if schema == "curriculum":
        from uuvsim_cosim.learn.training.curriculum import read_curriculum

        return partial(read_curriculum, file)
    if schema == "access":
        from uuvsim_cosim.bridge.access.access_file import read_access

        return partial(read_access, file)
    if schema == "scenario":
        from uuvsim_cosim.orchestrator.scenarios.scenario import read_scenario

        return partial(read_scenario, file)
    if schema == "mapping":
        from uuvsim_cosim.scene.mapping.survey import read_settings

        return partial(read_settings, file)
    if schema == "scene":
        from uuvsim_cosim.models.worlds.scene import load_scene

        return partial(load_scene, file.parent) if file.name == "scene.yaml" else None
    return None


def _read_in_folder(schema: str, file: Path) -> None:
    """Read a vehicle's file: with its whole folder, or alone where there is no parameters.yaml."""
    from uuvsim_cosim.models.actuators.fins import read_fins
    from uuvsim_cosim.models.actuators.thruster_geometry import read_thrusters
    from uuvsim_cosim.models.declaration.parameter_files import vehicle_file
    from uuvsim_cosim.models.vehicles.check_vehicle_folder import read_folder

    if (file.parent / "parameters.yaml").is_file() and file.name in _NAMES_IN_FOLDER:
        read_folder(str(file.parent))
    elif schema == "vehicle":
        vehicle_file(str(file))
    elif schema == "thrusters":
        read_thrusters(file)
    elif schema == "fins":
        read_fins(file)


_NAMES_IN_FOLDER = {
    name
    for schema in ("vehicle", "thrusters", "fins", "control", "published", "checks")
    for name in PATTERNS[schema]
} | {"propeller.yaml"}


def _declare(kind: str, file: Path) -> None:
    """Declare the component that reads a preset, if the kind names one."""
    from inspect import signature

    from uuvsim_cosim.models.declaration.library import LIBRARY, declare
    from uuvsim_cosim.orchestrator.python.class_file import imported

    module, _, function = LIBRARY.get(kind, "").partition(":")
    if module and "id" in signature(getattr(imported(module, kind), function)).parameters:
        declare(kind, id=str(file))


def _of_error(file: Path, data: Any, error: UuvsimError) -> Iterator[Mistake]:
    """Yield the problems of an error that are about YAML files; line 0 if it is not known."""
    for problem in error.problems:
        text = str(problem)
        if not text.startswith(f"{file}:"):
            other = _OTHER.fullmatch(text)
            if other is not None and Path(other[1]).is_file():
                yield Mistake(Path(other[1]), int(other[2] or 1), other[3])
            elif (
                isinstance(error, InputInvalid)
                and str(file) not in text
                and len(error.problems) == 1
            ):
                yield Mistake(file, 0, text)
            continue
        rest = text.removeprefix(f"{file}:")
        numbered = re.match(r"(\d+): (.*)", rest, re.S)
        if numbered is not None:
            yield Mistake(file, int(numbered[1]), numbered[2])
            continue
        rest = rest.strip()
        place = _PLACE.match(rest)
        path = [int(p) if p.isdigit() else p for p in place[1].split(".")] if place else []
        yield Mistake(file, line_of(data, path) if path and path[0] in (data or ()) else 0, rest)


def _last_key(message: str) -> str:
    """Return the last key of the place with which a message begins."""
    found = _PLACE.match(message)
    return found[1].rpartition(".")[2] if found else message.partition(":")[0]
