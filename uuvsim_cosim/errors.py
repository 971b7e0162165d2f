"""Errors of this package; the command line prints each as one message."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = [
    "ComponentFailed",
    "FmuError",
    "InputInvalid",
    "LoopNotConverged",
    "Overrun",
    "ParameterInvalid",
    "Problem",
    "RecordingError",
    "SystemInvalid",
    "ToolchainError",
    "UuvsimError",
]


class UuvsimError(Exception):
    """Base of all errors of this package; `exit_status` is what the command line returns."""

    exit_status = 2


@dataclass(frozen=True)
class Problem:
    """One problem: its place, the value that was read, and what was expected."""

    place: str
    read: str
    expected: str

    def __str__(self) -> str:
        """Return the sentence that a user reads."""
        return f"{self.place}: {self.read}; expected {self.expected}"

    @classmethod
    def of(cls, message: str) -> Problem:
        """Read a sentence "place: what was read; expected what would be right".

        A part that the sentence does not have is empty; "--option value" is place and value.
        """
        head, _, expected = message.partition("expected ")
        head = head.rstrip(" ;,:")
        separator = " " if head.startswith("--") and ": " not in head else ": "
        place, found, read = head.partition(separator)
        return cls(place, read, expected) if found or expected else cls("", head, "")


class SystemInvalid(UuvsimError):
    """A system that cannot exist; lists every problem, not only the first."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        count = len(self.problems)
        head = "" if count == 1 else f"{count} problems:\n  "
        super().__init__(head + "\n  ".join(str(p) for p in self.problems))


class InputInvalid(UuvsimError):
    """A file, option or value given by the user that cannot be used."""


class ParameterInvalid(InputInvalid):
    """A parameter file or value with a wrong name, unit, shape or range."""


class FmuError(UuvsimError):
    """An FMU that cannot be read, or does not do what FMI asks of it."""


class ComponentFailed(UuvsimError):
    """A component that failed while it ran; names its path and the time.

    `asks_to_end`: it was the component's way to end the simulation, which FMI allows.
    """

    exit_status = 3
    recording: Path | None = None  # the folder of the run, if it recorded

    def __init__(self, path: str, time: float, reason: str, asks_to_end: bool = False) -> None:
        self.path = path
        self.time = time
        self.reason = reason
        self.asks_to_end = asks_to_end
        self.partial: object | None = None  # what was computed up to then, if anything
        super().__init__(f"component {path!r} failed at t = {time:.9g} s: {reason}")


class LoopNotConverged(UuvsimError):
    """An algebraic loop without a solution that could be found; names its hops."""

    exit_status = 3
    recording: Path | None = None  # the folder of the run, if it recorded


class Overrun(UuvsimError):
    """A step took longer than real time allows, and the run is set to fail then."""

    exit_status = 3


class ToolchainError(UuvsimError):
    """A C compiler that is missing, or cannot compile for the wanted platform."""


class RecordingError(UuvsimError):
    """A recording that cannot be written or read."""
