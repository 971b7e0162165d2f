"""Recordings as MCAP files of ROS 2 messages (CDR), as Foxglove and PlotJuggler read them.

A component's numbers have a fixed size, so NumPy makes the messages of a block; texts follow them.
"""

from __future__ import annotations

import base64
import contextlib
import json
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.notebook_bar import Progress
from uuvsim_cosim.orchestrator.master.observer import seconds
from uuvsim_cosim.orchestrator.recording.columns import BLOCK
from uuvsim_cosim.orchestrator.recording.signals import Signals

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.recording.mcap_file import McapFile

__all__ = ["read_mcap", "write_mcap"]

_LIBRARY = "uuvsim-cosim"
CHUNK = 1 << 22  # bytes of a chunk, about
STRIP = 256  # rows that are filled at a time, so that they stay in the processor's cache
_CDR = b"\0\1\0\0"  # before each message: CDR, little endian
# Beginning of the record of a message, before its data. `length` counts the bytes after itself.
MESSAGE = np.dtype([("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("stamp", "V20")])
STAMP = np.dtype([("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])
OPCODE = 5  # of a message
BEFORE = 9  # bytes of a record that its length does not count
DRAWN = "foxglove."  # prefix of the schemas of drawings, which are not signals
_KINDS = {"f": "float", "i": "int", "u": "uint"}


@dataclass(frozen=True)
class _Field:
    """Variable of a component, and the field of its messages. `dtype` is "O" for texts."""

    name: str
    field: str
    dtype: str
    size: int | None  # of an array
    place: int  # among the component's variables
    is_bytes: bool = False  # written as text in base64
    units: Sequence[str] = ()
    about: str = ""

    @property
    def is_text(self) -> bool:
        return self.dtype == "O"

    @property
    def row(self) -> np.dtype[Any]:
        """Type of the numbers in a message."""
        return np.dtype((f"<{self.dtype}", () if self.size is None else (self.size,)))

    @property
    def line(self) -> str:
        """Line of the message definition."""
        kind, bits = self.dtype[0], 8 * int(self.dtype[1:] or 0)
        type_ = {"O": "string", "b": "bool"}.get(kind) or f"{_KINDS[kind]}{bits}"
        size = "" if self.size is None else f"[{self.size}]"
        about = " ".join(f"{self.about} [{', '.join(dict.fromkeys(self.units))}]".split())
        return f"{type_}{size} {self.field}  # {about}"


def _fields(names: Sequence[str], signals: Signals) -> list[_Field]:
    """Return the fields of a component's messages: the widest numbers first, so that all are
    aligned, and texts last.
    """
    fields: list[_Field] = []
    for name in names:
        values = signals[name]
        dtype = "O" if values.dtype.kind == "O" else values.dtype.str[1:]
        variable = name.rpartition(".")[2]
        word = _word(variable, [f.field for f in fields])
        size = values.shape[1] if values.ndim == 2 else None
        is_bytes = dtype == "O" and values.size > 0 and isinstance(values.flat[0], bytes)
        units, about = signals.element_units.get(name, ()), signals.descriptions.get(name, "")
        fields.append(
            _Field(variable, word, dtype, size, len(fields), is_bytes, tuple(units), about)
        )
    return sorted(fields, key=lambda f: (f.is_text, 0 if f.is_text else -f.row.base.itemsize))


def _word(name: str, used: Sequence[str]) -> str:
    """Return a name of ROS 2 that is not used yet, with letters, digits and underscores."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    word = word if word[:1].isalpha() else f"x_{word}"
    while word in used:
        word += "_"
    return word


@dataclass(frozen=True)
class _Channel:
    """Channel of a component: a message has its numbers, and then its texts."""

    number: int
    path: str
    fields: tuple[_Field, ...]

    @property
    def texts(self) -> list[_Field]:
        return [f for f in self.fields if f.is_text]

    def rows(self, most: int) -> np.ndarray:
        """Return records of messages, each up to its texts, with what is equal in all of them."""
        numbers = [(f.field, f.row) for f in self.fields if not f.is_text]
        rows = np.zeros(most, [("head", MESSAGE), ("cdr", "V4"), *numbers])
        rows["head"]["opcode"], rows["head"]["channel"] = OPCODE, self.number
        rows["head"]["length"] = rows.dtype.itemsize - BEFORE
        rows["cdr"] = np.void(_CDR)
        return rows

    def with_texts(self, block: Signals, part: slice, stamps: np.ndarray) -> list[bytes]:
        """Return the records of a part of the block, one by one."""
        rows = self.rows(part.stop - part.start)
        rows["head"]["stamp"] = stamps[part].view("V20")
        for f in self.fields:
            if not f.is_text:
                rows[f.field] = block[f"{self.path}.{f.name}"][part]
        columns = [block[f"{self.path}.{f.name}"][part].tolist() for f in self.texts]
        records = []
        for k, values in enumerate(zip(*columns, strict=True)):
            data = bytearray(rows[k : k + 1].tobytes())
            for value in values:
                for element in value if isinstance(value, list) else [value]:
                    is_bytes = isinstance(element, bytes)
                    text = base64.b64encode(element) if is_bytes else element.encode()
                    data += bytes(-(len(data) - MESSAGE.itemsize) % 4)
                    data += struct.pack("<I", len(text) + 1) + text + b"\0"
            struct.pack_into("<Q", data, 1, len(data) - BEFORE)
            records.append(bytes(data))
        return records


def write_mcap(
    signals: Signals,
    file: Path,
    further: Callable[[McapFile], None] | None = None,
    progress: Progress | None = None,
) -> None:
    """Write one channel of ROS 2 messages for each component; time 0 is the log's epoch.

    A message's sequence is its communication point. `further` may write additional channels into
    the same file. Memory holds one block of rows at a time.
    """
    from uuvsim_cosim.orchestrator.recording.mcap_file import McapFile

    groups: dict[str, list[str]] = {}
    for name in signals:
        groups.setdefault(name.rpartition(".")[0], []).append(name)
    with file.open("wb") as out:
        writer = McapFile(out, _LIBRARY)
        writer.add_metadata("uuvsim", {"recording": json.dumps(dict(signals.metadata))})
        first = next(signals.blocks(), signals)
        channels: list[_Channel] = []
        types: list[str] = []
        for path, names in groups.items():
            fields = tuple(_fields(names, first))
            words = re.split(r"[\W_]+", path)
            types.append(_word("".join(w[:1].upper() + w[1:] for w in words), types))
            definition = "\n".join(f.line for f in fields).encode()
            schema = writer.register_schema(f"uuvsim/msg/{types[-1]}", "ros2msg", definition)
            about = {"component": path, "variables": json.dumps([asdict(f) for f in fields])}
            topic = f"/{path.replace('.', '/')}"
            channels.append(
                _Channel(writer.register_channel(topic, "cdr", schema, about), path, fields)
            )
        fixed = {f"{c.number}": c.rows(1) for c in channels if not c.texts}
        whole = np.dtype([(number, row.dtype) for number, row in fixed.items()])
        most = max(1, CHUNK // max(1, whole.itemsize))
        rows = np.zeros(most, whole)
        for number, row in fixed.items():
            rows[number] = row[0]
        for block in signals.blocks(progress) if channels else ():
            stamps = np.zeros(len(block.time), STAMP)
            stamps["sequence"] = block.ticks & 0xFFFFFFFF
            stamps["log_time"] = stamps["publish_time"] = np.rint(block.time * 1e9)
            for begin in range(0, len(stamps), most):
                part = slice(begin, min(begin + most, len(stamps)))
                writer.add_block(*_records(channels, rows, block, part, stamps))
        if further is not None:
            further(writer)
        writer.finish()


def _records(
    channels: Sequence[_Channel], rows: np.ndarray, block: Signals, part: slice, stamps: np.ndarray
) -> tuple[memoryview | bytes, dict[int, np.ndarray]]:
    """Return the records of a part of the block, and the index of each channel in them.

    `rows` has those of the channels without texts, and is written anew.
    """
    fixed = [c for c in channels if not c.texts]
    size, times = part.stop - part.start, stamps["log_time"][part]
    # A view of each field, beside what is written into it.
    views = [(rows[f"{c.number}"]["head"]["stamp"], stamps.view("V20")[part]) for c in fixed]
    for c in fixed:
        own = rows[f"{c.number}"]
        views += [(own[f.field], block[f"{c.path}.{f.name}"][part]) for f in c.fields]
    for begin in range(0, size, STRIP):
        end = min(begin + STRIP, size)
        for view, values in views:
            view[begin:end] = values[begin:end]
    places_of = {name: offset for name, (_, offset, *_) in (rows.dtype.fields or {}).items()}
    places = np.arange(size, dtype=np.uint64) * np.uint64(rows.itemsize)
    index = {}
    for c in fixed:
        offset = places_of[f"{c.number}"]
        index[c.number] = np.stack([times, places + np.uint64(offset)], axis=1)
    records: memoryview | bytes = rows[:size].view(np.uint8).data if fixed else b""
    for c in channels:
        if c.texts:
            texted = c.with_texts(block, part, stamps)
            begins = np.cumsum([len(records), *map(len, texted)], dtype=np.uint64)[:-1]
            index[c.number] = np.stack([times, begins], axis=1)
            records = b"".join([records, *texted])
    return records, index


# ---- reading ----------------------------------------------------------------------------------


def read_mcap(file: Path) -> Signals:
    """Read a file that `write_mcap` wrote; raises RecordingError for other or incomplete files."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    try:
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            header = reader.get_header()
            kept = {m.name: m.metadata for m in reader.iter_metadata()}.get("uuvsim")
            if header.library != _LIBRARY or kept is None:
                raise RecordingError(
                    file,
                    f"is an MCAP file of {header.library or 'another program'!r}",
                    "one that `uuvsim export RUN -o FILE.mcap` wrote",
                )
            metadata = json.loads(kept["recording"])
            found: dict[int, _Messages] = {}
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                if schema is None or schema.name.startswith(DRAWN):
                    continue
                if channel.id not in found:
                    about = channel.metadata
                    if "variables" not in about:
                        raise RecordingError(
                            file,
                            f"has messages of {channel.message_encoding or 'no encoding'!r}, as "
                            "earlier versions wrote",
                            "one that this version's `uuvsim export RUN -o FILE.mcap` wrote",
                        )
                    fields = tuple(_Field(**f) for f in json.loads(about["variables"]))
                    found[channel.id] = _Messages(_Channel(channel.id, about["component"], fields))
                found[channel.id].add((message.log_time, message.sequence, message.data))
            return _signals(metadata, [found[k] for k in sorted(found)])
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror or error})") from error
    except RecordingError:
        raise
    except (McapError, ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise _damaged(file, error) from error
    except Exception as error:  # struct.error, those of its decompressors
        raise _damaged(file, error) from error


def _damaged(file: Path, error: Exception) -> RecordingError:
    reason = str(error) or type(error).__name__
    return RecordingError(
        file,
        f"is no MCAP file, or is incomplete or damaged ({reason})",
        "a complete file, as `uuvsim export RUN -o FILE.mcap` writes it",
    )


class _Messages:
    """Messages of a channel: arrays of those before, and at most `BLOCK` of the last ones."""

    def __init__(self, channel: _Channel) -> None:
        self.channel = channel
        self._waiting: list[tuple[int, int, bytes]] = []  # time [ns], sequence, data
        self._packed: list[tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]] = []

    def add(self, message: tuple[int, int, bytes]) -> None:
        """Add a message."""
        self._waiting.append(message)
        if len(self._waiting) == BLOCK:
            self._pack()

    def arrays(self) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Return the times [ns], the sequence numbers and the values by variable."""
        if self._waiting or not self._packed:
            self._pack()
        packed = self._packed
        times, sequences = (np.concatenate([part[i] for part in packed]) for i in (0, 1))
        values = {
            f.name: np.concatenate([part[2].pop(f.name) for part in packed])
            for f in self.channel.fields
        }
        return times, sequences, values

    def _pack(self) -> None:
        waiting, self._waiting = self._waiting, []
        times, sequences = (np.array([m[i] for m in waiting], np.int64) for i in (0, 1))
        row = self.channel.rows(0).dtype
        numbers = row.itemsize - MESSAGE.itemsize  # bytes of a message
        data = [m[2] for m in waiting]
        if any(len(d) != numbers and not self.channel.texts for d in data):
            raise ValueError(f"{self.channel.path} has messages of another size")
        head = bytes(MESSAGE.itemsize)
        rows = np.frombuffer(b"".join(head + d[:numbers] for d in data), row)
        values = {f.name: rows[f.field].copy() for f in self.channel.fields if not f.is_text}
        for f in self.channel.texts:
            shape = (len(data),) if f.size is None else (len(data), f.size)
            values[f.name] = np.empty(shape, object)
        for k, d in enumerate(data if self.channel.texts else ()):
            at = numbers
            for f in self.channel.texts:
                for i in range(1 if f.size is None else f.size):
                    at += -at % 4
                    end = at + 4 + struct.unpack_from("<I", d, at)[0]
                    text = d[at + 4 : end - 1]
                    element = base64.b64decode(text) if f.is_bytes else text.decode()
                    values[f.name][k if f.size is None else (k, i)] = element
                    at = end
        self._packed.append((times, sequences, values))


def _signals(metadata: Mapping[str, Any], found: Sequence[_Messages]) -> Signals:
    """Return the signals of the messages by channel; raises ValueError for missing messages."""
    nanoseconds = np.zeros(0, np.int64)
    ticks = np.zeros(0, np.int64)
    count: int | None = None  # messages of each channel
    values: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    element_units: dict[str, tuple[str, ...]] = {}
    descriptions: dict[str, str] = {}
    for messages in found:
        nanoseconds, ticks, arrays = messages.arrays()
        count = len(ticks) if count is None else count
        # A sequence has 32 bits and begins at 0 again when they are used up.
        ticks = ticks + (np.cumsum(np.diff(ticks, prepend=ticks[:1]) < -(1 << 31)) << 32)
        path = messages.channel.path
        if len(ticks) != count:
            raise ValueError(f"{path} has {len(ticks)} messages, unlike the others")
        for f in sorted(messages.channel.fields, key=lambda f: f.place):
            name = f"{path}.{f.name}"
            values[name] = arrays[f.name]
            element_units[name] = tuple(f.units)
            units[name] = ", ".join(dict.fromkeys(f.units))
            descriptions[name] = f.about
    time: np.ndarray = nanoseconds / 1e9
    # Nanoseconds are rounded; the number of ticks gives the recorded time exactly, if known.
    with contextlib.suppress(KeyError, ValueError, ZeroDivisionError):
        exact = seconds(ticks, Fraction(str(metadata["tick"])))
        time = exact if np.allclose(exact, time, rtol=0.0, atol=1e-8) else time
    return Signals(time, ticks, values, units, descriptions, dict(metadata), element_units)
