"""Conversion of variables' values to columns of numbers or to JSON, and back."""

from __future__ import annotations

import json
import math
import mmap
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from uuvsim_cosim.bridge.calls.service import SignalInfo
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.models.declaration.near_names import did_you_mean

__all__ = [
    "columns_of", "find", "format_of", "json_of", "json_texts", "numbers_of", "pieces",
    "shaped", "shown", "unpacked",
]  # fmt: skip

_INTEGERS = {"Int64": "int64", "UInt64": "uint64", "Enumeration": "int64"}
_EXACT = 1 << 53  # float64 represents all integers up to this one exactly
_PIECE = 1 << 13  # numbers that are converted at once; other threads wait meanwhile


def find(schema: Mapping[str, SignalInfo], name: str) -> SignalInfo:
    """Look a variable up; raises InputInvalid with similar names."""
    found = schema.get(name)
    if found is None:
        raise InputInvalid(f"signal {shown(name)} does not exist{did_you_mean(name, schema)}")
    return found


def shown(value: object) -> str:
    """Format a value for a message; a long text is cut."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:80]}…"


def format_of(type_: str) -> str | None:
    """Return the format that holds integers of a type exactly; None if float64 does."""
    return _INTEGERS.get(type_)


# ---- columns of 8 bytes a number --------------------------------------------------------------


def columns_of(
    values: Mapping[str, object], schema: Mapping[str, SignalInfo], *, integers: bool = False
) -> tuple[list[dict[str, object]], list[dict[str, str]], list[np.ndarray]]:
    """Return the columns (name, type, shape), the texts, and the arrays of all numbers.

    With `integers`, each column has a `format`: int64 or uint64 if its integers are sent as such,
    else float64.
    """
    columns: list[dict[str, object]] = []
    texts: list[dict[str, str]] = []
    arrays: list[np.ndarray] = []
    for name, value in values.items():
        array = array_of(name, value)
        if array.dtype.kind not in "fiub":
            flat = np.asarray(value).ravel().tolist()
            text = ", ".join(v.hex() if isinstance(v, bytes) else str(v) for v in flat)
            texts.append({"name": name, "value": text})
            continue
        info = schema.get(name) or schema.get(split_element_name(name)[0])
        type_ = "Float64" if info is None else info.type
        column: dict[str, object] = {"name": name, "type": type_, "shape": list(array.shape)}
        exact = format_of(type_) if integers else None
        if integers:
            column["format"] = exact or "float64"
        if exact is not None:
            array = array.astype(exact, copy=False)
        else:
            _check_exact(name, array)
            if array.dtype.kind in "iu":
                array = array.astype(np.float64)
        columns.append(column)
        arrays.append(array)
    return columns, texts, arrays


def array_of(name: str, value: object) -> np.ndarray:
    """Return a value as an array; raises InputInvalid for Booleans among numbers.

    NumPy would read such a Boolean as 0 or 1.
    """
    array: np.ndarray = np.asanyarray(value)
    if isinstance(value, list | tuple) and array.dtype.kind in "fiu":
        flat = np.array(value, dtype=object).ravel()
        if any(isinstance(x, bool | np.bool_) for x in flat):
            raise InputInvalid(name, f"{value!r}", "numbers, without true and false")
    return array


def numbers_of(array: np.ndarray) -> bytes:
    """Return numbers as 8 bytes each: int64 and uint64 unchanged, all others as float64."""
    kept = array.dtype.kind in "iu" and array.dtype.itemsize == 8
    return np.ascontiguousarray(array, array.dtype.newbyteorder("<") if kept else "<f8").tobytes()


def _check_exact(name: str, array: np.ndarray) -> None:
    """Refuse integers that float64 would round."""
    if array.dtype.kind not in "iu" or array.dtype.itemsize < 8 or not array.size:
        return
    if int(array.min()) >= -_EXACT and int(array.max()) <= _EXACT:
        return
    for value in array.ravel().tolist():
        if int(float(value)) != value:
            raise InputInvalid(
                f"{name}: {value} is not exact as float64; expected a request with "
                '"integers": true, whose answer has int64 and uint64'
            )


def unpacked(
    columns: object, payload: bytes, schema: Mapping[str, SignalInfo]
) -> dict[str, np.ndarray]:
    """Return the values that a request's columns name, from its payload of 8 bytes a number."""
    if not isinstance(columns, list):
        raise InputInvalid("columns: expected a list of objects with name and shape")
    values: dict[str, np.ndarray] = {}
    at, count = 0, len(payload) // 8
    for entry in columns:
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str):
            raise InputInvalid("columns", f"{shown(entry)} was read", "an object with a name")
        if name in values:
            raise InputInvalid("columns", f"{name} is given twice", "each name once")
        info = find(schema, name)
        shape = entry.get("shape", list(info.shape))
        shape = [shape] if isinstance(shape, int | float) else shape
        if not isinstance(shape, list) or not all(
            isinstance(n, int) and not isinstance(n, bool) and 0 <= n < 1 << 32 for n in shape
        ):
            raise InputInvalid(name, f"shape {shape!r} was read", list(info.shape))
        size = math.prod(shape)
        if at + size > count:
            raise InputInvalid(name, f"{count - at} numbers are left in the payload", size)
        format_ = entry.get("format", "float64")
        if format_ not in ("float64", "int64", "uint64"):
            raise InputInvalid(
                name, f"format {shown(format_)} was read", "float64, int64 or uint64"
            )
        numbers = np.frombuffer(payload, np.dtype(format_).newbyteorder("<"), size, 8 * at)
        values[name] = shaped(info, numbers)
        at += size
    if at != count:
        raise InputInvalid(f"payload: {count} numbers were read; the columns name {at}")
    return values


