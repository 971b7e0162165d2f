"""`uuvsim models`: list the declarations, show one, check them, start a vehicle of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.models.import_vehicle import import_command
from uuvsim_cosim.commands.models.mesh import mesh_command
from uuvsim_cosim.commands.models.picture import picture_command
from uuvsim_cosim.commands.models.speeds import speeds_command
from uuvsim_cosim.commands.shared.completion import models, of
from uuvsim_cosim.commands.shared.options import folder_option
from uuvsim_cosim.commands.shared.terminal import (
    Shown,
    file_line,
    line,
    number,
    range_of,
    remark,
    table,
    tilde,
)
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.models.checks.reference_trajectory import Deviation

__all__ = ["app"]

app = typer.Typer(help="List the models, show one, check vehicles, or create a vehicle.")


@app.callback(invoke_without_command=True)
def every(context: typer.Context) -> None:
    """List the models that can be simulated and built as FMUs."""
    if context.invoked_subcommand is not None:
        return
    from uuvsim_cosim.commands.shared.listings import listed_models

    table(("model", "what it is"), listed_models(""), key="models")


@app.command("show")
def show(
    name: Annotated[
        str,
        typer.Argument(
            autocompletion=models,
            help="Name of a model; vehicle as id@set; preset such as imu@stim300.",
        ),
    ],
) -> None:
    """Show a model's variables with units, values and meaning."""
    from uuvsim_cosim.fmus.codegen.describe import describe
    from uuvsim_cosim.models.declaration.library import declare
    from uuvsim_cosim.models.declaration.parameter_files import is_vehicle, split_address
    from uuvsim_cosim.models.declaration.preset import presets_of

    model = declare(name)
    wanted: tuple[str, ...] = ("input", "output", "parameter")
    if is_vehicle(split_address(name)[0]):
        from uuvsim_cosim.commands.models.show_vehicle import show_vehicle

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
        key="variables",
    )  # fmt: skip
    presets = presets_of(model.name)
    if presets:
        line()
        table(("preset", "what it is"), [(f"{model.name}@{k}", v) for k, v in presets.items()],
              key="presets")  # fmt: skip


def _start(value: object) -> Shown | str:
    import numpy as np

    if value is None:
        return ""
    flat = np.asarray(value, dtype=float).ravel()
    text = " ".join(f"{x:.6g}" for x in flat[:6])
    return Shown(value, text + (" …" if flat.size > 6 else ""))


@app.command("check")
def check(
    name: Annotated[
        str | None,
        typer.Argument(
            autocompletion=models,
            help="A vehicle as id, id@set or its folder, or a component such as thruster_t200; "
            "with --real, a recording; by default all.",
        ),
    ] = None,
    source: Annotated[
        list[str] | None,
        typer.Option(
            help="Source to compare with: mss, fossen, prestero, gz_sim, …; may be repeated."
        ),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option("--against", "--reference", help="CSV of one trajectory to compare with."),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="With --against: largest permitted deviation.")
    ] = 1e-5,
    relative: Annotated[
        bool,
        typer.Option(
            "--relative", help="With --against: deviations relative to each column's largest value."
        ),
    ] = False,
    real: Annotated[
        bool, typer.Option("--real", help="Compare predictions with recordings of real vehicles.")
    ] = False,
    fetch: Annotated[
        Path | None,
        typer.Option(
            "--fetch", help="With --real: folder with clones of repositories that hold recordings."
        ),
    ] = None,
    page: Annotated[
        Path | None,
        typer.Option("--page", help="With --real: page whose tables and pictures are written."),
    ] = None,
) -> None:
    """Compare models with trajectories, published values and closed forms; list deviations."""
    from uuvsim_cosim.models.checks.comparison import known_groups

    if real:
        if source or against is not None or relative:
            raise InputInvalid(
                "--real and --source, --against or --relative: expected --real alone"
            )
        from uuvsim_cosim.commands.models.real import check_real

        check_real(name, fetch, page)
        return
    if fetch is not None or page is not None:
        raise InputInvalid("--fetch and --page: expected --real beside them")
    groups = known_groups(source or ())
    if against is None:
        _check_all(name, groups)
        return
    if groups:
        raise InputInvalid("--source and --against: expected one of them")
    if name is None:
        raise InputInvalid("--against needs a vehicle before it, such as bluerov2_heavy@wu_2018")
    if not tolerance >= 0:
        raise InputInvalid(f"--tolerance {tolerance:g}", "a number, 0 or more")
    if not against.is_file():
        raise InputInvalid(against, "no such file", "a CSV of a trajectory")
    _check_against(name, against, tolerance, relative)


