"""Phases in the life of an FMU instance, and copies of its state."""

from __future__ import annotations

from enum import Enum

__all__ = ["FmuState", "Phase"]


class Phase(Enum):
    """Where in its life an instance is; the values go into serialised states."""

    INSTANTIATED = 1
    INITIALIZATION = 2
    STEP = 3
    TERMINATED = 4
    FATAL = 5
    FREED = 6
    FAILED = 7  # by an error in a step: may be reset, restored or freed


class FmuState:
    """A copy of an instance's state, owned by the FMU; freed when nobody holds it any more."""

    def __init__(self, pointer: int, phase: Phase, orphans: list[int]) -> None:
        self.pointer = pointer
        self.phase = phase
        self._orphans = orphans

    def __del__(self) -> None:
        # Freed by the instance at its next call: this may run while another thread steps it.
        self._orphans.append(self.pointer)
