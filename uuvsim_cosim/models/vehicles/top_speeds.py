"""Top speeds of a vehicle at full command, and published speeds to compare them with.

The speed U along a direction s (a unit vector of b) is the root of

    s·(sum_i e_i f_i(U) + F_hull(U)) = 0,   u_i in [-1, 1]

with the thrust f_i of each thruster in steady state, at the flow of that speed. The commands are
those of the largest force along s for which the two other forces and the yaw moment of the
thrusters are zero: a linear programme in f_i. The attitude is held level. So roll and pitch
moments, and the hull's forces across s, are taken as balanced: by the righting moment, by fins or
by a small change of attitude, whose effect on the speed is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.actuators.bench_rows import read_bench
from uuvsim_cosim.models.actuators.thruster_geometry import (
    Geometry,
    configuration_matrix,
    thruster_geometry,
    thrusters_file,
)
from uuvsim_cosim.models.analysis.operating_point import Coordinates
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.parameter_files import (
    in_unit,
    read_yaml,
    split_address,
    vehicle_folder,
)
from uuvsim_cosim.models.vehicles.closed_forms import total_mass
from uuvsim_cosim.models.vehicles.vehicle_figures import FASTEST, submerged_force

__all__ = [
    "DIRECTIONS",
    "PublishedSpeed",
    "TopSpeed",
    "depends_on_voltage",
    "published_speeds",
    "top_speeds",
]

Array = NDArray[np.float64]

# Axis of b and sign of each direction.
DIRECTIONS = {
    "ahead": (0, 1.0),
    "astern": (0, -1.0),
    "starboard": (1, 1.0),
    "port": (1, -1.0),
    "up": (2, -1.0),
    "down": (2, 1.0),
}


@dataclass(frozen=True)
class PublishedSpeed:
    """A published speed [m/s] of a real vehicle; `by` is "maker" or "measurement"."""

    direction: str
    speed: float
    by: str
    source: str


@dataclass(frozen=True)
class TopSpeed:
    """The steady speed of a vehicle in one direction at full command, level attitude.

    `force` [N] is the largest force of the thrusters along the direction at rest, 0 if none
    pushes there. `speed` [m/s] is then 0 as well, and also if the force is less than the net
    weight; it is nan if it is above `FASTEST`.
    """

    direction: str
    speed: float
    force: float


def top_speeds(address: str, voltage: float | None = None) -> tuple[TopSpeed, ...]:
    """Return the top speed of a vehicle in each of the six directions of `DIRECTIONS`.

    `address` is a vehicle as id, id@set or folder. `voltage` [V] is that of the thrusters' supply;
    without it each thruster has the nominal voltage of its component (16 V for the T200). Only a
    thruster with bench rows depends on it. Raises ParameterInvalid for a vehicle that has no
    thrusters.yaml, InputInvalid for a voltage outside of the thruster's range.

    >>> ahead = top_speeds("remus100@fossen_2021")[0]
    >>> ahead.direction, round(ahead.speed, 2)
    ('ahead', 2.55)
    """
    id, _ = split_address(address)
    geometry = thruster_geometry(id)
    thrusters = _thrusts(id, geometry, voltage)
    hull = declare(address, surface=False)
    hull_force = submerged_force(Coordinates(hull), total_mass(hull))
    T = configuration_matrix(geometry)

    def push(axis: int, sign: float, speed: float) -> float:
        nu = np.zeros(6)
        nu[axis] = sign * speed
        return _largest_force(T, axis, sign, [f(nu) for f in thrusters])

    def found(direction: str) -> TopSpeed:
        from scipy.optimize import brentq

        axis, sign = DIRECTIONS[direction]
        at_rest = push(axis, sign, 0.0)

        def net(speed: float) -> float:
            nu = np.zeros(6)
            nu[axis] = sign * speed
            return push(axis, sign, speed) + sign * float(hull_force(nu)[axis])

        if at_rest < 1e-9 or net(0.0) <= 0.0:
            return TopSpeed(direction, 0.0, at_rest)
        if net(FASTEST) > 0.0:
            return TopSpeed(direction, float("nan"), at_rest)
        return TopSpeed(direction, float(brentq(net, 0.0, FASTEST)), at_rest)

    return tuple(map(found, DIRECTIONS))


def depends_on_voltage(vehicle: str) -> bool:
    """Return whether the thrust of a vehicle depends on its supply: only that of bench rows does.

    >>> depends_on_voltage("bluerov2"), depends_on_voltage("rexrov")
    (True, False)
    """
    file = thrusters_file(vehicle_folder(split_address(vehicle)[0]) / "thrusters.yaml")
    return str(file.get("model", "")) == "thruster_t200"


def published_speeds(vehicle: str) -> tuple[PublishedSpeed, ...]:
    """Return the published speeds of a vehicle's folder (`speeds.yaml`); empty if none is there.

    >>> [(s.direction, s.by, s.speed) for s in published_speeds("tethys_lrauv")]
    [('ahead', 'maker', 1.0)]
    """
    path = vehicle_folder(split_address(vehicle)[0]) / "speeds.yaml"
    if not path.is_file():
        return ()
    return tuple(
        PublishedSpeed(
            str(s["direction"]),
            in_unit(float(s["value"]), str(s["unit"]), "m/s"),
            str(s["by"]),
            str(s["source"]),
        )
        for s in read_yaml(path, "speeds.schema.json")["speeds"]
    )


def _thrusts(
    id: str, geometry: Geometry, voltage: float | None
) -> list[Callable[[Array], tuple[float, float]]]:
    """Return for each thruster (least, largest) steady thrust [N] as a function of nu_r (6,)."""
    path = vehicle_folder(id) / "thrusters.yaml"
    name = str(thrusters_file(path).get("model", ""))
    if not name:
        raise ParameterInvalid(path, "no model", "model: such as thruster_t200 or propeller")
    if name == "propeller":
        models = [declare(name, vehicle=id, number=i + 1) for i in range(len(geometry.names))]
        return [_steady(m, voltage) for m in models]
    one = declare(name)
    if name == "thruster_t200" and voltage is not None:  # its rows at the lowest voltage hold there
        rows, highest = read_bench("t200").voltage, one.variables["voltage"].max
        if not rows[0] <= voltage <= (highest or rows[-1]):
            expected = f"{rows[0]:g} to {highest:g} V, the range of its bench rows"
            raise InputInvalid(f"{name} at {voltage:g} V", expected)
    return [_steady(one, voltage)] * len(geometry.names)


def _steady(model: Model, voltage: float | None) -> Callable[[Array], tuple[float, float]]:
    """Return (thrust at u = -1, at u = 1) [N] of one thruster where its states are steady."""
    supply = model.variables["voltage"]
    at = Coordinates(model)
    f, jacobians = at.functions
    thrust = at.outputs.index("thrust")
    if voltage is not None and not (
        (supply.min is None or voltage >= supply.min)
        and (supply.max is None or voltage <= supply.max)
    ):
        raise InputInvalid(f"{model.name} at {voltage:g} V", f"{supply.min:g} to {supply.max:g} V")

    def at_command(u: float, nu: Array) -> float:
        given: dict[str, float | Array] = {"u": u, "nu_r": nu}
        x, inputs = at.point(given if voltage is None else {**given, "voltage": voltage})
        for _ in range(20):  # Newton; a first-order shaft needs one step
            step = np.linalg.solve(np.array(jacobians(x, inputs)[0]), np.array(f(x, inputs)[0]))
            x = x - step.ravel()
            if np.max(np.abs(step)) <= 1e-9 * (1.0 + np.max(np.abs(x))):
                break
        return float(np.array(f(x, inputs)[1]).ravel()[thrust])

    return lambda nu: (at_command(-1.0, nu), at_command(1.0, nu))


def _largest_force(T: Array, axis: int, sign: float, limits: list[tuple[float, float]]) -> float:
    """Return the largest force [N] along an axis without cross force and without yaw moment."""
    from scipy.optimize import linprog

    balanced = [i for i in (0, 1, 2, 5) if i != axis and np.max(np.abs(T[i])) > 1e-9]
    A = T[balanced] if balanced else None
    b = np.zeros(len(balanced)) if balanced else None
    bounds = [(min(pair), max(pair)) for pair in limits]
    done = linprog(-sign * T[axis], A_eq=A, b_eq=b, bounds=bounds)
    return max(0.0, -float(done.fun or 0.0)) if done.status == 0 else 0.0
