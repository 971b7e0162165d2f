"""The answer of a command: text for people, one JSON object (`--json`), or nothing (`--quiet`).

`answering` opens the answer of one command. In JSON, every line and table of `terminal` becomes a
field of the object, and standard output holds the object only. Other output there, also that of
compiled FMUs and child processes, is redirected to standard error.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Literal, TextIO

from uuvsim_cosim.errors import ComponentFailed, Problem, UuvsimError
from uuvsim_cosim.strict_json import Shown, strict

__all__ = ["Answer", "Mode", "Shown", "answer", "answering", "error_fields", "mode_of"]

Mode = Literal["text", "json", "quiet"]


@dataclass
class Answer:
    """Report of one command; `fields` are those of the JSON object."""

    mode: Mode = "text"
    fields: dict[str, Any] = field(default_factory=dict)
    _out: TextIO | None = None
    _written: bool = False

    def put(self, key: str, value: object) -> None:
        """Set a field of the JSON object; it does not appear in text and quiet answers."""
        self.fields[key] = value

    def add(self, key: str, *values: object) -> None:
        """Append to a list in the JSON object."""
        self.fields.setdefault(key, []).extend(values)

    def add_table(self, key: str, head: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """Add a table: objects by column, or one object if it has two columns without names."""
        cells = [[c.value if isinstance(c, Shown) else c for c in row] for row in rows]
        if len(head) == 2 and not head[1]:
            self.put(key, self.fields.get(key, {}) | {_key(str(k)): v for k, v in cells})
            return
        names = [_key(name) or f"column_{n}" for n, name in enumerate(head, start=1)]
        self.add(key, *(dict(zip(names, row, strict=True)) for row in cells))

    def write_early(self) -> None:
        """Write the JSON object of a command that runs until Ctrl-C; its status is null."""
        self.put("status", None)
        self.write()

    def write(self) -> None:
        """Write the JSON object, once; nothing in the other modes."""
        if self.mode != "json" or self._written:
            return
        self._written = True
        import json

        found, replaced = strict(self.fields)
        if replaced:
            found["not_finite"] = replaced
        out = self._out or sys.stdout
        out.write(json.dumps(found, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
        out.flush()


_current = Answer()


def answer() -> Answer:
    """Return the answer of the command that is running."""
    return _current


def mode_of(arguments: Sequence[str]) -> Mode:
    """Return the mode of a command line; `--json` overrides `--quiet`."""
    given = list(arguments)
    options = given[: given.index("--")] if "--" in given else given
    return "json" if "--json" in options else "quiet" if "--quiet" in options else "text"


@contextmanager
def answering(mode: Mode) -> Iterator[Answer]:
    """Open the answer of one command; in JSON, standard output is reserved for the object."""
    global _current  # noqa: PLW0603 (one command a process; tests call one after the other)
    before, _current = _current, Answer(mode)
    try:
        if mode != "json":
            yield _current
            return
        with _kept_output() as _current._out:
            yield _current
            _current.write()
    finally:
        _current = before


@contextmanager
def _kept_output() -> Iterator[TextIO]:
    """Yield standard output, while all other output to it is redirected to standard error."""
    out = sys.stdout
    try:
        is_first = out.fileno() == 1 and sys.stderr.fileno() == 2
    except (OSError, ValueError):  # replaced by an object without a file
        is_first = False
    sys.stdout = sys.stderr
    if not is_first:
        try:
            yield out
        finally:
            sys.stdout = out
        return
    out.flush()  # earlier output still belongs to standard output
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with open(os.dup(kept), "w", encoding="utf-8") as own:
            yield own
    finally:
        import ctypes

        # Compiled code buffers what it prints into a pipe until the process ends: flush it now.
        with suppress(OSError, AttributeError, TypeError):  # Windows: each binary has its own
            ctypes.CDLL(None).fflush(None)
        os.dup2(kept, 1)
        os.close(kept)
        sys.stdout = out


def error_fields(error: BaseException | None, message: str, status: int) -> dict[str, object]:
    """Return the field `error` of a command that did not succeed."""
    kind = type(error).__name__ if error is not None else "Refused"
    if isinstance(error, ComponentFailed):
        place = {"component": error.path, "time": error.time}
        return {"type": kind, "status": status, "message": message, **place, "reason": error.reason}
    problems = error.problems if isinstance(error, UuvsimError) else ()
    if not problems or not all(p.place and p.expected for p in problems):
        problems = (_read_sentence(message),)
    found = [{"place": p.place, "value": p.read, "expected": p.expected} for p in problems]
    return {"type": kind, "status": status, "message": message, **found[0], "problems": found}


def _read_sentence(message: str) -> Problem:
    """Read a sentence that has no data beside it: "place: value; expected what is right".

    A part that the sentence does not have is empty; "--option value" is place and value.
    """
    head, _, expected = message.partition("expected ")
    head = head.rstrip(" ;,:")
    separator = " " if head.startswith("--") and ": " not in head else ": "
    place, found, read = head.partition(separator)
    return Problem(place, read, expected) if found or expected else Problem("", head, "")


def _key(name: str) -> str:
    return re.sub(r"[^0-9a-z]+", "_", name.lower()).strip("_")
