"""The source ``bag:``: topics of a rosbag2 as the outputs of a component.

``bag:FILE.mcap?topic=/cmd_vel`` reads a file, or the folder of a rosbag2. `topic` may be repeated,
and may have wildcards (``/guidance/*``). Messages become signals in NED and FRD (readings.py).
Times are whole nanoseconds. A signal has the value of the last message (``between=held``, default),
or is linear between two (``between=linear``; angles take the shorter way, flags and integers are
held). Before the first message it has the first value, after the last one the last.

A message counts from the time at which the bag recorded it, or with ``stamp=header`` from the time
in its header. The bag's begin is t = 0, unless its times are simulated ones, which begin near 0:
they are used as they are. ``zero=SECONDS`` sets the time of the bag that is t = 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal
from urllib.parse import parse_qsl, urlencode

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.messages.readings import READINGS, Reading, field_values
from uuvsim_cosim.bridge.ros2.topic_writer import typestore
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description, Variable, VariableType
from uuvsim_cosim.models.declaration.files_read import Stamp, stamp
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.system.sources import Backend

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

__all__ = ["BagSource", "Track", "source"]

_OPTIONS = {"between": ("held", "linear"), "stamp": ("bag", "header")}
_SIMULATED = 10**9 * 3600 * 24 * 365 * 10  # [ns] times before 1980 are not those of a clock
_ANGLES = {"eta": (3, 4, 5), "eta_d": (3, 4, 5)}
_TYPES: dict[str, VariableType] = {"b": "Boolean", "i": "Int64", "u": "Int64", "f": "Float64"}


@dataclass(frozen=True, eq=False)
class Track:
    """A signal over time: `ticks` (n,) [ns] that grow, and values (n,) or (n, k)."""

    ticks: Array
    values: Array
    units: tuple[str | None, ...]
    is_linear: bool = False
    angles: tuple[int, ...] = ()

    def at(self, tick: int) -> Any:
        """Return the value at a time [ns]."""
        i = int(np.searchsorted(self.ticks, tick, "right")) - 1
        if i < 0 or not self.is_linear or i + 1 == len(self.ticks):
            return self.values[max(i, 0)]
        low, high = self.ticks[i], self.ticks[i + 1]
        way = self.values[i + 1] - self.values[i]
        for k in self.angles:
            way[k] = (way[k] + np.pi) % (2 * np.pi) - np.pi
        value = self.values[i] + (tick - low) / (high - low) * way
        for k in self.angles:
            value[k] = (value[k] + np.pi) % (2 * np.pi) - np.pi
        return value


@dataclass(frozen=True)
class _Contents:
    """What a bag's topics are: signals by name, and what was assumed."""

    tracks: Mapping[str, Track]
    remarks: tuple[str, ...]


_read: dict[tuple[str, tuple[Stamp, ...]], _Contents] = {}


def source(text: str, base: Path) -> BagSource:
    """Resolve ``bag:FILE?topic=NAME&…``; the entry point of the scheme.

    A file is searched in `base`, then in the current folder. Raises InputInvalid for an unknown
    option, without a topic, and if there is no such file.
    """
    name, _, query = text.removeprefix("bag:").partition("?")
    pairs = parse_qsl(query, keep_blank_values=True)
    topics = tuple(value for key, value in pairs if key == "topic")
    options = {key: value for key, value in pairs if key != "topic"}
    place = f"source {text!r}"
    known = ("topic", "zero", *_OPTIONS)
    for key, value in options.items():
        if key not in known:
            raise InputInvalid(place, f"option {key!r}", expected_names(key, known))
        if value not in _OPTIONS.get(key, (value,)):
            raise InputInvalid(place, f"{key}={value}", " or ".join(_OPTIONS[key]))
    if not topics:
        raise InputInvalid(place, "no topic", "bag:FILE?topic=/cmd_vel, which may be repeated")
    if "zero" in options:
        try:
            if not Decimal(options["zero"]).is_finite():
                raise InvalidOperation
        except InvalidOperation:
            raise InputInvalid(place, f"zero={options['zero']}", "seconds") from None
    wanted = Path(name).expanduser()
    found = next((p for p in (base / wanted, wanted) if name and p.exists()), None)
    if found is None:
        raise InputInvalid(wanted, "no such file", "a .mcap file or the folder of a rosbag2")
    return BagSource(found.absolute(), topics, tuple(options.items()))


