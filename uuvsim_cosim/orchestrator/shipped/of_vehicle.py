"""A complete system from a vehicle's folder: hull, actuators, control, guidance, sensors.

The actuators stand at their places in the vehicle's files. Allocation and gains are designed from
the same files (`models/control/vehicle_design.py`), and the path follows from the vehicle's length
and top speed. Every figure that no file states is listed in the system's remarks.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.control.fin_design import design_fins, fin_margins
from uuvsim_cosim.models.control.margins import margin_words
from uuvsim_cosim.models.control.vehicle_design import (
    AXES,
    VehicleDesign,
    control_design,
    propelled_speed,
    thrusters_of,
)
from uuvsim_cosim.models.declaration.parameter_files import (
    split_address,
    vehicle_file,
    vehicle_folder,
    vehicle_size,
)
from uuvsim_cosim.models.guidance.line_of_sight import MAX_WAYPOINTS, lawn_mower
from uuvsim_cosim.orchestrator.shipped.actuators import (
    CELLS,
    has_fins,
    quoted,
    with_actuators,
    with_allocation,
)
from uuvsim_cosim.orchestrator.shipped.tasks import OBSERVED
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["MISSIONS", "Flight", "Mission", "flight_of", "system_of"]

Mission = Literal["hold", "survey"]
MISSIONS = get_args(Mission)
READINGS = {
    "imu": ("acc", "gyro", "valid", "t_sample"),
    "dvl": ("beam_velocity", "beam_valid", "t_sample"),
    "compass": ("psi", "valid", "t_sample"),
    "usbl": ("position", "sigma", "valid", "t_sample"),
    "pressure": ("valid", "t_sample"),
}


@dataclass(frozen=True)
class Flight:
    """How a vehicle flies a mission: what `hold` means, its path, and the guidance's figures.

    `kind` is "station keeping", "loiter" or "survey". `radius` is that of the loiter [m].
    """

    kind: str
    guidance: str
    waypoints: tuple[tuple[float, float, float], ...]
    start: tuple[float, ...]  # N E D [m], phi theta psi [rad]
    figures: dict[str, float]
    radius: float | None
    assumed: tuple[str, ...]


def flight_of(vehicle: str, mission: Mission = "hold") -> Flight:
    """Return how a `vehicle` flies the `mission`, "hold" or "survey".

    Raises ParameterInvalid, with the missing directions, if its actuators cannot fly it.

    Example:

    >>> from uuvsim_cosim.orchestrator.shipped.of_vehicle import flight_of
    >>> flight_of("bluerov2").kind
    'station keeping'
    """
    if mission not in MISSIONS:
        raise InputInvalid(f"mission {mission!r}", f"one of {', '.join(MISSIONS)}")
    folder = vehicle_folder(split_address(vehicle)[0])
    if (folder / "ballast.yaml").is_file() and not (folder / "thrusters.yaml").is_file():
        raise ParameterInvalid(
            f"{vehicle}: a glider, without thrusters and propeller, cannot fly {mission!r}",
            "the system slocum_yo, or one of your own with yo_yo and ballast",
        )
    size = vehicle_size(split_address(vehicle)[0])
    length = 1.0 if size is None else max(size.length, size.breadth)
    depth = max(5.0, math.ceil(3.0 * (1.0 if size is None else size.height)))
    finned = has_fins(vehicle)
    if finned:
        keeps, figures, around, words = False, *_with_fins(vehicle, length)
    else:
        design = control_design(vehicle)
        keeps = not design.thrusters.missing
        figures, around, words = _with_thrusters(design, length)
    radius: float | None = None
    if mission == "survey":
        kind = "survey"
        leg = 20.0 if keeps and length < 1.0 else max(20.0, 15.0 * length, 5.0 * around)
        between = 5.0 if keeps and length < 1.0 else max(5.0, 4.0 * length, 2.0 * around)
        path = tuple(lawn_mower(_rounded(leg), _rounded(between), 4, depth))
    elif keeps:
        kind, path = "station keeping", ((0.0, 0.0, depth),)
    else:
        # In a circle of fewer lengths, fins slip too much for a line of sight.
        radius = _rounded(max(around, 9.0 * length)) if finned else around
        kind, path = "loiter", ((0.0, 0.0, depth),)
    start = (-2.0 * length, 0.0, depth, 0.0, 0.0, 0.0)
    follows = "model:guidance" if keeps else "model:path_following?method=alos"
    if kind == "loiter" or finned:
        follows += "&end=loiter"
        figures["loiter_radius"] = radius or around
    listed = [f"guidance: {name} {value:g}" for name, value in figures.items()]
    return Flight(kind, follows, path, start, figures, radius, (*words, *listed))


def _with_thrusters(
    design: VehicleDesign, length: float
) -> tuple[dict[str, float], float, list[str]]:
    """Return the guidance's figures, the radius of a turn [m], and the reason for the speed."""
    keeps = not design.thrusters.missing
    top = float(design.top_speed[0])
    limit = 0.7 * design.stable_speed
    speed = _rounded(min(0.5 * top, limit))
    yaw = float(min(0.4, 0.3 * design.top_speed[5]))
    figures = {
        "speed": speed,
        "acceleration": _rounded(min(speed / 4.0, 0.3 * design.tau_max[0] / design.M[0, 0])),
        "lookahead": _rounded((4.0 if keeps else 3.0) * length),
        "radius": _rounded((0.5 if keeps else 1.0) * length),
        "r_max": _rounded(yaw),
        "r_dot_max": _rounded(min(0.3, 0.3 * design.tau_max[5] / design.M[5, 5])),
    }
    if keeps:
        figures |= {"corner_speed": _rounded(speed / 8.0), "lag_max": _rounded(2.0 * length)}
    why = (
        f"speed: half of {top:.3g} m/s, the speed at 90 % of the full thrust"
        if 0.5 * top <= limit
        else f"speed: 0.7 of {design.stable_speed:.3g} m/s, above which the attitude is unstable"
    )
    # A turn of this radius takes half the largest yaw rate.
    return figures, _rounded(max(5.0 * length, 2.0 * speed / yaw)), [why]


