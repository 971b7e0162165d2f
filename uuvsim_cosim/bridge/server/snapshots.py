"""Snapshots by name: each client keeps a limited number, and none is lost without a message."""

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
    state: Any
    owner: str | None  # None: its client has left


@final
class Snapshots:
    """The snapshots of a current master, by name: s1, s2, … in the order in which they were taken.

    A client that keeps `EACH` discards one before it takes another. Snapshots of a client that has
    left stay; the oldest of them go once there are `ALL`.
    """

    def __init__(self) -> None:
        self._kept: dict[str, _Kept] = {}
        self._taken = 0
        self._replaced = 0  # those taken until then went with a replacement
        self._gone = 0  # of clients that have left

    def check(self, owner: str) -> None:
        """Refuse a client that keeps all that it may, before its snapshot is taken."""
        own = sum(kept.owner == owner for kept in self._kept.values())
        if own >= EACH:
            raise InputInvalid(
                f"snapshot: client {owner!r} keeps {own} snapshots; expected at most {EACH}: "
                "discard one first"
            )
        if len(self._kept) >= ALL:
            left = next((name for name, kept in self._kept.items() if kept.owner is None), None)
            if left is None:
                raise InputInvalid(
                    f"snapshot: all clients together keep {ALL} snapshots, the most that fit; "
                    "discard one first"
                )
            del self._kept[left]
            self._gone = max(self._gone, int(left[1:]))

    def add(self, state: Any, owner: str) -> str:
        """Keep a state; returns its name."""
        self._taken += 1
        name = f"s{self._taken}"
        self._kept[name] = _Kept(state, owner)
        return name

    def find(self, name: str) -> Any:
        """Return the state; raises InputInvalid with the reason if there is none."""
        if name in self._kept:
            return self._kept[name].state
        raise InputInvalid(
            f"no snapshot {name!r}{self._why(name)}; expected {expected_names(name, self._kept)}"
        )

    def discard(self, name: str) -> None:
        """Forget a snapshot; raises InputInvalid if there is none."""
        self.find(name)
        del self._kept[name]

    def left(self, owner: str) -> None:
        """Note that a client has left: another one of this name keeps its own."""
        for kept in self._kept.values():
            if kept.owner == owner:
                kept.owner = None

    def replaced(self) -> None:
        """Forget all: they are of components that are no longer there."""
        self._kept.clear()
        self._replaced = self._taken

    def _why(self, name: str) -> str:
        known = name[:1] == "s" and name[1:].isdecimal() and len(name) < 16
        number = int(name[1:]) if known else 0
        if not 0 < number <= self._taken:
            return ""
        if number <= self._replaced:
            return ", which was of the components before a replacement"
        if number <= self._gone:
            return f", which was discarded, or made room for one of {ALL} after its client left"
        return ", which was discarded"
