"""Parameter files: YAML with value, unit and source of each number, checked line by line."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.files_read import (
    kept_until_changed,
    noted,
    shared_until_changed,
)
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of, missing, near_names
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.units import parse_unit, value_conversion

__all__ = [
    "ParameterSet",
    "Quantity",
    "Size",
    "in_unit",
    "is_vehicle",
    "line_of",
    "parameter_set",
    "parsed_yaml",
    "propelled_ids",
    "read_yaml",
    "schema_mistakes",
    "size_alone",
    "split_address",
    "vehicle_file",
    "vehicle_folder",
    "vehicle_ids",
    "vehicle_sets",
    "vehicle_size",
]


@dataclass(frozen=True)
class Quantity:
    """One number in its unit, and where it was published."""

    value: float
    unit: str
    source: str


@dataclass(frozen=True)
class ParameterSet:
    """One published set of a vehicle's parameters, whole; sets are never mixed."""

    vehicle: str
    name: str
    is_default: bool
    citation: str
    quantities: Mapping[str, Quantity]


@dataclass(frozen=True)
class Size:
    """Outline of a vehicle: length, breadth, height, and where its middle is [m]."""

    length: float
    breadth: float
    height: float
    at: tuple[float, float, float]  # from CO in b
    shape: str  # box, torpedo or ellipsoid


def split_address(address: str) -> tuple[str, str | None]:
    """Return (vehicle, set) of an address such as ``bluerov2_heavy@wu_2018``."""
    vehicle, at, name = address.rpartition("@")
    if not at or "/" in name:  # an @ within the path of a folder
        return address, None
    return vehicle, name or None


def vehicle_ids() -> list[str]:
    """List the vehicles that are shipped: each folder that holds a parameter file."""
    return sorted(p.parent.name for p in content("models", "vehicles").glob("*/parameters.yaml"))


def propelled_ids() -> list[str]:
    """List the shipped vehicles with thrusters or a propeller: all but the gliders."""
    root = content("models", "vehicles")
    return [id for id in vehicle_ids() if (root / id / "thrusters.yaml").is_file()]


def is_vehicle(id: str) -> bool:
    """Return whether this is a shipped vehicle, a folder with a parameter file, or such a file."""
    return _folder(id) is not None


def vehicle_folder(id: str) -> Path:
    """Return the folder of a vehicle (``id`` or ``id@set``): a shipped one, or one by its path."""
    id, _ = split_address(id)
    folder = _folder(id)
    if folder is None:
        names = expected_names(id, vehicle_ids())
        raise ParameterInvalid(
            f"there is no vehicle {id!r}",
            f"{names}, the path of a folder with a parameters.yaml, or of such a file",
        )
    return folder


def _folder(id: str) -> Path | None:
    if id in vehicle_ids():
        return content("models", "vehicles", id)
    path = Path(id).expanduser()
    if id.endswith((".yaml", ".yml")):
        return path.parent
    is_path = bool(id) and (Path(id).name != id or Path(id).is_dir())
    return path if is_path and (path / "parameters.yaml").is_file() else None


def vehicle_size(id: str) -> Size | None:
    """Return the size of a vehicle, None if its file does not state it."""
    return _size(vehicle_file(id)[1])


def size_alone(path: Path) -> Size | None:
    """Return the size that a hull's file states, whatever else is wrong there; None without one."""
    try:
        return _size(_load(path)) if path.is_file() else None
    except (AttributeError, KeyError, TypeError, ValueError, ParameterInvalid):
        return None


def _size(data: Any) -> Size | None:
    if "size" not in data:
        return None
    size = data["size"]
    length, breadth, height, x, y, z = (
        in_unit(float(v), str(size["unit"]), "m")
        for v in [*size["value"], *size.get("at", [0] * 3)]
    )
    return Size(length, breadth, height, (x, y, z), str(size["shape"]))


def vehicle_sets(id: str) -> list[str]:
    """List the names of a vehicle's parameter sets, the default one first."""
    return [*_set_names(id)]


@kept_until_changed
def _set_names(id: str) -> tuple[str, ...]:
    data = vehicle_file(id)[1]
    return tuple(map(str, sorted(data["sets"], key=lambda name: name != data["default"])))


