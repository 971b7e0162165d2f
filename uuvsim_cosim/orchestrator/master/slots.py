"""Conversion between Python values and the stepping loop's slots of 8 bytes."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.master.core import Type, library

__all__ = ["decode", "encode", "read_blob", "write_blob"]


def decode(variable: Variable, raw: np.ndarray) -> Any:
    """Return the value in a variable's slots: a number, text, bytes, or array of its shape."""
    type_ = Type.of(variable)
    if type_.is_blob:
        data = [read_blob(raw, i) for i in range(variable.size)]
        flat = [d.decode(errors="replace") for d in data] if type_ == Type.String else data
        return np.array(flat, object).reshape(variable.shape) if variable.shape else flat[0]
    numbers = raw.view(type_.dtype)
    if type_ == Type.Boolean:
        numbers = numbers.astype(bool)
    return numbers.reshape(variable.shape).copy() if variable.shape else numbers[0].item()


def encode(variable: Variable, value: object, raw: np.ndarray) -> None:
    """Write a value of the variable's shape into its slots."""
    type_ = Type.of(variable)
    if type_.is_blob:
        for i, item in enumerate(np.asarray(value, object).ravel()):
            write_blob(raw, i, item.encode() if isinstance(item, str) else item)
        return
    raw.view(type_.dtype)[:] = np.asarray(value).astype(type_.dtype, casting="unsafe").ravel()


def read_blob(raw: np.ndarray, i: int) -> bytes:
    """Copy the bytes that slot i points to."""
    size = ctypes.c_size_t()
    data = library().uuv_core_read_blob(raw.ctypes.data + 8 * i, ctypes.byref(size))
    return ctypes.string_at(data, size.value)


def write_blob(raw: np.ndarray, i: int, data: bytes) -> None:
    """Copy bytes to the memory that slot i points to."""
    if not library().uuv_core_write_blob(raw.ctypes.data + 8 * i, data, len(data)):
        raise MemoryError(f"no memory for {len(data)} bytes")
