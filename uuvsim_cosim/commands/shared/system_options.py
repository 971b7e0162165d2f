"""Options that change a system before it runs: `--replace`, `--map`, `--rate`, `--set`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.commands.shared.options import by_component, value_of
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["MAP", "SET", "edited_system"]

SET = "component.parameter=value"
MAP = "component.variable=its_name_there"


def edited_system(
    name: str, waypoints: Path | None, changes: dict[str, dict[str, str]],
    loops: str | None = None, origin: str | None = None,
) -> System:  # fmt: skip
    """Load the system and apply the swaps, then rates, values, waypoints and the loop policy."""
    from uuvsim_cosim.orchestrator.running.library import load
    from uuvsim_cosim.orchestrator.running.mission import with_waypoints
    from uuvsim_cosim.waypoints import load_waypoints, origin_of

    place = None if origin is None else origin_of(origin)
    flown = None if waypoints is None else load_waypoints(waypoints, place)
    system = load(name)
    if loops is not None:
        system = system.with_loops(loops)  # type: ignore[arg-type]  # refused if there is none
    rates, swaps = changes["rate"], changes["replace"]
    files = {c: f for c, f in changes["map"].items() if f.lower().endswith(".ssm")}
    maps = by_component({k: v for k, v in changes["map"].items() if k not in files})
    for component in {**files, **maps}:
        if component not in swaps:
            raise InputInvalid(
                f"--map {component}: nothing is put there", f"--replace {component}=SOURCE"
            )
    for component, source in swaps.items():
        # A file on the command line is relative to the current folder, not to the system's.
        mapping = Path(files[component]) if component in files else maps.get(component)
        system = system.replace(component, _from_here(source), map=mapping,
                                rate=rates.get(component))  # fmt: skip
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
                    f"--set {path}: is fed by {wire.connection.source}",
                    "a parameter, or an input that nothing is connected to",
                )
    if flown is None:
        return system
    system = with_waypoints(system, flown.points)
    return replace(system, remarks=(*system.remarks, *flown.notes))


def _from_here(source: str) -> str:
    name, colon, _ = source.rpartition(":")
    file = name if colon and name.endswith(".py") else source
    path = Path(file).expanduser()
    if path.suffix.lower() in (".fmu", ".ssd", ".ssp", ".py"):
        return f"{path.absolute()}{source[len(file) :]}" if "#" not in file else source
    return source