def parameter_set(id: str, set: str | None = None) -> ParameterSet:
    """Read one set of a vehicle, the default one unless named, each number in the model's unit."""
    data = vehicle_file(id)[1]
    name = set or str(data["default"])
    if name not in data["sets"]:
        raise ParameterInvalid(id, f"there is no parameter set {name!r}", ", ".join(data["sets"]))
    chosen = data["sets"][name]
    quantities = {}
    for key, entry in chosen["parameters"].items():
        meaning = meaning_of(key)
        assert meaning is not None  # the file has been checked
        value = in_unit(float(entry["value"]), str(entry["unit"]), meaning.unit)
        quantities[str(key)] = Quantity(value, meaning.unit, str(entry["source"]))
    default = name == data["default"]
    return ParameterSet(str(data["id"]), name, default, str(chosen["citation"]), quantities)


def in_unit(value: float, read: str, wanted: str) -> float:
    """Convert a value; raises ValueError if the units are not commensurable."""
    try:
        one = parse_unit(read)
    except ValueError as error:
        raise ValueError(f"{error}; expected {wanted!r} or one commensurable with it") from None
    other = parse_unit(wanted)
    pair = value_conversion(one, other)
    if pair is None:
        raise ValueError(f"unit {read!r}; expected {wanted!r} or one commensurable with it")
    factor, offset = pair
    return factor * value + offset


Mistakes = Callable[[Any], Iterator[tuple[int, str]]]


def read_yaml(path: Path, schema: str | Path, further: Mistakes | None = None) -> Any:
    """Read a YAML file that keeps to a schema (a name: of models/schema); mistakes by line.

    `further` yields mistakes that a schema cannot see; all are reported together.
    """
    data = _load(path)
    file = schema if isinstance(schema, Path) else content("models", "schema", schema)
    found = list(schema_mistakes(data, json.loads(noted(file).read_text(encoding="utf-8"))))
    try:
        deeper = list(further(data)) if further is not None else []
    except (AttributeError, KeyError, TypeError, ValueError):
        if not found:  # else it could look no further
            raise
        deeper = []
    known = {(line, text.partition(":")[0]) for line, text in deeper}
    found = [m for m in found if not ("unknown; " in m[1] and (m[0], _key(m[1])) in known)]
    if found or deeper:
        raise ParameterInvalid.of(f"{path}:{n}: {text}" for n, text in sorted([*found, *deeper]))
    return data


def schema_mistakes(data: Any, rules: Any) -> Iterator[tuple[int, str]]:
    """Yield (line, sentence) of each mistake that a JSON schema finds in a file that was read.

    What would be right is the schema's `expected`, else its `description`. An unknown key has a
    sentence of its own, with the names that are close to it.
    """
    from jsonschema import Draft202012Validator

    for error in Draft202012Validator(rules).iter_errors(data):
        path = list(error.absolute_path)
        place = ".".join(str(part) for part in path)
        if error.validator == "additionalProperties" and not error.validator_value:
            names = error.schema.get("properties", {})
            patterns = error.schema.get("patternProperties", ())
            for key in error.instance:
                if key in names or any(re.search(pattern, str(key)) for pattern in patterns):
                    continue
                hint = "; a number has a decimal point, no comma"
                hint = hint if isinstance(key, int | float) else ""
                text = f"{place}.{key}" if place else str(key)
                yield (
                    line_of(data, [*path, key]),
                    f"{text}: unknown; expected {expected_names(key, names)}{hint}",
                )
            continue
        expected = error.schema.get("expected") or error.schema.get(
            "description", f"{error.validator}: {error.validator_value}"
        )
        yield line_of(data, path), f"{place or 'the file'}: {error.message}; expected {expected}"


def _key(sentence: str) -> str:
    """Return the last key of the place with which a sentence begins."""
    return sentence.partition(":")[0].rpartition(".")[2]


