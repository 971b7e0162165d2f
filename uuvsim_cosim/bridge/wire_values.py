"""Values of variables as columns of float64 and back: what a door sends and takes."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from uuvsim_cosim.bridge.desk import SignalInfo
from uuvsim_cosim.errors import InputInvalid

__all__ = ["columns_of", "find", "json_of", "taken", "typed", "unpacked"]

_TEXT = ("String", "Binary", "Clock")


def find(schema: Mapping[str, SignalInfo], name: str) -> SignalInfo:
    """Look a variable up; raises InputInvalid with near names."""
    found = schema.get(name)
    if found is None:
        raise InputInvalid(f"signal {name!r} does not exist{near(name, schema)}")
    return found


def near(name: str, known: Iterable[str]) -> str:
    """Write the names that were perhaps meant."""
    names = difflib.get_close_matches(name, list(known), n=3, cutoff=0.5)
    return f"; near names: {', '.join(names)}" if names else ""


def columns_of(
    values: Mapping[str, Any], schema: Mapping[str, SignalInfo]
) -> tuple[list[dict[str, Any]], list[dict[str, str]], bytes]:
    """Give the columns (name, type, shape), the texts, and all numbers, each array row by row."""
    columns: list[dict[str, Any]] = []
    texts: list[dict[str, str]] = []
    parts: list[bytes] = []
    for name, value in values.items():
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            texts.append({"name": name, "value": _text(value)})
            continue
        info = schema.get(name)
        kind = info.type if info is not None else "Float64"
        columns.append({"name": name, "type": kind, "shape": list(array.shape)})
        parts.append(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return columns, texts, b"".join(parts)


def _text(value: Any) -> str:
    flat = np.asarray(value).ravel().tolist()
    return ", ".join(v.hex() if isinstance(v, bytes) else str(v) for v in flat)


def unpacked(columns: object, payload: bytes, schema: Mapping[str, SignalInfo]) -> dict[str, Any]:
    """Give the values that a request's columns name, from its payload."""
    if not isinstance(columns, list):
        raise InputInvalid("columns: expected a list of objects with name and shape")
    numbers = np.frombuffer(payload, dtype="<f8")
    values: dict[str, Any] = {}
    at = 0
    for entry in columns:
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str):
            raise InputInvalid(f"columns: {entry!r} was read; expected an object with a name")
        info = find(schema, name)
        size = _size(entry, info)
        if at + size > numbers.size:
            raise InputInvalid(
                f"{name}: {numbers.size - at} numbers are left in the payload; expected {size}"
            )
        values[name] = typed(info, numbers[at : at + size])
        at += size
    if at != numbers.size:
        raise InputInvalid(f"payload: {numbers.size} numbers were read; the columns name {at}")
    return values


def _size(entry: Mapping[str, Any], info: SignalInfo) -> int:
    shape = entry.get("shape", list(info.shape))
    shape = [shape] if isinstance(shape, int | float) else shape
    if not isinstance(shape, list) or not all(
        isinstance(n, int) and not isinstance(n, bool) and 0 <= n < 1 << 32 for n in shape
    ):
        raise InputInvalid(f"{info.name}: shape {shape!r} was read; expected {list(info.shape)}")
    return math.prod(shape)


def taken(values: object, schema: Mapping[str, SignalInfo]) -> dict[str, Any]:
    """Give the values of a JSON object, in the variables' shapes and types; texts as they are."""
    if not isinstance(values, dict):
        raise InputInvalid(f"values: {values!r} was read; expected an object of name: value")
    out: dict[str, Any] = {}
    for name, value in values.items():
        info = find(schema, name)
        if info.type in _TEXT or isinstance(value, str):  # a number with its unit: "0.4 km/h"
            if not isinstance(value, str):
                raise InputInvalid(f"{name}: {value!r} was read; expected a text")
            out[name] = value
            continue
        try:
            out[name] = typed(info, np.asarray(value, dtype=np.float64).ravel())
        except (TypeError, ValueError):
            raise InputInvalid(f"{name}: {value!r} was read; expected {_expected(info)}") from None
    return out


def typed(info: SignalInfo, numbers: np.ndarray) -> np.ndarray:
    """Give numbers in a variable's shape and type; raises InputInvalid if they do not fit."""
    size = math.prod(info.shape)
    if numbers.size != size:
        raise InputInvalid(
            f"{info.name}: {numbers.size} numbers were read; expected {_expected(info)}"
        )
    if info.type in _TEXT:
        raise InputInvalid(f"{info.name}: numbers were read; expected a text ({info.type})")
    shaped = numbers.reshape(info.shape)
    if info.type == "Float64":
        return shaped
    if info.type == "Float32":
        return shaped.astype(np.float32)
    if not np.all(shaped == np.floor(shaped)):  # NaN as well
        raise InputInvalid(f"{info.name}: {numbers.tolist()} was read; expected {_expected(info)}")
    dtype = np.dtype(np.bool_) if info.type == "Boolean" else _integer(info)
    low, high = 0, 1
    if info.type != "Boolean":
        limits = np.iinfo(dtype.name)
        low, high = int(limits.min), int(limits.max)
    if shaped.size and not (low <= shaped.min() and shaped.max() <= high):
        raise InputInvalid(f"{info.name}: {numbers.tolist()} was read; expected {low} to {high}")
    return shaped.astype(dtype)


def _integer(info: SignalInfo) -> np.dtype[Any]:
    try:
        return np.dtype("int64" if info.type == "Enumeration" else info.type.lower())
    except TypeError:
        raise InputInvalid(f"{info.name}: its type {info.type} cannot be set from here") from None


def _expected(info: SignalInfo) -> str:
    size = math.prod(info.shape)
    count = "1 number" if size == 1 else f"{size} numbers"
    return f"{count} of type {info.type}" + (f" in {info.unit}" if info.unit else "")


def json_of(value: Any) -> Any:
    """Give a value as JSON has it: lists, and null for a number that is NaN or infinite."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, Mapping):
        return {str(k): json_of(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return json_of(value.tolist())
    if isinstance(value, Sequence | frozenset | set) and not isinstance(value, str):
        return [
            json_of(v) for v in (sorted(value) if isinstance(value, frozenset | set) else value)
        ]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
