"""Buffers to read and write a variable, which are made once and reused."""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES

__all__ = ["Access", "BinaryAccess", "NumericAccess", "StringAccess", "scalar_access"]


class Access(ABC):
    """Buffers of one variable; `suffix` is that of the Get and Set functions."""

    def __init__(self, variable: Variable, suffix: str, *, counts_values: bool) -> None:
        self.suffix = suffix
        self._variable = variable
        references = variable.value_references
        self._references = (ctypes.c_uint32 * len(references))(*references)
        self._count = (variable.size,) if counts_values else ()

    @abstractmethod
    def fill(self, flat: np.ndarray) -> None:
        """Put the elements into the buffer."""

    @abstractmethod
    def elements(self) -> np.ndarray:
        """Copy the elements out of the buffer."""

    @abstractmethod
    def buffers(self) -> tuple[object, ...]:
        """Return the arguments for the values."""

    def arguments(self) -> tuple[object, ...]:
        """Return the arguments after the instance."""
        references = self._references
        return (references, len(references), *self.buffers(), *self._count)

    def value(self) -> Any:
        """Return the value: an array, or a scalar of Python."""
        return self.shaped(self.elements())

    def shaped(self, flat: np.ndarray) -> Any:
        """Return elements as a value of the variable's shape."""
        if self._variable.shape:
            return flat.reshape(self._variable.shape)
        return flat[0] if flat.dtype == object else flat[0].item()


class NumericAccess(Access):
    """Numbers and Booleans, in FMI's C type."""

    def __init__(
        self, variable: Variable, suffix: str, dtype: DTypeLike, *, counts_values: bool
    ) -> None:
        super().__init__(variable, suffix, counts_values=counts_values)
        self._buffer = np.zeros(max(variable.size, 1), dtype=dtype)
        self._pointer = self._buffer.ctypes.data

    def fill(self, flat: np.ndarray) -> None:
        """Put the elements into the buffer."""
        self._buffer[: flat.size] = _negative(flat) if self._variable.negated else flat

    def elements(self) -> np.ndarray:
        """Copy the elements out of the buffer."""
        flat = self._buffer[: self._variable.size].astype(DTYPES[self._variable.type])
        return _negative(flat) if self._variable.negated else flat

    def buffers(self) -> tuple[object, ...]:
        """Return the buffer's address."""
        return (self._pointer,)


def _negative(flat: np.ndarray) -> np.ndarray:
    """Return numbers with the opposite sign; true becomes false."""
    return ~flat if flat.dtype == np.bool_ else -flat


class StringAccess(Access):
    """Zero-terminated UTF-8 texts."""

    def __init__(self, variable: Variable, suffix: str, *, counts_values: bool) -> None:
        super().__init__(variable, suffix, counts_values=counts_values)
        self._buffer = (ctypes.c_char_p * max(variable.size, 1))()

    def fill(self, flat: np.ndarray) -> None:
        """Put the elements into the buffer."""
        for i, text in enumerate(flat):
            self._buffer[i] = text.encode()

    def elements(self) -> np.ndarray:
        """Copy the elements out of the buffer."""
        flat = np.empty(self._variable.size, dtype=object)
        flat[:] = [(b or b"").decode(errors="replace") for b in self._buffer[: flat.size]]
        return flat

    def buffers(self) -> tuple[object, ...]:
        """Return the array of texts."""
        return (self._buffer,)


class BinaryAccess(Access):
    """Byte strings with their sizes (FMI 3.0)."""

    def __init__(self, variable: Variable) -> None:
        super().__init__(variable, "Binary", counts_values=True)
        self._sizes = (ctypes.c_size_t * max(variable.size, 1))()
        self._pointers = (ctypes.c_void_p * max(variable.size, 1))()
        self._owned: list[ctypes.Array[ctypes.c_char]] = []  # the data that the pointers refer to

    def fill(self, flat: np.ndarray) -> None:
        """Put the elements into the buffer."""
        self._owned = [ctypes.create_string_buffer(data, len(data) + 1) for data in flat]
        for i, (owned, data) in enumerate(zip(self._owned, flat, strict=True)):
            self._sizes[i] = len(data)
            self._pointers[i] = ctypes.addressof(owned)

    def elements(self) -> np.ndarray:
        """Copy the elements out of the buffer."""
        flat = np.empty(self._variable.size, dtype=object)
        flat[:] = [
            ctypes.string_at(pointer, size) if pointer else b""
            for pointer, size in zip(self._pointers, self._sizes, strict=True)
        ][: flat.size]
        return flat

    def buffers(self) -> tuple[object, ...]:
        """Return sizes and pointers."""
        return (self._sizes, self._pointers)


def scalar_access(variable: Variable, numeric: Mapping[str, tuple[str, type]]) -> Access:
    """Return the calls of FMI 1.0 and 2.0 for a variable; `numeric` has suffix and type in C."""
    if variable.type == "String":
        return StringAccess(variable, "String", counts_values=False)
    suffix, dtype = numeric[variable.type]
    return NumericAccess(variable, suffix, dtype, counts_values=False)
