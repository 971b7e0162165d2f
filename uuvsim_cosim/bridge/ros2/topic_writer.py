"""Topics as rows of messages, for a recording and for a running system alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from uuvsim_cosim.bridge.ros2.cdr import MessageLayout
from uuvsim_cosim.bridge.ros2.conversions import CONVERSIONS, sensor_figures
from uuvsim_cosim.bridge.ros2.frames import Array, body, body_quaternion, euler_quaternion
from uuvsim_cosim.bridge.ros2.rows import Block
from uuvsim_cosim.bridge.ros2.topics import Topic
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.plan import Plan

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["DISTRIBUTIONS", "TRANSFORMS", "Mount", "TopicColumns", "TopicWriter", "mounted",
           "mounts_of", "parameters_of", "typestore"]  # fmt: skip

TRANSFORMS = "tf2_msgs/msg/TFMessage"
DISTRIBUTIONS = ("humble", "jazzy", "kilted", "lyrical")
# Fields that a distribution's message may lack.
_NEW = {"sensor_msgs/msg/Range": frozenset({"variance"})}


def typestore(distribution: str) -> Typestore:
    """Return the messages of a ROS 2 distribution; raises InputInvalid without rosbags."""
    if distribution not in DISTRIBUTIONS:
        raise InputInvalid(f"ROS 2 {distribution!r}", ", ".join(DISTRIBUTIONS))
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputInvalid("rosbags is not installed", "pip install 'uuvsim-cosim[ros]'") from None
    return get_typestore(Stores[f"ROS2_{distribution.upper()}"])


def parameters_of(plan: Plan, components: Iterable[str]) -> dict[str, dict[str, Array]]:
    """Return the numeric parameters of components, by their paths."""
    wanted = set(components)
    return {
        c.path: {
            v.name: np.asarray(c.start.get(v.name, v.start), float)
            for v in c.description.variables.values()
            if v.causality == "parameter" and v.type not in ("String", "Binary")
        }
        for c in plan.components
        if c.path in wanted
    }


class Mount(NamedTuple):
    """A frame that does not move in another one: translation (1, 3) [m] and rotation (1, 4)."""

    parent: str
    child: str
    translation: Array
    rotation: Array


def mounts_of(
    topics: Iterable[Topic], parameters: Mapping[str, Mapping[str, Array]]
) -> list[Mount]:
    """Return the frames of sensors whose place is known, `r_s` and `Theta_s` from b."""
    frames = {t.frame: parameters.get(t.component, {}) for t in topics}
    found = []
    for name, p in frames.items():
        if name.endswith("_link") and name != "base_link" and "r_s" in p:
            parent = f"{name.rpartition('/')[0]}/base_link".removeprefix("/")
            q = euler_quaternion(p.get("Theta_s", np.zeros(3)).reshape(1, 3))
            found.append(Mount(parent, name, body(p["r_s"].reshape(1, 3)), body_quaternion(q)))
    return found


def mounted(
    store: Typestore, topics: Iterable[Topic], parameters: Mapping[str, Mapping[str, Array]]
) -> Array:
    """Return the message of /tf_static; without a sensor whose place is known, it is empty."""
    known = mounts_of(topics, parameters)
    if not known:
        return np.zeros(0, np.uint8)
    texts, columns = {}, {}
    for i, mount in enumerate(known):
        at = f"transforms.{i}"
        texts[f"{at}.header.frame_id"] = mount.parent
        texts[f"{at}.child_frame_id"] = mount.child
        columns[f"{at}.transform.translation"] = mount.translation
        columns[f"{at}.transform.rotation"] = mount.rotation
    layout = MessageLayout(store, TRANSFORMS, texts, {"transforms": len(known)})
    return layout.rows(1, columns).ravel()


@dataclass
class TopicColumns:
    """New samples of a topic, block by block, as columns of its message's fields."""

    topic: Topic
    parameters: Mapping[str, Mapping[str, Array]]
    _last: float = -np.inf  # time of the last sample [s]
    _at: float = -np.inf  # time of the last row [s]
    _figures: dict[str, float] = field(default_factory=dict)

    def columns(self, block: Block) -> tuple[Array, dict[str, Array]]:
        """Return the times [s] of the samples, and the columns."""
        time, chosen = self._samples(block)
        values = {
            role: np.asarray(block[name])[chosen] for role, name in self.topic.signals.items()
        }
        if not len(time):
            return time, {}
        if self.topic.type in CONVERSIONS:
            return time, CONVERSIONS[self.topic.type].columns(values, self._of_sensor(time))
        return time, {"data": values["data"]}

    def _samples(self, block: Block) -> tuple[Array, Array]:
        """Return the times [s] of new samples, and the rows of the block that hold them."""
        path = self.topic.component
        time, keep = block.time, np.ones(len(block.time), bool)
        if len(time):
            if time[0] < self._at:  # a reset, or an earlier snapshot
                self._last = -np.inf
            self._at = float(time[-1])
        if f"{path}.t_sample" in block and not self.topic.type.startswith("std_msgs"):
            time = np.asarray(block[f"{path}.t_sample"])
            before = np.concatenate([[max(self._last, -1.0)], time[:-1]])
            keep = (time >= 0) & (time > before)
            if f"{path}.valid" in block:
                keep &= np.asarray(block[f"{path}.valid"]) > 0
        chosen = np.flatnonzero(keep)
        if self.topic.rate is not None:
            chosen = self._thinned(time, chosen, 1 / float(self.topic.rate))
        if len(chosen):
            self._last = float(time[chosen[-1]])
        return time[chosen], chosen

    def _thinned(self, time: Array, chosen: Array, period: float) -> Array:
        kept, last = [], self._last
        for i in chosen:
            if time[i] >= last + period * (1 - 1e-9):
                kept.append(i)
                last = time[i]
        return np.array(kept, int)

    def _of_sensor(self, time: Array) -> dict[str, float]:
        path = self.topic.component
        if not self._figures and path in self.parameters and len(time) > 1:
            period = float(np.min(np.diff(time)))
            self._figures = sensor_figures(self.topic.type, self.parameters[path], period)
        return self._figures


