"""Events of a run: which component had one, when, and why; and their file."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

__all__ = ["Event", "event_counts", "write_events"]


@dataclass(frozen=True)
class Event:
    """Event of a component, at communication point `tick` plus `offset` [s]; `time` is the sum [s].

    `cause` is "reported" by the component, "input" if a discrete input changed at the
    communication point, or "clock NAME" if a clock of the component ticked.
    """

    component: str
    tick: int
    offset: float
    time: float
    cause: str


def write_events(path: Path, events: Sequence[Event]) -> None:
    """Write a table of events as CSV; raises OSError."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([f.name for f in fields(Event)])
        writer.writerows(astuple(e) for e in events)


def event_counts(events: Iterable[Event]) -> dict[str, int]:
    """Return the number of events of each component that has one."""
    return dict(Counter(e.component for e in events))
