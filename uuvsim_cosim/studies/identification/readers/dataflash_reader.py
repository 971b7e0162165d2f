"""Reader of DataFlash logs (.BIN) of ArduPilot: an index of all messages, then columns by name.

A message is A3 95, one byte of type, and fields of the layout that an FMT message declares. The
index finds all headers of a block at once. A header is the next message if it lies where the one
before it ends; only the places where this fails are followed one by one. Bytes that belong to no
message are counted. Of a log, one block and the offsets of the messages are in memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["DataFlash", "Layout"]

_FMT, _FMT_LENGTH = 128, 89
_BLOCK = 1 << 24  # bytes
# ArduPilot's letters: NumPy's type, and the factor of fixed-point numbers.
_TYPES: dict[str, tuple[str, float]] = {
    "a": ("(32,)<i2", 1.0), "b": ("i1", 1.0), "B": ("u1", 1.0), "h": ("<i2", 1.0),
    "H": ("<u2", 1.0), "i": ("<i4", 1.0), "I": ("<u4", 1.0), "f": ("<f4", 1.0),
    "d": ("<f8", 1.0), "g": ("<f2", 1.0), "n": ("S4", 1.0), "N": ("S16", 1.0),
    "Z": ("S64", 1.0), "c": ("<i2", 0.01), "C": ("<u2", 0.01), "e": ("<i4", 0.01),
    "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "M": ("u1", 1.0), "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}  # fmt: skip


@dataclass(frozen=True)
class Layout:
    """Layout of a type of message, as its FMT message declares it."""

    number: int
    name: str
    length: int  # bytes, with the header of three
    format: str  # one letter for each column
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Return the fields without the header."""
        return np.dtype([(c, _TYPES[f][0]) for c, f in zip(self.columns, self.format, strict=True)])


