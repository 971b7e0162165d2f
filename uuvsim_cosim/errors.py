"""Errors of this package; the command line prints each as one message."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self, overload

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


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where, what was read, what would have been right; "" if unknown."""

    place: str
    read: str
    expected: str

    def __str__(self) -> str:
        """Return the sentence that a user reads."""
        expected = f"; expected {self.expected}" if self.expected else ""
        return f"{self.place}: {self.read}{expected}" if self.place else f"{self.read}{expected}"


class UuvsimError(Exception):
    """Base of all errors of this package; `exit_status` is what the command line returns.

    Its `parts` are (place, what was read, what was expected), the last two, or one whole sentence.
    `problems` holds them as data; `str` is the sentence.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> try:
    ...     uuv.load("bluerov2_hold").set("controller.T_ff", "3 m")
    ... except uuv.UuvsimError as error:
    ...     print(error.problems[0])
    controller.T_ff: a value in 'm'; expected one in 's' or a unit of its kind
    """

    exit_status = 2

    @overload
    def __init__(self, sentence: object, /) -> None: ...
    @overload
    def __init__(self, read: object, expected: object, /) -> None: ...
    @overload
    def __init__(self, place: object, read: object, expected: object, /) -> None: ...
    def __init__(self, *parts: object) -> None:
        if not 1 <= len(parts) <= 3:
            raise TypeError(f"{len(parts)} parts of an error; expected (place, read, expected)")
        super().__init__(*parts)
        *place, read, expected = parts if len(parts) > 1 else (*parts, "")
        where = str(place[0]) if place else ""
        self.problems: tuple[Problem, ...] = (Problem(where, str(read), str(expected)),)

    @classmethod
    def of(cls, problems: Iterable[Problem | str]) -> Self:
        """Make an error of several `problems`, or whole sentences, one a line.

        Example:

        >>> from uuvsim_cosim.errors import InputInvalid, Problem
        >>> wrong = Problem("survey.csv:3", "depth -2 m", "0 m or more")
        >>> print(InputInvalid.of([wrong, "survey.csv: no waypoints"]))
        survey.csv:3: depth -2 m; expected 0 m or more
          survey.csv: no waypoints
        """
        each = tuple(p if isinstance(p, Problem) else Problem("", p, "") for p in problems)
        error = cls("\n  ".join(map(str, each)))
        error.problems = each
        return error

    def __str__(self) -> str:
        """Return a sentence for each problem."""
        return "\n  ".join(str(p) for p in self.problems)

    def at(self, place: str, otherwise: str) -> Problem:
        """Return this error as a problem at a `place`; `otherwise` is expected if it has none.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> print(uuv.UuvsimError("3 values", "6").at("plan.csv:4", "numbers"))
        plan.csv:4: 3 values; expected 6
        """
        first, *more = self.problems
        read = f"{first.place}: {first.read}" if first.place else first.read
        right = first.expected or ("" if "expected " in read else otherwise)
        expected = "\n  ".join([right, *map(str, more)])
        return Problem(place, read, expected)


class SystemInvalid(UuvsimError):
    """A system that cannot exist; lists every problem, not only the first."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        super().__init__(problems)
        self.problems = tuple(problems)

    def __str__(self) -> str:
        """Return a sentence for each problem, and how many there are."""
        count = len(self.problems)
        return (f"{count} problems:\n  " if count != 1 else "") + super().__str__()


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
