"""The progress of a study on the terminal: finished runs, and when the last will be."""

from __future__ import annotations

from typing import final

from uuvsim_cosim.commands.shared.curriculum_progress import StageProgress

__all__ = ["StudyProgress"]


@final
class StudyProgress(StageProgress):
    """Nothing to count while "building", then runs, or whatever is `counted`."""

    def __init__(self, counted: str = "runs") -> None:
        self._counted = counted
        super().__init__()

    def words(self, stage: str, done: float, total: float, passed: float) -> tuple[str, str]:
        """Count what is finished."""
        if stage == "building":
            return "building, once", ""
        return stage, f"{done:.0f} of {total:.0f} {self._counted}"
