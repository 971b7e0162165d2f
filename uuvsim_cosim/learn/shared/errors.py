"""Errors of learning: divergence, and a missing installation of torch."""

from __future__ import annotations

from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["LearningDiverged", "check_torch"]


class LearningDiverged(UuvsimError):
    """Loss or gradient that is not finite; learning stops, and the last valid state is kept.

    `algorithm` is the algorithm, `name` the quantity, `value` its value, and `kept` a message about
    the state that was kept.
    """

    exit_status = 3

    def __init__(self, algorithm: str, name: str, value: float, kept: str = "") -> None:
        self.algorithm, self.name, self.value = algorithm, name, value
        super().__init__(
            f"{algorithm}: {name} is {value}; expected a finite number: a smaller lr, or a "
            "smaller weight of the penalties in the reward (and a new start, --restart)"
            f"{kept and '; '}{kept}"
        )

    def saying(self, algorithm: str, kept: str) -> LearningDiverged:
        """Return the same error with the user's name of the algorithm and the kept state."""
        return LearningDiverged(algorithm, self.name, self.value, kept)


def check_torch() -> None:
    """Raise InputInvalid if torch is not installed."""
    try:
        import torch  # noqa: F401
    except ModuleNotFoundError as error:
        raise InputInvalid(
            f"{error}; learning expects torch: pip install 'uuvsim-cosim[rl]'"
        ) from None
