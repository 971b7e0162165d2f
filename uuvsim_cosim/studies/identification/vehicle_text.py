"""Edits of a vehicle's files that keep their comments: new sets, and sources of values."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.ambiguity import WEAK
from uuvsim_cosim.studies.identification.identify import Identified, Number

if TYPE_CHECKING:
    from ruamel.yaml.comments import CommentedMap

__all__ = ["inserted", "is_known", "replaced", "words_of"]


def is_known(number: Number) -> bool:
    """Return whether a number's 95 % interval is within half of it."""
    return bool(number.half_width < 2.0 * WEAK * abs(number.value))


def words_of(found: Identified, number: Number, day: str) -> str:
    """Return the source of a fitted number: the recording, the day, the interval."""
    return (
        f"identified from {found.recording} on {day}, 95 % interval {number.low:.6g} to "
        f"{number.high:.6g}"
    )


def inserted(text: str, data: CommentedMap, block: str) -> str:
    """Insert a set (indented by two) after the last one, or add `sets` at the file's end."""
    lines = text.splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    if "sets" not in data:
        return "".join([*lines, "sets:\n", block])
    keys = sorted(data.lc.key(k)[0] for k in data)
    sets_at = data.lc.key("sets")[0]
    end = next((k for k in keys if k > sets_at), len(lines))
    indent = data["sets"].lc.key(next(iter(data["sets"])))[1]
    if indent != 2:
        block = "".join(" " * (indent - 2) + row for row in block.splitlines(keepends=True))
    return "".join([*lines[:end], block, *lines[end:]])


def replaced(file: Path, text: str, read: Callable[[str], object]) -> None:
    """Write a parameter file if `read` accepts it; otherwise the old file stays."""
    try:
        with whole_file(file) as scratch:
            scratch.write_text(text, encoding="utf-8")
            read(str(scratch))
    except OSError as error:
        raise InputInvalid(
            file,
            f"cannot be written ({error.strerror})",
            "a folder of your own, as --save-as my_rov@my_fit",
        ) from None
