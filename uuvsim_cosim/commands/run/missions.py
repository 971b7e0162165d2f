"""`uuvsim systems missions`: what each vehicle flies, with errors, energy and margins."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.shared.completion import vehicles
from uuvsim_cosim.commands.shared.options import seconds
from uuvsim_cosim.commands.shared.terminal import number, remark, table
from uuvsim_cosim.errors import InputInvalid, UuvsimError

if TYPE_CHECKING:
    from uuvsim_cosim.models.control.margins import LoopMargin
    from uuvsim_cosim.orchestrator.running.run import Run
    from uuvsim_cosim.orchestrator.shipped.of_vehicle import Flight

__all__ = ["missions_command"]

FLIGHTS = {  # in the table: mission and whether the water moves
    "hold": ("hold", False),
    "survey": ("survey", False),
    "survey in a current": ("survey", True),
}
HEAD = ("vehicle", "mission", "flown", "speed [m/s]", "error, RMS [m]", "error, max [m]",
        "depth, RMS [m]", "energy [Wh]", "gain margin [dB]", "phase margin [deg]", "CPU [us/step]",
        "done")  # fmt: skip


@dataclass(frozen=True)
class _Flown:
    """Errors [m] of the hull's true state, energy [Wh] and whether the flight was completed."""

    rms: float
    largest: float
    depth: float
    energy: float | None  # of thrusters with an electrical model
    done: str


def missions_command(
    vehicle: Annotated[
        list[str] | None,
        typer.Argument(autocompletion=vehicles, help="Vehicles; by default those of the package."),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            help="End of each flight: seconds, or '2 min'; by default, when its path is flown.",
            parser=seconds("--until"),
            metavar="TIME",
        ),
    ] = None,
) -> None:
    """Fly each vehicle's missions, and print errors, energy, and the margins of its loops."""
    from uuvsim_cosim.models.declaration.parameter_files import propelled_ids

    if until is not None and not 0 < until < float("inf"):
        raise InputInvalid(f"--until {until:g}: expected more than 0 seconds")
    rows: list[tuple[object, ...]] = []
    refused: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in vehicle or propelled_ids():
            try:
                loops = _margins(name)
                for label in FLIGHTS:
                    rows.append(_row(name, label, until, Path(folder) / f"{len(rows)}", loops))
            except UuvsimError as error:
                refused.append(f"{name}: {error}")
    table(HEAD, rows, key="missions")
    for text in refused:
        remark("note", text)
    if not rows:
        raise InputInvalid("no vehicle flew", "; ".join(refused))


def _row(
    vehicle: str, label: str, until: float | None, folder: Path, loops: Sequence[LoopMargin]
) -> tuple[object, ...]:
    from uuvsim_cosim.models.control.margins import smallest
    from uuvsim_cosim.orchestrator.running.run import run
    from uuvsim_cosim.orchestrator.shipped.of_vehicle import flight_of, system_of

    mission, current = FLIGHTS[label]
    flight = flight_of(vehicle, mission)  # type: ignore[arg-type]  # it is a Mission
    system = system_of(vehicle, mission)  # type: ignore[arg-type]
    if mission == "survey" and not current:
        system = system.set("current.speed", 0.0).set("current.sigma", 0.0)
    begun: list[float] = []  # CPU time at the first step, after building and initialisation

    def progress(stage: str, done: float, total: float) -> None:
        if stage == "simulating" and not begun:
            begun.append(time.process_time())

    flown = run(
        system, until=until, out=folder, backend="native", record_every=5, progress=progress
    )
    spent = time.process_time() - (begun[0] if begun else float("nan"))
    f = _errors(flown, flight)
    cpu = 1e6 * spent / flown.steps
    kind = flight.kind if flight.radius is None else f"{flight.kind}, {flight.radius:g} m"
    gain, phase = smallest(loops)
    numbers = [number(x, ".3f") for x in (f.rms, f.largest, f.depth)]
    speed = number(flight.figures["speed"], "g")
    used = "-" if f.energy is None else number(f.energy, ".2f")
    return (vehicle, label, kind, speed, *numbers, used,
            number(gain, ".1f"), number(phase, ".0f"), number(cpu, ".0f"), f.done)  # fmt: skip


def _errors(run: Run, flight: Flight) -> _Flown:
    """Return the errors of a flight: after its first quarter, or along the legs of a survey."""
    import numpy as np

    from uuvsim_cosim.view.recorded.metrics import energy_of, path_end, tracking
    from uuvsim_cosim.view.recorded.traces import traces_of

    signals = run.signals()
    eta = signals["hull.eta"]
    traces = traces_of(run.folder)
    used = energy_of(traces)
    energy = None if used is None else used / 3600.0
    path = np.asarray(flight.waypoints)
    done = "yes" if signals["guidance.done"][-1] else "no" if flight.radius is None else "-"
    if flight.kind == "survey":
        end = path_end(traces)
        found = tracking(np.asarray(signals.time), eta.T, path, None, end)
        depth = eta[:end, 2] - path[0, 2]
        return _Flown(found.rms, found.max, float(np.sqrt(np.mean(depth**2))), energy, done)
    place = eta[len(eta) // 4 :, :3]
    if flight.radius is None:
        away = np.linalg.norm(place - path[0], axis=1)
    else:
        away = np.abs(np.linalg.norm(place[:, :2], axis=1) - flight.radius)  # around its waypoint
    depth = place[:, 2] - path[0, 2]
    rms = [float(np.sqrt(np.mean(x**2))) for x in (away, depth)]
    return _Flown(rms[0], float(away.max()), rms[1], energy, done)


def _margins(vehicle: str) -> Sequence[LoopMargin]:
    from uuvsim_cosim.models.control.fin_design import design_fins, fin_margins
    from uuvsim_cosim.models.control.vehicle_design import control_design
    from uuvsim_cosim.orchestrator.shipped.actuators import has_fins

    if has_fins(vehicle):
        return fin_margins(design_fins(vehicle))
    return control_design(vehicle).margins