def shaped(info: SignalInfo, numbers: np.ndarray) -> np.ndarray:
    """Return numbers in a variable's shape; raises InputInvalid if there are more or fewer.

    The service checks type and range, as it does for values in JSON.
    """
    size = math.prod(info.shape)
    if numbers.size != size:
        count = "1 number" if size == 1 else f"{size} numbers"
        unit = f" in {info.unit}" if info.unit else ""
        raise InputInvalid(
            info.name, f"{numbers.size} numbers were read", f"{count} of type {info.type}{unit}"
        )
    return numbers.reshape(info.shape)


# ---- JSON -------------------------------------------------------------------------------------


def json_of(value: object) -> object:
    """Convert a value for JSON: arrays to lists, and NaN and infinite numbers to null."""
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


def json_texts(values: Mapping[str, object]) -> Iterator[str]:
    """Yield a JSON object of values piece by piece, so that its text is never in memory whole."""
    yield "{"
    for i, (name, value) in enumerate(values.items()):
        yield f"{', ' if i else ''}{json.dumps(name)}: "
        if not isinstance(value, np.ndarray) or value.size <= _PIECE:
            yield json.dumps(json_of(value))
            continue
        yield "["
        for k, piece in enumerate(pieces(value)):
            kind = piece.dtype.kind
            plain = kind in "iub" or (kind == "f" and np.isfinite(piece).all())
            text = json.dumps(piece.tolist() if plain else json_of(piece))[1:-1]
            yield f", {text}" if k else text
        yield "]"
    yield "}"


def pieces(array: np.ndarray) -> Iterator[np.ndarray]:
    """Yield an array by rows, some thousands of numbers at once.

    An array that is mapped from a file is read piece by piece, and does not stay in memory.
    """
    if not array.shape:
        yield array
        return
    rows = max(1, _PIECE * len(array) // max(1, array.size))
    mapped = getattr(array, "_mmap", None)  # of a memmap, and of slices of it
    for at in range(0, len(array), rows):
        yield array[at : at + rows]
        if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
            mapped.madvise(mmap.MADV_DONTNEED)
