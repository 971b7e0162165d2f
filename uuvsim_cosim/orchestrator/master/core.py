"""The stepping loop as an object: tables of one plan in C's memory, and the calls that step it."""

from __future__ import annotations

import contextlib
import ctypes
import mmap
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.fmus.isolation.guard import guard_functions
from uuvsim_cosim.orchestrator.master.core_library import (
    Action,
    ClockKind,
    Coupling,
    Event,
    Failure,
    Outcome,
    StepControl,
    StepCounts,
    Type,
    library,
)

__all__ = ["Access", "Core", "columns_of"]

_LINE = 8  # slots of 8 bytes in a cache line
_PAGE = 512  # slots in a page
_HUGE = 1 << 21  # bytes
# Columns above which rows are stored row by row. Stored column by column, each value of a row is in
# another cache line, and no cache holds that many lines until the next row.
_WIDE = 4096


@dataclass(frozen=True)
class Access:
    """One grouped call: `n_values` slots from `slot` on, all of one type."""

    action: Action
    type: Type
    slot: int
    n_values: int
    references: tuple[int, ...]
    function: int = 0


class Core:
    """Tables of one plan in C's memory, and the calls that step it.

    Order of calls: `member`, then `access` and `state`, `transfer`, `iterate`, `record`; then
    `begin`, and `run` any number of times. Faults may be added and cleared between runs.

    `slots` holds the values at the communication point that has been reached: each input as it was
    last set, each output as other components see it. `fresh` holds values that exist but are not
    visible yet. Both are views of C's memory, and views that are kept elsewhere must not be used
    after `free`. Addresses of components (`member`, `instance`) must stay valid until `free`,
    and states of FMUs that the loop copied are freed by `forget`, while the FMUs still exist.
    """

    def __init__(self, n_members: int, n_slots: int, tick: Fraction) -> None:
        self._c = library()
        self._core = self._c.uuv_core_new(n_members, n_slots, tick.numerator, tick.denominator)
        if not self._core:
            raise UuvsimError(f"no memory for {n_members} components with {n_slots} values")
        self.n_members = n_members
        self.slots = _array(self._c.uuv_core_slots(self._core), n_slots)
        self.fresh = _array(self._c.uuv_core_fresh(self._core), n_slots)
        self._rows = np.zeros((0, 0), np.uint64)  # (rows, columns)
        self._ticks = np.zeros(0, np.int64)
        # Addresses of rows and ticks, number of rows, distances of columns and of rows.
        self._buffer: tuple[int | None, int | None, int, int, int] = (None, None, 0, 0, 0)
        self._row_texts: list[bytes] = []  # the texts of the rows
        self._image: ctypes.Array[ctypes.c_char] | None = None  # buffer of `get_image`
        self._names: list[bytes] = []  # of the members; C keeps pointers to them
        self._c.uuv_core_guard(self._core, *guard_functions())

    # ---- building -------------------------------------------------------------------------

    def member(
        self,
        index: int,
        kind: int,
        instance: int,
        do_step: int,
        get: int,
        kept: int,
        step_ticks: int,
        sequential: bool,
        name: str,
    ) -> None:
        """Fill in a component; members are in stepping order.

        `kept` is the address of an int32 that is 1 once a state of an FMU is kept, or 0.
        """
        self._names.append(name.encode())
        self._c.uuv_core_name(self._core, index, self._names[-1])
        self._c.uuv_core_member(
            self._core, index, kind, instance, do_step, get, kept, step_ticks, sequential
        )

    def access(self, member: int, a: Access) -> None:
        """Add a grouped read or write of a component."""
        n = len(a.references)
        references = (ctypes.c_uint32 * n)(*a.references)
        self._c.uuv_core_access(
            self._core, member, a.action, a.type, a.slot, a.n_values, n, references, a.function
        )

    def negate(self, member: int, slot: int) -> None:
        """Let a slot of an FMU of FMI 1.0 have the value with the opposite sign."""
        self._c.uuv_core_negate(self._core, member, slot)

    def in_place(
        self,
        member: int,
        find: int,
        steps: int,
        offsets: Sequence[int],
        bounds: Sequence[tuple[float, float]],
    ) -> None:
        """Let the loop read and write a component's values in its own memory, after its `access`es.

        `find` is the address of the FMU's function that finds them, 0 for a native member, and
        `steps` that of the function which steps several instances.
        `offsets` are those of the inputs, then of the outputs, in the order of their slots;
        `bounds` are those of the inputs.
        """
        low, high = zip(*bounds, strict=True) if bounds else ((), ())
        doubles = ctypes.c_double * len(bounds)
        self._c.uuv_core_in_place(
            self._core, member, find, steps, (ctypes.c_uint32 * len(offsets))(*offsets),
            doubles(*low), doubles(*high),
        )  # fmt: skip

    def transfer(
        self,
        target: int,
        source: int,
        slots: tuple[int, int],
        early: int,
        conversion: tuple[float, float],
        table: Sequence[tuple[int, int]] = (),
    ) -> None:
        """Add a transfer of a value; `slots` are (target's, source's).

        `early`: 0 if the value is delayed by a step, 1 from a member that steps before in a
        Gauss-Seidel group, 2 in an iterated group.
        """
        pairs = [v for pair in table for v in pair]
        self._c.uuv_core_transfer(
            self._core, target, source, *slots, early, *conversion, len(table),
            (ctypes.c_int64 * len(pairs))(*pairs) if table else None,
        )  # fmt: skip

    def state(self, member: int, get: int, set_: int, free: int, size: int) -> None:
        """Set the functions that copy the state of a native or iterated member."""
        self._c.uuv_core_state(self._core, member, get, set_, free, size)

    def iterate(
        self, first: int, n_members: int, solver: int, tolerance: float, limit: int
    ) -> None:
        """Make an iterated group of consecutive members."""
        self._c.uuv_core_iterate(self._core, first, n_members, solver, tolerance, limit)

    def vary(self, control: StepControl) -> None:
        """Give the members with a step of one tick a step of variable length, after `member`."""
        self._c.uuv_core_vary(self._core, ctypes.byref(control))

    def extrapolate(self, slot: int) -> None:
        """Extrapolate an output over each step; before the connections that are judged."""
        self._c.uuv_core_extrapolate(self._core, slot)

    def judge(
        self,
        slots: tuple[int, int],
        conversion: tuple[float, float],
        absolute: float,
        relative: float,
    ) -> None:
        """Choose the step by the error of a connection; `slots` are (target's, source's)."""
        self._c.uuv_core_judge(self._core, *slots, *conversion, absolute, relative)

    def bond(self, slots: Sequence[int]) -> None:
        """Choose it by a power bond too: input and output of one side, then of the other."""
        self._c.uuv_core_bond(self._core, *slots)

    def horizon(self, tick: int) -> None:
        """Let no step of variable length go beyond a communication point, until it is reached."""
        self._c.uuv_core_horizon(self._core, tick)

    def step_counts(self) -> StepCounts:
        """Return how many steps of variable length were made, and how long they were."""
        counts = StepCounts()
        self._c.uuv_core_step_counts(self._core, ctypes.byref(counts))
        return counts

    def event_mode(self, member: int, group: int, functions: Sequence[int], repeats: bool) -> None:
        """Let a member use Event Mode, in an event group; after its `access`es.

        `functions` enter Event Mode, update discrete states, and enter Step Mode. `repeats`: its
        state can be restored.
        """
        self._c.uuv_core_event_mode(self._core, member, group, *functions, repeats)

    def inside(self, member: int, flag: int) -> None:
        """Set the address of the int32 that is 1 while a member is in Event Mode."""
        self._c.uuv_core_inside(self._core, member, flag)

    def clocks(self, member: int, functions: Sequence[int]) -> None:
        """Add the functions for the clocks of a member with Event Mode, 0 for one that it lacks.

        They are GetClock, SetClock, GetIntervalDecimal and GetIntervalFraction.
        """
        self._c.uuv_core_clocks(self._core, member, *functions)

    def clock(
        self, member: int, reference: int, kind: ClockKind, asks: int, gates: Sequence[int]
    ) -> None:
        """Add a clock; clocks are numbered from 0 on. `gates` are clocks of the same member.

        `asks` is 0, or 1 to ask for its interval by GetIntervalDecimal, 2 by GetIntervalFraction.
        """
        numbers = (ctypes.c_uint32 * len(gates))(*gates)
        self._c.uuv_core_clock(self._core, member, reference, kind, asks, len(gates), numbers)

    def clock_wire(self, source: tuple[int, int], target: tuple[int, int]) -> None:
        """Let a clock (member, number) activate another."""
        self._c.uuv_core_clock_wire(self._core, *source, *target)

    def clocked(self, member: int, slot: int, clocks: Sequence[int]) -> None:
        """Make the access with a slot only while one of these clocks is active."""
        numbers = (ctypes.c_uint32 * len(clocks))(*clocks)
        self._c.uuv_core_clocked(self._core, member, slot, len(clocks), numbers)

    def clock_parts(self, parts: int) -> None:
        """Divide a tick into equal parts, for the instants of periodic clocks."""
        self._c.uuv_core_clock_parts(self._core, parts)

    def clock_starts(
        self, member: int, clock: int, first: tuple[int, int], period: tuple[int, int], s: float
    ) -> None:
        """Start a periodic clock: first instant and period in (ticks, parts), the period in `s`."""
        self._c.uuv_core_clock_starts(self._core, member, clock, *first, *period, s)

    def clock_waits(self, member: int, clock: int, tick: int, interval: float | None) -> None:
        """Start another time-based clock, whose first interval [s] may not be known yet."""
        known = interval is not None
        self._c.uuv_core_clock_waits(self._core, member, clock, tick, known, interval or 0.0)

    def discrete(self, member: int, slot: int) -> None:
        """Set the inputs of the access with a slot in Event Mode only."""
        self._c.uuv_core_discrete(self._core, member, slot)

    def take_events(self) -> list[Event]:
        """Return the events since the last call, and forget them."""
        events = (Event * self._c.uuv_core_n_events(self._core))()
        self._c.uuv_core_take_events(self._core, events)
        return list(events)

    def fault(
        self, number: int, member: int, slot: int, kind: int, value: float, n: int, seed: int
    ) -> None:
        """Apply a fault to the value of an output slot that other components receive."""
        self._c.uuv_core_fault(self._core, number, member, slot, kind, value, n, seed)

    def clear_fault(self, number: int) -> None:
        """Remove a fault."""
        self._c.uuv_core_clear_fault(self._core, number)

    def fault_past(self, number: int) -> tuple[int, bytes]:
        """Copy the past values of a fault: the index of the next one, and the values."""
        head, values = self._fault(number)
        return int(head[0]), values.tobytes()

    def set_fault_past(self, number: int, head: int, past: bytes) -> None:
        """Restore a copy made by `fault_past`."""
        place, values = self._fault(number)
        place[0] = head
        values[:] = np.frombuffer(past, np.uint64)

    def _fault(self, number: int) -> tuple[Any, np.ndarray]:
        n, head = ctypes.c_uint32(), ctypes.POINTER(ctypes.c_uint32)()
        past = self._c.uuv_core_fault_past(self._core, number, ctypes.byref(n), ctypes.byref(head))
        return head, _array(past, n.value)

    def forget(self) -> None:
        """Free the copies of states; only while the components still exist."""
        if self._core:
            self._c.uuv_core_forget(self._core)

    def record(self, slots: Sequence[int], every: int, n_rows: int) -> None:
        """Choose the slots of a row, and allocate memory for rows."""
        self._c.uuv_core_record(
            self._core, len(slots), (ctypes.c_uint32 * len(slots))(*slots), every
        )
        if len(slots) > _WIDE:
            self._rows = columns_of(n_rows, len(slots))[:, : len(slots)]
        else:
            self._rows = columns_of(len(slots), n_rows)[:, :n_rows].T
        self._ticks = np.full(n_rows, 0, np.int64)
        addresses = self._rows.ctypes.data, self._ticks.ctypes.data
        row, column = (stride // 8 for stride in self._rows.strides)
        self._buffer = (*addresses, n_rows, column, row)
        self.clear_rows()

    def instance(self, member: int, instance: int, kept: int) -> None:
        """Put another instance of the same FMU in a component's place; `kept` as in `member`."""
        self._c.uuv_core_instance(self._core, member, instance, kept)

    # ---- running --------------------------------------------------------------------------

    def propagate(self, tick: int, order: ctypes.Array[ctypes.c_uint32]) -> Failure | None:
        """Set inputs from their sources in Initialization Mode, members in this order."""
        done = self._c.uuv_core_propagate(self._core, tick, len(order), order)
        return self._failure(done)

    def serve(self, exchange: int, pipe: int, messages: int | None) -> None:
        """Step the only member on request of another process, until that writes to the pipe."""
        self._c.uuv_core_serve(self._core, exchange, pipe, messages)

    def why(self) -> Failure:
        """Return the failure of the last step."""
        failure = Failure()
        self._c.uuv_core_why(self._core, ctypes.byref(failure))
        return failure

    def begin(self, tick: int) -> Failure | None:
        """Read all outputs at a communication point, and write the first row."""
        return self._failure(self._c.uuv_core_begin(self._core, tick))

    def run(self, n_ticks: int, seconds: float) -> Failure | None:
        """Make at most `n_ticks` steps; fewer if rows are full or `seconds` of wall time pass."""
        return self._failure(self._c.uuv_core_run(self._core, n_ticks, seconds))

    def accept_step(self, member: int) -> bool:
        """Accept a step whose member asks to end; False for a member of an iterated group."""
        return bool(self._c.uuv_core_accept_step(self._core, member))

    def angle(self, slot: int, turn: float) -> None:
        """Measure a slot's coupling residual modulo a full `turn`, in its unit."""
        self._c.uuv_core_angle(self._core, slot, turn)

    def measure_nothing(self) -> None:
        """Measure no coupling residuals; before `begin`."""
        self._c.uuv_core_measure_nothing(self._core)

    def couplings(self) -> list[Coupling]:
        """Return the largest residual of each delayed connection since `begin`."""
        found = []
        for i in range(self._c.uuv_core_couplings(self._core)):
            found.append(Coupling())
            self._c.uuv_core_coupling(self._core, i, ctypes.byref(found[-1]))
        return found

    def rows(self) -> tuple[np.ndarray, np.ndarray, list[bytes]]:
        """Return (ticks, rows, texts) written since the last `clear_rows`; views, not copies.

        `rows` (n, columns) is stored column by column, or row by row if it is wide.
        """
        n = self._c.uuv_core_rows_used(self._core)
        size = ctypes.c_size_t()
        for i in range(len(self._row_texts), self._c.uuv_core_texts(self._core)):
            data = self._c.uuv_core_text(self._core, i, ctypes.byref(size))
            self._row_texts.append(ctypes.string_at(data, size.value))
        return self._ticks[:n], self._rows[:n], self._row_texts

    @property
    def is_full(self) -> bool:
        """Return whether stepping has to wait for `clear_rows`."""
        return bool(self._c.uuv_core_rows_used(self._core) == len(self._ticks))

    def clear_rows(self) -> None:
        """Release the rows for the next steps; views of them are overwritten from then on."""
        self._c.uuv_core_rows(self._core, *self._buffer)
        self._row_texts = []

    @property
    def next_row(self) -> int:
        """The first communication point that may still be recorded."""
        return int(self._c.uuv_core_next_row(self._core))

    @next_row.setter
    def next_row(self, tick: int) -> None:
        self._c.uuv_core_set_next_row(self._core, tick)

    @property
    def tick(self) -> int:
        """The communication point that has been reached."""
        return int(self._c.uuv_core_tick(self._core))

    def free(self) -> None:
        """Free the tables; a second call does nothing."""
        if self._core:
            self.slots = self.fresh = np.zeros(0, np.uint64)
            self._c.uuv_core_free(self._core)
            self._core = None

    # ---- state ----------------------------------------------------------------------------

    def get_image(self) -> bytes:
        """Copy the clock, all slots but texts, and the states of native members."""
        if self._image is None:
            self._image = ctypes.create_string_buffer(self.image_size)
        self._c.uuv_core_get_image(self._core, self._image)
        return bytes(self._image.raw)

    def set_image(self, image: bytes) -> None:
        """Restore a copy made by `get_image`."""
        self._c.uuv_core_set_image(self._core, image)

    @property
    def image_size(self) -> int:
        """Return the bytes of an image."""
        return int(self._c.uuv_core_image_size(self._core))

    def _failure(self, outcome: int) -> Failure | None:
        return None if outcome == Outcome.GOOD else self.why()


def _array(address: int, n: int) -> np.ndarray:
    if n == 0:
        return np.zeros(0, np.uint64)
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_uint64)), (n,))


def columns_of(columns: int, rows: int) -> np.ndarray:
    """Return zeros (columns, at least `rows`) of uint64; numbers of a column are contiguous.

    The distance of two columns is an odd number of cache lines, so that the values of a row do not
    all fall into one set of the cache. Every page is written here: a page fault while stepping
    costs as much as many steps.
    """
    lines = -(-rows // _LINE) | 1
    stride = lines * _LINE
    n = columns * stride
    if 8 * n < _HUGE // 2 or not hasattr(mmap, "MADV_HUGEPAGE"):
        return np.full(n, 0, np.uint64).reshape(columns, stride)
    memory = mmap.mmap(-1, -(-8 * n // _HUGE) * _HUGE)
    with contextlib.suppress(OSError):  # the kernel has no huge pages
        memory.madvise(mmap.MADV_HUGEPAGE)
    slots = np.frombuffer(memory, np.uint64, n)
    slots[::_PAGE] = 0
    return slots.reshape(columns, stride)
