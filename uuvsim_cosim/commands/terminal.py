"""What commands write to the terminal: tables and lines to stdout, progress to stderr."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from shutil import get_terminal_size

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from uuvsim_cosim.errors import InputInvalid

__all__ = ["console", "line", "range_of", "size_of", "table", "tilde", "written"]


def console(*, stderr: bool = False) -> Console:
    """Give a console; wide when its output goes into a file or a pipe, so that nothing wraps."""
    found = Console(stderr=stderr, highlight=False)
    if not found.is_terminal:
        return Console(stderr=stderr, highlight=False, width=160)
    if found.is_dumb_terminal:  # rich takes any of these to have 80 columns
        width, height = get_terminal_size()
        return Console(stderr=stderr, highlight=False, width=width, height=height)
    return found


def range_of(low: float | None, high: float | None) -> str:
    """Write what a value may be; nothing if it may be anything."""
    if low is None and high is None:
        return ""
    if high is None:
        return f">= {low:g}"
    return f"<= {high:g}" if low is None else f"{low:g} … {high:g}"


def line(text: str = "") -> None:
    """Write one line to stdout, as it is."""
    console().print(escape(text), soft_wrap=True)


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table to stdout; columns of numbers line up on the right."""
    shown = [[str(cell) for cell in row] for row in rows]
    grid = Table(box=None, show_header=any(head), header_style="dim", padding=(0, 2, 0, 0))
    for number, name in enumerate(head):
        numeric = bool(shown) and all(_numeric(row[number]) for row in shown)
        grid.add_column(escape(name), justify="right" if numeric else "left", overflow="fold")
    for row in shown:
        grid.add_row(*(escape(cell) for cell in row))
    target = console()
    with target.capture() as drawn:
        target.print(grid)
    for text in drawn.get().splitlines():
        target.out(text.rstrip(), highlight=False)


def _numeric(text: str) -> bool:
    return text[:1].isdigit() or text[:1] in "-+." or not text


def tilde(path: str | Path) -> str:
    """Give a path as a person would write it: from here if below, else with ~ for home."""
    path = Path(path).absolute()
    for base, prefix in ((Path.cwd(), ""), (Path.home(), "~/")):
        if path.is_relative_to(base) and base != Path("/"):
            return prefix + str(path.relative_to(base))
    return str(path)


def size_of(path: Path) -> str:
    """Give a file's or folder's size in words."""
    size = float(_bytes(path) if path.is_file() else _bytes_in(path))
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"


def _bytes_in(folder: Path) -> int:
    """Add up a folder's files; others may be made and deleted meanwhile."""
    total = 0
    for place, _, names in os.walk(folder, onerror=lambda error: None):
        total += sum(_bytes(Path(place) / name) for name in names)
    return total


def _bytes(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # gone since it was listed, as files of a cache go
        return 0


def written(path: Path, text: str) -> Path:
    """Write a text file, whole or not at all, and give its path; raises InputInvalid."""
    scratch = path.with_name(f".{path.name}.part")
    try:
        scratch.write_text(text, encoding="utf-8")
        scratch.replace(path)
    except OSError as error:
        scratch.unlink(missing_ok=True)
        raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None
    return path
