"""The stepping loop in C (orchestrator/core), compiled at first use and called through ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.isolation.guard import guard_functions
from uuvsim_cosim.orchestrator.master.row_buffer import columns_of

__all__ = [
    "Access",
    "Action",
    "Core",
    "Coupling",
    "Failure",
    "Outcome",
    "Type",
    "by_type",
    "library",
]


class Type(IntEnum):
    """Types of values, with the numbers of uuv_core.h."""

    Float64 = 0
    Float32 = 1
    Int8 = 2
    Int16 = 3
    Int32 = 4
    Int64 = 5
    UInt8 = 6
    UInt16 = 7
    UInt32 = 8
    UInt64 = 9
    Boolean = 10
    String = 11
    Binary = 12

    @classmethod
    def of(cls, variable: Variable) -> Type:
        """Return the type of a variable's slots; enumerations are integers, clocks Booleans."""
        renamed = {"Enumeration": "Int64", "Clock": "Boolean"}
        return cls[renamed.get(variable.type, variable.type)]

    @property
    def dtype(self) -> str:
        """Return numpy's type of a slot; for text and binary the slot holds a pointer."""
        if self <= Type.Float32:
            return "f8"
        return "i8" if self <= Type.Int64 else "u8"

    @property
    def is_blob(self) -> bool:
        """Return whether the slot points to text or bytes."""
        return self >= Type.String


class Outcome(IntEnum):
    """Reason why the loop stopped; numbers of uuv_core.h."""

    GOOD = 0
    BAD_STATUS = 1
    NOT_FINITE = 2
    STATE_NOT_FINITE = 3
    OUT_OF_RANGE = 4
    ENDED = 5
    EARLY_RETURN = 6
    NO_MEMORY = 7
    NOT_CONVERGED = 8


class Action(IntEnum):
    """Call of the loop to a component; numbers of uuv_core.h."""

    SET = 1
    DO_STEP = 2
    GET = 3
    GET_STATE = 4
    SET_STATE = 5


class Failure(ctypes.Structure):
    """Failure of the loop: outcome, member, action and communication point."""

    _fields_ = (
        ("outcome", ctypes.c_int32),
        ("status", ctypes.c_int32),
        ("action", ctypes.c_int32),
        ("member", ctypes.c_uint32),
        ("slot", ctypes.c_uint32),
        ("tick", ctypes.c_uint64),
        ("residual", ctypes.c_double),
    )


class Coupling(ctypes.Structure):
    """Largest residual of a delayed connection, its slots and time; `relative` to 1 + |input|."""

    _fields_ = (
        ("source_slot", ctypes.c_uint32),
        ("target_slot", ctypes.c_uint32),
        ("relative", ctypes.c_double),
        ("residual", ctypes.c_double),
        ("tick", ctypes.c_uint64),
    )


@dataclass(frozen=True)
class Access:
    """One grouped call: `n_values` slots from `slot` on, all of one type."""

    action: Action
    type: Type
    slot: int
    n_values: int
    references: tuple[int, ...]
    function: int = 0


def by_type(variables: Iterable[Variable]) -> list[Variable]:
    """Order variables by type, as their slots are; within a type as in the description."""
    return sorted(variables, key=Type.of)


