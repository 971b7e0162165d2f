"""Report of a run with a variable communication step."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["VariableStepReport"]


@dataclass(frozen=True)
class VariableStepReport:
    """Steps of variable length: made, made again, and their lengths [s].

    `unsatisfied` steps had an estimate above 1 and were accepted, because they had the smallest
    length. `shortest` does not count steps that were cut short by what was due.
    `largest_estimate` is that of accepted steps, at the end of the step [s].
    """

    steps: int
    rejected: int
    unsatisfied: int
    shortest: float
    longest: float
    largest_estimate: float
    time_of_largest: float

    def remarks(self) -> tuple[str, ...]:
        """Return the warning of a run whose steps could not be as short as the estimate asks."""
        if not self.unsatisfied:
            return ()
        return (
            f"variable step: {self.unsatisfied} of {self.steps} steps have an error above the "
            "tolerance, because no shorter step is allowed; the largest is "
            f"{self.largest_estimate:.3g} times the tolerance at t = {self.time_of_largest:.6g} s; "
            "expected a smaller smallest=, larger tolerances, or an iterated group",
        )
