"""`uuvsim models`: list the declarations, show one, check them, start a vehicle of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from uuvsim_cosim.commands.import_vehicle import import_command
from uuvsim_cosim.commands.terminal import line, range_of, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["app"]

app = typer.Typer(help="List the models, show one, check vehicles, or start one of your own.")


@app.callback(invoke_without_command=True)
def every(context: typer.Context) -> None:
    """List the models that can be simulated and built as FMUs."""
    if context.invoked_subcommand is not None:
        return
    from uuvsim_cosim.models.library import IN_PROCESS, available, declare

    rows = []
    for name in available():
        model = declare(name)
        rows.append((name, " ".join(model.description.split())))
    rows += [(name, f"Python component, in process only: {where}")
             for name, where in IN_PROCESS.items()]  # fmt: skip
    table(("model", "what it is"), rows)


@app.command("show")
def show(
    name: Annotated[
        str, typer.Argument(help="A name, a vehicle as id@set, a preset as imu@stim300.")
    ],
) -> None:
    """Show a model's variables with units, values and meaning."""
    from uuvsim_cosim.fmus.describe import describe
    from uuvsim_cosim.models.library import declare
    from uuvsim_cosim.models.parameters import is_vehicle, split_address
    from uuvsim_cosim.models.preset import presets_of

    model = declare(name)
    wanted: tuple[str, ...] = ("input", "output", "parameter")
    if is_vehicle(split_address(name)[0]):
        from uuvsim_cosim.commands.show_vehicle import show_vehicle

        show_vehicle(name)
        wanted = ("input", "output")
    else:
        line(f"{model.name}: {' '.join(model.description.split())}")
    line()
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
    presets = presets_of(model.name)
    if presets:
        line()
        table(("preset", "what it is"), [(f"{model.name}@{k}", v) for k, v in presets.items()])


def _start(value: Any) -> str:
    import numpy as np

    if value is None:
        return ""
    flat = np.asarray(value, dtype=float).ravel()
    text = " ".join(f"{x:.6g}" for x in flat[:6])
    return text + (" …" if flat.size > 6 else "")


@app.command("check")
def check(
    name: Annotated[
        str | None, typer.Argument(help="A vehicle, as id, id@set or its folder; all, if left out.")
    ] = None,
    reference: Annotated[Path | None, typer.Option(help="CSV of one reference trajectory.")] = None,
    tolerance: Annotated[float, typer.Option(help="Largest deviation that passes.")] = 1e-5,
) -> None:
    """Compare vehicles with trajectories, published values and closed forms; say how far off."""
    if reference is None:
        _check_all([name] if name else None)
        return
    if name is None:
        raise InputInvalid("--reference needs a vehicle before it, such as bluerov2_heavy@wu_2018")
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


def _check_all(names: list[str] | None) -> None:
    from uuvsim_cosim.models.checks import checks_of
    from uuvsim_cosim.models.parameters import vehicle_ids

    done = [c for name in names or vehicle_ids() for c in checks_of(name)]
    words = {True: "yes", False: "NO"}
    table(
        ("vehicle", "check", "off", "at most", "holds"),
        [
            (c.address, c.what, f"{c.off:.2g}", f"{c.tolerance:g}",
             "known" if c.known else words[c.holds])
            for c in done
        ],
    )  # fmt: skip
    for c in done:
        if c.known:
            line(f"known: {c.address}: {c.what}: {c.known}")
    failed = [c for c in done if not c.holds and not c.known]
    if failed:
        raise InputInvalid(
            "; ".join(
                f"{c.address}: {c.what} is {c.off:.3g} off; expected at most {c.tolerance:g}"
                f" ({c.source})"
                for c in failed
            )
        )
    kept = sum(c.holds for c in done)
    rest = ", the cause of the rest is known" if kept < len(done) else ""
    line(f"{kept} of {len(done)} checks hold{rest}")


@app.command("new")
def new(
    name: Annotated[str, typer.Argument(help="Its id: lower case, digits and _.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write into.")] = Path(),
    shape: Annotated[str, typer.Option(help="box or torpedo.")] = "box",
) -> None:
    """Write the folder of a vehicle of your own, which can be run at once, and say how."""
    from uuvsim_cosim.commands.terminal import tilde
    from uuvsim_cosim.models.new_vehicle import write_vehicle

    folder = write_vehicle(name, out, shape)
    for path in sorted(folder.iterdir()):
        line(tilde(path))
    line()
    line(f"see it with    uuvsim models show {tilde(folder)}")
    line(f"check it with  uuvsim models check {tilde(folder)}")
    line(f"use it as      model:{tilde(folder)}")


app.command("import")(import_command)
