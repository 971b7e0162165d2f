"""System `seabed_mapping`: the survey vehicle maps charted terrain.

Five legs of 36 m, 5 m apart, run 5 m above a charted slope (19 to 24 m deep) of the scene `tacoma`,
Puget Sound: the depths of the path's corners are those of the terrain, less 5 m. DVL and altimeter
measure ranges to that terrain; multibeam and depth camera take frames of it at their own rates. The
camera's frames are small here, for a viewer or a policy. The data for the map are defined in
`mapping.yaml` beside the system: the multibeam's readings, and the camera's whole frames. No
component reads these frames, so they are computed outside of the loop.
"""

from __future__ import annotations

from dataclasses import replace

from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["ALTITUDE", "WAYPOINTS", "seabed_mapping"]

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
    """Return the survey with its vehicle above the slope, its vessel near by, and its path."""
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
