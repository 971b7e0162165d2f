"""Systems for tasks of one vehicle: their unconnected inputs are the actions of a policy."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, get_args

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.control.vehicle_design import control_design
from uuvsim_cosim.models.declaration.parameter_files import split_address, vehicle_file
from uuvsim_cosim.orchestrator.shipped.actuators import quoted, with_actuators, with_allocation
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["HEAVY", "OBSERVED", "THRUSTERS", "ActedOn", "Observed", "task_system"]

ActedOn = Literal["force", "thrusters", "velocity"]
Observed = Literal["truth", "navigation"]
HEAVY = "bluerov2_heavy"
THRUSTERS = tuple(f"thruster_{i}" for i in range(1, 9))
START = (0.0, 0.0, 10.0, 0.0, 0.0, 0.0)  # N E D [m], phi theta psi [rad]
OBSERVED = {  # outputs of the hull that each sensor measures
    "imu": ("eta", "q", "nu", "nu_dot"),
    "dvl": ("eta", "q", "nu"),
    "pressure": ("eta", "q"),
    "compass": ("eta",),
    "usbl": ("eta", "q"),
}


@lru_cache(maxsize=32)
def task_system(
    action: ActedOn = "force",
    observation: Observed = "truth",
    reference: bool = False,
    disturbances: bool = False,
    vehicle: str = HEAVY,
) -> System:
    """Return a BlueROV2 Heavy with eight T200 in a meandering current, for a policy.

    With another `vehicle`, hull, actuators, allocation and gains are made from its folder. Its
    action "thrusters" acts on all its actuators, fins included; "force" and "velocity" need
    thrusters that control surge, heave and yaw, and `disturbances` the BlueROV2 Heavy.

    The unconnected inputs depend on `action`: `allocation.tau_d` for "force", each `thruster_i.u`
    for "thrusters", and `controller.nu_d` for "velocity", of a controller that keeps the hull
    level. The observation "navigation" adds the sensors and the filter. `reference` adds a curve to
    follow; `disturbances` adds ramps of the current and thrusters that lose thrust. Equal arguments
    return the same object, so that its kernel is made once.
    """
    for what, given, known in (
        ("action", action, get_args(ActedOn)),
        ("observation", observation, get_args(Observed)),
    ):
        if given not in known:
            raise InputInvalid(f"{what} {given!r}", f"one of {', '.join(known)}")
    if vehicle != HEAVY:
        return _task_of(vehicle, action, observation, reference, disturbances)
    system = System("bluerov2_task", "0.01", "A BlueROV2 Heavy that a policy acts on")
    system = system.add("hull", "model:bluerov2_heavy", start={"eta_0": START})
    system = system.add("wrench", "model:wrench").connect("wrench.tau", "hull.tau")
    system = system.add("current", "model:current_gauss_markov")
    if disturbances:
        system = system.add("ramps", "model:current_ramps").connect("current.v_c", "ramps.v")
    system = system.connect("ramps.v_c" if disturbances else "current.v_c", "hull.v_c")
    receiver = "wrench.thrust"
    if disturbances:  # a component weakens the thrust
        system = system.add("faults", "model:thruster_faults")
        system = system.connect("faults.thrust", "wrench.thrust")
        receiver = "faults.thrust_in"
    for i, name in enumerate(THRUSTERS, 1):
        system = (
            system.add(name, "model:thruster_t200")
            .connect("hull.nu_r", f"{name}.nu_r")
            .connect(f"{name}.thrust", f"{receiver}[{i}]")
            .connect(f"{name}.current", f"wrench.current[{i}]")
        )
    if observation == "navigation":
        system = _navigation(system)
    if action != "thrusters":
        system = system.add("allocation", "model:allocation")
        for i, name in enumerate(THRUSTERS, 1):
            system = system.connect(f"allocation.u[{i}]", f"{name}.u")
    if action == "velocity":
        gains: dict[str, object] = {"Ki": (0.0, 0.0, 0.0, 4.0, 4.0, 0.0)}
        system = system.add("controller", "model:controller", start=gains)
        system = _velocity(system, observation)
    return system.add("reference", "model:reference") if reference else system


def _task_of(
    vehicle: str, action: ActedOn, observation: Observed, reference: bool, disturbances: bool
) -> System:
    """Return the system of a task for another vehicle than the BlueROV2 Heavy."""
    id = str(vehicle_file(split_address(vehicle)[0])[1]["id"])
    if disturbances:
        raise InputInvalid(f"disturbances of {id}", "its faults are of eight T200", HEAVY)
    name = "".join(c if c.isalnum() else "_" for c in id)
    system = System(f"{name}_task", "0.01", f"{id}, on which a policy acts")
    system = system.add("hull", f"model:{quoted(vehicle)}", start={"eta_0": START})
    system = system.add("current", "model:current_gauss_markov").connect("current.v_c", "hull.v_c")
    if observation == "navigation":
        system = _navigation(system)
    if action != "thrusters":
        control_design(vehicle)  # refuses thrusters that do not make the forces
        system = with_allocation(system, vehicle)
    system, _ = with_actuators(system, vehicle)
    if action == "velocity":
        system = system.add("controller", f"model:lqr?id=vehicle&vehicle={quoted(vehicle)}")
        z_max = control_design(vehicle).z_max
        # Integrals of roll and pitch alone: the other errors are 0 by the connections.
        system = system.set("controller.z_max", [0.0, 0.0, 0.0, *z_max[3:5].tolist(), 0.0])
        system = _velocity(system, observation)
    return system.add("reference", "model:reference") if reference else system


def _velocity(system: System, observation: Observed) -> System:
    """Connect a controller that follows velocities and keeps the hull level.

    Its desired position is the present one.
    """
    source = "hull" if observation == "truth" else "navigation"
    return (
        system.connect(f"{source}.eta", "controller.eta")
        .connect(f"{source}.nu", "controller.nu")
        .connect(f"{source}.eta[1:3]", "controller.eta_d[1:3]")
        .connect(f"{source}.eta[6]", "controller.eta_d[6]")
        .connect("controller.tau_d", "allocation.tau_d")
        .group(["controller", "allocation"])
    )


def _navigation(system: System) -> System:
    """Add the sensors and the navigation filter."""
    readings = {
        "imu": ("acc", "gyro", "valid", "t_sample"),
        "dvl": ("beam_velocity", "beam_valid", "t_sample"),
        "pressure": ("pressure", "valid", "t_sample"),
        "compass": ("psi", "valid", "t_sample"),
        "usbl": ("position", "sigma", "valid", "t_sample"),
    }
    for sensor, names in OBSERVED.items():
        system = system.add(sensor, f"model:{sensor}")
        for name in names:
            system = system.connect(f"hull.{name}", f"{sensor}.{name}")
    system = system.add("navigation", "model:navigation", start={"eta_0": START})
    for sensor, names in readings.items():
        for name in names:
            prefix = "" if name == "pressure" else f"{sensor}_"
            system = system.connect(f"{sensor}.{name}", f"navigation.{prefix}{name}")
    return system
