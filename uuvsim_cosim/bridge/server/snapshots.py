"""Snapshots by name; each client keeps a limited number, and a missing one is explained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["EACH", "Snapshots"]

EACH = 256  # snapshots that one client keeps
ALL = 1024  # that all clients keep together, those that have left included


@dataclass
class _Kept:
    state: Any  # of a `Master`, or the communication point of a recording
    owner: str | None  # None: its client has left


@final
class Snapshots:
    """The snapshots of the current master by name: s1, s2, … in the order of their creation.

    A client with `EACH` snapshots must discard one before it makes another. Snapshots of a client
    that has left are kept; the oldest of them are deleted once there are `ALL`.
    """

    def __init__(self) -> None:
        self._kept: dict[str, _Kept] = {}
        self._count = 0  # snapshots made so far
        self._replaced = 0  # the number of the last one that a replacement deleted
        self._gone = 0  # the number of the last one that was deleted after its client had left

    def check(self, owner: str) -> None:
        """Refuse a client that has reached its limit, before its snapshot is made."""
        own = sum(kept.owner == owner for kept in self._kept.values())
        if own >= EACH:
            raise InputInvalid(
                "snapshot",
                f"client {owner!r} keeps {own} snapshots",
                f"at most {EACH}: discard one first",
            )
        if len(self._kept) >= ALL:
            oldest = next((name for name, kept in self._kept.items() if kept.owner is None), None)
            if oldest is None:
                raise InputInvalid(
                    f"snapshot: all clients together keep {ALL} snapshots, the maximum; discard "
                    "one first"
                )
            del self._kept[oldest]
            self._gone = max(self._gone, int(oldest[1:]))

    def add(self, state: object, owner: str) -> str:
        """Keep a state; return its name."""
        self._count += 1
        name = f"s{self._count}"
        self._kept[name] = _Kept(state, owner)
        return name

    def find(self, name: str) -> Any:
        """Return the state; raises InputInvalid with the reason if there is none."""
        if name in self._kept:
            return self._kept[name].state
        raise InputInvalid(
            f"no snapshot {name!r}{self._cause(name)}", expected_names(name, self._kept)
        )

    def discard(self, name: str) -> None:
        """Delete a snapshot; raises InputInvalid if there is none."""
        self.find(name)
        del self._kept[name]

    def client_left(self, owner: str) -> None:
        """Note that a client has left, so that another client of this name has its own limit."""
        for kept in self._kept.values():
            if kept.owner == owner:
                kept.owner = None

    def replaced(self) -> None:
        """Delete all: they are of components that do not exist any more."""
        self._kept.clear()
        self._replaced = self._count

    def _cause(self, name: str) -> str:
        """Return why a snapshot does not exist any more; empty if it never existed."""
        known = name[:1] == "s" and name[1:].isdecimal() and len(name) < 16
        number = int(name[1:]) if known else 0
        if not 0 < number <= self._count:
            return ""
        if number <= self._replaced:
            return ", which was taken before a component was replaced"
        if number <= self._gone:
            return f", which was discarded, or deleted to keep at most {ALL} after its client left"
        return ", which was discarded"
