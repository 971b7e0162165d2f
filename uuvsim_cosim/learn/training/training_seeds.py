"""Which seeds are whose: those trained on, those that choose the best, those that judge it."""

from __future__ import annotations

__all__ = ["EVALUATION_SEED", "JUDGING_SEED", "MOST_ENVS", "first_of_training"]

EVALUATION_SEED = 1_000_000  # the first of those evaluated on in a training
JUDGING_SEED = 2_000_000  # the first of those that a finished policy is judged on
MOST_ENVS = 65_536  # of a training
TRAINED = 2**32  # the first of those trained on


def first_of_training(seed: int) -> int:
    """Return the seed of environment 0 of the training `seed`; environment i has that + i.

    No two trainings share one, nor do they with evaluations and judgements.
    """
    return TRAINED + MOST_ENVS * seed
