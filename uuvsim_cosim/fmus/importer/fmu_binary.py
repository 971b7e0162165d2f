"""Base of FMI 1.0, 2.0 and 3.0 instances: life cycle, values, states, and failures."""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.codegen.toolchain import Signatures
from uuvsim_cosim.fmus.component import Binding, BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.fmu_access import Access
from uuvsim_cosim.fmus.importer.fmu_library import FmuLibrary
from uuvsim_cosim.fmus.importer.message_log import STATUS, MessageLog
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.values import flat_array

__all__ = ["FmuBinary", "FmuState", "Phase", "lives_here"]


class Phase(Enum):
    """Phase of an instance's life cycle; serialised states contain the value."""

    INSTANTIATED = 1
    INITIALIZATION = 2
    STEP = 3
    TERMINATED = 4
    FATAL = 5
    FREED = 6
    FAILED = 7  # after an error in a step: the instance may be reset, restored or freed


class FmuState:
    """A copy of an instance's state, owned by the FMU; freed after its last reference is gone."""

    def __init__(self, pointer: int, phase: Phase, orphans: list[int]) -> None:
        self.pointer = pointer
        self.phase = phase
        self._orphans = orphans
        self.in_event_mode = 0  # of FMI 3.0

    def __del__(self) -> None:
        # The instance frees it in a later call: another thread may be stepping it now.
        self._orphans.append(self.pointer)


_OK, _WARNING, _ERROR, _FATAL = 0, 1, 3, 4
_P, _I, _Z = ctypes.c_void_p, ctypes.c_int, ctypes.c_size_t
# Functions whose arguments are the same in FMI 2.0 and FMI 3.0.
COMMON: Signatures = {
    **dict.fromkeys(
        ("ExitInitializationMode", "Terminate", "Reset", "EnterEventMode",
         "EnterContinuousTimeMode"), (_I, (_P,)),
    ),
    **dict.fromkeys(
        ("GetContinuousStates", "SetContinuousStates", "GetEventIndicators",
         "GetNominalsOfContinuousStates"), (_I, (_P, _P, _Z)),
    ),
    "FreeInstance": (None, (_P,)),
    "SetTime": (_I, (_P, ctypes.c_double)),
}  # fmt: skip
_living: Counter[Path] = Counter()  # instances in this process, by library


def lives_here(archive: FmuArchive) -> bool:
    """Return whether this process holds a living instance of the FMU."""
    return any(count and file.is_relative_to(archive.folder) for file, count in _living.items())