@dataclass
class TopicWriter:
    """Messages of a topic, block by block; `count` of them so far."""

    topic: Topic
    store: Typestore
    parameters: Mapping[str, Mapping[str, Array]]
    count: int = 0
    _layout: MessageLayout | None = None

    def __post_init__(self) -> None:
        self._columns = TopicColumns(self.topic, self.parameters)

    def messages(self, block: Block) -> tuple[Array, Array]:
        """Return the times [ns] and bytes (n, size) of the messages of a block."""
        time, columns = self._columns.columns(block)
        self.count += len(time)
        if not len(time):
            return np.zeros(0, np.int64), np.zeros((0, 0), np.uint8)
        stamps = np.rint(time * 1e9).astype(np.int64)
        return stamps, self._rows(stamps, columns)

    def _rows(self, stamps: Array, columns: dict[str, Array]) -> Array:
        prefix = "transforms.0." if self.topic.type == TRANSFORMS else ""
        if self._layout is None:
            lengths = {"data": np.size(columns["data"][0])} if "data" in columns else {}
            texts = {f"{prefix}header.frame_id": self.topic.frame,
                     f"{prefix}child_frame_id": self.topic.child}  # fmt: skip
            self._layout = MessageLayout(
                self.store, self.topic.type, texts, {**lengths, "transforms": 1}
            )
        for name in _NEW.get(self.topic.type, frozenset()) - self._layout.fields:
            columns.pop(name, None)
        if f"{prefix}header.stamp.sec" in self._layout.fields:
            columns[f"{prefix}header.stamp.sec"] = stamps // 10**9
            columns[f"{prefix}header.stamp.nanosec"] = stamps % 10**9
        return self._layout.rows(len(stamps), columns)