@dataclass(frozen=True)
class BagSource:
    """Topics of a bag; see `source`."""

    path: Path
    topics: tuple[str, ...]
    options: tuple[tuple[str, str], ...] = ()
    kind: str = "rosbag2"
    is_recorded: ClassVar[bool] = True

    @property
    def text(self) -> str:
        """The whole source, with an absolute path."""
        pairs = [*(("topic", topic) for topic in self.topics), *self.options]
        return f"bag:{self.path}?{urlencode(pairs, safe='/*')}"

    @property
    def contents(self) -> _Contents:
        """The signals, read once until the bag changes; raises InputInvalid."""
        files = sorted(self.path.iterdir()) if self.path.is_dir() else [self.path]
        key = (self.text, tuple(stamp(file) for file in files))
        if key not in _read:
            _read[key] = _contents(self)
        return _read[key]

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about what was assumed."""
        return self.contents.remarks

    def describe(self) -> Description:
        """Return the signals as outputs."""
        return self.instantiate("description").description

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make a component whose outputs are the signals; the stepping loop calls Python for it."""
        tracks = self.contents.tracks

        class Replayed:
            """Recorded topics over time."""

            inputs: ClassVar[dict[str, object]] = {}
            outputs: ClassVar[dict[str, object]] = {
                name: (track.values.shape[1], track.units)
                if track.values.ndim > 1
                else track.units[0]
                for name, track in tracks.items()
            }

            def initialize(self, t: float) -> dict[str, object]:
                tick = round(t * 1e9)
                return {name: track.at(tick) for name, track in tracks.items()}

            def step(self, t: float, dt: float, u: dict[str, object]) -> dict[str, object]:
                return self.initialize(t + dt)

        made = PythonComponent(Replayed, path)
        variables = {
            name: _typed(variable, tracks[name])
            for name, variable in made.description.variables.items()
        }
        made.description = replace(made.description, variables=variables)
        made.reset()
        return made


def _typed(variable: Variable, track: Track) -> Variable:
    """Return an output with the type of its values, which are discrete unless they are linear."""
    variability: Literal["continuous", "discrete"] = "continuous" if track.is_linear else "discrete"
    type_ = _TYPES[track.values.dtype.kind]
    zero = np.zeros(variable.shape, track.values.dtype)
    start = zero if variable.shape else zero.item()
    return replace(variable, type=type_, variability=variability, start=start)


def _contents(bag: BagSource) -> _Contents:
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
    except ImportError:
        raise InputInvalid("rosbags is not installed", "pip install 'uuvsim-cosim[ros]'") from None
    try:
        with AnyReader([bag.path], default_typestore=typestore("jazzy")) as reader:
            return _signals(bag, reader)
    except UuvsimError:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        raise InputInvalid(bag.path, f"cannot be read ({error})", "a rosbag2") from None


def _signals(bag: BagSource, reader: AnyReader) -> _Contents:
    options, types = dict(bag.options), {c.topic: c.msgtype for c in reader.connections}
    chosen: list[str] = []
    remarks: list[str] = []
    for wanted in bag.topics:
        found = sorted(topic for topic in types if fnmatchcase(topic, wanted))
        if not found:
            names = expected_names(wanted, sorted(types))
            raise InputInvalid(bag.path, f"no topic {wanted!r}", names)
        for topic in found:
            if types[topic] in READINGS:
                chosen.append(topic)
            elif len(found) > 1 or topic != wanted:
                remarks.append(f"{topic}: {types[topic]} is not read")
            else:
                raise InputInvalid(f"{bag.path}: {topic}", types[topic], ", ".join(READINGS))
    zero, words = _zero(options.get("zero"), reader.start_time)
    remarks.insert(0, words)
    tracks: dict[str, Track] = {}
    for topic in dict.fromkeys(chosen):
        new, more = _topic(bag.path, reader, topic, zero, options)
        remarks += more
        for name, track in new.items():
            if name in tracks and name not in ("t_sample", "valid"):
                raise InputInvalid(f"{bag.path}: {topic}", f"a second signal {name!r}",
                                   "topics whose signals have different names")  # fmt: skip
            tracks.setdefault(name, track)
    return _Contents(tracks, tuple(f"{bag.path.name}: {remark}" for remark in remarks))


def _zero(given: str | None, begin: int) -> tuple[int, str]:
    """Return the time of the bag [ns] that is t = 0, and a sentence on it."""
    if given is not None:
        return int(Decimal(given).scaleb(9)), f"t = 0 is the bag's time {given} s, as given"
    if begin < _SIMULATED:
        return 0, "the bag has simulated times, which are used as they are"
    return (
        begin,
        f"t = 0 is the bag's begin, {Decimal(begin).scaleb(-9)} s; zero=SECONDS changes it",
    )


