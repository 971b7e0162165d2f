"""Output of commands: tables, lines and files to stdout, progress to stderr.

With `--json` the same becomes fields of one object, with `--quiet` nothing is written (`answer`).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from shlex import quote
from shutil import get_terminal_size
from typing import Literal

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from uuvsim_cosim.commands.shared.answer import Shown, answer

__all__ = [
    "Shown",
    "console",
    "file_line",
    "file_table",
    "for_shell",
    "line",
    "notice",
    "number",
    "put",
    "range_of",
    "remark",
    "size_of",
    "table",
    "tilde",
]

_REMARKS = {"assumed": "assumed", "warning": "warnings", "note": "notes", "known": "known"}


def console(*, stderr: bool = False) -> Console:
    """Return a console; wide when its output goes into a file or a pipe, so that nothing wraps.

    A notebook's kernel runs commands in a terminal of 80 columns and asks for colours.
    """
    if answer().mode == "quiet":
        return Console(stderr=stderr, quiet=True)
    if "JPY_PARENT_PID" in os.environ:  # `!uuvsim …` in a notebook, which cannot redraw a bar
        return Console(stderr=stderr, highlight=False, force_terminal=False, width=88)
    found = Console(stderr=stderr, highlight=False)
    if not found.is_terminal:
        return Console(stderr=stderr, highlight=False, width=160)
    if found.is_dumb_terminal:  # rich takes any of these to have 80 columns
        width, height = get_terminal_size()
        return Console(stderr=stderr, highlight=False, width=width, height=height)
    return found


def range_of(low: float | None, high: float | None) -> str:
    """Return the range of a value as text; empty without limits."""
    if low is None and high is None:
        return ""
    if high is None:
        return f">= {low:g}"
    return f"<= {high:g}" if low is None else f"{low:g} … {high:g}"


def line(text: str = "") -> None:
    """Write one line to stdout, as it is; in JSON, an item of `text`."""
    if answer().mode == "json":
        if text:
            answer().add("text", text.strip())
        return
    console().print(escape(text), soft_wrap=True)


def put(key: str, value: object) -> None:
    """Set a field of the JSON object that the text does not show, or shows differently."""
    answer().put(key, value)


def remark(kind: Literal["assumed", "warning", "note", "known"], text: str) -> None:
    """Write a remark as "kind: text"; a warning is written in a quiet command as well."""
    if answer().mode == "json":
        answer().add(_REMARKS[kind], text)
    elif answer().mode == "quiet":
        if kind == "warning":
            sys.stderr.write(f"uuvsim: warning: {text}\n")
    else:
        line(f"{kind}: {text}")


def notice(text: str) -> None:
    """Write one line to stderr, in every mode; in JSON, an item of `messages` as well."""
    answer().add("messages", text)
    sys.stderr.write(f"uuvsim: {text}\n")


def file_line(path: Path, text: str | None = None) -> None:
    """Write the name and size of a file that a command has made, or `text` instead."""
    if answer().mode == "json":
        answer().add("written", _as_file(path))
    else:
        line(f"{tilde(path)}  {size_of(path)}" if text is None else text)


def file_table(paths: Iterable[Path], **more: object) -> None:
    """Write the names and sizes of the files that a command has made, as a table.

    `more` are columns that hold the same in each row.
    """
    if answer().mode == "json":
        answer().add("written", *(_as_file(path) | more for path in paths))
    else:
        rows = [(tilde(path), size_of(path), *more.values()) for path in paths]
        table(("written", "size", *more), rows)


def number(value: float, form: str) -> Shown:
    """Return a number that people read in a format, and programs as it is."""
    return Shown(value, f"{value:{form}}")


def table(head: Sequence[str], rows: Iterable[Sequence[object]], *, key: str = "table") -> None:
    """Write a table to stdout; columns of numbers line up on the right. In JSON, field `key`."""
    if answer().mode == "json":
        answer().add_table(key, head, list(rows))
        return
    shown = [[str(cell) for cell in row] for row in rows]
    grid = Table(box=None, show_header=any(head), header_style="dim", padding=(0, 2, 0, 0))
    for number, name in enumerate(head):
        cells = [row[number] for row in shown]
        numeric = bool(shown) and all(c[:1].isdigit() or c[:1] in "-+." for c in cells)
        grid.add_column(escape(name), justify="right" if numeric else "left", overflow="fold")
    for row in shown:
        grid.add_row(*(escape(cell) for cell in row))
    target = console()
    with target.capture() as drawn:
        target.print(grid)
    target.out("\n".join(text.rstrip() for text in drawn.get().splitlines()), highlight=False)


def tilde(path: str | Path) -> str:
    """Return a path as a person would write it: from here if below, else with ~ for home."""
    from uuvsim_cosim.cache import home

    path = Path(path).absolute()
    for base, prefix in ((Path.cwd(), ""), (home(), "~/")):
        if base is not None and path.is_relative_to(base) and base != Path("/"):
            return prefix + str(path.relative_to(base))
    return str(path)


def for_shell(path: str | Path) -> str:
    """Return a path as `tilde` does, quoted where a shell needs it; ~ stays outside the quotes."""
    text = tilde(path)
    return f"~/{quote(text[2:])}" if text.startswith("~/") else quote(text)


def size_of(path: Path) -> str:
    """Return a file's or folder's size in words."""
    size = float(_bytes_of(path))
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"


def _as_file(path: Path) -> dict[str, object]:
    return {"file": str(path.absolute()), "bytes": _bytes_of(path)}


def _bytes_of(path: Path) -> int:
    """Return the size of a file, or of all files in a folder."""
    if path.is_file():
        return _bytes(path)
    total = 0
    # Other processes may create and delete files in the folder meanwhile.
    for place, _, names in os.walk(path, onerror=lambda error: None):
        total += sum(_bytes(Path(place) / name) for name in names)
    return total


def _bytes(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # deleted since it was listed, as files of a cache may be
        return 0
