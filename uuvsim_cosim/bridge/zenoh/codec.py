"""Format of messages: JSON, which every program can write, and optionally one block of numbers.

A value in JSON is a number, a list, a text or a Boolean. ``{"at": 0, "type": "f8", "shape": [6]}``
stands for numbers in the attachment, from byte `at` on, little-endian.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np

from uuvsim_cosim import errors
from uuvsim_cosim.bridge.calls.values import array_of
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, UuvsimError

__all__ = ["PROTOCOL", "error_of", "message_of", "packed", "read_message", "unpacked"]

PROTOCOL = 1  # of messages; processes with different numbers do not understand each other
_TYPES = ("f8", "i8", "u8", "?")


def packed(values: Mapping[str, object]) -> tuple[dict[str, object], bytes]:
    """Return values for JSON, and the block of their numbers."""
    encoded: dict[str, object] = {}
    parts: list[bytes] = []
    at = 0
    for name, value in values.items():
        array = array_of(name, value)
        if array.dtype.kind not in "fiub":
            encoded[name] = array.tolist()
            continue
        type_ = {"f": "f8", "i": "i8", "u": "u8", "b": "?"}[array.dtype.kind]
        data = array.astype("?" if type_ == "?" else f"<{type_}", copy=False).tobytes()
        encoded[name] = {"at": at, "type": type_, "shape": list(array.shape)}
        parts.append(data)
        at += len(data)
    return encoded, b"".join(parts)


def unpacked(encoded: object, block: bytes) -> dict[str, Any]:
    """Return the values of `packed`; raises InputInvalid for other data."""
    if not isinstance(encoded, Mapping):
        raise InputInvalid("values", type(encoded).__name__, "an object of names")
    return {str(name): _value(str(name), value, block) for name, value in encoded.items()}


def _value(name: str, value: object, block: bytes) -> object:
    if not isinstance(value, Mapping):
        return value
    try:
        type_, at, shape = value["type"], value["at"], tuple(value["shape"])
        if type_ not in _TYPES or at < 0 or any(n < 0 for n in shape):
            raise ValueError
        array = np.frombuffer(block, "?" if type_ == "?" else f"<{type_}", prod(shape), at)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputInvalid(
            name,
            f"{json.dumps(value)[:100]} with a block of {len(block)} bytes",
            "at, type (f8, i8, u8 or ?) and shape of numbers that lie in the block",
        ) from None
    return array.reshape(shape).copy() if shape else array[0].item()


def read_message(data: bytes) -> dict[str, Any]:
    """Read a message; raises InputInvalid for data that is no JSON object."""
    try:
        message = json.loads(data) if data else {}
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict):
        read = data[:40].decode(errors="replace")
        raise InputInvalid(f"message {read!r}", "a JSON object")
    return message


def message_of(error: BaseException) -> dict[str, object]:
    """Return an error as a message."""
    if not isinstance(error, UuvsimError):
        text = f"unexpected {type(error).__name__}: {error}"
        return {"error": "UuvsimError", "message": text}
    message: dict[str, object] = {"error": type(error).__name__, "message": str(error)}
    if isinstance(error, ComponentFailed):
        message |= {"path": error.path, "time": error.time, "reason": error.reason}
    return message


def error_of(message: Mapping[str, Any]) -> UuvsimError:
    """Return the error of a message, of its original class if it can be made from a text."""
    text = str(message.get("message", "the answer contains no reason"))
    if message.get("error") == "ComponentFailed" and "path" in message:
        return ComponentFailed(str(message["path"]), float(message["time"]), str(message["reason"]))
    cls = getattr(errors, str(message.get("error")), None)
    if isinstance(cls, type) and issubclass(cls, UuvsimError):
        if cls.__init__ in (UuvsimError.__init__, Exception.__init__):
            return cls(text)
        return InputInvalid(text)
    return UuvsimError(text)
