"""Subscription to states: an iterator of blocks, each with its tick and time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, Self, final

import numpy as np

from uuvsim_cosim.bridge.calls.values import format_of
from uuvsim_cosim.bridge.calls.zenoh_keys import state_key
from uuvsim_cosim.bridge.zenoh.session import Disconnected, WrappedSession
from uuvsim_cosim.bridge.zenoh.stream import HEADER
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Block", "Subscription"]


@dataclass(frozen=True)
class Block:
    """The values of one component at one communication point."""

    component: str
    tick: int
    time: float  # s
    values: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:
        """Return one value."""
        return self.values[name]


@final
class Subscription(Closing):
    """Blocks of the wanted variables, or of all; it ends when either end closes it.

    States are dropped if they arrive faster than they are read; the ticks show that.
    """

    def __init__(
        self,
        session: WrappedSession,
        system: str,
        names: Sequence[str],
        components: Collection[str],
        blocks: Callable[[], Mapping[str, Any]],
        keep: int,
    ) -> None:
        self._blocks = blocks
        self._learn()
        known = [n for held in self._names.values() for n in held]
        for name in names:
            if name not in known and name not in components:
                raise InputInvalid("subscribe", f"no output {name!r}", expected_names(name, known))
        self._wanted = frozenset(names)
        paths = {
            path
            for path, held in self._names.items()
            if path in self._wanted or self._wanted & set(held) or not names
        }
        key = state_key(system, next(iter(paths)) if len(paths) == 1 else "*")
        self._paths = paths
        self._session = session
        self._subscriber = session.subscribe(key, keep)
        self._samples = self._subscriber.handler  # a subscriber that receives cannot be undeclared

    def __iter__(self) -> Self:
        """Return itself."""
        return self

    def __next__(self) -> Block:
        """Wait for the next block."""
        import zenoh

        while True:
            try:
                with self._session.inside():
                    sample = self._samples.recv()
            except (zenoh.ZError, Disconnected):
                raise StopIteration from None
            path = str(sample.key_expr).rpartition("/")[2]
            if path in self._paths:
                return self._block(path, sample.payload.to_bytes())

    def close(self) -> None:
        """End the subscription; a thread that waits for a block stops waiting."""
        import zenoh

        try:
            self._subscriber.undeclare()
        except (zenoh.ZError, AttributeError):
            return

    def _learn(self) -> None:
        """Read the layout of the blocks, which a replacement of a component changes."""
        schema = self._blocks()
        self._layout = schema["layout"]
        self._names: Mapping[str, list[str]] = schema["blocks"]
        self._shapes = {s["name"]: tuple(s["shape"]) for s in schema["signals"]}
        self._exact = {s["name"]: format_of(s["type"]) for s in schema["signals"]}

    def _block(self, path: str, data: bytes) -> Block:
        tick, time, layout = HEADER.unpack_from(data)
        if layout != self._layout:
            self._learn()
        numbers = np.frombuffer(data, "<f8", offset=HEADER.size)
        values: dict[str, Any] = {}
        names = self._names.get(path, ())
        # Offsets: of the variable, and of exact integers, which follow all variables.
        at, behind = 0, sum(prod(self._shapes[name]) for name in names)
        for name in names:
            shape, exact = self._shapes[name], self._exact[name]
            size = prod(shape)
            part = numbers[at : at + size]
            if exact is not None and behind + size <= len(numbers):  # not from older servers
                part = numbers[behind : behind + size].view(np.dtype(exact).newbyteorder("<"))
                behind += size
            if not self._wanted or name in self._wanted or path in self._wanted:
                values[name] = part.reshape(shape) if shape else part[0].item()
            at += size
        return Block(path, tick, time, values)
