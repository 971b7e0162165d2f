"""The progress of a run on the terminal: building components once, then simulated time."""

from __future__ import annotations

from typing import final

from uuvsim_cosim.commands.shared.curriculum_progress import StageProgress

__all__ = ["RunProgress"]


@final
class RunProgress(StageProgress):
    """Components while "building", seconds while "simulating"."""

    def words(self, stage: str, done: float, total: float, passed: float) -> tuple[str, str]:
        """Count what is built; then simulated time, and how fast it passes."""
        if stage == "building":
            return f"building {total:.0f} components, once:", f"{done:.0f} of {total:.0f}"
        return "simulating", f"{done:.1f} of {total:g} s, {done / passed:.0f} times real time"
