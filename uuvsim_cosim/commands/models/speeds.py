"""`uuvsim models speeds`: top speeds at full command, beside published speeds."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import models
from uuvsim_cosim.commands.shared.terminal import Shown, line, remark, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["speeds_command"]


def speeds_command(
    vehicle: Annotated[
        str | None,
        typer.Argument(
            autocompletion=models,
            help="Vehicle as id or its folder, for all its sets, or as id@set; by default the "
            "default set of every shipped vehicle.",
        ),
    ] = None,
    voltage: Annotated[
        float | None,
        typer.Option(
            help="Voltage [V] of the thrusters' supply, by default the nominal voltage of each "
            "thruster."
        ),
    ] = None,
) -> None:
    """Compute the top speeds of vehicles in six directions and compare them with published ones."""
    from uuvsim_cosim.models.declaration.parameter_files import (
        parameter_set,
        propelled_ids,
        split_address,
        vehicle_sets,
    )
    from uuvsim_cosim.models.vehicles.top_speeds import (
        DIRECTIONS,
        depends_on_voltage,
        published_speeds,
        top_speeds,
    )

    if vehicle is None:
        addresses = [f"{id}@{parameter_set(id).name}" for id in propelled_ids()]
    else:
        id, name = split_address(vehicle)
        addresses = [f"{id}@{s}" for s in ([name] if name else vehicle_sets(id))]
    deaf = [] if voltage is None else [a for a in addresses if not depends_on_voltage(a)]
    if deaf and deaf == addresses:
        raise InputInvalid(
            f"--voltage {voltage:g}: the thrust of {vehicle} does not depend on its supply",
            "no --voltage; it applies to thrusters with bench rows, as those of bluerov2",
        )
    full = {a: {s.direction: s for s in top_speeds(a, voltage)} for a in addresses}
    found = {a: {d: s.speed for d, s in full[a].items()} for a in addresses}
    line("steady speed at full command [m/s], held level; -: no thruster pushes that way")
    if any(s.force > 1e-9 and s.speed == 0 for by in full.values() for s in by.values()):
        line("too weak: the largest force of the thrusters that way is less than the net weight")
    if deaf:
        remark("note", f"--voltage {voltage:g} has no effect on {', '.join(deaf)}: the thrust does "
               "not depend on the supply")  # fmt: skip
    table(
        ("vehicle", *DIRECTIONS),
        [(a, *(_speed(full[a][d].speed, full[a][d].force) for d in DIRECTIONS)) for a in found],
        key="speeds",
    )
    rows: list[tuple[str | Shown, ...]] = []
    for a, speeds in found.items():
        published = published_speeds(a)
        rows += [
            (
                a,
                s.direction,
                _speed(speeds[s.direction]),
                Shown(s.speed, f"{s.speed:.3g}"),
                s.by,
                Shown(speeds[s.direction] / s.speed, f"{speeds[s.direction] / s.speed:.2f}"),
                s.source,
            )
            for s in published
        ]
        if not published:
            rows.append((a, "-", "", "none found", "", "", ""))
    line()
    table(
        ("vehicle", "direction", "model [m/s]", "published [m/s]", "by", "ratio", "source"),
        rows,
        key="published",
    )


def _speed(speed: float, force: float = 0.0) -> Shown:
    """Return a speed as it is shown: - where no thruster pushes, "too weak" where one does."""
    if math.isnan(speed):
        return Shown(None, "unlimited")
    return Shown(speed, f"{speed:.2f}" if speed else "too weak" if force > 1e-9 else "-")
