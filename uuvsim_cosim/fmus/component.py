"""The protocol of all components that a master can step: FMU, native component, Python class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from uuvsim_cosim.fmus.description import Description, Variable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

__all__ = ["Binding", "BindingKind", "Component", "ExchangesRows"]


class BindingKind(IntEnum):
    """How the stepping loop calls a component; the numbers are those of uuv_core.h."""

    NATIVE = 1
    FMI2 = 2
    FMI3 = 3
    CALLBACK = 4
    SHARED = 5
    FMI1 = 6


@dataclass(frozen=True)
class Binding:
    """Addresses for the stepping loop in C.

    `functions` maps FMI names without prefix (``DoStep``, ``GetFloat64``, ``SetReal``, …; only
    those that the binary has) to addresses. Native: ``DoStep`` is ``uuv_do_step`` and
    ``instance`` a ``uuv_instance *``; ``StateSize`` is no address but bytes. FMUs: ``StateKept``
    is the address of an int32, 1 once a state of the run is kept. ``FindValues`` is the function of
    an FMU of this package which finds the memory of its values, so that the loop need not look
    them up; ``DoSteps`` steps several instances of it, or of a native component. Callback: see the
    core.
    """

    kind: BindingKind
    instance: int
    functions: Mapping[str, int]


class Component(Protocol):
    """One live instance. The order of calls is that of FMI 3.0; the constructor instantiates.

    A state is of the component's own type, so that only the component which copied it can restore
    it.
    """

    path: str
    description: Description

    def get(self, variable: Variable) -> Any:
        """Read a value: float/int/bool/str/bytes for a scalar, else a numpy array of its shape."""

    def set(self, variable: Variable, value: object) -> None:
        """Set a value of the variable's shape (a scalar is not broadcast)."""

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Begin at `start_time`; parameters and start values may still be set."""

    def exit_initialization_mode(self) -> None:
        """End initialization; fixed parameters hold from here on."""

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance by one communication step; raises ComponentFailed."""

    def get_fmu_state(self) -> object:
        """Copy the state; raises FmuError if the component cannot."""

    def set_fmu_state(self, state: Any) -> None:
        """Restore a state copied by `get_fmu_state`."""

    def serialize_fmu_state(self, state: Any) -> bytes:
        """Write a state as bytes that outlive the process."""

    def deserialize_fmu_state(self, data: bytes) -> object:
        """Read a state back from such bytes."""

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: ArrayLike
    ) -> np.ndarray:
        """Return d(unknowns)/d(knowns) · seed, flat; raises FmuError if not provided."""

    def reset(self) -> None:
        """Return to the state after instantiation, without loading the binary again."""

    def terminate(self) -> None:
        """End the simulation."""

    def free(self) -> None:
        """Free everything; a second call does nothing."""

    def binding(self) -> Binding:
        """Return the addresses that the stepping loop in C calls."""


@runtime_checkable
class ExchangesRows(Protocol):
    """A component in Python that exchanges all its inputs and outputs at once while it steps.

    One call for each variable costs several microseconds, which matters in a loop of 400 Hz or
    more. A row has the numbers in the order of `SlotRow`; other calls still use `get` and `set`.
    """

    def set_row(self, row: bytes) -> None:
        """Set all inputs."""

    def get_row(self) -> bytes:
        """Read all outputs and local variables."""
