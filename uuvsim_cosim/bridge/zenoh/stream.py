"""Stream of states: one block for each component and communication point, sent by its own thread.

A block is little-endian: tick (int64), time [s] (float64), layout (int64), then the component's
recorded variables as float64, in the order that the schema gives for this layout. After them,
each element of an Int64, UInt64 or Enumeration variable follows a second time, exactly, as int64 or
uint64. Blocks that cannot be sent in time are dropped; a client sees that from the ticks.
"""

from __future__ import annotations

import contextlib
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, final

import numpy as np

from uuvsim_cosim.bridge.calls.values import format_of
from uuvsim_cosim.bridge.zenoh.shared_memory import SharedMemory
from uuvsim_cosim.closing import started
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column, seconds
from uuvsim_cosim.orchestrator.plan.plan import Plan

if TYPE_CHECKING:
    import zenoh

__all__ = ["HEADER", "Layout", "Stream"]

HEADER = struct.Struct("<qdq")
_Integers = tuple[int, np.dtype, bool]  # a column, its type, and whether float64 may round it
_CHUNKS = 512  # chunks of rows that wait at most; older ones are dropped
_RATE = 2000.0  # [rows/s] that are sent at most
_MANY = 64  # more rows arrive at once only in a run that is as fast as possible; of these, only
_FEW = 4  # the newest are sent, which is enough for a viewer and hardly slows the run
_BYTES = 32 << 20  # of rows that wait at most: rows with camera frames are large
_REST = 0.001  # [s] pause after sending: rows of this time are sent together, as waking costs time
_LOOK = 0.05  # [s] between two checks which components are subscribed to


@dataclass(frozen=True)
class Layout:
    """The columns of a component's block; `names` and `shapes` are those of its variables."""

    names: tuple[str, ...]
    shapes: tuple[tuple[int, ...], ...]
    columns: tuple[int, ...]


@final
class Stream:
    """An observer that copies rows into a ring buffer, which a thread sends by `publisher(path)`.

    `observe` never waits for a client: it runs in the thread that steps.
    """

    def __init__(
        self, publisher: Callable[[str], zenoh.Publisher], memory: SharedMemory | None = None
    ) -> None:
        self._make = publisher
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._ring: deque[tuple[int, np.ndarray, np.ndarray]] = deque(maxlen=_CHUNKS)
        self._wake = threading.Event()
        self._noticed = threading.Condition()
        self._over = False
        self._wanted: tuple[str, ...] = ()
        self._plans: dict[int, list[tuple[str, np.ndarray | slice, list[_Integers]]]] = {}
        self._most, self._tick = _CHUNKS, Fraction(1)
        self.layout = 0
        self.layouts: Mapping[str, Layout] = {}
        self.dropped = 0
        self.memory = memory or SharedMemory()
        self._thread = started("uuvsim-stream", self._drain)

    # ---- the observer, in the conductor's thread ------------------------------------------

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Lay out the blocks of a new run."""
        self.layouts, self._tick = _layouts(columns), plan.tick
        self._most = max(2, _BYTES // (8 * len(columns) + 1))
        if self._most < _CHUNKS:
            self._ring = deque(self._ring, self._most)
        number = self.layout + 1
        self._plans = {number: [_gather(p, held, columns) for p, held in self.layouts.items()]}
        for path in self.layouts:
            if path not in self._publishers:
                self._publishers[path] = self._make(path)
        self.layout = number

    def observe(self, chunk: Chunk) -> None:
        """Copy the rows, only the newest if they are many."""
        if not self._wanted:
            return
        ring, n = self._ring, len(chunk.ticks)
        few = min(n if n <= _MANY else _FEW, self._most)
        self.dropped += n - few
        if len(ring) == ring.maxlen:
            with contextlib.suppress(IndexError):  # the thread has just emptied the ring
                self.dropped += len(ring[0][1])  # `append` removes this one
        ring.append((self.layout, chunk.ticks[n - few :].copy(), chunk.rows[n - few :].copy()))
        if not self._wake.is_set():
            self._wake.set()

    def end(self) -> None:
        """Stop; rows that still wait are not sent."""
        self._over = True
        self._wake.set()
        self._thread.join()

    def wait_until_wanted(self, path: str, timeout: float) -> bool:
        """Wait until the thread has noticed a subscriber of a component; return whether it has."""
        with self._noticed:
            return self._noticed.wait_for(lambda: path in self._wanted, timeout)

    # ---- the thread that sends ------------------------------------------------------------

    def _drain(self) -> None:
        looked, budget, then = 0.0, _RATE, time.monotonic()
        while not self._over:
            self._wake.wait(_LOOK)
            self._wake.clear()
            now = time.monotonic()
            if now - looked >= _LOOK:
                looked = now
                publishers = list(self._publishers.items())
                with self._noticed:
                    self._wanted = tuple(path for path, p in publishers if p.matching_status)
                    self._noticed.notify_all()
            budget = min(_RATE * _LOOK * 2, budget + _RATE * (now - then))
            then, sent = now, False
            while self._ring and not self._over:
                try:
                    layout, ticks, rows = self._ring.popleft()
                except IndexError:
                    break
                n = min(len(ticks), int(budget))
                self.dropped += len(ticks) - n
                if n:
                    budget -= n
                    self._send(layout, ticks[-n:], rows[-n:])
                    sent = True
            if sent and not self._over:
                time.sleep(_REST)

    def _send(self, layout: int, ticks: np.ndarray, rows: np.ndarray) -> None:
        wanted, payload = self._wanted, self.memory.payload
        times = seconds(ticks, self._tick).tolist()
        heads = [HEADER.pack(k, t, layout) for k, t in zip(ticks.tolist(), times, strict=True)]
        for path, columns, converted in self._plans.get(layout, ()):
            if path not in wanted:
                continue
            block = rows[:, columns]
            if converted:
                exact = [i for i, _, is_exact in converted if is_exact]
                block = np.concatenate([block, block[:, exact]], 1)
                for i, type_, _ in converted:
                    block[:, i] = block[:, i].view(type_).astype(np.float64).view(np.uint64)
            put = self._publishers[path].put
            for head, values in zip(heads, block, strict=True):
                put(payload(head, values))


def _layouts(columns: Sequence[Column]) -> dict[str, Layout]:
    found: dict[str, dict[str, tuple[tuple[int, ...], list[int]]]] = {}
    for i, c in enumerate(columns):
        if not c.type.is_blob:
            variables = found.setdefault(c.path, {})
            variables.setdefault(c.variable.name, (c.variable.shape, []))[1].append(i)
    return {
        path: Layout(
            tuple(f"{path}.{name}" for name in variables),
            tuple(shape for shape, _ in variables.values()),
            tuple(i for _, indices in variables.values() for i in indices),
        )
        for path, variables in found.items()
    }


def _gather(
    path: str, layout: Layout, columns: Sequence[Column]
) -> tuple[str, np.ndarray | slice, list[_Integers]]:
    """Return a component's path and columns, and the columns that must be converted to float64."""
    converted = []
    for k, i in enumerate(layout.columns):
        type_ = np.dtype(columns[i].type.dtype)
        if type_ != np.dtype("f8"):
            exact = format_of(columns[i].variable.type) is not None
            converted.append((k, type_, exact))
    indices = layout.columns
    if indices and indices == tuple(range(indices[0], indices[-1] + 1)):
        return path, slice(indices[0], indices[-1] + 1), converted  # mostly: needs no copy
    return path, np.array(indices, np.intp), converted
