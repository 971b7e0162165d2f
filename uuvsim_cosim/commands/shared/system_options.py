"""Options that make or change a system before it runs, as `--vehicle`, `--replace` or `--set`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uuvsim_cosim.commands.shared.completion import of, replacements, vehicles
from uuvsim_cosim.commands.shared.options import (
    assignments,
    by_component,
    rates,
    seconds,
    value_of,
)
from uuvsim_cosim.commands.shared.terminal import notice
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.commands.shared.waypoints import Waypoints
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = [
    "MAP",
    "SET",
    "ArdusubBinary",
    "ArmReal",
    "Events",
    "Force",
    "Loops",
    "Maps",
    "Px4Build",
    "Rates",
    "Replacements",
    "Unsigned",
    "Until",
    "Values",
    "VariableSteps",
    "VehicleOfMission",
    "changes_of",
    "edited_system",
    "flown_path",
    "named_system",
    "permit_commands",
    "with_path",
]

SET = "component.parameter=value"
MAP = "component.variable=name_in_source"
MISSIONS = ("hold", "survey")  # of `system_of`

VehicleOfMission = Annotated[
    str | None,
    typer.Option(
        "--vehicle",
        autocompletion=vehicles,
        help="Vehicle that flies the mission SYSTEM, hold or survey: id, id@set or folder.",
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Accept parts of another vehicle, and masses that sink it, with a warning."
    ),
]

Replacements = Annotated[
    list[str] | None,
    typer.Option(
        "--replace", autocompletion=replacements,
        help="component=source: an .fmu, FILE.py:Class, model:…, keyboard; may be repeated.",
    ),
]  # fmt: skip
Maps = Annotated[list[str] | None, typer.Option("--map", help=f"{MAP}, or component=FILE.ssm.")]
Rates = Annotated[
    list[str] | None,
    typer.Option("--rate", help="Communication step: component=0.02, or component=20ms."),
]
Values = Annotated[list[str] | None, typer.Option("--set", help=f"{SET}; may be repeated.")]
Loops = Annotated[
    str | None,
    typer.Option(
        "--loops", autocompletion=of("iterate", "refuse", "delay"),
        help="Algebraic loops: iterate, refuse or delay.",
    ),
]  # fmt: skip
VariableSteps = Annotated[
    str | None,
    typer.Option(
        "--variable-step",
        help="Step that follows the coupling's error, in s: 'smallest=1e-5 largest=0.01'.",
    ),
]
Events = Annotated[
    bool,
    typer.Option(
        "--events", help="FMUs of FMI 3.0 exchange values at the instant of an event (Event Mode)."
    ),
]
Until = Annotated[
    float | None,
    typer.Option(
        "--until", help="End of the simulated time: seconds, or '2 min'.",
        parser=seconds("--until"), metavar="TIME",
    ),
]  # fmt: skip
ArdusubBinary = Annotated[
    str | None,
    typer.Option(
        "--ardusub", help="ArduSub's simulation binary; by default `ardusub` in the PATH."
    ),
]
Px4Build = Annotated[
    str | None,
    typer.Option("--px4", help="PX4's build folder, or its binary; by default `px4` in the PATH."),
]
ArmReal = Annotated[
    bool, typer.Option("--arm-real", help="Send commands to a vehicle that is followed.")
]
Unsigned = Annotated[
    bool, typer.Option("--unsigned", help="Send these commands without a signature.")
]


def changes_of(
    set_: list[str] | None, replace: list[str] | None = None,
    map_: list[str] | None = None, rate: list[str] | None = None,
) -> dict[str, dict[str, str]]:  # fmt: skip
    """Return what `--set`, `--replace`, `--map` and `--rate` change. Raises InputInvalid."""
    return {
        "replace": assignments("--replace", replace or [], "component=source", dotted=False),
        "map": assignments("--map", map_ or [], MAP, dotted=False),
        "rate": rates(rate or []),
        "set": assignments("--set", set_ or [], SET, dotted=True),
    }


def edited_system(
    name: str, waypoints: Path | None, changes: dict[str, dict[str, str]],
    loops: str | None = None, origin: str | None = None, vehicle: str | None = None,
    force: bool = False, binaries: Mapping[str, str | None] | None = None,
    variable_step: str | None = None, events: bool = False,
) -> System:  # fmt: skip
    """Load the system and apply the swaps, then rates, values, waypoints and the policies.

    With a `vehicle`, `name` is a mission, and the system is made for both. `binaries` has
    the paths of autopilots' binaries, by their schemes.
    """
    from uuvsim_cosim.orchestrator.shipped.autopilot import (
        autopilot_of,
        with_autopilot,
        with_binary,
    )
    from uuvsim_cosim.orchestrator.system.resolve import resolve

    flown = flown_path(waypoints, origin)
    system = named_system(name, vehicle)
    if force:
        system = system.with_mismatches("warn")
    if loops is not None:
        system = system.with_loops(loops)  # type: ignore[arg-type]  # refused if there is none
    if variable_step is not None:
        asked = variable_step.strip()
        system = system.with_variable_step(None if asked == "none" else asked)
    if events:
        system = system.with_events()
    rates, swaps = changes["rate"], dict(changes["replace"])
    if any(text.startswith("axes:") for text in swaps.values()):
        from uuvsim_cosim.bridge.http.recorded_axes import with_recorded_axes

        with_recorded_axes(lambda: system, swaps)
    files = {c: f for c, f in changes["map"].items() if f.lower().endswith(".ssm")}
    maps = by_component({k: v for k, v in changes["map"].items() if k not in files})
    for component in {**files, **maps}:
        if component not in swaps:
            raise InputInvalid(
                f"--map {component}: the component is not replaced", f"--replace {component}=SOURCE"
            )
    for component, source in swaps.items():
        if autopilot_of(source) is not None:
            full = resolve(source if ":" in source else f"{source}:", Path.cwd()).text
            system = with_autopilot(system, component, full)
            continue
        # A file on the command line is relative to the current folder, not to the system's.
        mapping = Path(files[component]) if component in files else maps.get(component)
        system = system.replace(component, _from_here(source), map=mapping,
                                rate=rates.get(component))  # fmt: skip
    for autopilot, binary in (binaries or {}).items():
        if binary is not None:
            path_of_it = str(Path(binary).expanduser().absolute())
            system = with_binary(system, path_of_it, autopilot)
    for component, step in rates.items():
        if component not in swaps:
            element = system.components.get(component)
            if element is None:
                known = ", ".join(system.components)
                raise InputInvalid(f"--rate {component}: no such component", f"one of {known}")
            kept: Any = element.source  # its own source again: text, or a nested system
            system = system.replace(component, kept, rate=step)
    for path, text in changes["set"].items():
        system = system.set(path, value_of(text))
        for wire in system.checked.wires:
            if path.partition("[")[0] == f"{wire.target.element}.{wire.target.variable.name}":
                raise InputInvalid(  # the connection would overwrite it at once
                    f"--set {path}: is connected to {wire.connection.source}",
                    "a parameter, or an input that nothing is connected to",
                )
    return system if flown is None else with_path(system, flown)


def flown_path(
    waypoints: Path | None, origin: str | None, *, shared: bool = False
) -> Waypoints | None:
    """Return the waypoints of a file; None without one. Raises InputInvalid.

    An `origin` that is `shared` is of use without waypoints, too.
    """
    from uuvsim_cosim.commands.shared.waypoints import load_waypoints, origin_of

    place = None if origin is None else origin_of(origin)
    if waypoints is not None:
        return load_waypoints(waypoints, place, shared=shared)
    if place is not None and not shared:
        raise InputInvalid(f"--origin {origin}: applies to --waypoints", "--waypoints as well")
    return None


def with_path(system: System, flown: Waypoints) -> System:
    """Return the system with these waypoints in its guidance, and with their notes."""
    from uuvsim_cosim.orchestrator.running.mission import with_waypoints

    system = with_waypoints(system, flown.points)
    return replace(system, remarks=(*system.remarks, *flown.notes))


def permit_commands(swaps: Mapping[str, str], *, arm_real: bool, unsigned: bool) -> bool:
    """Permit or forbid commands to followed vehicles, and print what is permitted.

    `swaps` are the values of `--replace`. Return whether a vehicle is followed.
    """
    follows = any(text.startswith("mavlink:") for text in swaps.values())
    if arm_real or unsigned or follows:
        from uuvsim_cosim.bridge.mavlink.follower import allow

        for text in allow(arm_real=arm_real, unsigned=unsigned, report=notice):
            notice(text)
    return follows


def named_system(name: str, vehicle: str | None) -> System:
    """Return a system by its name or file, or with a `vehicle`, that vehicle's mission `name`."""
    if vehicle is None:
        if name in MISSIONS:
            raise InputInvalid(
                name, "a mission, which every vehicle can fly", f"{name} --vehicle VEHICLE"
            )
        from uuvsim_cosim.orchestrator.running.library import load

        return load(name)
    from uuvsim_cosim.orchestrator.shipped.of_vehicle import system_of

    if name not in MISSIONS:
        raise InputInvalid(
            f"--vehicle {vehicle}: {name} is no mission",
            f"{' or '.join(MISSIONS)}, as in hold --vehicle {vehicle}",
        )
    return system_of(vehicle, name)  # type: ignore[arg-type]  # it is one of MISSIONS


def _from_here(source: str) -> str:
    name, colon, _ = source.rpartition(":")
    file = name if colon and name.endswith(".py") else source
    path = Path(file).expanduser()
    if path.suffix.lower() in (".fmu", ".ssd", ".ssp", ".py"):
        return f"{path.absolute()}{source[len(file) :]}" if "#" not in file else source
    return source
