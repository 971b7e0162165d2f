"""Messages: JSON that anybody can write, and beside it one block of numbers for those who can.

A value in JSON is a number, a list, a text or a truth; or ``{"at": 0, "type": "f8", "shape": [6]}``
for numbers that lie in the attachment, from byte `at` on, little-endian.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np

from uuvsim_cosim import errors
from uuvsim_cosim.bridge.calls.values import array_of
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, UuvsimError

__all__ = ["PROTOCOL", "error_of", "message_of", "packed", "plain", "read_message", "unpacked"]

PROTOCOL = 1  # of messages; another number is another language
_TYPES = ("f8", "i8", "u8", "?")


def packed(values: Mapping[str, Any]) -> tuple[dict[str, Any], bytes]:
    """Return values as JSON can hold them, and the block of their numbers."""
    held: dict[str, Any] = {}
    parts: list[bytes] = []
    at = 0
    for name, value in values.items():
        array = array_of(name, value)
        if array.dtype.kind not in "fiub":
            held[name] = array.tolist()
            continue
        kind = {"f": "f8", "i": "i8", "u": "u8", "b": "?"}[array.dtype.kind]
        data = array.astype("?" if kind == "?" else f"<{kind}", copy=False).tobytes()
        held[name] = {"at": at, "type": kind, "shape": list(array.shape)}
        parts.append(data)
        at += len(data)
    return held, b"".join(parts)


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values in JSON alone; what is not a finite number is null."""
    return {name: _plain(np.asarray(value).tolist()) for name, value in values.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def unpacked(held: Any, block: bytes) -> dict[str, Any]:
    """Return the values of `packed`; raises InputInvalid for what cannot be one."""
    if not isinstance(held, Mapping):
        raise InputInvalid(f"values: {type(held).__name__}; expected an object of names")
    return {str(name): _value(str(name), value, block) for name, value in held.items()}


def _value(name: str, value: Any, block: bytes) -> Any:
    if not isinstance(value, Mapping):
        return value
    try:
        kind, at, shape = value["type"], value["at"], tuple(value["shape"])
        if kind not in _TYPES or at < 0 or any(n < 0 for n in shape):
            raise ValueError
        array = np.frombuffer(block, "?" if kind == "?" else f"<{kind}", prod(shape), at)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputInvalid(
            f"{name}: {json.dumps(value)[:100]} with a block of {len(block)} bytes; expected "
            "at, type (f8, i8, u8 or ?) and shape of numbers that lie in the block"
        ) from None
    return array.reshape(shape).copy() if shape else array[0].item()


def read_message(data: bytes) -> dict[str, Any]:
    """Read a message; raises InputInvalid for what is not a JSON object."""
    try:
        message = json.loads(data) if data else {}
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict):
        read = data[:40].decode(errors="replace")
        raise InputInvalid(f"message {read!r}; expected a JSON object")
    return message


def message_of(error: BaseException) -> dict[str, Any]:
    """Return an error as a message."""
    if not isinstance(error, UuvsimError):
        words = f"unexpected {type(error).__name__}: {error}"
        return {"error": "UuvsimError", "message": words}
    told: dict[str, Any] = {"error": type(error).__name__, "message": str(error)}
    if isinstance(error, ComponentFailed):
        told |= {"path": error.path, "time": error.time, "reason": error.reason}
    return told


def error_of(told: Mapping[str, Any]) -> UuvsimError:
    """Return the error of a message, of the class that it had where that can be."""
    words = str(told.get("message", "the answer holds no reason"))
    if told.get("error") == "ComponentFailed" and "path" in told:
        return ComponentFailed(str(told["path"]), float(told["time"]), str(told["reason"]))
    kind = getattr(errors, str(told.get("error")), None)
    if isinstance(kind, type) and issubclass(kind, UuvsimError):
        if kind.__init__ in (UuvsimError.__init__, Exception.__init__):
            return kind(words)
        return InputInvalid(words)
    return UuvsimError(words)