def _check_against(name: str, path: Path, tolerance: float, relative: bool) -> None:
    from uuvsim_cosim.models.checks.reference_trajectory import deviations, read_reference

    reference = read_reference(path)
    found = deviations(name, reference)
    for note in reference.notes:
        line(note)
    table(
        ("column", "largest deviation", "of its greatest value", "at t [s]"),
        [
            (
                d.column,
                number(d.max, ".3g"),
                Shown(d.relative, f"{d.relative:.3g}" if d.relative < 1e3 else "-"),
                number(d.t, "g"),
            )
            for d in found
        ],
        key="deviations",
    )

    def off(d: Deviation) -> float:
        return float(min(d.max, d.relative) if relative else d.max)

    worst = max(found, key=off)
    measure = " of its largest value" if relative else ""
    if not off(worst) <= tolerance:
        raise InputInvalid(
            f"{name} against {path}",
            f"{worst.column} deviates by {off(worst):.3g}{measure} at t = {worst.t:g} s",
            f"at most {tolerance:g}",
        )
    line(f"{name} agrees with {path.name} within {tolerance:g}{' relative' if relative else ''}")


def _check_all(name: str | None, groups: set[str]) -> None:
    from uuvsim_cosim.models.checks.checks import checks_of, every_check, groups_of
    from uuvsim_cosim.models.checks.comparison import GROUPS

    done = list(every_check(groups) if name is None else checks_of(name, groups))
    if not done:
        there = ", ".join(groups_of(name or ""))
        raise InputInvalid(name, f"has no comparison with {', '.join(sorted(groups))}", there)
    table(
        ("source", "vehicle", "quantity", "difference", "tolerance", "verdict"),
        [
            (
                c.group,
                c.address or "-",
                c.what,
                number(c.off, ".2g"),
                number(c.tolerance, "g"),
                c.verdict,
            )
            for c in done
        ],
        key="checks",
    )
    for c in done:
        if c.verdict == "known":
            where = f"{c.address}: " if c.address else ""
            remark("known", f"{where}{c.what}: {c.known}")
    for group in sorted({c.group for c in done} & set(GROUPS)):
        line(f"{group}: {GROUPS[group]}")
    failed = [c for c in done if c.verdict == "FAILS"]
    if failed:
        raise InputInvalid(
            "; ".join(
                f"{c.address or c.group}: {c.what} deviates by {c.off:.3g}; expected at most "
                f"{c.tolerance:g} ({c.source})"
                for c in failed
            )
        )
    kept = sum(c.holds for c in done)
    rest = "; the other deviations have a known cause" if kept < len(done) else ""
    line(f"{kept} of {len(done)} comparisons hold{rest}")


@app.command("new")
def new(
    name: Annotated[
        str, typer.Argument(help="Id of the vehicle: lower-case letters, digits and _.")
    ],
    out: Annotated[Path, folder_option("Folder to write into.")] = Path(),
    shape: Annotated[
        str,
        typer.Option(
            autocompletion=of("box", "torpedo"), help="Shape of the hull: box or torpedo."
        ),
    ] = "box",
) -> None:
    """Write the folder of a new vehicle that can be simulated at once, and print how."""
    from uuvsim_cosim.models.importing.new_vehicle import write_vehicle

    folder = write_vehicle(name, out, shape)
    for path in sorted(folder.iterdir()):
        file_line(path, tilde(path))
    line()
    line(f"see it with    uuvsim models show {tilde(folder)}")
    line(f"check it with  uuvsim models check {tilde(folder)}")
    line(f"use it as      model:{tilde(folder)}")


app.command("import")(import_command)
app.command("picture")(picture_command)
app.command("mesh")(mesh_command)
app.command("speeds")(speeds_command)
