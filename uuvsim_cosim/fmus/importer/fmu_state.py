"""Phases in the life of an FMU instance, and copies of its state."""

from __future__ import annotations

from enum import Enum

__all__ = ["FmuState", "Phase"]


class Phase(Enum):
    """Phase of an instance's life cycle; serialised states contain the value."""

    INSTANTIATED = 1
    INITIALIZATION = 2
    STEP = 3
    TERMINATED = 4
    FATAL = 5
    FREED = 6
    FAILED = 7  # after an error in a step: the instance may be reset, restored or freed


class FmuState:
    """A copy of an instance's state, owned by the FMU; freed after its last reference is gone."""

    def __init__(self, pointer: int, phase: Phase, orphans: list[int]) -> None:
        self.pointer = pointer
        self.phase = phase
        self._orphans = orphans

    def __del__(self) -> None:
        # The instance frees it in a later call: another thread may be stepping it now.
        self._orphans.append(self.pointer)
