"""The systems `sidescan_survey` and `wreck_inspection`: charted wrecks, seen by sonar."""

from __future__ import annotations

from dataclasses import replace

from uuvsim_cosim.orchestrator.shipped.of_vehicle import system_of
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["sidescan_survey", "wreck_inspection"]

Point = tuple[float, float, float]  # N E D [m]

FIELD = "tacoma"
LEGS: tuple[Point, ...] = (
    (-1290.0, 1253.0, 60.0),
    (-1000.0, 1253.0, 60.0),
    (-1000.0, 1180.0, 60.0),
    (-1290.0, 1180.0, 60.0),
)
WRECK = "tacoma_wreck"
PLACE = (-1158.44, 1290.22)  # N, E [m], of the charted wreck
# Toward the wreck, along it, and away: from the south, the west and the north.
AROUND: tuple[Point, ...] = (
    (-1196.0, 1290.0, 67.0),
    (-1178.0, 1290.0, 67.0),
    (-1178.0, 1264.0, 68.0),
    (-1158.0, 1258.0, 68.0),
    (-1158.0, 1274.0, 68.0),
    (-1136.0, 1266.0, 67.0),
    (-1132.0, 1290.0, 67.0),
    (-1142.0, 1290.0, 67.0),
)
ROWS = 32  # of the guidance's table


def sidescan_survey() -> System:
    """Return a survey of two legs by a REMUS 100 with a side-scan sonar, past charted wrecks.

    The legs of 290 m run 15 to 30 m above the seabed of the scene `tacoma`. Three objects that the
    chart calls wrecks lie within the range of 60 m; their sizes are assumed.
    """
    sonar = f"model:side_scan_sonar?scene={FIELD}&bins=200&range_max=60&period=0.2&labels=true"
    system = _flown(system_of("remus100", "survey"), LEGS, FIELD, (-1150.0, 1250.0, 1.0))
    system = _with_sonar(system, "side_scan", sonar)
    return replace(
        system,
        name="sidescan_survey",
        description="A REMUS 100 passes charted wrecks with a side-scan sonar",
        stop_time=330.0,
        remarks=(),
    )


def wreck_inspection(survey: System) -> System:
    """Return an inspection of a charted wreck by a BlueROV2 Heavy with a forward-looking sonar.

    Position and depth of the wreck are those of the chart, its shape is made up: see the scene
    `tacoma_wreck`. The vehicle turns its sonar to the wreck from the south, the west and the north.
    """
    sonar = (
        f"model:imaging_sonar@m450?scene={WRECK}&beams=64&bins=128&range_max=32&period=0.5"
        "&labels=true"
    )
    system = _flown(survey, AROUND, WRECK, (-1190.0, 1250.0, 1.0))
    system = _with_sonar(system, "sonar", sonar).set("guidance.speed", 0.6)
    return replace(
        system,
        name="wreck_inspection",
        description="A BlueROV2 Heavy inspects a charted wreck with a forward-looking sonar",
        stop_time=300.0,
    )


def _flown(system: System, path: tuple[Point, ...], scene: str, vessel: Point) -> System:
    """Return the system over a scene, from the first point of its path on."""
    start = (*path[0], 0.0, 0.0, 0.0)
    rows = [*path, *[path[-1]] * (ROWS - len(path))]
    return (
        system.replace("dvl", f"model:dvl?scene={scene}")
        .set("hull.eta_0", start)
        .set("navigation.eta_0", start)
        .set("guidance.waypoints", [list(row) for row in rows])
        .set("guidance.count", len(path))
        .set("usbl.p_transceiver", vessel)
    )


def _with_sonar(system: System, name: str, source: str) -> System:
    system = system.add(name, source)
    for signal in ("eta", "q"):
        system = system.connect(f"hull.{signal}", f"{name}.{signal}")
    return system
