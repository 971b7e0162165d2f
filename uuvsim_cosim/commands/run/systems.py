"""`uuvsim systems`: list the systems, show one with its diagram, or one of its slots."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.cache import written
from uuvsim_cosim.commands.shared.completion import components, systems
from uuvsim_cosim.commands.shared.terminal import file_line, line, number, remark, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["app"]

app = typer.Typer(help="List the systems, show one, or what a replacement must have.")


@app.callback(invoke_without_command=True)
def every(context: typer.Context) -> None:
    """List the systems that `uuvsim run` knows by name."""
    if context.invoked_subcommand is not None:
        return
    from uuvsim_cosim.orchestrator.running.library import available, load

    rows = []
    for name in available():
        system = load(name)
        rows.append((name, len(system.components), " ".join(system.description.split())))
    table(("system", "components", "what it is"), rows, key="systems")


@app.command("show")
def show(
    name: Annotated[
        str, typer.Argument(autocompletion=systems, help="A name, or a path to .ssd, .ssp or .fmu.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The diagram: NAME.svg if not given.")
    ] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Print the plan instead.")] = False,
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
        str, typer.Argument(autocompletion=systems, help="A name, or a path to .ssd or .ssp.")
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
