"""Topics as rows of messages, for a recording and for a running system alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.bridge.ros2.cdr import MessageLayout
from uuvsim_cosim.bridge.ros2.facts import Facts
from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.messages.conversion import Conversion, Shape, Values
from uuvsim_cosim.bridge.ros2.messages.conversions import CONVERSIONS, sensor_figures
from uuvsim_cosim.bridge.ros2.rows import Block
from uuvsim_cosim.bridge.ros2.topics import Topic
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["DISTRIBUTIONS", "TRANSFORMS", "TopicColumns", "TopicWriter", "typestore"]

DEFINITIONS = Path(__file__).parent / "definitions"  # of packages that rosbags lacks
TRANSFORMS = "tf2_msgs/msg/TFMessage"
DISTRIBUTIONS = ("humble", "jazzy", "kilted", "lyrical", "rolling")
# Fields that a distribution's message may lack.
_NEW = {"sensor_msgs/msg/Range": frozenset({"variance"})}


def typestore(distribution: str) -> Typestore:
    """Return the messages of a ROS 2 distribution, and of marine_acoustic_msgs.

    Those of rolling are the ones of lyrical, the newest that rosbags has. Raises InputInvalid
    without rosbags.
    """
    if distribution not in DISTRIBUTIONS:
        raise InputInvalid(f"ROS 2 {distribution!r}", ", ".join(DISTRIBUTIONS))
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise InputInvalid("rosbags is not installed", "pip install 'uuvsim-cosim[ros]'") from None
    known = "lyrical" if distribution == "rolling" else distribution
    store = get_typestore(Stores[f"ROS2_{known.upper()}"])
    for file in sorted(DEFINITIONS.glob("*/*.msg")):
        name = f"{file.parent.name}/msg/{file.stem}"
        store.register(get_types_from_msg(file.read_text(encoding="utf-8"), name))
    return store


_PLAIN = Conversion(
    {"data": -1},
    lambda v, _: {"data": v["data"]},
    shape=lambda v, _: Shape(lengths={"data": np.size(v["data"][0])}),
)


@dataclass
class TopicColumns:
    """New samples of a topic, block by block."""

    topic: Topic
    facts: Facts
    _last: float = -np.inf  # time of the last sample [s]
    _at: float = -np.inf  # time of the last row [s]
    _state: bytes = b""  # of the last message
    _sampled: float = -np.inf  # time of the last sample, also of one without a message [s]
    _period: float = np.inf  # of the samples [s]
    _figures: dict[str, float] | None = None

    def __post_init__(self) -> None:
        self.conversion = CONVERSIONS.get(self.topic.type, _PLAIN)
        path = self.topic.component
        self._stamp, self._valid = f"{path}.t_sample", f"{path}.valid"
        self._is_sensor = self.conversion is not _PLAIN and not self.conversion.prefixes
        self._every = 1 / float(self.topic.rate) if self.topic.rate is not None else None  # [s]

    def rests(self, block: Block) -> bool:
        """Return whether the topic's rate leaves out every row of a block; cheap to ask."""
        if self._every is None or self._period == np.inf or self.conversion.has_states:
            return False
        first, last = float(block.time[0]), float(block.time[-1])
        if first < self._at or last >= self._last + self._every * (1 - 1e-9):
            return False
        self._at = last
        return True

    def columns(self, block: Block) -> tuple[Array, Mapping[str, Array]]:
        """Return the times [s] of the samples, and the columns of the message's fields."""
        time, _, values, figures = self.samples(block)
        return time, self.conversion.columns(values, figures) if len(time) else {}

    def samples(self, block: Block) -> tuple[Array, Array, Values, Mapping[str, object]]:
        """Return the times [s] of new samples and of their rows, their values, and figures."""
        time, chosen = self._samples(block)
        values = (
            {role: np.asarray(block[name])[chosen] for role, name in self.topic.signals.items()}
            if len(chosen)
            else {}
        )
        return time, block.time[chosen], values, self._of_sensor()

    def _samples(self, block: Block) -> tuple[Array, Array]:
        """Return the times [s] of new messages, and the rows of the block that hold them."""
        time = block.time
        if len(time):
            if time[0] < self._at:  # a reset, or an earlier snapshot
                self._last, self._sampled, self._state = -np.inf, -np.inf, b""
            self._at = float(time[-1])
        chosen: Array = np.arange(len(time))
        if self._is_sensor and self._stamp in block:
            time = np.asarray(block[self._stamp])
            before = np.concatenate([[max(self._last, -1.0)], time[:-1]])
            keep = (time >= 0) & (time > before)
            if self._valid in block:
                valid = np.asarray(block[self._valid]) > 0
                keep &= valid
                if self.conversion.lost:
                    time = np.where(valid, time, block.time)
                    lost = self._thinned(time, np.flatnonzero(~valid | keep), 1.0)
                    keep[lost] = True
            chosen = np.flatnonzero(keep)
        self._measure(time[chosen])
        if self._every is not None:
            chosen = self._thinned(time, chosen, self._every)
            if self.conversion.has_states:
                chosen = np.union1d(chosen, self._changes(block)).astype(int)
        if len(chosen):
            self._last = float(time[chosen[-1]])
        return time[chosen], chosen

    def _changes(self, block: Block) -> Array:
        """Return the rows at which a state is another than before."""
        names = self.topic.signals.values()
        states = np.stack([np.asarray(block[name]).astype(np.uint8) for name in names], axis=1)
        before = np.concatenate([np.frombuffer(self._state, np.uint8).reshape(-1, len(names)),
                                 states[:-1]])  # fmt: skip
        self._state = states[-1:].tobytes() or self._state
        return np.flatnonzero(np.any(states[len(states) - len(before) :] != before, axis=1)) + (
            len(states) - len(before)
        )

    def _thinned(self, time: Array, chosen: Array, period: float) -> Array:
        kept, last = [], self._last
        for i, at in zip(chosen.tolist(), time[chosen].tolist(), strict=True):
            if at >= last + period * (1 - 1e-9):
                kept.append(i)
                last = at
        return np.array(kept, int)

    def _measure(self, time: Array) -> None:
        """Keep the period of the samples, from which the noise of one sample follows."""
        if not len(time):
            return
        shortest = float(time[0]) - self._sampled
        if len(time) > 1:
            shortest = min(shortest, float(np.min(np.diff(time))))
        self._sampled = float(time[-1])
        if 0.0 < shortest < self._period * (1 - 1e-6):
            self._period, self._figures = shortest, None

    def _of_sensor(self) -> Mapping[str, object]:
        facts = self.facts.get(self.topic.component, {})
        if self.conversion.needs:
            return facts
        if self._figures is None:
            parameters = {name: v for name, v in facts.items() if not name.startswith("@")}
            self._figures = sensor_figures(self.topic.type, parameters, self._period)
        return self._figures


