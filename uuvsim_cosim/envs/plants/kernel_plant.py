"""Plant of a fused kernel: all environments in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.plants.plant import Seeds
from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.kernels import Kernel
from uuvsim_cosim.kernels.batch.exchange import Exchange

__all__ = ["KernelPlant"]

Array = NDArray[np.float64]


@final
class KernelPlant:
    """The `Plant` protocol over a batch of environments.

    `reads` names the variables of `gather`, `acts` the inputs (and their elements, flat, from 0)
    of `scatter`.
    """

    def __init__(
        self,
        kernel: Kernel,
        n: int,
        *,
        reads: Sequence[str],
        acts: Sequence[tuple[str, int]],
        threads: int = 1,
    ) -> None:
        self.n = n
        self.tick = kernel.fused.plan.tick
        acted = [name for name, _ in acts]
        self._batch = kernel.batch(n, threads=threads, reads=[*reads, *acted])
        self.variables = self._batch.variables
        # The declared start values of all variables that `start` has named: a later reset without
        # them must set them back.
        self._given: dict[str, Array] = {}
        self._kernel = kernel
        self._width = kernel.lanes
        self._outputs = Exchange(kernel, n, [self._batch.view(name) for name in reads])
        inputs = [self._batch.view(name)[:, i : i + 1] for name, i in acts]
        self._inputs = Exchange(kernel, n, inputs)
        self._any_failed = True  # or it is not known
        self._one: Array | None = None  # the cells of the only block
        if n <= self._width:
            self._one = self._batch.free_cells[0]
            self._out = np.array([c for name in reads for c in self._places(name)], np.intp)
            self._in = np.array([self._places(name)[i] for name, i in acts], np.intp)

    def gather(self) -> Array:
        """Copy the variables that are read, of shape (size, n)."""
        if self._one is not None:
            rows = self._one.take(self._out, axis=0)
            return np.asarray(rows[:, : self.n], np.float64)
        return self._outputs.read()

    def scatter(self, values: Array) -> None:
        """Set the inputs that are acted on, of shape (width, n)."""
        if self._one is not None:
            self._one[self._in, : self.n] = values
            return
        self._inputs.write(values)

    def step(self, ticks: int) -> None:
        """Make communication steps in all copies."""
        self._any_failed = self._batch.advance(ticks)  # failures do not raise

    def reset(
        self, mask: NDArray[np.bool_], seeds: Seeds, start: Mapping[str, NDArray[np.generic]]
    ) -> None:
        """Go back to time 0 where the mask is true."""
        fused = self._kernel.fused
        for name in start:
            if name not in self._given:
                path, _, own = name.rpartition(".")
                v = self.variables.get(name)
                if v is None:
                    self._given[name] = np.zeros(0)  # the batch refuses the name
                    continue
                planned = fused.plan.components[fused.index[path]]
                value = np.asarray(planned.start.get(own, v.start), float).reshape(v.shape)
                rows = np.broadcast_to(value, (self.n, *v.shape))
                self._given[name] = np.ascontiguousarray(rows)
        values = {name: start.get(name, own) for name, own in self._given.items()}
        self._any_failed = True
        every = None if mask.all() else mask
        self._batch.reset(every, seeds=np.asarray(seeds, np.uint64), start=values, check=False)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """The copies that have failed since their reset."""
        return self._batch.failed if self._any_failed else np.zeros(self.n, bool)

    def failure(self, row: int) -> ComponentFailed | None:
        """Return the failure of a copy, or None."""
        failure = self._batch.failure(row)
        if failure is None:
            return None
        # The batch names the environment; `Episodes.failure` adds it where there are several.
        reason = failure.reason.removesuffix(f" in environment {row}")
        return ComponentFailed(failure.path, failure.time, reason)

    def close(self) -> None:
        """End the threads; a second call does nothing."""
        self._batch.close()

    def _places(self, name: str) -> range:
        """Return the cells of a variable."""
        path, _, own = name.rpartition(".")
        fused = self._kernel.fused
        i = fused.index[path]
        v = fused.plan.components[i].description.variables[own]
        first = fused.members[i].cell + v.value_references[0]
        return range(first, first + v.size)
