"""Simulators of runs: a kernel, many at a time, or a master, one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Protocol, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ComponentFailed, LoopNotConverged, UuvsimError
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.metric import ReadMetric

if TYPE_CHECKING:
    from uuvsim_cosim.kernels import Batch

__all__ = ["KernelRuns", "MasterRuns", "Outcome", "Script", "Simulated"]

Array = NDArray[np.float64]
AT_ONCE = 256  # communication steps after which an interruption is noticed, at the latest


@dataclass(frozen=True)
class Script:
    """Run without its seed and start values; each `every`-th communication point is sampled."""

    system: System
    steps: int
    every: int
    metrics: tuple[ReadMetric, ...]

    @property
    def signals(self) -> tuple[str, ...]:
        """The names of the variables that metrics read."""
        return tuple(dict.fromkeys(s for m in self.metrics for s in m.root.signals()))

    @property
    def ticks(self) -> list[int]:
        """The communication points that are sampled; the last is the end."""
        return [*range(0, self.steps, self.every), self.steps]

    @property
    def time(self) -> Array:
        """Return their times [s], as the master labels them."""
        tick = Fraction(self.system.tick)
        return np.array([k * tick.numerator for k in self.ticks]) / float(tick.denominator)

    def pieces(self) -> Iterator[list[int]]:
        """Yield the communication steps up to each sampled point, in pieces of at most AT_ONCE."""
        reached = 0
        for tick in self.ticks:
            yield [min(tick - k, AT_ONCE) for k in range(reached, tick, AT_ONCE)]
            reached = tick

    def judged(self, courses: Mapping[str, Array]) -> list[float]:
        """Return the values of all metrics from the sampled signals of one run."""
        return [x for m in self.metrics for x in m.value(self.time, courses)]

    @property
    def n_numbers(self) -> int:
        """Return the number of all metrics' elements."""
        return sum(m.root.size for m in self.metrics)


@dataclass(frozen=True)
class Outcome:
    """Metrics of a run, or the message of its failure."""

    numbers: list[float]
    failure: str | None = None


Starts = Mapping[str, Array]  # start values of runs by variable, of shape (n, *shape)


class Simulated(Protocol):
    """A simulator of runs, which computes their metrics."""

    def runs(self, seeds: Sequence[int], start: Starts) -> list[Outcome]:
        """Simulate runs with these system seeds and start values, of shape (n, *shape)."""

    def close(self) -> None:
        """Free everything."""


@final
class MasterRuns:
    """One master; each run is a reset of it."""

    def __init__(self, script: Script) -> None:
        self.script = script
        self._plan = flatten(script.system)
        self._instantiate = prepare(self._plan, "native")
        self._master: Master | None = None
        # The longest first: a path may be the beginning of another one.
        self._paths = sorted((c.path for c in self._plan.components), key=len, reverse=True)
        self._variables = {c.path: c.description.variables for c in self._plan.components}

    def runs(self, seeds: Sequence[int], start: Starts) -> list[Outcome]:
        """Simulate one after the other."""
        return [self._run(int(s), {k: v[i] for k, v in start.items()}) for i, s in enumerate(seeds)]

    def close(self) -> None:
        """Free the master."""
        if self._master is not None:
            self._master.free()
            self._master = None

    def _run(self, seed: int, start: Starts) -> Outcome:
        script = self.script
        try:
            if self._master is None:
                self._master = Master(self._plan, self._instantiate, measured=False)
                self._master.initialize()
            master = self._master
            starts: dict[str, dict[str, object]] = {}
            for name, value in start.items():
                path, own = self._split(name)
                dtype = DTYPES[self._variables[path][own].type]
                array = np.asarray(value).astype(dtype)
                starts.setdefault(path, {})[own] = array if array.ndim else array.item()
            master.reset(seed, starts)
            points = [self._split(name) for name in script.signals]
            sampled: list[list[Array]] = [[] for _ in points]
            for pieces in script.pieces():
                for steps in pieces:
                    master.step(steps)
                for values, (path, own) in zip(sampled, points, strict=True):
                    values.append(np.array(master.get(path, own), dtype=float).reshape(-1))
        except (ComponentFailed, LoopNotConverged) as error:
            if any(c.description.kind != "native" for c in self._plan.components):
                # An FMU in error may refuse a reset; native components copy their whole state.
                self.close()
            return Outcome([np.nan] * script.n_numbers, str(error))
        courses = {n: np.array(v) for n, v in zip(script.signals, sampled, strict=True)}
        return Outcome(script.judged(courses))

    def _split(self, name: str) -> tuple[str, str]:
        path = next(p for p in self._paths if name.startswith(f"{p}."))
        return path, name[len(path) + 1 :]


@final
class KernelRuns:
    """A batch of a kernel; raises SystemInvalid for a system that cannot be fused."""

    def __init__(self, script: Script, n: int, threads: int) -> None:
        from uuvsim_cosim.kernels import fuse

        self.script = script
        self._n, self._threads = n, threads
        self._kernel = fuse(script.system)
        self._batch: Batch | None = None
        self._master: MasterRuns | None = None

    def runs(self, seeds: Sequence[int], start: Starts) -> list[Outcome]:
        """Simulate side by side; unused places of the batch repeat the last run."""
        n = len(seeds)
        if n > self._n:  # more runs than the batch has places: in pieces
            head, tail = {}, {}
            for k, v in start.items():
                head[k], tail[k] = v[: self._n], v[self._n :]
            return self.runs(seeds[: self._n], head) + self.runs(seeds[self._n :], tail)
        place = np.minimum(np.arange(self._n), n - 1)
        filled = {k: np.asarray(v)[place] for k, v in start.items()}
        words = [int(seeds[i]) % 2**64 for i in place]
        if self._batch is None:
            try:
                self._batch = self._kernel.batch(self._n, threads=self._threads)
            except ComponentFailed as error:
                raise UuvsimError(
                    f"{self.script.system.name}: fails with the given values, before any "
                    f"parameter is varied: {error}"
                ) from error
        batch = self._batch
        batch.reset(seeds=words, start=filled, check=False)
        script, signals = self.script, self.script.signals
        count = len(script.ticks)
        sampled = [np.empty((count, self._n, batch.variables[s].size)) for s in signals]
        for j, pieces in enumerate(script.pieces()):
            for steps in pieces:
                batch.step(steps, check=False)
            for values, name in zip(sampled, signals, strict=True):
                values[j] = batch.get(name).reshape(self._n, -1)
        failed, outcomes = batch.failed, []
        for i in range(n):
            if not failed[i]:
                courses = {s: v[:, i] for s, v in zip(signals, sampled, strict=True)}
                outcomes.append(Outcome(script.judged(courses)))
                continue
            # A master simulates it again, because its messages name the component and the time.
            if self._master is None:
                self._master = MasterRuns(script)
            (again,) = self._master.runs(
                seeds[i : i + 1], {k: v[i : i + 1] for k, v in start.items()}
            )
            if again.failure is None:
                again = Outcome([np.nan] * script.n_numbers, str(batch.failure(i)))
            outcomes.append(again)
        return outcomes

    def close(self) -> None:
        """End the threads."""
        if self._batch is not None:
            self._batch.close()
            self._batch = None
        if self._master is not None:
            self._master.close()