@dataclass
class TopicWriter:
    """Messages of a topic, block by block; `count` of them so far."""

    topic: Topic
    store: Typestore
    facts: Facts
    count: int = 0
    _layouts: dict[tuple[tuple[str, str], ...], MessageLayout] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._samples = TopicColumns(self.topic, self.facts)
        self.rests = self._samples.rests

    def messages(self, block: Block) -> tuple[Array, Sequence[Array]]:
        """Return the times [ns] and bytes of the messages of a block.

        The times are those at which the messages are there. Headers have the times of the samples.
        """
        time, there, values, figures = self._samples.samples(block)
        self.count += len(time)
        if not len(time):
            return np.zeros(0, np.int64), ()
        stamps = np.rint(time * 1e9).astype(np.int64)
        rows: list[Array] = []
        for begin, end in self._alike(values):
            part = {role: v[begin:end] for role, v in values.items()}
            rows += list(self._rows(stamps[begin:end], part, figures))
        return np.rint(there * 1e9).astype(np.int64), rows

    def _alike(self, values: Values) -> list[tuple[int, int]]:
        """Return the spans of rows whose messages have the same texts."""
        n = len(next(iter(values.values())))
        if not self._samples.conversion.has_states:
            return [(0, n)]
        return [(i, i + 1) for i in range(n)]

    def _rows(self, stamps: Array, values: Values, figures: Mapping[str, object]) -> Array:
        prefix = "transforms.0." if self.topic.type == TRANSFORMS else ""
        conversion = self._samples.conversion
        columns = conversion.columns(values, figures)
        if conversion.has_states or not self._layouts:
            shape = Shape() if conversion.shape is None else conversion.shape(values, figures)
            texts = {f"{prefix}header.frame_id": self.topic.frame,
                     f"{prefix}child_frame_id": self.topic.child, **shape.texts}  # fmt: skip
            key = tuple(texts.items())
            layout = self._layouts.get(key) or MessageLayout(
                self.store, self.topic.type, texts, {**shape.lengths, "transforms": 1}
            )
            self._layouts[key] = layout
        else:
            layout = next(iter(self._layouts.values()))
        for name in _NEW.get(self.topic.type, frozenset()) - layout.fields:
            columns.pop(name, None)
        if f"{prefix}header.stamp.sec" in layout.fields:
            columns[f"{prefix}header.stamp.sec"] = stamps // 10**9
            columns[f"{prefix}header.stamp.nanosec"] = stamps % 10**9
        return layout.rows(len(stamps), columns)
