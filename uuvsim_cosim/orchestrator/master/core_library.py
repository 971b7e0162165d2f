"""C library of the stepping loop (orchestrator/core): its enumerations, structures and functions.

A slot is 8 bytes of the loop's memory and holds one scalar: a Float64, an integer, a Boolean, or a
pointer to text or bytes. `decode` and `encode` convert between slots and Python values.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from enum import IntEnum
from functools import lru_cache
from typing import Any

import numpy as np

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.fmus.description import Variable

__all__ = ["Action", "ClockKind", "Coupling", "Event", "Failure", "Outcome", "StepControl",
           "StepCounts", "Type", "by_type", "decode", "encode", "library", "read_blob",
           "write_blob"]  # fmt: skip


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
    NOT_RESTORED = 9
    EVENTS_DO_NOT_END = 10
    NO_PROGRESS = 11
    NOT_REPEATED = 12
    BAD_INTERVAL = 13


class Action(IntEnum):
    """Call of the loop to a component; numbers of uuv_core.h."""

    SET = 1
    DO_STEP = 2
    GET = 3
    GET_STATE = 4
    SET_STATE = 5
    ENTER_EVENT_MODE = 6
    UPDATE_DISCRETE_STATES = 7
    ENTER_STEP_MODE = 8
    GET_CLOCK = 9
    SET_CLOCK = 10
    GET_INTERVAL_DECIMAL = 11
    GET_INTERVAL_FRACTION = 12


class ClockKind(IntEnum):
    """Clock of FMI 3.0 as the loop handles it; numbers of uuv_core.h."""

    PERIODIC = 0
    CHANGING = 1
    COUNTDOWN = 2
    TRIGGERED_INPUT = 3
    TRIGGERED_OUTPUT = 4


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
        ("value", ctypes.c_double),
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


class Event(ctypes.Structure):
    """Event of a component at a communication point plus an offset [s] (uuv_core.h)."""

    _fields_ = (
        ("tick", ctypes.c_uint64),
        ("offset", ctypes.c_double),
        ("member", ctypes.c_uint32),
        ("cause", ctypes.c_int32),
    )


class StepControl(ctypes.Structure):
    """Settings of a variable communication step, lengths in ticks (uuv_core.h)."""

    _fields_ = (
        *((name, ctypes.c_uint64) for name in ("smallest", "largest", "first")),
        *(
            (name, ctypes.c_double)
            for name in ("absolute", "relative", "safety", "slowest", "fastest")
        ),
        *((name, ctypes.c_double) for name in ("proportional", "integral")),
        *((name, ctypes.c_uint32) for name in ("order", "rollback")),
    )


class StepCounts(ctypes.Structure):
    """Steps of variable length that were made and repeated, and their lengths in ticks."""

    _fields_ = (
        *(
            (name, ctypes.c_uint64)
            for name in ("steps", "rejected", "unsatisfied", "least", "most")
        ),
        ("worst", ctypes.c_double),
        ("worst_tick", ctypes.c_uint64),
    )


def by_type(variables: Iterable[Variable]) -> list[Variable]:
    """Order variables by type, as their slots are; within a type as in the description."""
    return sorted(variables, key=Type.of)


@lru_cache
def library() -> ctypes.CDLL:
    """Compile the core if the cache has none, and load it; raises UuvsimError, ToolchainError."""
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

    def check_memory(done: int, *about: object) -> None:
        if not done:
            raise UuvsimError("no memory for the tables of the stepping loop")

    c = ctypes.CDLL(str(compile_shared(sources, name="uuv_core", include=headers)))
    pointer, size, double = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double
    i32, u32, u64 = ctypes.c_int32, ctypes.c_uint32, ctypes.c_uint64
    i = ctypes.c_int
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "uuv_core_new": (pointer, [u32, u32, u64, u64]),
        "uuv_core_free": (None, [pointer]),
        "uuv_core_member": (i, [pointer, u32, i, pointer, pointer, pointer, pointer, u64, i]),
        "uuv_core_name": (None, [pointer, u32, ctypes.c_char_p]),
        "uuv_core_guard": (None, [pointer, pointer, pointer]),
        "uuv_core_access": (i, [pointer, u32, i, i, u32, u32, u32, pointer, pointer]),
        "uuv_core_negate": (i, [pointer, u32, u32]),
        "uuv_core_in_place": (i, [pointer, u32, pointer, pointer, pointer, pointer, pointer]),
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
        "uuv_core_rows": (None, [pointer, pointer, pointer, u32, size, size]),
        "uuv_core_next_row": (u64, [pointer]),
        "uuv_core_set_next_row": (None, [pointer, u64]),
        "uuv_core_rows_used": (u32, [pointer]),
        "uuv_core_texts": (u64, [pointer]),
        "uuv_core_text": (pointer, [pointer, u64, pointer]),
        "uuv_core_vary": (i, [pointer, pointer]),
        "uuv_core_extrapolate": (i, [pointer, u32]),
        "uuv_core_judge": (i, [pointer, u32, u32, double, double, double, double]),
        "uuv_core_bond": (i, [pointer, u32, u32, u32, u32]),
        "uuv_core_horizon": (None, [pointer, u64]),
        "uuv_core_step_counts": (None, [pointer, pointer]),
        "uuv_core_event_mode": (i, [pointer, u32, u32, pointer, pointer, pointer, i]),
        "uuv_core_discrete": (None, [pointer, u32, u32]),
        "uuv_core_inside": (None, [pointer, u32, pointer]),
        "uuv_core_clocks": (i, [pointer, u32, pointer, pointer, pointer, pointer]),
        "uuv_core_clock": (i, [pointer, u32, u32, i, i, u32, pointer]),
        "uuv_core_clock_wire": (i, [pointer, u32, u32, u32, u32]),
        "uuv_core_clocked": (i, [pointer, u32, u32, u32, pointer]),
        "uuv_core_clock_parts": (None, [pointer, u64]),
        "uuv_core_clock_starts": (None, [pointer, u32, u32, u64, u64, u64, u64, double]),
        "uuv_core_clock_waits": (None, [pointer, u32, u32, u64, i, double]),
        "uuv_core_n_events": (u32, [pointer]),
        "uuv_core_take_events": (None, [pointer, pointer]),
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
        "uuv_core_any": (i, [pointer, u32]),
        "uuv_core_slots": (pointer, [pointer]),
        "uuv_core_fresh": (pointer, [pointer]),
        "uuv_core_read_blob": (pointer, [pointer, pointer]),
        "uuv_core_write_blob": (i, [pointer, ctypes.c_char_p, size]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(c, name)
        function.restype, function.argtypes = result, arguments
    # Functions that allocate memory return 0 if there is none.
    for name in ("access", "in_place", "transfer", "state", "iterate", "fault", "record",
                 "vary", "extrapolate", "judge", "bond", "event_mode", "clocks", "clock",
                 "clock_wire", "clocked"):  # fmt: skip
        getattr(c, f"uuv_core_{name}").errcheck = check_memory
    return c


def decode(variable: Variable, raw: np.ndarray) -> Any:
    """Return the value in a variable's slots: a number, text, bytes, or array of its shape."""
    type_ = Type.of(variable)
    if type_.is_blob:
        data = [read_blob(raw, i) for i in range(variable.size)]
        flat = [d.decode(errors="replace") for d in data] if type_ == Type.String else data
        return np.array(flat, object).reshape(variable.shape) if variable.shape else flat[0]
    numbers = raw.view(type_.dtype)
    if type_ == Type.Boolean:
        numbers = numbers.astype(bool)
    return numbers.reshape(variable.shape).copy() if variable.shape else numbers[0].item()


def encode(variable: Variable, value: object, raw: np.ndarray) -> None:
    """Write a value of the variable's shape into its slots."""
    type_ = Type.of(variable)
    if type_.is_blob:
        for i, item in enumerate(np.asarray(value, object).ravel()):
            write_blob(raw, i, item.encode() if isinstance(item, str) else item)
        return
    raw.view(type_.dtype)[:] = np.asarray(value).astype(type_.dtype, casting="unsafe").ravel()


def read_blob(raw: np.ndarray, i: int) -> bytes:
    """Copy the bytes that slot i points to."""
    size = ctypes.c_size_t()
    data = library().uuv_core_read_blob(raw.ctypes.data + 8 * i, ctypes.byref(size))
    return ctypes.string_at(data, size.value)


def write_blob(raw: np.ndarray, i: int, data: bytes) -> None:
    """Copy bytes to the memory that slot i points to."""
    if not library().uuv_core_write_blob(raw.ctypes.data + 8 * i, data, len(data)):
        raise MemoryError(f"no memory for {len(data)} bytes")