def _topic(
    file: Path, reader: AnyReader, topic: str, zero: int, options: Mapping[str, str]
) -> tuple[dict[str, Track], list[str]]:
    """Return the signals of a topic, and sentences about it."""
    connections = [c for c in reader.connections if c.topic == topic]
    type_ = connections[0].msgtype
    reading, place = READINGS[type_], f"{file}: {topic}"
    times: list[int] = []
    stamps: list[int] = []
    frames: dict[str, None] = {}
    rows: list[list[Array]] = []
    for connection, time, raw in reader.messages(connections):
        try:
            message: Any = reader.deserialize(raw, connection.msgtype)
            rows.append([field_values(message, path) for path in reading.fields])
        except Exception as error:  # bytes of another program: whatever rosbags raises for them
            shown = f"a message cannot be read ({type(error).__name__}: {error})"
            raise InputInvalid(_at(place, time - zero), shown, type_) from None
        header = getattr(message, "header", None)
        own = 0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec
        times.append(time)
        is_stamped = header is not None and (own > 0 or time < _SIMULATED)
        stamps.append(own if is_stamped else time)  # 0 of a bag with real times: no stamp
        frames |= {} if header is None else {header.frame_id: None}
        if len(rows) > 1 and [len(x) for x in rows[-1]] != [len(x) for x in rows[0]]:
            raise InputInvalid(_at(place, time - zero), "another number of elements than before",
                               "messages of one length")  # fmt: skip
    if not rows:
        raise InputInvalid(place, "no message", "at least one")
    if odd := next((f for f in frames if f.rstrip("/").endswith(("ned", "frd"))), None):
        raise InputInvalid(place, f"frame {odd!r}", "frames of REP 103: ENU, or FLU")
    at_bag, at_header = np.array(times) - zero, np.array(stamps) - zero
    ticks = at_header if options.get("stamp") == "header" else at_bag
    order = np.argsort(ticks, kind="stable")
    ticks, at_header = ticks[order], at_header[order]
    fields = {
        path: np.stack([row[i] for row in rows])[order] for i, path in enumerate(reading.fields)
    }
    values = _finite(place, reading, fields, ticks)
    tracks = _tracks(topic, type_, reading, values, ticks, options.get("between", "held"))
    if reading.is_sensor:
        first = int(ticks[0])
        before = np.concatenate([[first - 1], ticks])
        seconds = np.concatenate([[-1.0], at_header / 1e9])
        tracks["t_sample"] = Track(before, seconds, ("s",))
        tracks["valid"] = Track(
            before, np.concatenate([[False], np.ones(len(ticks), bool)]), ("1",)
        )
    return tracks, list(_remarks(topic, type_, frames, ticks, at_header, order, options))


def _finite(place: str, reading: Reading, fields: Mapping[str, Array], ticks: Array) -> Any:
    """Return the signals of all messages; raises InputInvalid for numbers that are not finite."""
    try:
        values = reading.signals(fields)
    except InputInvalid as error:
        raise InputInvalid(f"{place}: {error}") from None
    for name, value in values.items():
        lost = ~np.isfinite(value) if value.dtype.kind == "f" else np.zeros(value.shape, bool)
        if lost.any() and not reading.gaps:
            row = int(np.flatnonzero(lost.reshape(len(value), -1).any(axis=1))[0])
            raise InputInvalid(
                _at(place, int(ticks[row])), f"{name} {value[row]}", "finite numbers"
            )
        values[name] = np.where(lost, 0.0, value) if lost.any() else value
    return values


def _tracks(
    topic: str,
    type_: str,
    reading: Reading,
    values: Mapping[str, Array],
    ticks: Array,
    between: str,
) -> dict[str, Track]:
    """Return tracks of signals; of messages at one time, the last one counts."""
    last = np.append(np.diff(ticks) > 0, True)
    found = {}
    for name, value in values.items():
        is_plain = type_.startswith("std_msgs")
        scalar = value.ndim > 1 and value.shape[1] == 1 and not type_.endswith("MultiArray")
        kept = value[last, 0] if scalar else value[last]
        if kept.dtype.kind in "iu":
            kept = kept.astype(np.int64)
        found[topic.rpartition("/")[2] if is_plain else name] = Track(
            ticks[last],
            kept.astype(float) if kept.dtype.kind == "f" else kept,
            reading.units[name],
            between == "linear" and kept.dtype.kind == "f",
            _ANGLES.get(name, ()),
        )
    return found


def _remarks(
    topic: str, type_: str, frames: Mapping[str, None], ticks: Array, stamps: Array, order: Array,
    options: Mapping[str, str],
) -> Iterator[str]:  # fmt: skip
    """Yield sentences on how a topic is read, and on what is unusual in it."""
    between = "linear" if options.get("between") == "linear" else "held"
    named = ", ".join(repr(f) for f in frames if f)
    yield (
        f"{topic}: {type_}, {len(ticks)} messages from {ticks[0] / 1e9:g} to "
        f"{ticks[-1] / 1e9:g} s, {between} between them"
        + (f"; frame {named}, read by REP 103" if named else "")
    )
    if ticks[0] > 0:
        yield f"{topic}: before {ticks[0] / 1e9:g} s, the first message's values are used"
    steps = np.diff(ticks)
    if len(steps) and steps.max() > 5 * max(np.median(steps), 1):
        i = int(np.argmax(steps))
        yield (
            f"{topic}: the longest gap is {steps[i] / 1e9:g} s, from {ticks[i] / 1e9:g} s on; "
            f"the median is {np.median(steps) / 1e9:g} s"
        )
    late = int(np.sum(np.diff(stamps) < 0))
    if late:
        yield f"{topic}: {late} messages have an older stamp than the one before them"
    moved = int(np.sum(np.diff(order) < 0))
    if moved:
        yield f"{topic}: {moved} messages were out of order, and are sorted by their time"
    same = int(np.sum(steps == 0))
    if same:
        yield f"{topic}: {same} messages have the time of the next one, which is used"


def _at(place: str, tick: int) -> str:
    return f"{place}, t = {tick / 1e9:g} s"
