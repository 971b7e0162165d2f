"""`uuvsim lint`: check YAML files, as an editor with their schemas does and beyond it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.terminal import line, put, tilde

__all__ = ["lint_command"]


def lint_command(
    files: Annotated[
        list[Path] | None,
        typer.Argument(help="YAML files, or folders with some; without one, this folder."),
    ] = None,
) -> None:
    """Check YAML files: every mistake is reported as FILE:LINE: message, with what is expected.

    Checked are keys, values, units and names, by the file's schema and by the code that reads it.
    The exit status is 2 if there is a mistake. Nothing is simulated.
    """
    from uuvsim_cosim.commands.editor.file_checks import Mistake, mistakes_in, yaml_files

    checked, skipped = 0, []
    problems: list[Mistake] = []
    for file, is_named in yaml_files(files or []).items():
        mistakes = mistakes_in(file, is_named)
        if mistakes is None:
            skipped.append(file)
            continue
        checked += 1
        problems += mistakes
    problems = list(dict.fromkeys(problems))  # files of a vehicle are read together
    put("problems", [{"file": str(f), "line": n, "message": m} for f, n, m in problems])
    put("checked", checked)
    put("skipped", [str(file) for file in skipped])
    if answer().mode != "json":
        for file, number, message in problems:
            line(f"{tilde(file)}:{number}: {message}")
        count = f"{len(problems) or 'no'} mistake{'s' * (len(problems) > 1)}"
        if checked or skipped:
            line(f"{checked} file{'s' * (checked != 1)} checked: {count}")
        else:
            line("this folder has no YAML files")
        if skipped:
            names = ", ".join(tilde(file) for file in skipped[:6])
            names += f" and {len(skipped) - 6} more" if len(skipped) > 6 else ""
            line(f"not checked, since no schema fits: {names}; a modeline names the schema")
    if problems:
        raise typer.Exit(2)