def _load(path: Path) -> Any:
    try:
        text = noted(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterInvalid(f"{path}: cannot be read as YAML: {error}") from None
    return parsed_yaml(path, text)


def parsed_yaml(path: Path, text: str) -> Any:
    """Return the contents of YAML text with their lines; `path` is its file, for errors.

    Raises ParameterInvalid with the line.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        return YAML(typ="rt", pure=True).load(text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = str(error.problem or error.context).splitlines()[0]
        problem, twice, _ = problem.partition(" with value ")
        alias = re.fullmatch(r"found undefined alias '(.*)'", problem)
        if twice:
            wanted = "each name once"
        elif alias is not None:
            wanted = f"an anchor &{alias[1]} before it"
        elif problem.startswith(r"found character '\t'"):
            wanted = "spaces, since YAML does not allow tabs for indentation"
        else:
            wanted = "YAML"
        raise ParameterInvalid(f"{path}:{line}", problem, wanted) from None
    except YAMLError as error:
        raise ParameterInvalid(f"{path}: cannot be read as YAML: {error}") from None
    except RecursionError:
        wanted = "the few levels of a file of settings"
        raise ParameterInvalid(f"{path}:1", "too deeply nested", wanted) from None


def line_of(data: Any, path: list[Any]) -> int:
    """Return the line, from 1, of the element at `path` of what `read_yaml` gave."""
    line = 0
    for key in path:
        position = getattr(data, "lc", None)
        try:
            line = position.key(key)[0] if isinstance(data, Mapping) else position.item(key)[0]  # type: ignore[union-attr]
            data = data[key]
        except (AttributeError, KeyError, TypeError, IndexError):
            break
    return int(line) + 1


@shared_until_changed
def vehicle_file(id: str) -> tuple[Path, Any]:
    """Return a vehicle's parameter file and its contents, checked."""
    is_file = id.endswith((".yaml", ".yml"))
    path = Path(id).expanduser() if is_file else vehicle_folder(id) / "parameters.yaml"
    return path, read_yaml(path, "vehicle.schema.json", _mistakes)


def _mistakes(data: Any) -> Iterator[tuple[int, str]]:
    # It needs CasADi, and most commands read no vehicle's file, as their results are kept.
    from uuvsim_cosim.models.declaration.inertia import not_positive

    if data["default"] not in data["sets"]:
        known = ", ".join(data["sets"])
        yield line_of(data, ["default"]), f"default: {data['default']!r}; expected one of {known}"
    if "size" in data:
        try:
            in_unit(1.0, str(data["size"]["unit"]), "m")
        except ValueError as error:
            yield line_of(data, ["size"]), f"size: {error}"
    for name, chosen in data["sets"].items():
        gaps = list(missing(chosen["parameters"]))
        yield from ((line_of(data, ["sets", name]), f"sets.{name}: {text}") for text in gaps)
        numbers: dict[str, float] = {}
        for key, entry in chosen["parameters"].items():
            line = line_of(data, ["sets", name, "parameters", key])
            meaning = meaning_of(key)
            if meaning is None:
                yield line, f"{key}: not a parameter of a hull; expected {near_names(str(key))}"
                continue
            if not isinstance(entry.get("value"), int | float) or "unit" not in entry:
                continue  # the schema reports it
            try:
                value = in_unit(float(entry["value"]), str(entry["unit"]), meaning.unit)
            except ValueError as error:
                yield line, f"{key}: {error}"
                continue
            if not isfinite(value):
                yield line, f"{key}: {value}; expected a finite number"
                continue
            if meaning.min is not None and not value >= meaning.min:
                yield line, f"{key}: {value:g} {meaning.unit}; expected at least {meaning.min:g}"
                continue
            numbers[str(key)] = value
        yield from _outside(data, name, numbers)
        for key, text in not_positive([str(k) for k in chosen["parameters"]], numbers):
            place = ["parameters", key] if key else []
            yield line_of(data, ["sets", name, *place]), f"sets.{name}: {key or 'M'}: {text}"


def _outside(data: Any, name: str, numbers: Mapping[str, float]) -> Iterator[tuple[int, str]]:
    """Yield each coordinate of CG that lies outside the hull's size (a published CB may)."""
    try:
        size = _size(data)
    except ValueError:
        return
    if size is None:
        return
    extents = (size.length, size.breadth, size.height)
    for axis, at, extent in zip("xyz", size.at, extents, strict=True):
        key = f"{axis}_g"
        low, high = at - 0.5 * extent, at + 0.5 * extent
        if key in numbers and not low <= numbers[key] <= high:
            line = line_of(data, ["sets", name, "parameters", key])
            text = f"{key}: {numbers[key]:g} m, the centre of gravity outside the hull; expected "
            yield line, text + f"{low:g} to {high:g} m, of its size"
