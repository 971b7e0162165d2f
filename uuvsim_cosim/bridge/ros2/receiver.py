"""Subscriptions of a node: messages become values of the system's inputs, with a fail-safe.

One thread looks at all topics, 200 times per second. Zenoh keeps the newest messages of each topic,
and older ones are dropped outside Python, so that a flood costs the simulation nothing. A message
that cannot be used is reported once for its topic and kind of fault, and is then ignored.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from threading import Event
from typing import Any, final

import numpy as np

from uuvsim_cosim.bridge.calls.service import Client, Schema, Service
from uuvsim_cosim.bridge.http.keyboard import SPEED, YAW_RATE
from uuvsim_cosim.bridge.http.manual_axes import AXES, manual_axes_of
from uuvsim_cosim.bridge.ros2.ends import Ends
from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.inputs import KEEP, Input, System
from uuvsim_cosim.bridge.ros2.interfaces import decoded
from uuvsim_cosim.bridge.ros2.messages.readings import command_values
from uuvsim_cosim.bridge.ros2.rmw_zenoh import KEEP_10, read_attachment
from uuvsim_cosim.closing import Closing, started
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["Receiver", "system_of"]

_LOOK = 0.005  # [s] between two looks at the topics
_KEPT = 8  # messages of a topic that wait at most
_LARGEST = 1 << 16  # bytes of a message
_AXES_LAST = 0.2  # [s] after which the axes of a page are given again; they hold for 0.5 s
_WINDOW = 1.0  # [s] over which messages are counted
_CLIENT = Client("ros2", "ros2", frozenset({"read", "set"}))


class _OldStamp(InputInvalid):
    """A time stamp that is far from both clocks."""


def system_of(service: Service, outputs: tuple[str, ...] = ()) -> System:
    """Return what clients can set in a system."""
    pilots = [c["path"] for c in service.describe()["components"] if c["kind"] == "keyboard"]
    return System(service.schema().by_name, pilots, outputs)


@final
class Receiver(Closing):
    """The inputs of a node, from construction to `close`, which applies the fail-safe.

    `choose` returns the inputs of a system; it is called again after a component was replaced.
    """

    def __init__(
        self, service: Service, ends: Ends, choose: Callable[[System], list[Input]],
        outputs: Callable[[], tuple[str, ...]],
    ) -> None:  # fmt: skip
        self._service, self._ends, self._choose, self._outputs = service, ends, choose, outputs
        self._schema: Schema | None = None
        self._topics: list[_Topic] = []
        self._over = Event()
        self.inputs: list[Input] = []
        self._renew(service.schema())
        self._thread = started("uuvsim-ros2-inputs", self._serve)

    def close(self) -> None:
        """End the thread and the commands that hold."""
        self._over.set()
        self._thread.join()
        for topic in self._topics:
            topic.undeclare()

    def _serve(self) -> None:
        while not self._over.wait(_LOOK):
            if (schema := self._service.schema()) is not self._schema:
                try:
                    self._renew(schema)
                except UuvsimError as error:  # the file does not fit the changed system
                    self._ends.reports.put(f"inputs are closed: {error}")
            for topic in self._topics:
                topic.look(time.monotonic())

    def _renew(self, schema: Schema) -> None:
        self._schema, kept, self._topics = schema, self._topics, []
        for topic in kept:
            topic.undeclare()
        chosen = self._choose(system_of(self._service, self._outputs()))
        owners: dict[str, _Topic] = {}
        self._topics = [_Topic(self._service, self._ends, one, owners) for one in chosen]
        self.inputs = chosen


@final
class _Topic:
    """The subscription of one input; `owners` has the topic that set each signal last."""

    def __init__(self, service: Service, ends: Ends, of: Input, owners: dict[str, _Topic]) -> None:
        self._service, self._ends, self._of, self._owners = service, ends, of, owners
        self._key = ends.key(of.name, of.type)
        prefix = f"{ends.node.domain}/{of.name.strip('/')}"
        # Any type and hash, so that messages of another distribution are noticed.
        self._channel = ends.session.subscribe(f"{prefix}/*/*", _KEPT)
        self._token: Any = ends.session.token(ends.token("MS", of.name, of.type, KEEP_10))
        names = [n for role, names in of.signals.items() if role != "axes" for n in names]
        self._start = service.get(_CLIENT, names)
        self._axes = np.zeros(6)
        self._lasts = self._next = self._given = 0.0
        self._is_live = False
        self._window = time.monotonic()
        self._numbers: dict[bytes, tuple[int, int]] = {}  # by publisher: first and last in window

    def undeclare(self) -> None:
        """End the subscription, and a command that holds."""
        self._channel.undeclare()
        self._token.undeclare()
        if self._is_live:
            with suppress(UuvsimError):  # the co-simulation has ended already
                self._fail_safe()

    def look(self, now: float) -> None:
        """Use the newest message; without one for the time-out, apply the fail-safe."""
        if now >= self._next:
            newest = None
            while (sample := self._channel.try_recv()) is not None:
                newest = self._read(sample) or newest
            if newest is not None and self._set(newest):
                self._lasts, self._is_live = now + self._of.timeout, True
                self._next = now + 1.0 / self._of.rate
        if self._is_live and now > self._lasts:
            self._is_live = False
            self._lose()
        elif self._is_live and "axes" in self._of.signals and now > self._given + _AXES_LAST:
            self._steer(self._axes)
        self._count(now)

    # ---- messages ---------------------------------------------------------------------------

    def _read(self, sample: Any) -> dict[str, Array] | None:
        """Return the values of a message; None for one that is reported instead."""
        of, place = self._of, self._of.name
        if sample.attachment is not None:
            self._number(sample.attachment.to_bytes())
        if str(sample.key_expr) != self._key:
            type_, hash_ = str(sample.key_expr).split("/")[-2:]
            expected_type, expected_hash = self._key.split("/")[-2:]
            self._ends.reports.once(
                place, "type", f"messages of type {type_}, hash {hash_[:200]}; expected "
                f"{expected_type}, hash {expected_hash}, as the distribution has it",
            )  # fmt: skip
            return None
        data = sample.payload.to_bytes()
        try:
            if len(data) > _LARGEST:
                raise InputInvalid(f"a message of {len(data)} bytes", f"at most {_LARGEST}")
            message = decoded(self._ends.store, of.type, data)
            self._check_stamp(message)
            return command_values(of.type, message, of.frame, of.child)
        except InputInvalid as error:
            self._refused(error)
            return None

    def _refused(self, error: UuvsimError) -> None:
        """Report an error once; errors are of one kind if they expect the same."""
        fault = "stamp" if isinstance(error, _OldStamp) else error.problems[0].expected
        self._ends.reports.once(self._of.name, fault, f"{error}; such messages are ignored")

    def _check_stamp(self, message: Any) -> None:
        """Refuse a time stamp that is far from the simulated time and from the time of day."""
        header = getattr(message, "header", None)
        stamp = 0.0 if header is None else header.stamp.sec + 1e-9 * header.stamp.nanosec
        simulated = self._service.moment().time
        if stamp and min(abs(stamp - t) for t in (simulated, time.time())) > self._of.timeout:
            raise _OldStamp(
                f"header.stamp {stamp:.9g} s",
                f"one within {self._of.timeout:g} s of the simulated time, {simulated:.6g} s, or "
                "of the time of day, or 0",
            )

    def _number(self, attachment: bytes) -> None:
        if (read := read_attachment(attachment)) is not None and len(self._numbers) < _KEPT:
            number, _, gid = read
            first, _ = self._numbers.get(gid, (number, number))
            self._numbers[gid] = (first, number)

    def _count(self, now: float) -> None:
        """Report a flood, by the numbers that publishers give their messages."""
        if now < self._window + _WINDOW:
            return
        rate = sum(last - first for first, last in self._numbers.values()) / (now - self._window)
        self._window, self._numbers = now, {}
        if rate > 2.0 * self._of.rate:
            self._ends.reports.once(
                self._of.name, "flood", f"{rate:.0f} messages per second; expected at most "
                f"{self._of.rate:g}, of which the newest are used",
            )  # fmt: skip

    # ---- the system's inputs ----------------------------------------------------------------

    def _set(self, values: Mapping[str, Array]) -> bool:
        """Set the signals; return whether the system accepts the values."""
        given: dict[str, object] = {}
        try:
            for role, names in self._of.signals.items():
                if role == "axes":
                    self._axes = values["axes"]
                    continue
                given |= self._split(role, names, values[role])
            if given:
                self._service.set(_CLIENT, given)
        except UuvsimError as error:
            self._refused(error)
            return False
        self._owners.update(dict.fromkeys(given, self))
        if "axes" in self._of.signals:
            self._steer(self._axes)
        return True

    def _split(self, role: str, names: tuple[str, ...], value: Array) -> dict[str, object]:
        shapes = [np.shape(self._start[name]) for name in names]
        sizes = [int(np.prod(shape, dtype=int)) for shape in shapes]
        if len(value) != sum(sizes):
            raise InputInvalid(f"{role} has {len(value)} elements", sum(sizes))
        parts = np.split(np.asarray(value, float), np.cumsum(sizes)[:-1])
        return {n: part.reshape(s) for n, s, part in zip(names, shapes, parts, strict=True)}

    def _steer(self, nu: Array) -> None:
        """Give the axes of the piloted components the share of their largest velocities."""
        self._given = time.monotonic()
        for path in self._of.signals["axes"]:
            largest = self._largest(path)
            shares = np.clip(nu[[0, 1, 2, 5]] / largest, -1.0, 1.0)
            axes = dict(zip(AXES, map(float, shares), strict=True))
            if (refused := manual_axes_of(path).update(self._page, axes)) is not None:
                self._ends.reports.once(self._of.name, "page", refused)

    def _largest(self, path: str) -> Array:
        names = [f"{path}.{axis}_max" for axis in AXES]
        if names[0] not in self._service.schema().by_name:  # over another pilot
            return np.array([SPEED, np.inf, np.inf, YAW_RATE])
        values = self._service.get(_CLIENT, names)
        return np.array([max(float(values[name]), 1e-9) for name in names])

    @property
    def _page(self) -> str:
        return f"ROS 2 {self._of.name}"

    def _lose(self) -> None:
        """Apply the fail-safe, and report it."""
        try:
            done = self._fail_safe()
        except UuvsimError as error:
            self._refused(error)
            return
        self._ends.reports.put(
            f"{self._of.name}: no message for {self._of.timeout:g} s, at "
            f"t = {self._service.moment().time:.6g} s; fail-safe: {done}"
        )

    def _fail_safe(self) -> str:
        """Set the signals that this topic set last to their fail-safe values; return the text."""
        values: dict[str, object] = {}
        actions = []
        for role, names in self._of.signals.items():
            signals, after = ", ".join(names), self._of.after_loss(role)
            if role == "axes":
                for path in names:
                    manual_axes_of(path).release(self._page)
                actions.append(f"{signals} stops")
            elif after == KEEP:
                actions.append(f"{signals} keeps its value")
            else:
                given = isinstance(after, tuple)
                parts = self._split(role, names, np.array(after)) if given else self._start
                actions.append(
                    f"{signals} {f'= {list(after)}' if given else 'gets its start value'}"
                )
                own = [name for name in names if self._owners.get(name) is self]
                values |= {name: parts[name] for name in own}
        if values:
            self._service.set(_CLIENT, values)
        return "; ".join(actions)
