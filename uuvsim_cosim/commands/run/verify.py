"""`uuvsim verify`: one hash of a system's outputs from every way to run it, or what differs."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.cache import written
from uuvsim_cosim.commands.shared.completion import systems
from uuvsim_cosim.commands.shared.system_options import Values, changes_of, edited_system
from uuvsim_cosim.commands.shared.terminal import console, file_line, line, put, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["verify_command"]


def verify_command(
    context: typer.Context,
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="SYSTEM...",
            autocompletion=systems,
            help="Names of systems, .ssd or .ssp; or folders of runs.",
        ),
    ],
    steps: Annotated[int, typer.Option(help="Number of communication steps.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed from which random values are drawn.")] = 0,
    set_: Values = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Table of the hashes to write: .csv or .md.")
    ] = None,
) -> None:
    """Run a system as FMUs, natively, as a kernel and as WebAssembly, and compare all bits.

    It prints the hash of all outputs that all ways agree on, or the first output, time and pair
    that differ. The exit status is 0 if all agree, 1 if two differ. Of a run's folder, it prints
    the hash of the recorded outputs, which a page shows for the same run.
    """
    if out is not None and out.suffix.lower() not in (".csv", ".md"):
        raise InputInvalid(out, f"ending {out.suffix!r} was read", ".csv or .md")
    from uuvsim_cosim.kernels.verification.recorded import hash_of_run
    from uuvsim_cosim.kernels.verification.verify import verify
    from uuvsim_cosim.orchestrator.running.library import available

    changes = changes_of(set_)
    rows: list[tuple[object, ...]] = []
    results: list[dict[str, object]] = []
    equal = True
    for name in names:
        if name not in available() and Path(name).is_dir():
            for option in ("steps", "seed", "set_"):
                source = context.get_parameter_source(option)
                if source is not None and source.name == "COMMANDLINE":
                    raise InputInvalid(
                        f"--{option.strip('_')}", f"{name} is a run, which has its own",
                        "systems alone, or no such option",
                    )  # fmt: skip
            kept = hash_of_run(Path(name))
            line(f"{name}: {kept.steps:,} steps of {kept.tick:g} s, recorded: {kept.hash}")
            results.append({"run": name, **asdict(kept)})
            rows.append((name, kept.steps, "", kept.hash, "as recorded"))
            continue
        system = edited_system(name, None, changes)
        with console(stderr=True).status(f"verifying {system.name}") as status:
            found = verify(
                system, steps, seed=seed,
                progress=lambda way: status.update(f"{system.name}: {way}"),  # noqa: B023
            )  # fmt: skip
        line(
            f"{system.name}: {found.steps:,} steps of {found.tick:g} s, {found.outputs} elements "
            f"of outputs, seed {seed}"
        )
        table(
            ("way", "compiler", "hash", "time [s]"),
            [(o.way, o.compiler, o.hash, f"{o.seconds:.1f}") for o in found.outcomes],
        )
        for text in found.not_covered:
            line(f"not covered: {text}")
        for text in found.missing:
            line(f"not run: {text}")
        if found.difference is None:
            line(f"all {len(found.outcomes)} ways agree: {found.hash}")
        else:
            d = found.difference
            equal = False
            line(
                f"{d.output} differs first, at t = {d.time:.9g} s: {d.a!r} in {d.reference}, "
                f"{d.b!r} in {d.way}"
            )
        line()
        results.append({"system": system.name, "hash": found.hash, "seed": seed, **asdict(found)})
        covered = "all components" if not found.not_covered else "; ".join(found.not_covered)
        rows.append((system.name, found.steps, seed, found.hash or "they differ", covered))
    put("equal", equal)
    put("systems", results)
    if out is not None:
        header = ("system", "steps", "seed", "hash", "covered")
        file_line(written(out, _table_text([header, *rows], out.suffix.lower())))
    if not equal:
        raise typer.Exit(1)


def _table_text(rows: Sequence[Sequence[object]], ending: str) -> str:
    """Return rows, of which the first has the names, as CSV or Markdown."""
    if ending == ".md":
        head, *body = [f"| {' | '.join(map(str, row))} |\n" for row in rows]
        return "".join([head, "|" + "---|" * len(rows[0]) + "\n", *body])
    sheet = io.StringIO()
    csv.writer(sheet, lineterminator="\n").writerows(rows)
    return sheet.getvalue()