def _with_fins(vehicle: str, length: float) -> tuple[dict[str, float], float, list[str]]:
    """Return the same for a vehicle with fins, which needs speed to steer."""
    design = design_fins(vehicle)
    top = propelled_speed(vehicle)
    speed = _rounded(min(max(0.6 * top, 1.15 * float(design.V[0])), float(design.V[-1])))
    turn = float(np.interp(speed, design.V, design.rates[:, 1]))
    around = _rounded(max(5.0 * length, 2.0 * speed / turn))
    figures = {
        "speed": speed,
        "acceleration": _rounded(speed / 10.0),
        "lookahead": _rounded(max(5.0 * length, 0.5 * around)),
        # A right angle is cut by the circle of r_max, and the yaw rate takes time to grow.
        "radius": _rounded(speed / (0.7 * turn) + 0.5 * speed * 0.7 / 0.2),
        "r_max": _rounded(0.7 * turn),
        "r_dot_max": _rounded(0.2 * turn),
        # ALOS on a vehicle that turns at once: s² + U / Delta s + gamma U = 0, damped by 0.87.
        "gamma": _rounded(speed / (3.0 * max(5.0 * length, 0.5 * around) ** 2)),
    }
    why = f"speed: {speed / top:.2g} of {top:.3g} m/s, the speed at full command of the propeller"
    turns = f"turns of {around:g} m, at half of the largest yaw rate of the autopilot"
    return figures, around, [why, turns, *design.assumed]


def _stop_time(flight: Flight) -> float | None:
    """Return the end of a survey with wide turns [s]; None: the run's own rule holds."""
    if flight.kind != "survey" or "lag_max" in flight.figures:
        return None
    legs = sum(math.dist(a, b) for a, b in itertools.pairwise(flight.waypoints))
    return 10.0 * math.ceil(1.3 * legs / flight.figures["speed"] / 10.0 + 6.0)


def _rounded(value: float) -> float:
    """Return a value with two significant digits."""
    return float(f"{float(value):.2g}")