class FmuBinary(ABC):
    """An instance of an FMU in this process; `Fmu1` to `Fmu3` have the calls of each version."""

    prefix: ClassVar[str]
    kind: ClassVar[BindingKind]
    signatures: ClassVar[Signatures]
    further_signatures: ClassVar[Mapping[str, Signatures]] = {}  # by interface type
    state_word: ClassVar[str]  # FMUstate or FMUState
    deserialize: ClassVar[str]
    counts_values: ClassVar[bool]  # whether a number of values follows their addresses

    def __init__(
        self,
        archive: FmuArchive,
        path: str,
        *,
        logging_on: bool = True,
        library: Callable[..., FmuLibrary] = FmuLibrary,
    ) -> None:
        self.path = path
        self.description = archive.description
        self.archive = archive
        self.time = 0.0  # [s] of the last call that has one; named by errors
        self.phase = Phase.FREED
        self._instance: int | None = None
        self._accesses: dict[str, Access] = {}
        self._states: set[int] = set()
        self._orphans: list[int] = []
        # Shared with the stepping loop in C, which sets it for states that it keeps itself.
        self._has_kept = ctypes.c_int32(0)
        signatures = {**self.signatures, **self.further_signatures.get(archive.interface, {})}
        self._library = library(archive, self._exported_prefix(archive), signatures)
        self._library.component = path.encode()
        once = self.description.can_be_instantiated_only_once
        if once and _living[self._library.file]:
            raise FmuError(
                path,
                f"{archive.path.name} may exist only once per process",
                "each further instance to be isolated in a process of its own (isolate=True)",
            )
        self._log = MessageLog(path, self._variable_named)
        self.messages = self._log.kept
        instance = self._instantiate(logging_on)
        messages = self._log.drain()
        if not instance:
            reason = self._log.last(messages)
            self._log.free()
            raise FmuError(
                f"{path}: {archive.path.name} could not be instantiated"
                + (f": {reason}" if reason else "")
            )
        _living[self._library.file] += 1
        self._instance = instance
        self.phase = Phase.INSTANTIATED
        for text in archive.remarks:
            self._log.remark(text)
        try:
            self._configure()
        except BaseException:
            self.free()
            raise

    # ---- calls that differ between versions ---------------------------------------------------

    def _exported_prefix(self, archive: FmuArchive) -> str:
        """Return the beginning of the functions' names in the library."""
        return self.prefix

    @abstractmethod
    def _instantiate(self, logging_on: bool) -> int | None: ...

    def _release(self, instance: int | None) -> None:
        self._library.function("FreeInstance")(instance)

    @abstractmethod
    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Enter Initialization Mode, after start values have been set."""

    @abstractmethod
    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance by one communication step; raises ComponentFailed with the FMU's message."""

    @abstractmethod
    def _access(self, variable: Variable) -> Access: ...

    # ---- values -------------------------------------------------------------------------------

    def get(self, variable: Variable) -> Any:
        """Read a value; an array is a new one of the variable's shape."""
        access = self._accessed(variable)
        self.call(f"Get{access.suffix}", *access.arguments())
        return access.value()

    def set(self, variable: Variable, value: object) -> None:
        """Set a value of the variable's shape; raises FmuError for another shape or type."""
        if variable.causality == "structuralParameter":
            if np.array_equal(np.asarray(value), np.asarray(variable.start)):
                return
            raise FmuError(
                f"{self.path}.{variable.name}",
                f"a structural parameter keeps its start value {variable.start}",
                "another value only before the component is made",
            )
        self._fill(variable, value)

    def _fill(self, variable: Variable, value: object) -> None:
        access = self._accessed(variable)
        access.fill(flat_array(variable, value, f"{self.path}.{variable.name}"))
        self.call(f"Set{access.suffix}", *access.arguments())

    def _configure(self) -> None:
        """Set the structural parameters, in Configuration Mode."""
        if not self.archive.structure:
            return
        self.call("EnterConfigurationMode")
        for name, value in self.archive.structure.items():
            self._fill(self.description.variables[name], value)
        self.call("ExitConfigurationMode")

    def _accessed(self, variable: Variable) -> Access:
        access = self._accesses.get(variable.name)
        if access is None:
            access = self._accesses[variable.name] = self._access(variable)
        return access

    # ---- life cycle ---------------------------------------------------------------------------

    def exit_initialization_mode(self) -> None:
        """Leave Initialization Mode; stepping may begin."""
        self.call("ExitInitializationMode")
        self.phase = Phase.STEP

    def reset(self) -> None:
        """Go back to the state after instantiation; the library stays loaded."""
        self.call("Reset")
        self.phase = Phase.INSTANTIATED
        self._configure()

    def terminate(self) -> None:
        """End stepping; does nothing if stepping never began, has ended or has failed."""
        if self.phase is Phase.STEP:
            self.phase = Phase.TERMINATED
            self.call("Terminate")

    def free(self) -> None:
        """Free the instance and its states; a second call does nothing."""
        if self.phase is Phase.FREED:
            return
        instance, self._instance = self._instance, None
        if self.phase is not Phase.FATAL:  # then FMI allows no further call
            self._free_states(instance, list(self._states))
            self._release(instance)
        self.phase = Phase.FREED
        _living[self._library.file] -= 1
        self._log.free()

    # ---- states -------------------------------------------------------------------------------

    @property
    def never_goes_back(self) -> bool:
        """Whether no state of this run is kept: FMI's ``noSetFMUStatePriorToCurrentPoint``."""
        return not self._has_kept.value

    def get_fmu_state(self) -> FmuState:
        """Copy the state; raises FmuError if the FMU cannot."""
        self._require(self.description.can_get_and_set_state, "copy its state")
        self._free_states(self._instance, self._orphans)
        pointer = ctypes.c_void_p()
        self.call(f"Get{self.state_word}", ctypes.byref(pointer))
        return self._state(pointer, self.phase)

    def set_fmu_state(self, state: FmuState) -> None:
        """Restore a state of this instance, and the phase in which it was copied."""
        if state.pointer not in self._states:
            raise FmuError(f"{self.path}: the state is of another instance")
        self.call(f"Set{self.state_word}", state.pointer)
        self.phase = state.phase

    def serialize_fmu_state(self, state: FmuState) -> bytes:
        """Convert a state to bytes, which another instance of this FMU can read."""
        self._require(self.description.can_serialize_state, "serialise its state")
        size = ctypes.c_size_t()
        self.call(f"Serialized{self.state_word}Size", state.pointer, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.call(f"Serialize{self.state_word}", state.pointer, buffer, size.value)
        return bytes([state.phase.value]) + buffer.raw

    def deserialize_fmu_state(self, data: bytes) -> FmuState:
        """Convert bytes to a state of this instance."""
        self._require(self.description.can_serialize_state, "serialise its state")
        if not data or data[0] not in (1, 2, 3, 4):
            raise FmuError(f"{self.path}: {len(data)} bytes that are no serialised state")
        pointer = ctypes.c_void_p()
        body = ctypes.create_string_buffer(data[1:], len(data) - 1)
        self.call(self.deserialize, body, len(data) - 1, ctypes.byref(pointer))
        return self._state(pointer, Phase(data[0]))

    def _state(self, pointer: ctypes.c_void_p, phase: Phase) -> FmuState:
        address = pointer.value or 0
        self._states.add(address)
        if phase is not Phase.INITIALIZATION:  # restoring such a state begins another run
            self._has_kept.value = 1
        return FmuState(address, phase, self._orphans)

    def _free_states(self, instance: int | None, addresses: list[int]) -> None:
        """Free states and remove them from the list, to which `FmuState.__del__` appends."""
        while addresses:
            address = addresses.pop()
            if address in self._states:
                self._states.discard(address)
                pointer = ctypes.c_void_p(address)
                self._library.function(f"Free{self.state_word}")(instance, ctypes.byref(pointer))

    # ---- the rest -----------------------------------------------------------------------------

    def directional_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: ArrayLike
    ) -> np.ndarray:
        """Return d(unknowns)/d(knowns) · seed, flat; raises FmuError if not provided."""
        self._require(
            self.description.provides_directional_derivatives, "give directional derivatives"
        )
        flat = np.ascontiguousarray(seed, dtype=float).ravel()
        expected = sum(v.size for v in knowns)
        if flat.size != expected:
            raise FmuError(self.path, f"a seed of {flat.size} numbers", expected)
        result = np.zeros(sum(v.size for v in unknowns))
        arguments: list[object] = []
        for variables in (unknowns, knowns):
            references = [r for v in variables for r in v.value_references]
            arguments += [(ctypes.c_uint32 * len(references))(*references), len(references)]
        for values in (flat, result):
            arguments += [values.ctypes.data, *([values.size] if self.counts_values else [])]
        self.call("GetDirectionalDerivative", *arguments)
        return result

    def binding(self) -> Binding:
        """Return the addresses that the stepping loop in C calls."""
        if not self._library.addressable:
            return Binding(BindingKind.CALLBACK, 0, {})
        functions = {**self._library.addresses(), "StateKept": ctypes.addressof(self._has_kept)}
        return Binding(self.kind, self._live(), functions)

    def drain_messages(self) -> None:
        """Fetch the FMU's new messages, for a loop that steps it from C."""
        self._log.drain()

    def remark(self, text: str) -> None:
        """Add a note on how the instance is run to its messages."""
        self._log.remark(text)

    @property
    def waiting_messages(self) -> int:
        """The address of the number of messages that have not been fetched."""
        return self._log.environment

    def failure(self, function: str, status: int, time: float) -> ComponentFailed:
        """Return the error for a status that the stepping loop in C got from a function."""
        messages = self._log.drain()
        if status == _FATAL:
            self.phase = Phase.FATAL
        elif status == _ERROR and self.phase is Phase.STEP:
            self.phase = Phase.FAILED
        name = STATUS[status] if 0 <= status < len(STATUS) else f"the unknown status {status}"
        text = self._log.last(messages)
        reason = f"{self.prefix}{function} returned {name}" + (f": {text}" if text else "")
        return ComponentFailed(self.path, time, reason)

    def call(self, name: str, *arguments: object) -> None:
        """Call a function by its name without prefix; raises unless its status is ok or warning."""
        status = self._library.function(name)(self._live(), *arguments)
        if status not in (_OK, _WARNING):
            failed = self.failure(name, status, self.time)
            if self.phase in (Phase.INSTANTIATED, Phase.INITIALIZATION):
                raise FmuError(f"{self.path}: {failed.reason}")
            raise failed
        self._log.drain()

    def _live(self) -> int:
        if self._instance is None:
            raise FmuError(f"{self.path}: used after it was freed")
        if self.phase is Phase.FATAL:
            raise FmuError(self.path, "used after a fatal error", "a new instance")
        return self._instance

    def _require(self, capable: bool, what: str) -> None:
        self._live()
        if not capable:
            raise FmuError(f"{self.path}: {self.archive.path.name} says that it cannot {what}")

    def _variable_named(self, letter: str, reference: int) -> str | None:
        """Return the name for a type's letter and a reference, such as ``#r5#`` in a message."""
        types = {"r": ("Float64",), "i": ("Int32", "Enumeration"), "b": ("Boolean",)}
        for v in self.description.variables.values():
            if v.type in types.get(letter, ("String",)) and reference in v.value_references:
                return v.element_name(v.value_references.index(reference))
        return None
