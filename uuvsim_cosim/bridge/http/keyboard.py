"""The source `keyboard`: a person at the page /pilot replaces a pilot or guidance.

The axes s of a page, each from -1 to 1, become desired velocities that change by at most `a_max`,
nu_d -> s nu_max; the desired pose moves with them from the vehicle's first pose,

    d eta_d/dt = J(psi_d) nu_d,    |p_d - p| <= lead,   |psi_d - psi| <= lead_psi,

and a policy's outputs follow: a = k_u (u_d - u), omega = r_d. Without input it stops.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, hypot, pi, sin
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.bridge.http.manual_axes import ManualAxes, SetPoint, manual_axes_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.system.resolve import register, resolve
from uuvsim_cosim.orchestrator.system.sources import Backend, Source
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["KeyboardSource", "ManualOverlay", "piloted", "source", "with_keyboards"]

SPEED = 0.3  # [m/s] that the surge axis asks for, a helm's speed_max
YAW_RATE = 1.5  # [rad/s] that the yaw axis asks for, a helm's omega_max
A_MAX = 0.4  # [m/s2] a helm's a_max
K_U = 2.0  # [1/s] a helm's k_u
_State = tuple[object, dict[str, float], bool]  # inner state, inputs, whether it moves


@final
class ManualOverlay:
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


_NONE = (0.0, 0.0, 0.0, 0.0)
_ETA = (6, ("m", "m", "m", "rad", "rad", "rad"))
_NU = (6, ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s"))


class Piloted:
    """A person at a page: desired pose and velocity, and a policy's accelerations.

    The output `axes` are those of the step that ends, so that a recording contains every command.
    If a client over MAVLink has computed them, `mode` is its mode (-1: none, or disarmed), and its
    set-point is the pose (`setpoint_kind` 1) or the velocity (2); otherwise the kind is 0.
    """

    inputs = {"eta": _ETA, "nu": _NU}  # noqa: RUF012
    outputs = {  # noqa: RUF012
        "eta_d": _ETA,
        "nu_d": _NU,
        "a": "m/s2",
        "omega": "rad/s",
        "axes": (4, "1"),
        "mode": "1",
        "setpoint_kind": "1",
        "setpoint_pose": (4, ("m", "m", "m", "rad")),
        "setpoint_velocity": (4, ("m/s", "m/s", "m/s", "rad/s")),
    }
    parameters = {  # noqa: RUF012
        "surge_max": (0.5, "m/s"),
        "sway_max": (0.3, "m/s"),
        "heave_max": (0.3, "m/s"),
        "yaw_max": (0.6, "rad/s"),
        "a_max": (0.5, "m/s2"),
        "r_dot_max": (1.0, "rad/s2"),
        "lead": (1.0, "m"),
        "lead_psi": (0.6, "rad"),
        "k_u": (2.0, "1/s"),
    }
    manual_axes = ManualAxes("nobody")

    def __init__(self) -> None:
        self.pose: list[float] = []  # desired N E D psi; empty before the first step
        self.velocity = [0.0, 0.0, 0.0, 0.0]  # desired u v w r

    def initialize(self, t: float) -> dict[str, object]:
        """Begin without a client."""
        return {"mode": SetPoint().mode}

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, object]:
        """Move the desired pose by the manual axes."""
        eta, nu = [float(x) for x in u["eta"]], u["nu"]
        if not self.pose:
            self.pose = [*eta[:3], eta[5]]
        largest = (self.surge_max, self.sway_max, self.heave_max, self.yaw_max)
        changes = (self.a_max, self.a_max, self.a_max, self.r_dot_max)
        axes, setpoint = self.commands_at(t + dt)
        for i, s in enumerate(axes):
            most = changes[i] * dt
            self.velocity[i] += _within(s * largest[i] - self.velocity[i], most)
        self._move(eta, dt)
        n, e, d, psi = self.pose
        u_d, v_d, w_d, r_d = self.velocity
        return {
            "eta_d": [n, e, d, 0.0, 0.0, psi],
            "nu_d": [u_d, v_d, w_d, 0.0, 0.0, r_d],
            "a": _within(self.k_u * (u_d - float(nu[0])), self.a_max),
            "omega": r_d,
            "axes": axes,
            "mode": setpoint.mode,
            "setpoint_kind": 1.0 if setpoint.pose else 2.0 if setpoint.velocity else 0.0,
            "setpoint_pose": setpoint.pose or _NONE,
            "setpoint_velocity": setpoint.velocity or _NONE,
        }

    def commands_at(self, t: float) -> tuple[tuple[float, float, float, float], SetPoint]:
        """Return the axes and the set-point of the step that ends at time t [s]."""
        return self.manual_axes.commands()

    def _move(self, eta: list[float], dt: float) -> None:
        """Integrate the desired pose; it stays within `lead` and `lead_psi` of the vehicle."""
        n, e, d, psi = self.pose
        u, v, w, r = self.velocity
        n += dt * (cos(psi) * u - sin(psi) * v)
        e += dt * (sin(psi) * u + cos(psi) * v)
        d += dt * w
        away = hypot(n - eta[0], e - eta[1], d - eta[2])
        share = min(1.0, self.lead / away) if away > 0.0 else 1.0
        near = [at + share * (to - at) for at, to in zip(eta, (n, e, d), strict=False)]
        turn = _within(_wrapped(psi + dt * r - eta[5]), self.lead_psi)
        self.pose = [*near, _wrapped(eta[5] + turn)]

    # set as attributes by PythonComponent
    surge_max: float
    sway_max: float
    heave_max: float
    yaw_max: float
    a_max: float
    r_dot_max: float
    lead: float
    lead_psi: float
    k_u: float


def source(text: str, base: Path) -> KeyboardSource:
    """Resolve ``keyboard:`` or ``keyboard:SOURCE``; the entry point of the scheme."""
    over = text.partition(":")[2]
    return KeyboardSource(resolve(over, base) if over else None)


@dataclass(frozen=True)
class KeyboardSource:
    """A person instead of a component, or at the inputs `a` and `omega` of another (`over`)."""

    over: Source | None = None
    kind: str = "keyboard"

    @property
    def text(self) -> str:
        """The source string."""
        return "keyboard:" + (self.over.text if self.over is not None else "")

    def describe(self) -> Description:
        """Return the interface."""
        if self.over is None:
            return PythonComponent(Piloted, "keyboard").description
        return ManualOverlay.described(self.over.describe())

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Let the page pilot the component `path`."""
        if self.over is not None:
            return ManualOverlay(self.over.instantiate(path, backend=backend), manual_axes_of(path))
        return PythonComponent(
            type("Piloted", (Piloted,), {"manual_axes": manual_axes_of(path)}), path
        )


