"""Table of the runs of a study: grid points times seeds, each with all of its start values.

A study that does not fit into memory is refused before it begins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.randomisation.distributions import Choice
from uuvsim_cosim.envs.randomisation.mass import hulls_of
from uuvsim_cosim.envs.randomisation.net_weight import net_weight_of_runs
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation, Vary
from uuvsim_cosim.envs.randomisation.targets import Places, Quantity, resolved
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.errors import InputInvalid, Problem, SystemInvalid

__all__ = ["MOST_NUMBERS", "MOST_RUNS", "Runs", "check_runs", "check_samples", "check_seeds"]

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


Array = NDArray[np.float64]


@final
class Runs:
    """Run r is grid point r // len(seeds) under seed r % len(seeds).

    A seed draws the same parameters at every grid point, and is the system's seed of its run, so
    that grid points are compared under the same random numbers. Raises SystemInvalid, also from
    `start` for a mass that the actuators do not carry, and InputInvalid for a grid point without a
    possible body.
    """

    def __init__(
        self, drawn: Randomisation, grid: Sequence[Vary], seeds: Sequence[int], places: Places
    ) -> None:
        self.drawn, self.seeds, self.places = drawn, tuple(seeds), places
        self.sinking: tuple[str, ...] = ()  # hulls that their actuators do not carry
        self.grid: list[Quantity] = []
        problems: list[Problem] = []
        for axis in grid:
            found, wrong = resolved(places, [axis])
            self.grid += found
            problems += wrong
            if len(found) > 1:
                problems.append(
                    Problem(axis.name, f"a grid over {len(found)} numbers at once",
                            "one element, values that are vectors, or together: true")
                )  # fmt: skip
        problems += resolved(places, [*grid, *drawn.parameters])[1]
        if problems:
            raise SystemInvalid(list(dict.fromkeys(problems)))
        choices = [q.targets[0].distribution for q in self.grid]
        counts = [len(choice.values) for choice in choices if isinstance(choice, Choice)]
        check_runs(math.prod(counts), len(self.seeds))
        self.points = list(product(*(range(n) for n in counts)))
        self._axis_u = [(np.arange(n) + 0.5) / n for n in counts]

    @property
    def n(self) -> int:
        """The number of runs."""
        return len(self.points) * len(self.seeds)

    def point(self, run: int) -> int:
        """Return the grid point of a run."""
        return run // len(self.seeds)

    def seed(self, run: int) -> int:
        """Return the seed of a run."""
        return self.seeds[run % len(self.seeds)]

    @cached_property
    def start(self) -> Mapping[str, Array]:
        """All start values by variable, of shape (runs, *shape)."""
        zeros = np.zeros(len(self.seeds), np.uint64)
        words = [seed % 2**64 for seed in self.seeds]
        once = self.drawn.draw(Draws(words, zeros)) if self.drawn.parameters else {}
        start = {k: np.tile(v, (len(self.points), *([1] * (v.ndim - 1)))) for k, v in once.items()}
        for k, q in enumerate(self.grid):
            u = np.repeat([self._axis_u[k][p[k]] for p in self.points], len(self.seeds))
            for name, values in self.places.assembled([q], {q.label: u}).items():
                whole = start.setdefault(name, values).reshape(self.n, -1)
                fresh = values.reshape(self.n, -1)
                for t in (t for t in q.targets if t.name == name):
                    whole[:, t.element] = fresh[:, t.element]
        for hull in hulls_of(self.places, start):
            wrong = np.flatnonzero(~hull.right(start, self.n))
            if len(wrong):
                at = int(wrong[0])
                columns = self.columns(start)
                example = ", ".join(f"{k} = {float(c[at]):g}" for k, c in columns.items())
                raise InputInvalid(
                    hull.path,
                    f"{len(wrong)} of {self.n} runs have no possible body (M not positive "
                    f"definite, or inertia against its triangle rule), the first with {example}",
                    "masses and inertia that agree with each other",
                )
        self.sinking = net_weight_of_runs(self.places, start, self.n)
        return start

    def columns(self, start: Mapping[str, Array] | None = None) -> dict[str, Array]:
        """Return the parameters of the runs by column: the grid first, then those drawn."""
        start = self.start if start is None else start
        found: dict[str, Array] = {}
        for _, name, element, column in self._places():
            found[column] = start[name].reshape(self.n, -1)[:, element]
        return found

    def _places(self) -> list[tuple[Quantity, str, int, str]]:
        found: list[tuple[Quantity, str, int, str]] = []
        for q in [*self.grid, *(self.drawn.quantities if self.drawn.parameters else ())]:
            first, *others = q.targets
            if all(
                (t.distribution, t.factor, t.offset)
                == (first.distribution, first.factor, first.offset)
                for t in others
            ):
                found.append((q, first.name, first.element, q.label))
                continue
            for t in q.targets:
                shape = self.places.variables[t.name].shape
                index = [str(int(i) + 1) for i in np.unravel_index(t.element, shape)]
                text = f"{t.name}[{','.join(index)}]" if shape else t.name
                found.append((q, t.name, t.element, text))
        return found

    def about(self) -> list[dict[str, str]]:
        """Describe each column: its unit, and whether it is a grid's axis or drawn."""
        axes = {id(q) for q in self.grid}
        return [
            {
                "name": column,
                "unit": self.places.variables[name].unit_of_element(element) or "1",
                "kind": "grid" if id(q) in axes else "drawn",
            }
            for q, name, element, column in self._places()
        ]
