"""Which seeds are whose: those trained on, those that choose the best, those that judge it."""

from __future__ import annotations

__all__ = ["EVALUATION_SEED", "JUDGING_SEED"]

EVALUATION_SEED = 1_000_000  # the first of those evaluated on in a training; it is trained below
JUDGING_SEED = 2_000_000  # the first of those that a finished policy is judged on