class Core:
    """Tables of one plan in C's memory, and the calls that step it.

    Order of calls: `member`, then `access` and `state`, `transfer`, `iterate`, `record`; then
    `begin`, and `run` any number of times. Faults may be added and cleared at any time.
    """

    def __init__(self, n_members: int, n_slots: int, tick: Fraction) -> None:
        self._c = library()
        self._core = self._c.uuv_core_new(n_members, n_slots, tick.numerator, tick.denominator)
        if not self._core:
            raise UuvsimError(f"no memory for {n_members} components with {n_slots} values")
        self.n_members = n_members
        self.slots = _array(self._c.uuv_core_slots(self._core), n_slots)
        self.fresh = _array(self._c.uuv_core_fresh(self._core), n_slots)
        self._rows = np.zeros((0, 0), np.uint64)  # (columns, stride)
        self._ticks = np.zeros(0, np.int64)
        # Addresses of rows and ticks, number of rows, stride.
        self._buffer: tuple[int | None, int | None, int, int] = (None, None, 0, 0)
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
        self._check_memory(
            self._c.uuv_core_access(
                self._core, member, a.action, a.type, a.slot, a.n_values, n, references, a.function
            )
        )

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
        self._check_memory(
            self._c.uuv_core_transfer(
                self._core, target, source, *slots, early, *conversion, len(table),
                (ctypes.c_int64 * len(pairs))(*pairs) if table else None,
            )
        )  # fmt: skip

    def state(self, member: int, get: int, set_: int, free: int, size: int) -> None:
        """Set the functions that copy the state of a native or iterated member."""
        self._check_memory(self._c.uuv_core_state(self._core, member, get, set_, free, size))

    def iterate(
        self, first: int, n_members: int, solver: int, tolerance: float, limit: int
    ) -> None:
        """Make an iterated group of consecutive members."""
        self._check_memory(
            self._c.uuv_core_iterate(self._core, first, n_members, solver, tolerance, limit)
        )

    def fault(
        self, number: int, member: int, slot: int, kind: int, value: float, n: int, seed: int
    ) -> None:
        """Apply a fault to the value of an output slot that other components receive."""
        self._check_memory(
            self._c.uuv_core_fault(self._core, number, member, slot, kind, value, n, seed)
        )

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
        self._check_memory(
            self._c.uuv_core_record(
                self._core, len(slots), (ctypes.c_uint32 * len(slots))(*slots), every
            )
        )
        self._rows = columns_of(len(slots), n_rows)
        self._ticks = np.full(n_rows, 0, np.int64)
        addresses = self._rows.ctypes.data, self._ticks.ctypes.data
        self._buffer = (*addresses, n_rows, self._rows.shape[1])
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

        `rows` (n, columns) is stored column by column.
        """
        n = self._c.uuv_core_rows_used(self._core)
        size = ctypes.c_size_t()
        for i in range(len(self._row_texts), self._c.uuv_core_texts(self._core)):
            data = self._c.uuv_core_text(self._core, i, ctypes.byref(size))
            self._row_texts.append(ctypes.string_at(data, size.value))
        return self._ticks[:n], self._rows[:, :n].T, self._row_texts

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

    def _check_memory(self, is_done: int) -> None:
        if not is_done:
            raise UuvsimError("no memory for the tables of the stepping loop")

    def _failure(self, outcome: int) -> Failure | None:
        if outcome == Outcome.GOOD:
            return None
        return self.why()


def _array(address: int, n: int) -> np.ndarray:
    if n == 0:
        return np.zeros(0, np.uint64)
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_uint64)), (n,))


@lru_cache
def library() -> ctypes.CDLL:
    """Compile the core if the cache has none, and load it."""
    from importlib.util import find_spec
    from pathlib import Path

    from uuvsim_cosim.fmus.codegen.runtime import runtime
    from uuvsim_cosim.fmus.codegen.toolchain import compile_shared

    spec = find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise UuvsimError("the package 'fmpy' is missing", "`pip install fmpy`")
    folder = content("orchestrator", "core")
    folders = [folder, folder / "components", folder / "iteration"]
    fmi = Path(spec.origin).parent / "c-code"
    headers = [*folders, *runtime(), content("fmus", "guard"), fmi]
    sources = [f for each in folders for f in sorted(each.glob("*.c"))]
    c = ctypes.CDLL(str(compile_shared(sources, name="uuv_core", include=headers)))
    for name, (result, arguments) in _signatures().items():
        function = getattr(c, name)
        function.restype, function.argtypes = result, arguments
    return c


def _signatures() -> dict[str, tuple[Any, list[Any]]]:
    pointer, size, double = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double
    i32, u32, u64 = ctypes.c_int32, ctypes.c_uint32, ctypes.c_uint64
    i = ctypes.c_int
    return {
        "uuv_core_new": (pointer, [u32, u32, u64, u64]),
        "uuv_core_free": (None, [pointer]),
        "uuv_core_member": (i, [pointer, u32, i, pointer, pointer, pointer, pointer, u64, i]),
        "uuv_core_name": (None, [pointer, u32, ctypes.c_char_p]),
        "uuv_core_guard": (None, [pointer, pointer, pointer]),
        "uuv_core_access": (i, [pointer, u32, i, i, u32, u32, u32, pointer, pointer]),
        "uuv_core_transfer": (i, [pointer, u32, u32, u32, u32, i, double, double, u32, pointer]),
        "uuv_core_state": (i, [pointer, u32, pointer, pointer, pointer, size]),
        "uuv_core_iterate": (i, [pointer, u32, u32, i, double, u32]),
        "uuv_core_fault": (i, [pointer, u32, u32, u32, i, double, u32, u64]),
        "uuv_core_clear_fault": (None, [pointer, u32]),
        "uuv_core_fault_past": (pointer, [pointer, u32, pointer, pointer]),
        "uuv_core_forget": (None, [pointer]),
        "uuv_core_serve": (None, [pointer, pointer, i, pointer]),
        "uuv_exchange_size": (size, [u32, u32, size]),
        "uuv_exchange_new": (pointer, []),
        "uuv_exchange_map": (i, [pointer, i, u32, u32, size]),
        "uuv_exchange_waits": (None, [pointer, ctypes.c_int64, double, u32]),
        "uuv_exchange_leave": (None, [pointer]),
        "uuv_exchange_trouble": (i, [pointer]),
        "uuv_exchange_messages": (u32, [pointer]),
        "uuv_exchange_save": (i, [pointer, pointer]),
        "uuv_exchange_restore": (i, [pointer, pointer]),
        "uuv_exchange_close": (None, [pointer]),
        "uuv_exchange_free": (None, [pointer]),
        "uuv_core_record": (i, [pointer, u32, pointer, u64]),
        "uuv_core_rows": (None, [pointer, pointer, pointer, u32, size]),
        "uuv_core_next_row": (u64, [pointer]),
        "uuv_core_set_next_row": (None, [pointer, u64]),
        "uuv_core_rows_used": (u32, [pointer]),
        "uuv_core_texts": (u64, [pointer]),
        "uuv_core_text": (pointer, [pointer, u64, pointer]),
        "uuv_core_begin": (i32, [pointer, u64]),
        "uuv_core_run": (i32, [pointer, u64, double]),
        "uuv_core_accept_step": (i32, [pointer, u32]),
        "uuv_core_why": (None, [pointer, pointer]),
        "uuv_core_angle": (None, [pointer, u32, ctypes.c_double]),
        "uuv_core_measure_nothing": (None, [pointer]),
        "uuv_core_couplings": (u32, [pointer]),
        "uuv_core_coupling": (None, [pointer, u32, pointer]),
        "uuv_core_tick": (u64, [pointer]),
        "uuv_core_set_tick": (None, [pointer, u64]),
        "uuv_core_image_size": (size, [pointer]),
        "uuv_core_get_image": (None, [pointer, pointer]),
        "uuv_core_set_image": (None, [pointer, ctypes.c_char_p]),
        "uuv_core_propagate": (i32, [pointer, u64, u32, pointer]),
        "uuv_core_instance": (None, [pointer, u32, pointer, pointer]),
        "uuv_core_slots": (pointer, [pointer]),
        "uuv_core_fresh": (pointer, [pointer]),
        "uuv_core_read_blob": (pointer, [pointer, pointer]),
        "uuv_core_write_blob": (i, [pointer, ctypes.c_char_p, size]),
    }
