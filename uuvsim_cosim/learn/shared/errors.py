"""Errors of learning: divergence, and torch that is not installed."""

from __future__ import annotations

from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["LearningDiverged", "check_torch"]


class LearningDiverged(UuvsimError):
    """A loss or a gradient is NaN or infinite; learning stops, and the last good state is kept."""

    exit_status = 3

    def __init__(self, algorithm: str, name: str, value: float, kept: str = "") -> None:
        self.algorithm, self.name, self.value = algorithm, name, value
        super().__init__(
            f"{algorithm}: {name} is {value}; expected a finite number: a smaller lr, or a smaller "
            "weight of what the reward takes away (and to begin anew, --restart)"
            f"{kept and '; '}{kept}"
        )

    def saying(self, algorithm: str, kept: str) -> LearningDiverged:
        """Return the same error with the algorithm as the user named it, and what was kept."""
        return LearningDiverged(algorithm, self.name, self.value, kept)


def check_torch() -> None:
    """Raise InputInvalid where torch is not installed."""
    try:
        import torch  # noqa: F401
    except ModuleNotFoundError as error:
        raise InputInvalid(
            f"{error}; learning expects torch: pip install 'uuvsim-cosim[rl]'"
        ) from None