@final
class DataFlash:
    """Index of a DataFlash log: which messages are where, and their layouts.

    `lost` is the number of bytes that belong to no message, `gaps` the number of places where such
    bytes lie, and `cut` the number of bytes of an incomplete last message. `conflicts` are names of
    messages that were declared again with other fields; the first declaration counts.
    """

    def __init__(self, path: Path) -> None:
        """Index the log at `path`; raises InputInvalid if no message is found."""
        self.path = path
        self.layouts: dict[str, Layout] = {}
        self.lost = self.gaps = self.cut = 0
        self.conflicts: list[str] = []
        self._lengths: NDArray[np.int64] = np.zeros(256, np.int64)
        self._lengths[_FMT] = _FMT_LENGTH
        self._offsets: dict[int, list[NDArray[np.int64]]] = {}
        self._index()
        if not self.layouts:
            with path.open("rb") as file:
                head = file.read(9)
            raise InputInvalid(
                path, f"begins with {head.hex(' ') or 'nothing'}", "a DataFlash log of ArduPilot"
            )

    def __contains__(self, name: str) -> bool:
        """Whether the log has a message of this name."""
        return self.count(name) > 0

    @property
    def names(self) -> list[str]:
        """Return the names of the messages that the log contains."""
        return [n for n in self.layouts if n in self]

    def offsets(self, name: str) -> NDArray[np.int64]:
        """Return the places [bytes] of all messages of a name, in the order of the file."""
        layout = self.layouts.get(name)
        parts = [] if layout is None else self._offsets.get(layout.number, [])
        if layout is not None and len(parts) > 1:
            self._offsets[layout.number] = parts = [np.concatenate(parts)]
        return parts[0] if parts else np.zeros(0, np.int64)

    def count(self, name: str) -> int:
        """Return the number of messages of a name."""
        layout = self.layouts.get(name)
        return 0 if layout is None else sum(map(len, self._offsets.get(layout.number, [])))

    def messages(self, name: str) -> NDArray[Any]:
        """Return all messages of a name as a structured array with the numbers of the file."""
        layout = self.layouts[name]
        offsets = self.offsets(name)
        size = layout.length - 3
        out = np.empty((len(offsets), size), np.uint8)
        data = np.memmap(self.path, np.uint8, "r")
        for at in range(0, len(offsets), 1 << 16):
            part = offsets[at : at + (1 << 16)]
            out[at : at + len(part)] = data[part[:, None] + 3 + np.arange(size)]
        return out.view(layout.dtype)[:, 0]

    def column(self, name: str, column: str) -> NDArray[np.float64]:
        """Return a column as numbers, with the factor of its fixed-point format."""
        layout = self.layouts[name]
        factor = _TYPES[layout.format[layout.columns.index(column)]][1]
        return np.asarray(self.messages(name)[column], dtype=np.float64) * factor

    def table(self, name: str, *columns: str) -> NDArray[np.float64] | None:
        """Return columns as (n, len(columns)); None if the log lacks the message or a column."""
        if name not in self or not set(columns) <= set(self.layouts[name].columns):
            return None
        rows = self.messages(name)
        letters = dict(zip(self.layouts[name].columns, self.layouts[name].format, strict=True))
        return np.stack(
            [np.asarray(rows[c], np.float64) * _TYPES[letters[c]][1] for c in columns], axis=1
        )

    # ---- index --------------------------------------------------------------------------------

    def _index(self) -> None:
        end = self.path.stat().st_size
        begin, expected = 0, 0  # place of the block in the file, and of the next message
        with self.path.open("rb") as file:
            while expected + 3 <= end:
                begin = expected
                file.seek(begin)
                block = np.frombuffer(file.read(_BLOCK), np.uint8)
                last = begin + len(block) >= end
                consumed = self._index_block(block, begin, last)
                expected = begin + consumed
                if last or consumed == 0:
                    break
        self.cut += max(end - expected, 0)

    def _index_block(self, block: NDArray[np.uint8], begin: int, last: bool) -> int:
        """Index the messages that begin in a block, and return where the first other one begins."""
        at: NDArray[np.int64] = np.flatnonzero((block[:-2] == 0xA3) & (block[1:-1] == 0x95))
        kinds = block[at + 2]
        for header in np.flatnonzero(kinds == _FMT):
            self._read_layout(block[at[header] + 3 : at[header] + _FMT_LENGTH].tobytes())
        lengths = self._lengths[kinds]
        known = lengths > 0
        at, kinds = at[known], kinds[known]
        ends = at + lengths[known]
        # Message i is followed by header i + 1, unless bytes in it look like a header.
        broken = np.flatnonzero(ends[:-1] != at[1:])
        runs: list[NDArray[np.intp]] = []  # headers that are messages, without a gap in between
        i, place = 0, 0  # header, and where the next message should begin
        while i < len(at):
            if int(at[i]) != place:
                # After a gap, bytes that look like a header need another header behind them.
                following = int(np.searchsorted(at, ends[i]))
                is_followed = following < len(at) and at[following] == ends[i]
                if not is_followed and ends[i] + 2 < len(block):
                    i += 1
                    continue
                self._lose(int(at[i]) - place)
            k = int(np.searchsorted(broken, i))
            j = int(broken[k]) if k < len(broken) else len(at) - 1
            runs.append(np.arange(i, j + 1))
            place = int(ends[j])
            i = int(np.searchsorted(at, place))
        if runs:
            chosen = np.concatenate(runs)
            if place > len(block):  # the last message continues in the next block
                place = int(at[chosen[-1]])
                self._keep(at[chosen[:-1]] + begin, kinds[chosen[:-1]])
                return place
            self._keep(at[chosen] + begin, kinds[chosen])
        if last and place + 3 <= len(block):
            self._lose(len(block) - place)
            return len(block)
        if not last and place < len(block) // 2:  # no message begins in the rest of the block
            self._lose(len(block) - 2 - place)
            return len(block) - 2
        return place

    def _lose(self, count: int) -> None:
        self.lost += count
        self.gaps += 1

    def _keep(self, offsets: NDArray[np.int64], kinds: NDArray[np.uint8]) -> None:
        order = np.argsort(kinds, kind="stable")
        sorted_kinds = kinds[order]
        edges = np.flatnonzero(np.diff(sorted_kinds)) + 1
        for part in np.split(order, edges):
            if len(part):
                self._offsets.setdefault(int(kinds[part[0]]), []).append(offsets[part])

    def _read_layout(self, body: bytes) -> None:
        if len(body) < _FMT_LENGTH - 3:
            return
        number, length = body[0], body[1]
        name, letters, columns = (
            body[a:b].rstrip(b"\0").decode("ascii", "replace")
            for a, b in ((2, 6), (6, 22), (22, 86))
        )
        names = tuple(columns.split(",")) if columns else ()
        known = name.isalnum() and len(names) == len(letters) and set(letters) <= _TYPES.keys()
        if not known or len(set(names)) != len(names):
            return
        layout = Layout(number, name, length, letters, names)
        if layout.dtype.itemsize + 3 != length:
            return
        known_layout = self.layouts.setdefault(name, layout)
        if known_layout != layout or self._lengths[number] not in (0, length):
            self.conflicts.append(name)
            return
        self._lengths[number] = length
