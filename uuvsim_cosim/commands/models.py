"""`uuvsim models`: list the declarations, show one, check one against a reference."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from uuvsim_cosim.commands.terminal import line, range_of, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["app"]

app = typer.Typer(help="List the models, show one, or check one against a reference.")


@app.callback(invoke_without_command=True)
def every(context: typer.Context) -> None:
    """List the models that can be simulated and built as FMUs."""
    if context.invoked_subcommand is not None:
        return
    from uuvsim_cosim.models.library import available, declare

    rows = []
    for name in available():
        model = declare(name)
        rows.append((name, " ".join(model.description.split())))
    table(("model", "what it is"), rows)


@app.command("show")
def show(name: Annotated[str, typer.Argument(help="A name, or a vehicle as id@set.")]) -> None:
    """Show a model's variables with units, values and meaning."""
    from uuvsim_cosim.fmus.describe import describe
    from uuvsim_cosim.models.library import declare

    model = declare(name)
    line(f"{model.name}: {' '.join(model.description.split())}")
    line()
    wanted = ("input", "output", "parameter")
    table(
        ("causality", "variable", "size", "unit", "start", "range", "meaning"),
        [
            (v.causality, v.name, " x ".join(map(str, v.shape)) or "1", v.unit_text or "-",
             _start(v.start) if v.causality != "output" else "", range_of(v.min, v.max),
             v.description)
            for causality in wanted
            for v in describe(model).of(causality)  # type: ignore[arg-type]
        ],
    )  # fmt: skip


def _start(value: Any) -> str:
    import numpy as np

    if value is None:
        return ""
    flat = np.asarray(value, dtype=float).ravel()
    text = " ".join(f"{x:.6g}" for x in flat[:6])
    return text + (" …" if flat.size > 6 else "")


@app.command("check")
def check(
    name: Annotated[str, typer.Argument(help="A vehicle as id@set.")],
    reference: Annotated[Path, typer.Option(help="CSV of a reference trajectory.")],
    tolerance: Annotated[float, typer.Option(help="Largest deviation that passes.")] = 1e-5,
) -> None:
    """Simulate a vehicle along a reference trajectory and say how far it is off."""
    if not reference.is_file():
        raise InputInvalid(f"{reference}: no such file; expected a CSV of a trajectory")
    from uuvsim_cosim.models.check import check as compare

    deviations = compare(name, reference)
    table(
        ("column", "largest deviation", "at t [s]"),
        [(d.column, f"{d.max:.3g}", f"{d.t:g}") for d in deviations],
    )
    worst = max(deviations, key=lambda d: d.max)
    if not worst.max <= tolerance:
        raise InputInvalid(
            f"{name} against {reference}: {worst.column} is {worst.max:.3g} off at "
            f"t = {worst.t:g} s; expected at most {tolerance:g}"
        )
    line(f"{name} agrees with {reference.name} within {tolerance:g}")
