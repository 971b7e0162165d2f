"""Systems for tasks of one vehicle: their unconnected inputs are the actions of a policy."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, get_args

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["OBSERVED", "THRUSTERS", "ActedOn", "Observed", "task_system"]

ActedOn = Literal["force", "thrusters", "velocity"]
Observed = Literal["truth", "navigation"]
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
) -> System:
    """Return a BlueROV2 Heavy with eight T200 in a meandering current, for a policy.

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
        # It holds velocities and trim: its desired position is the present one.
        gains: dict[str, object] = {"Ki": (0.0, 0.0, 0.0, 4.0, 4.0, 0.0)}
        system = system.add("controller", "model:controller", start=gains)
        source = "hull" if observation == "truth" else "navigation"
        system = (
            system.connect(f"{source}.eta", "controller.eta")
            .connect(f"{source}.nu", "controller.nu")
            .connect(f"{source}.eta[1:3]", "controller.eta_d[1:3]")
            .connect(f"{source}.eta[6]", "controller.eta_d[6]")
            .connect("controller.tau_d", "allocation.tau_d")
            .group(["controller", "allocation"])
        )
    return system.add("reference", "model:reference") if reference else system


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