def system_of(vehicle: str, mission: Mission = "hold") -> System:
    """Return a complete system of a `vehicle` (``id``, ``id@set`` or a folder) and a mission.

    "hold": station keeping on the true state if the thrusters control surge, sway, heave and yaw,
    else a loiter. "survey": a lawn-mower survey by sensors alone, in a meandering current.
    `System.remarks` lists the flight, the stability margins, and every assumed figure.
    Raises ParameterInvalid, with the missing directions, if the vehicle cannot fly the mission.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> system = uuv.system_of("bluerov2", mission="hold")
    >>> system.name, len([c for c in system.components if c.startswith("thruster")])
    ('bluerov2_hold', 6)
    >>> system.remarks[0]
    'hold of bluerov2: station keeping at N 0, E 0, D 5 m'
    """
    finned = has_fins(vehicle)
    flight = flight_of(vehicle, mission)
    id = str(vehicle_file(split_address(vehicle)[0])[1]["id"])
    name = f"{''.join(c if c.isalnum() else '_' for c in id)}_{mission}"
    system = System(name, "0.01", f"{id}: {flight.kind}, made from the vehicle's folder")
    rows = [*flight.waypoints, *[flight.waypoints[-1]] * (MAX_WAYPOINTS - len(flight.waypoints))]
    path: dict[str, object] = {
        "waypoints": [list(w) for w in rows],
        "count": len(flight.waypoints),
        **flight.figures,
    }
    senses = mission == "survey"
    if senses:
        system = _sensors(system, flight.start)
    system = system.add("guidance", flight.guidance, path)
    if finned:
        system = system.add("controller", f"model:autopilot?vehicle={quoted(vehicle)}")
    else:
        system = system.add("controller", f"model:lqr?id=vehicle&vehicle={quoted(vehicle)}")
        system = with_allocation(system, vehicle)
    start: dict[str, object] = {"eta_0": flight.start}
    if finned:
        start["nu_0"] = (flight.figures["speed"], 0.0, 0.0, 0.0, 0.0, 0.0)
    system = system.add("hull", f"model:{quoted(vehicle)}", start)
    system, _ = with_actuators(system, vehicle, battery=True)
    source = "navigation" if senses else "hull"
    for reader in ("guidance", "controller"):
        system = system.connect(f"{source}.eta", f"{reader}.eta")
        system = system.connect(f"{source}.nu", f"{reader}.nu")
    for reference in ("eta_d", "nu_d"):
        system = system.connect(f"guidance.{reference}", f"controller.{reference}")
    if finned:
        system = system.connect("controller.delta_d", "fins.u")
        system = system.connect("controller.u", "propeller.u")
    else:
        system = system.connect("controller.tau_d", "allocation.tau_d")
    if senses:
        system = _sensed(system, flight)
    before = ["navigation"] if senses else []
    after = [] if finned else ["allocation"]
    # In sequence within a step, as on a vehicle's computer: three delays less in the loop.
    system = system.group([*before, "guidance", "controller", *after])
    remarks = _remarks(id, mission, flight, vehicle, senses)
    return replace(system, remarks=remarks, stop_time=_stop_time(flight))


def _sensors(system: System, start: tuple[float, ...]) -> System:
    system = system.add("current", "model:current_gauss_markov")
    for sensor in READINGS:
        system = system.add(sensor, f"model:{sensor}")
    return system.add("navigation", "model:navigation", start={"eta_0": start})


def _sensed(system: System, flight: Flight) -> System:
    """Connect water and hull to the sensors, and these to the navigation."""
    speed = _rounded(0.3 * flight.figures["speed"])
    system = system.connect("current.v_c", "hull.v_c")
    system = system.set("current.speed", min(0.2, speed)).set("current.sigma", min(0.2, speed) / 4)
    for sensor, observed in OBSERVED.items():
        for name in observed:
            system = system.connect(f"hull.{name}", f"{sensor}.{name}")
    for sensor, readings in READINGS.items():
        for name in readings:
            system = system.connect(f"{sensor}.{name}", f"navigation.{sensor}_{name}")
    return system.connect("pressure.pressure", "navigation.pressure")


def _remarks(id: str, mission: str, flight: Flight, vehicle: str, senses: bool) -> tuple[str, ...]:
    """Return the flight, the margins of the loops, and every figure that no file states."""
    depth = flight.waypoints[-1][2]
    thrusters = thrusters_of(vehicle)
    lacking = " and ".join(AXES[i] for i in thrusters.missing)
    where = {
        "station keeping": f"at N 0, E 0, D {depth:g} m",
        "loiter": f"of radius {flight.radius or 0:g} m at {depth:g} m depth, because the "
        f"{'propeller makes' if has_fins(vehicle) else 'thrusters make'} no force in {lacking}",
    }.get(flight.kind, f"of {len(flight.waypoints) // 2} legs at {depth:g} m depth")
    if has_fins(vehicle):
        told = margin_words(fin_margins(design_fins(vehicle)))
    else:
        design = control_design(vehicle)
        told = [*design.remarks, *margin_words(design.margins), *design.assumed]
    told += flight.assumed
    told.append(f"battery: 18 Ah, {CELLS[thrusters.model]} cells in series")
    if senses:
        told.append("sensors: presets and mounting of a BlueROV2")
    return (f"{mission} of {id}: {flight.kind} {where}", *told)
