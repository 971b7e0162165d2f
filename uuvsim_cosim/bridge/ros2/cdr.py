"""CDR of ROS 2 messages whose texts and lengths do not change: rows of bytes, written by NumPy.

A message type is a tree of fields. Once the texts and the lengths of its sequences are known, each
number has a fixed place in the message (CDR 1, little-endian: aligned to its own size, counted
from the end of the header 00 01 00 00). So n messages are one array of bytes (n, size), into which
columns of numbers are copied.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["MessageLayout"]

HEADER = b"\x00\x01\x00\x00"
_OTHER = {"bool": "u1", "byte": "u1", "octet": "u1", "char": "u1"}


class MessageLayout:
    """Places of the numbers in a message of one type.

    `texts` are its strings by the path of the field, such as ``header.frame_id``; fields that are
    not given are empty. `lengths` are those of its sequences; others are empty. A field of equal
    numbers one after the other, such as a ``geometry_msgs/msg/Vector3`` or a sequence of them, has
    a place of its own.
    """

    def __init__(
        self, store: Typestore, type_: str, texts: Mapping[str, str], lengths: Mapping[str, int]
    ) -> None:
        """Lay a message out; raises InputInvalid for a type that the store does not have."""
        if type_ not in store.fielddefs:
            raise InputInvalid(f"message type {type_!r}", "a type of the distribution's packages")
        self.type = type_
        self._store, self._texts, self._lengths = store, texts, lengths
        self._data = bytearray()
        self._places: dict[str, tuple[int, np.dtype[Any], int]] = {}  # offset, type, count
        self._message(type_, "")
        # One element of this type is a message; the parts of a vector overlap the whole of it.
        places = self._places.values()
        self._row = np.dtype({
            "names": list(self._places),
            "formats": [dtype if n == 1 else (dtype, (n,)) for _, dtype, n in places],
            "offsets": [len(HEADER) + offset for offset, _, _ in places],
            "itemsize": len(HEADER) + len(self._data),
        })  # fmt: skip
        self._template = np.frombuffer(HEADER + bytes(self._data), np.uint8)

    @property
    def fields(self) -> frozenset[str]:
        """Paths of the numbers."""
        return frozenset(self._places)

    def count(self, path: str) -> int:
        """Return how many numbers a field has."""
        return self._places[path][2]

    def rows(self, n: int, columns: Mapping[str, Array]) -> Array:
        """Return n messages (n, size) uint8; `columns` are (n,), (n, k) or one value for all.

        Raises InputInvalid for a field that is not in the message, or has another length.
        """
        out = np.empty((n, len(self._template)), np.uint8)
        out[:] = self._template
        messages = out.view(self._row)[:, 0]
        for path, values in columns.items():
            if path not in self._places:
                raise InputInvalid(f"{self.type}: no number {path!r}", ", ".join(self._places))
            single = values.ndim > 1 and self._places[path][2] == 1
            messages[path] = values[:, 0] if single else values
        return out

    def _message(self, type_: str, path: str) -> None:
        parts = []
        for field, node in self._store.fielddefs[type_][1]:
            parts.append(f"{path}.{field}" if path else field)
            self._field(node, parts[-1])
        if path:
            self._join(path, parts)

    def _join(self, path: str, parts: Iterable[str]) -> None:
        """Give a field a place of its own, if its parts are equal numbers one after the other."""
        places = [self._places.get(part) for part in parts]
        whole = places[0] if places else None
        for place in places[1:]:
            if whole is None or place is None:
                return
            offset, dtype, count = whole
            if place[:2] != (offset + count * dtype.itemsize, dtype):
                return
            whole = (offset, dtype, count + place[2])
        if whole is not None:
            self._places[path] = whole

    def _field(self, node: Any, path: str) -> None:
        kind, detail = node
        if kind.name == "NAME":
            self._message(detail, path)
        elif kind.name == "BASE":
            self._base(detail[0], path, 1)
        else:
            element, count = detail
            if kind.name == "SEQUENCE":
                count = self._lengths.get(path, 0)
                self._put(np.array([count], "<u4"))
            if element[0].name == "BASE" and element[1][0] != "string":
                if count:
                    self._base(element[1][0], path, count)
            else:
                parts = [f"{path}.{i}" for i in range(count)]
                for part in parts:
                    self._field(element, part)
                self._join(path, parts)

    def _base(self, name: str, path: str, count: int) -> None:
        if name == "string":
            text = np.frombuffer(self._texts.get(path, "").encode() + b"\0", np.uint8)
            self._put(np.array([len(text)], "<u4"))
            self._put(text)
            return
        dtype = np.dtype(_OTHER.get(name, name)).newbyteorder("<")
        self._places[path] = (self._put(np.zeros(count, dtype)), dtype, count)

    def _put(self, values: Array) -> int:
        """Append values at the next multiple of their size; return where they begin."""
        self._data.extend(bytes(-len(self._data) % values.itemsize))
        at = len(self._data)
        self._data.extend(values.tobytes())
        return at
