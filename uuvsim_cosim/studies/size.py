"""Limits of a study: one that would not fit into memory is refused before it begins."""

from __future__ import annotations

from collections.abc import Sequence

from uuvsim_cosim.errors import InputInvalid

__all__ = ["MOST_NUMBERS", "MOST_RUNS", "check_runs", "check_samples", "check_seeds"]

MOST_RUNS = 10_000_000
MOST_NUMBERS = 50_000_000  # that metrics read in one run
RUN_BYTES = 500  # of memory, that a run's outcome takes until the table is written


def check_runs(points: int, seeds: int) -> None:
    """Refuse more runs than MOST_RUNS; raises InputInvalid."""
    runs = points * seeds
    if runs > MOST_RUNS:
        raise InputInvalid(
            (
                f"{_count(points, 'grid point')} under {_count(seeds, 'seed')} are "
                f"{runs:,} runs, about {runs * RUN_BYTES / 1e9:,.0f} GB of memory, "
                f"and {runs / 3.6e6:,.0f} hours at 1000 runs a second"
            ),
            f"at most {MOST_RUNS:,} runs: fewer seeds, or a coarser grid",
        )


def check_samples(samples: int, width: int) -> None:
    """Refuse a run of more numbers than MOST_NUMBERS; raises InputInvalid."""
    numbers = samples * max(width, 1)
    if numbers > MOST_NUMBERS:
        raise InputInvalid(
            "duration, every",
            (
                f"{samples:,} samples of {_count(width, 'number')} in each run, "
                f"about {8 * numbers / 1e9:,.0f} GB of memory"
            ),
            f"at most {MOST_NUMBERS:,} numbers: a shorter duration, or a larger `every`",
        )


def check_seeds(given: int | Sequence[int]) -> tuple[int, ...]:
    """Return the seeds of a number of them or a list; raises InputInvalid for anything else."""
    if isinstance(given, int) and not isinstance(given, bool):
        if given < 1:
            raise InputInvalid("seeds", given, "at least 1, or a list of seeds")
        check_runs(1, given)
        return tuple(range(given))
    listed: tuple[int, ...] = ()
    if isinstance(given, Sequence) and not isinstance(given, str):
        check_runs(1, len(given))
        listed = tuple(given)
    whole = [s for s in listed if isinstance(s, int) and not isinstance(s, bool)]
    if not listed or len(whole) != len(listed) or len(set(listed)) != len(listed):
        raise InputInvalid("seeds", f"{given!r}", "a number of them, or distinct whole numbers")
    return listed


def _count(n: int, what: str) -> str:
    return f"{n:,} {what}{'' if n == 1 else 's'}"
