"""`uuvsim compare`: the first signal of two recordings that differs, when, and by how much."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.terminal import line, put, table, tilde
from uuvsim_cosim.errors import InputInvalid

__all__ = ["compare_command"]

MOST = 20
RECORDING = "Folder that `uuvsim run` wrote, or a recording (.parquet, .mcap)."


def compare_command(
    a: Annotated[Path, typer.Argument(help=RECORDING)],
    b: Annotated[Path, typer.Argument(help=RECORDING)],
    tol: Annotated[
        float,
        typer.Option("--tol", help="Largest |A - B| that counts as equal, in the signal's unit."),
    ] = 0.0,
) -> None:
    """Compare two recordings and name the first signal that differs.

    The exit status is 0 if they are equal, 1 if they differ.
    """
    if not 0 <= tol < float("inf"):
        raise InputInvalid(f"--tol {tol:g}: expected a finite number, 0 or more")
    from uuvsim_cosim.orchestrator.recording.compare import compare_signals

    found = compare_signals(a, b, tol)
    put("equal", found.equal)
    put("tolerance", tol)
    put("rows", found.rows)
    put("signals", found.signals)
    put("mismatches", found.mismatches)
    put("first", vars(found.differences[0]) if found.differences else None)
    if found.differences:
        first = found.differences[0]
        line(
            f"{first.signal} differs first, at t = {first.time:.9g} s: "
            f"{_text(first.a)} in A, {_text(first.b)} in B"
            + (f", by {first.size:.6g} {first.unit}".rstrip() if first.size == first.size else "")
        )
    for text in found.mismatches:
        line(text)
    if found.differences:
        line()
        table(
            ("signal", "first at [s]", "A", "B", "by", "largest", "at [s]", "unit"),
            [
                (d.signal, f"{d.time:.9g}", _text(d.a), _text(d.b), f"{d.size:.6g}",
                 f"{d.largest:.6g}", f"{d.largest_time:.9g}", d.unit)
                for d in found.differences[:MOST]
            ],
            key="differences",
        )  # fmt: skip
        if len(found.differences) > MOST:
            line(f"and {len(found.differences) - MOST} more elements of signals; --json lists all")
    put("differences", [vars(d) for d in found.differences])  # all, and as numbers
    if not found.equal:
        raise typer.Exit(1)
    within = "exactly" if tol == 0 else f"within {tol:g}"
    line(f"{tilde(a)} and {tilde(b)} agree {within}: {found.signals} signals at {found.rows} times")


def _text(value: object) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)
