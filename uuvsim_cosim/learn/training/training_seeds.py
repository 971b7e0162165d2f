"""Separate ranges of seeds: for training, for evaluation during training, for final judgement."""

from __future__ import annotations

__all__ = ["EVALUATION_SEED", "JUDGING_SEED", "MOST_ENVS", "first_of_training"]

EVALUATION_SEED = 1_000_000  # the first seed of the evaluations of a training
JUDGING_SEED = 2_000_000  # the first seed on which a finished policy is judged
MOST_ENVS = 65_536  # of a training
TRAINED = 2**32  # the first seed of trainings


def first_of_training(seed: int) -> int:
    """Return the seed s of environment 0 of the training with `seed`; environment i has s + i.

    Trainings with different seeds share no environment's seed, and use no seed of an evaluation or
    a judgement.
    """
    return TRAINED + MOST_ENVS * seed
