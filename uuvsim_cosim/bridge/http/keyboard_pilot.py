"""A pilot with a person's manual axes added at its inputs `a` and `omega`.

The axes are added to the inputs: a + k_u (s_1 u_max - u_d) while the surge axis is used, and after
its release until the vehicle has braked; omega + s_4 omega_max. u_d is the pilot's desired speed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.bridge.http.manual_axes import ManualAxes
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import Description, Variable

__all__ = ["Over"]

SPEED = 0.3  # [m/s] that the surge axis asks for, a helm's speed_max
YAW_RATE = 1.5  # [rad/s] that the yaw axis asks for, a helm's omega_max
A_MAX = 0.4  # [m/s2] a helm's a_max
K_U = 2.0  # [1/s] a helm's k_u
_State = tuple[object, dict[str, float], bool]  # inner state, inputs, whether it moves


@final
class Over:
    """The `Component` protocol around another component."""

    def __init__(self, inner: Component, manual_axes: ManualAxes) -> None:
        self.path, self.description = inner.path, self.described(inner.description)
        self._inner, self._manual_axes = inner, manual_axes
        self._given = dict.fromkeys(("a", "omega"), 0.0)
        self._nu_d = inner.description.variables["nu_d"]
        self._moved = False

    @staticmethod
    def described(inner: Description) -> Description:
        """Return the interface of the inner component, which is now called by Python."""
        return replace(inner, kind="python", provides_directional_derivatives=False)

    def get(self, variable: Variable) -> Any:
        """Read a value; `a` and `omega` are without the share of the axes."""
        if variable.name in self._given:
            return self._given[variable.name]
        return self._inner.get(variable)

    def set(self, variable: Variable, value: Any) -> None:
        """Set a value."""
        if variable.name in self._given:
            self._given[variable.name] = float(value)
        self._inner.set(variable, value)

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Step with the share of the axes; after its release, the surge axis brakes first."""
        surge, _, _, yaw = self._manual_axes.now()
        u_d = float(self._inner.get(self._nu_d)[0])
        self._moved = surge != 0.0 or (self._moved and abs(u_d) > 1e-3)
        brake = K_U * (surge * SPEED - u_d) if self._moved else 0.0
        share = {"a": max(-A_MAX, min(A_MAX, brake)), "omega": yaw * YAW_RATE}
        for name, added in share.items():
            variable = self.description.variables[name]
            self._inner.set(variable, self._given[name] + added)
        self._inner.do_step(current_communication_point, step_size)

    def get_fmu_state(self) -> _State:
        """Copy the state."""
        return self._inner.get_fmu_state(), dict(self._given), self._moved

    def set_fmu_state(self, state: _State) -> None:
        """Restore a copy."""
        inner, given, self._moved = state
        self._inner.set_fmu_state(inner)
        self._given = dict(given)

    def serialize_fmu_state(self, state: _State) -> bytes:
        """Convert a copy to bytes, without the inputs and the use of the axes."""
        return self._inner.serialize_fmu_state(state[0])

    def deserialize_fmu_state(self, data: bytes) -> _State:
        """Convert bytes to a copy."""
        return self._inner.deserialize_fmu_state(data), {"a": 0.0, "omega": 0.0}, False

    def reset(self) -> None:
        """Go back to the start."""
        self._given, self._moved = {"a": 0.0, "omega": 0.0}, False
        self._inner.reset()

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Begin initialization."""
        self._inner.enter_initialization_mode(start_time, stop_time)

    def exit_initialization_mode(self) -> None:
        """End initialization."""
        self._inner.exit_initialization_mode()

    def terminate(self) -> None:
        """End the simulation."""
        self._inner.terminate()

    def free(self) -> None:
        """Free the inner component."""
        self._inner.free()

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: ArrayLike
    ) -> np.ndarray:
        """Return the derivative of the inner component."""
        return self._inner.directional_derivative(unknowns, knowns, seed)

    def binding(self) -> Binding:
        """Return that the stepping loop in C has to call Python."""
        return Binding(BindingKind.CALLBACK, 0, {})
