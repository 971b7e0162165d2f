"""The protocol of a master, or of a recording that is replayed like one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Stepped"]


class Stepped(Protocol):
    """The part of `Master` that `CurrentMaster` uses."""

    @property
    def plan(self) -> Plan:
        """The plan."""

    @property
    def tick(self) -> int:
        """The communication point."""

    @property
    def time(self) -> float:
        """The time [s]."""

    def step(self, n: int = 1) -> None:
        """Make n communication steps."""

    def get(self, path: str, name: str) -> Any:
        """Read a value."""

    def set(self, path: str, name: str, value: object) -> None:
        """Set an unconnected input or a tunable parameter."""

    def fitted(self, path: str, name: str, value: object) -> Any:
        """Convert a value for `set`; raises InputInvalid if it cannot be set."""

    def reset(
        self, seed: int | None = None, start: Mapping[str, Mapping[str, object]] | None = None
    ) -> None:
        """Go back to the start."""

    def snapshot(self) -> object:
        """Copy the state."""

    def restore(self, snapshot: Any) -> None:
        """Go back to a copy."""

    def terminate(self) -> None:
        """End the simulation."""

    def free(self) -> None:
        """Free everything."""
