"""`uuvsim systems`: list the systems, show one with its diagram, or one of its slots."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.cache import written
from uuvsim_cosim.commands.run.missions import missions_command
from uuvsim_cosim.commands.shared.completion import components, of, systems, vehicles
from uuvsim_cosim.commands.shared.options import assignments
from uuvsim_cosim.commands.shared.system_options import Force
from uuvsim_cosim.commands.shared.terminal import file_line, line, number, remark, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["app"]

app = typer.Typer(help="List the systems, show one or its slots, or make one.")
CONNECTION = "component.input=component.output, such as tank.inflow=valve.flow"


app.command("missions")(missions_command)


@app.callback(invoke_without_command=True)
def every(context: typer.Context) -> None:
    """List the systems that `uuvsim run` knows by name."""
    if context.invoked_subcommand is not None:
        return
    from uuvsim_cosim.commands.shared.listings import listed_systems

    table(("system", "components", "what it is"), listed_systems(""), key="systems")


@app.command("show")
def show(
    name: Annotated[
        str,
        typer.Argument(
            autocompletion=systems, help="Name of a system, or a path to .ssd, .ssp or .fmu."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Diagram to write; default NAME.svg.")
    ] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Print the execution plan instead.")] = False,
) -> None:
    """Draw a system's block diagram with rates and units, and list components and loops."""
    if out is not None and out.suffix.lower() != ".svg":
        raise InputInvalid(out, f"ending {out.suffix!r} was read", ".svg")
    from uuvsim_cosim.orchestrator.plan.algebraic_loops import loop_lines_of
    from uuvsim_cosim.orchestrator.plan.flatten import plan_to_inspect
    from uuvsim_cosim.orchestrator.plan.loop_delays import loop_delays, loop_lines
    from uuvsim_cosim.orchestrator.plan.plan_table import format_plan
    from uuvsim_cosim.orchestrator.running.library import load

    system = load(name)
    found, refused = plan_to_inspect(system)
    if plan:
        line(format_plan(found))
        if refused:
            line(f"refused: {refused}")
        return
    line(f"{system.name}: {' '.join(system.description.split())}")
    line()
    rows = []
    for c in found.components:
        is_model = c.source.startswith("model:")
        source = c.source.removeprefix("model:") if is_model else Path(c.source).name
        step = number(float(c.step_ticks * found.tick), "g")
        of = c.description.of
        rows.append((c.path, source, step, len(of("input")), len(of("output")),
                     c.description.description))  # fmt: skip
    head = ("component", "kind", "step [s]", "inputs", "outputs", "what it is")
    table(head, rows, key="components")
    line()
    for loop in loop_lines(loop_delays(found), most=12):
        line(f"loop {loop}")
    for text in [f"refused: {refused}"] if refused else loop_lines_of(found):
        line(text)
    for note in system.notes:
        remark("assumed", note)
    for warning in found.warnings:
        if warning not in system.notes:
            remark("warning", warning)
    from uuvsim_cosim.view.diagram.diagram import diagram

    target = out or Path(f"{system.name}.svg")
    written(target, diagram(system))
    file_line(target)


@app.command("slot")
def slot(
    name: Annotated[
        str,
        typer.Argument(autocompletion=systems, help="Name of a system, or a path to .ssd or .ssp."),
    ],
    component: Annotated[
        str, typer.Argument(autocompletion=components, help="A component of the system.")
    ],
) -> None:
    """Print the connectors that a replacement of a component must have."""
    from uuvsim_cosim.orchestrator.running.library import load
    from uuvsim_cosim.orchestrator.system.slot import format_slot

    found = load(name).slot(component)
    line(format_slot(found))