def piloted(system: System, name: str) -> tuple[str, str]:
    """Return the component that ``--replace NAME=keyboard`` means, and its new source.

    `pilot` means the component of that name at any depth, else the one with outputs eta_d and nu_d.
    Raises InputInvalid if there is none, several, or one that a person cannot replace.
    """
    components = {c.path: c for c in flatten(system, 0).components}
    found = [name] if name in components else [
        path for path in components if path.rpartition(".")[2] == name
    ]  # fmt: skip
    if not found and name == "pilot":
        found = [p for p, c in components.items() if {"eta_d", "nu_d"} <= _outputs(c)]
    if len(found) != 1:
        fit = [p for p, c in components.items() if _source_for(c) is not None]
        count = f"{len(found)} of them ({', '.join(found)})" if found else "no such component"
        expected = f"one such as {', '.join(fit)}" if fit else "a system with a pilot or guidance"
        raise InputInvalid(f"--replace {name}=keyboard: {count}", expected)
    wanted = _source_for(components[found[0]])
    if wanted is None:
        raise InputInvalid(
            (
                f"--replace {name}=keyboard: {found[0]} has outputs "
                f"{', '.join(sorted(_outputs(components[found[0]]))) or 'none'}"
            ),
            (
                "a component with outputs eta_d and nu_d, or a and omega, or "
                "inputs a and omega and output nu_d"
            ),
        )
    return found[0], wanted


def with_keyboards(system: Callable[[], System], swaps: dict[str, str]) -> None:
    """Replace ``NAME: keyboard`` among swaps by the component and the source that it means.

    `system` loads the system, if there is such a swap.
    """
    named = [name for name, source_ in swaps.items() if source_ == "keyboard"]
    if not named:
        return
    register("keyboard", source)
    loaded = system()
    for name in named:
        path, wanted = piloted(loaded, name)
        del swaps[name]
        swaps[path] = wanted


def _source_for(component: PlannedComponent) -> str | None:
    """Return the source by which a person replaces a component; None if that is impossible."""
    outputs = _outputs(component)
    if {"eta_d", "nu_d"} <= outputs or {"a", "omega"} <= outputs:
        return "keyboard:"
    inputs = {v.name for v in component.description.of("input")}
    fits = {"a", "omega"} <= inputs and "nu_d" in outputs
    return f"keyboard:{component.source}" if fits else None


def _outputs(component: PlannedComponent) -> set[str]:
    return {v.name for v in component.description.of("output")}


def _within(x: float, most: float) -> float:
    return max(-most, min(most, x))


def _wrapped(angle: float) -> float:
    return (angle + pi) % (2.0 * pi) - pi
