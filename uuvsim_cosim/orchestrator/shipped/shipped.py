"""Systems of this package, written with the Python builder; their .ssd files are made here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from uuvsim_cosim.orchestrator.shipped.autopilot import bluerov2_with
from uuvsim_cosim.orchestrator.shipped.glider import slocum_yo
from uuvsim_cosim.orchestrator.shipped.pool import pool_tracking
from uuvsim_cosim.orchestrator.shipped.sonar_missions import (
    sidescan_survey,
    wreck_inspection,
)
from uuvsim_cosim.orchestrator.shipped.tasks import OBSERVED, THRUSTERS, task_system
from uuvsim_cosim.orchestrator.shipped.tracking import target_tracking
from uuvsim_cosim.orchestrator.system.system import System

__all__ = [
    "ALTITUDE",
    "BUILDERS",
    "WAYPOINTS",
    "bluerov2_hold",
    "bluerov2_survey",
    "seabed_mapping",
]

SCENE = "tacoma"
ALTITUDE = 5.0  # m, at the path's corners
CORNER = (944.0, 1214.0)  # m, N and E of the first corner, in the scene's frame
LENGTH, SPACING = 36.0, 5.0  # m
# D of the corners, in the order of the path: the terrain's less ALTITUDE (checked by a test).
DEPTHS = (16.32, 18.73, 18.29, 15.88, 15.44, 17.7, 17.07, 15.0, 14.56, 16.41)  # m
WAYPOINTS = tuple(
    (CORNER[0] + LENGTH * (i % 4 in (1, 2)), CORNER[1] + SPACING * (i // 2), depth)
    for i, depth in enumerate(DEPTHS)
)
ROWS = 32  # of the guidance's table


def seabed_mapping(survey: System) -> System:
    """Return the system `seabed_mapping`: the survey vehicle maps charted terrain.

    Five legs of 36 m, 5 m apart, run 5 m above a charted slope (19 to 24 m deep) of the scene
    `tacoma`, Puget Sound: the depths of the path's corners are those of the terrain, less 5 m. DVL
    and altimeter measure ranges to that terrain; multibeam and depth camera take frames of it at
    their own rates. The camera's frames are small here, for a viewer or a policy. The data for the
    map are defined in `mapping.yaml` beside the system: the multibeam's readings, and the camera's
    whole frames. No component reads these frames, so they are computed outside of the loop.
    """
    start = (*WAYPOINTS[0], 0.0, 0.0, 0.0)
    vessel = (CORNER[0] + LENGTH / 2, CORNER[1] - 20.0, 1.0)
    rows = [*WAYPOINTS, *[WAYPOINTS[-1]] * (ROWS - len(WAYPOINTS))]
    system = replace(
        survey,
        name="seabed_mapping",
        description="A BlueROV2 Heavy surveys charted terrain, of which a map is made",
        stop_time=470.0,
    )
    system = system.replace("dvl", f"model:dvl?scene={SCENE}")
    system = system.add("altimeter", f"model:altimeter?scene={SCENE}")
    system = system.add("multibeam", f"model:multibeam?id=p900&scene={SCENE}&period=0.2")
    system = system.add("camera", f"model:depth_camera?scene={SCENE}&period=0.2")
    for sensor in ("altimeter", "multibeam", "camera"):
        for name in ("eta", "q"):
            system = system.connect(f"hull.{name}", f"{sensor}.{name}")
    return (
        system.set("hull.eta_0", start)
        .set("navigation.eta_0", start)
        .set("guidance.waypoints", [list(w) for w in rows])
        .set("guidance.count", len(WAYPOINTS))
        .set("guidance.speed", 0.5)
        .set("usbl.p_transceiver", vessel)
    )


START = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # N E D [m], phi theta psi [rad]


def _vehicle(system: System) -> System:
    """Add hull, eight T200 thrusters, and the wrench that sums their thrust."""
    system = system.add("hull", "model:bluerov2_heavy", start={"eta_0": START})
    system = system.add("wrench", "model:wrench").connect("wrench.tau", "hull.tau")
    for i, name in enumerate(THRUSTERS, 1):
        system = (
            system.add(name, "model:thruster_t200")
            .connect(f"allocation.u[{i}]", f"{name}.u")
            .connect("hull.nu_r", f"{name}.nu_r")
            .connect(f"{name}.thrust", f"wrench.thrust[{i}]")
            .connect(f"{name}.current", f"wrench.current[{i}]")
        )
    return system


def bluerov2_hold() -> System:
    """Return a vehicle that follows waypoints by its true state, the smallest mission."""
    system = System("bluerov2_hold", "0.01", "A BlueROV2 Heavy flies waypoints on its true state")
    system = system.add("guidance", "model:guidance").add("controller", "model:controller")
    system = _vehicle(system.add("allocation", "model:allocation"))
    return (
        system.connect("hull.eta", "guidance.eta")
        .connect("hull.nu", "guidance.nu")
        .connect("hull.eta", "controller.eta")
        .connect("hull.nu", "controller.nu")
        .connect("guidance.eta_d", "controller.eta_d")
        .connect("guidance.nu_d", "controller.nu_d")
        .connect("controller.tau_d", "allocation.tau_d")
        .group(["guidance", "controller", "allocation"])
    )


def bluerov2_survey() -> System:
    """Return a lawn-mower survey through a meandering current, controlled by sensors only."""
    system = System(
        "bluerov2_survey",
        "0.01",
        "A BlueROV2 Heavy surveys through a meandering current and holds station at the end",
    )
    system = (
        system.add("current", "model:current_gauss_markov")
        .add("imu", "model:imu")
        .add("dvl", "model:dvl")
        .add("pressure", "model:pressure")
        .add("compass", "model:compass")
        .add("usbl", "model:usbl")
        .add("navigation", "model:navigation", start={"eta_0": START})
        .add("guidance", "model:guidance")
        .add("controller", "model:controller")
        .add("allocation", "model:allocation")
        .add("battery", "model:battery")
    )
    system = _vehicle(system)
    system = system.connect("current.v_c", "hull.v_c")
    for sensor, observed in OBSERVED.items():
        for name in observed:
            system = system.connect(f"hull.{name}", f"{sensor}.{name}")
    for sensor, readings in {
        "imu": ("acc", "gyro", "valid", "t_sample"),
        "dvl": ("beam_velocity", "beam_valid", "t_sample"),
        "compass": ("psi", "valid", "t_sample"),
        "usbl": ("position", "sigma", "valid", "t_sample"),
        "pressure": ("valid", "t_sample"),
    }.items():
        for name in readings:
            system = system.connect(f"{sensor}.{name}", f"navigation.{sensor}_{name}")
    system = system.connect("pressure.pressure", "navigation.pressure")
    for reader in ("guidance", "controller"):
        system = system.connect("navigation.eta", f"{reader}.eta")
        system = system.connect("navigation.nu", f"{reader}.nu")
    system = (
        system.connect("guidance.eta_d", "controller.eta_d")
        .connect("guidance.nu_d", "controller.nu_d")
        .connect("controller.tau_d", "allocation.tau_d")
        .connect("wrench.current_total", "battery.current")
    )
    for name in THRUSTERS:
        system = system.connect("battery.voltage", f"{name}.voltage")
    # In sequence within a step, as on a vehicle's computer: three delays less in the loop.
    return system.group(["navigation", "guidance", "controller", "allocation"])


BUILDERS: dict[str, Callable[[], System]] = {
    "bluerov2_ardusub": lambda: bluerov2_with("ardusub", bluerov2_survey()),
    "bluerov2_hold": bluerov2_hold,
    "bluerov2_px4": lambda: bluerov2_with("px4", bluerov2_survey()),
    "bluerov2_survey": bluerov2_survey,
    "bluerov2_task": task_system,
    "pool_tracking": pool_tracking,
    "seabed_mapping": lambda: seabed_mapping(bluerov2_survey()),
    "sidescan_survey": sidescan_survey,
    "slocum_yo": slocum_yo,
    "target_tracking": partial(target_tracking, 2),
    "wreck_inspection": lambda: wreck_inspection(bluerov2_survey()),
}
