"""What the current master steps: a master, or a recording that is replayed as if it were one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Stepped"]


class Stepped(Protocol):
    """The part of `Master` that `CurrentMaster` uses."""

    @property
    def plan(self) -> Plan:
        """Return what is stepped."""

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

    def set(self, path: str, name: str, value: Any) -> None:
        """Set an unconnected input or a tunable parameter."""

    def fitted(self, path: str, name: str, value: Any) -> Any:
        """Return a value as `set` takes it; raises InputInvalid if it cannot be set."""

    def reset(self, seed: int | None = None, start: Mapping[str, Any] | None = None) -> None:
        """Go back to the start."""

    def snapshot(self) -> Any:
        """Copy the state."""

    def restore(self, snapshot: Any) -> None:
        """Go back to a copy."""

    def terminate(self) -> None:
        """End in good order."""

    def free(self) -> None:
        """Free everything."""