@app.command("new")
def new(
    name: Annotated[
        str,
        typer.Argument(
            help="Name of the system; of its vehicle too by default.", show_default=False
        ),
    ] = "",
    vehicle: Annotated[
        str | None,
        typer.Option(autocompletion=vehicles, help="Vehicle: id, id@set or folder; default NAME."),
    ] = None,
    mission: Annotated[
        str | None,
        typer.Option(
            autocompletion=of("hold", "survey"), help="Mission: hold or survey; default survey."
        ),
    ] = None,
    from_: Annotated[
        list[Path] | None,
        typer.Option("--from", help="FMUs, one or several, in the place of a vehicle."),
    ] = None,
    connect: Annotated[
        list[str] | None,
        typer.Option(help="Source of an input, a.input=b.output; units are converted."),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(help="Communication step of all FMUs [s]; default: that of each FMU."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write; default NAME.ssd.")
    ] = None,
    force: Force = False,
) -> None:
    """Make a complete system from a vehicle's folder, or a system of FMUs.

    For a vehicle, the margins and assumptions are printed. Outputs and inputs of FMUs are connected
    if their names and units are equal; the inputs that stay open are listed.
    """
    if from_ is None and not name:
        raise InputInvalid("no name", "NAME of the system, or --from FILE.fmu")
    for option, given, needed in (
        ("--vehicle", from_ and vehicle, "no --from beside it"),
        ("--mission", from_ and mission, "no --from beside it"),
        ("--connect", not from_ and connect, "--from"),
        ("--step", not from_ and step, "--from"),
    ):
        if given:
            raise InputInvalid(f"{option} {given}", "an option for another source", needed)
    if (vehicle is not None or from_) and Path(name).name != name:
        raise InputInvalid(
            f"{name}: a path", "the name of the system; --out FILE.ssd for its place"
        )
    name = name or "system"
    target = out or Path(f"{Path(name).name}.ssd")
    if target.suffix.lower() != ".ssd":
        raise InputInvalid(target, f"ending {target.suffix!r} was read", ".ssd")
    if target.exists():
        raise InputInvalid(target, "it exists already", "another name, or --out FILE.ssd")
    own = "".join(c if c.isalnum() else "_" for c in Path(name).name)
    if from_:
        pairs = assignments("--connect", connect or (), CONNECTION, dotted=True)
        _new_of_fmus(from_, own, pairs, step, target)
        return
    from dataclasses import replace

    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.shipped.of_vehicle import system_of
    from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

    made = system_of(vehicle or name, mission or "survey")  # type: ignore[arg-type]  # it refuses
    made = made.with_mismatches("warn") if force else made
    first, *others = made.remarks
    warned = [w for w in flatten(made).warnings if w not in made.notes]
    write_ssd(replace(made, name=own), target)
    line(first)
    for text in warned:
        remark("warning", text)
    for text in others:
        remark("note" if text.startswith("margins") else "assumed", text)
    file_line(target)


def _new_of_fmus(
    files: list[Path], name: str, connect: dict[str, str], step: str | None, target: Path
) -> None:
    """Write a system of FMUs; print its connections, the inputs that stay open, and assumptions."""
    from uuvsim_cosim.orchestrator.plan.flatten import plan_to_inspect
    from uuvsim_cosim.orchestrator.shipped.of_fmus import system_of_fmus
    from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

    chosen = {(source, target) for target, source in connect.items()}
    made = system_of_fmus(files, name, connections=sorted(chosen), step=step)
    plan, refused = plan_to_inspect(made.system)
    write_ssd(made.system, target)
    rows = [
        (c.source, c.target, "by --connect" if (c.source, c.target) in chosen else "name and unit")
        for c in made.system.connections
    ]
    if rows:
        table(("output", "input", "connected by"), rows, key="connections")
    if made.open:
        line()
        table(
            ("open input", "unit", "outputs that it could have", "reason"),
            [(o.target, o.unit or "-", ", ".join(o.sources) or "-", o.reason) for o in made.open],
            key="open",
        )
    line()
    for text in made.system.notes:
        remark("assumed", text)
    for text in plan.warnings:
        if text not in made.system.notes:
            remark("warning", text)
    if refused:
        remark("warning", f"a run will refuse this system: {refused}")
    file_line(target)
