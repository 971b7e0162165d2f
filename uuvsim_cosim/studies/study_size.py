"""How large a study may be: what would fill a machine's memory is refused before it begins."""

from __future__ import annotations

from uuvsim_cosim.errors import InputInvalid

__all__ = ["MOST_NUMBERS", "MOST_RUNS", "check_runs", "check_samples"]

MOST_RUNS = 10_000_000
MOST_NUMBERS = 50_000_000  # that metrics read in one run
RUN_BYTES = 500  # of memory, that a run's outcome takes until the table is written


def check_runs(points: int, seeds: int) -> None:
    """Refuse more runs than MOST_RUNS; raises InputInvalid."""
    runs = points * seeds
    if runs > MOST_RUNS:
        raise InputInvalid(
            f"{_count(points, 'grid point')} under {_count(seeds, 'seed')} are {runs:,} runs, "
            f"about {runs * RUN_BYTES / 1e9:,.0f} GB of memory, and {runs / 3.6e6:,.0f} hours at "
            f"1000 runs a second; expected at most {MOST_RUNS:,} runs: fewer seeds, or a coarser "
            "grid"
        )


def check_samples(samples: int, width: int) -> None:
    """Refuse a run of more numbers than MOST_NUMBERS; raises InputInvalid."""
    numbers = samples * max(width, 1)
    if numbers > MOST_NUMBERS:
        raise InputInvalid(
            f"duration, every: {samples:,} samples of {_count(width, 'number')} in each run, about "
            f"{8 * numbers / 1e9:,.0f} GB of memory; expected at most {MOST_NUMBERS:,} numbers: a "
            "shorter duration, or a larger `every`"
        )


def _count(n: int, what: str) -> str:
    return f"{n:,} {what}{'' if n == 1 else 's'}"
