"""Batch: environments of one kernel, each with its own parameters, seed and time."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from operator import index
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.resources import refuse_beyond
from uuvsim_cosim.kernels.batch.memory import Lanes, Signal, aligned, signal_of
from uuvsim_cosim.kernels.batch.parts import Parts
from uuvsim_cosim.kernels.batch.sharing import Sharing
from uuvsim_cosim.kernels.batch.threads import Threads
from uuvsim_cosim.kernels.codegen.program import Program
from uuvsim_cosim.orchestrator.plan.seeds import seed_words

__all__ = ["Batch", "Seeds"]

Seeds = int | Sequence[int] | np.ndarray
_SMALL = 1 << 22  # bytes of values that stay in the processor's cache between two calls
TICK, FAILED, FAILED_TICK = 0, 1, 2  # words, as in fmus/kernels/uuv_lane_steps.h


@final
class Batch(Closing):
    """Environments of a `kernel` that step together; `Kernel.batch` makes it.

    There are `n_envs` environments, which `threads` threads step. `seeds` is a system seed for
    each, or one s for s, s + 1, …; `start` are start values by name, of the variable's shape, or
    one row for each environment. An environment keeps its seed and its start values until `reset`
    gets others; values of `set` are kept until its next reset. Raises InputInvalid for a name or a
    shape that does not fit. A ``with`` block closes it.

    With `reads`, "hull.eta", `get` returns these variables and parameters only, and a step of many
    environments takes less time, because it does not write the others to memory.

    Example:

    >>> import numpy as np
    >>> import uuvsim_cosim as uuv
    >>> kernel = uuv.fuse(uuv.System("tank").add("hull", "model:sphere"))
    >>> batch = kernel.batch(3)
    >>> batch.variables["hull.tau"].element_units[0], batch.cells.shape[0]
    ('N', 1)
    >>> batch.set("hull.tau", np.outer([10.0, 20.0, 30.0], [1, 0, 0, 0, 0, 0]))
    >>> batch.step(99)
    >>> batch.advance(1)  # a step without a check: whether any environment has failed
    False
    >>> batch.get("hull.eta")[:, 0].round(3)  # position N [m]
    array([0.098, 0.192, 0.282])
    >>> batch.tick, batch.failed, batch.failure(0)
    (array([100, 100, 100]), array([False, False, False]), None)
    >>> batch.reset(np.array([True, False, False]), seeds=7)
    >>> batch.time
    array([0., 1., 1.])
    >>> batch.free_cells.shape == batch.cells.shape
    True
    >>> batch.close()
    """

    def __init__(
        self,
        kernel: Program,
        n_envs: int,
        *,
        seeds: Seeds | None = None,
        start: Mapping[str, object] | None = None,
        threads: int = 1,
        reads: Sequence[str] | None = None,
    ) -> None:
        if n_envs < 1 or threads < 1:
            raise InputInvalid(f"{n_envs} environments in {threads} threads", "at least 1")
        self.kernel = kernel
        self.n_envs = n_envs
        fused, dtype = kernel.fused, kernel.dtype
        refuse_beyond(n_envs, (fused.n_cells + fused.n_moved + fused.n_start) * dtype.itemsize)
        self._memory = Lanes(n_envs, fused.n_cells, kernel.lanes, dtype, fused.n_words)
        self._reads = None if reads is None else frozenset(reads)
        self._parts: Parts | None = None
        if self._memory.cells.nbytes > _SMALL:
            self._parts = Parts(fused, self._memory, self._reads)
        self._words = self._memory if self._parts is None else self._parts.words
        self._start = Lanes(n_envs, fused.n_start, kernel.lanes, dtype)
        workers = min(threads, self._memory.n_blocks)
        # More ranges than threads, so that a thread whose processor is busy works on fewer.
        n_ranges = 4 * workers if self._memory.n_blocks >= 32 * workers > 32 else workers
        bounds = np.linspace(0, self._memory.n_blocks, n_ranges + 1).astype(int).tolist()
        self._ranges = list(pairwise(bounds))
        scratch = aligned((workers, fused.n_cells, kernel.lanes), dtype)
        self._scratch = [int(s.ctypes.data) for s in scratch]
        self._scratch_cells = scratch
        self._threads = Threads(workers) if workers > 1 else None
        self._raised = np.zeros(n_envs, bool)
        self._signals: dict[str, Signal] = {}
        self._sharing = Sharing(fused)
        self._address, self._n_blocks = self._memory.address, self._memory.n_blocks
        self._tick_length = fused.plan.tick.numerator, float(fused.plan.tick.denominator)
        # Start values of the declarations, then those of the plan.
        declared: dict[int, np.ndarray] = {}
        for planned, m in zip(fused.plan.components, fused.members, strict=True):
            if m.declaration not in declared:
                declared[m.declaration] = m.layout.start_values()
            values = declared[m.declaration]
            self._start.cells[:, m.start_cell : m.start_cell + m.n_start] = values[:, None]
            if dtype == np.float32 and m.is_seed("seed"):  # integers, which no float32 holds
                at = m.layout.offset_of("seed")
                self._signal(f"{m.path}.seed").start.write(values[at : at + 2])
            for name, given in planned.start.items():
                signal = self._signal(f"{m.path}.{name}")
                signal.start.write(signal.checked_start(given))
        for name in self._reads or ():
            self._signal(name)
        self.reset(seeds=0 if seeds is None else seeds, start=start)

    def close(self) -> None:
        """End the threads; a second call does nothing."""
        if self._threads is not None:
            self._threads.close()
            self._threads = None  # from now on the calling thread steps all blocks

    # ---- life -----------------------------------------------------------------------------

    def reset(
        self,
        mask: ArrayLike | None = None,
        *,
        seeds: Seeds | None = None,
        start: Mapping[str, object] | None = None,
        check: bool = True,
    ) -> None:
        """Go back to time 0 where the `mask` is true, with other seeds or start values if given.

        `mask` is (n_envs,), of Booleans; without it, all are reset. Raises ComponentFailed if an
        initial value is not finite, unless `check` is false.
        """
        chosen = None if mask is None else self._mask(mask)
        given = [(self._signal(n), v) for n, v in start.items()] if start else []
        rows = [(s, s.checked_start(v)) for s, v in given]  # all, before any of them is written
        words = None if seeds is None else self._seeds(seeds)
        for s, row in rows:
            s.start.write(row, chosen)
            self._sharing.started(s, every=chosen is None)
        self._sharing.reset(every=chosen is None)
        lanes = None
        if chosen is not None:
            lanes = np.ascontiguousarray(self._memory.padded(chosen).view(np.uint8))
        masks = 0 if lanes is None else lanes.ctypes.data
        c, memory, begin = self.kernel.c, self._address, self._start.address
        parts = self._parts
        if parts is not None and chosen is not None:
            own = parts.address
            self._each(lambda _, a, b: c.uuv_kernel_copy_parts(memory, own, 1, masks, a, b))
        if words is not None:
            seeded = words.ctypes.data
            self._each(lambda _, a, b: c.uuv_kernel_seed(begin, seeded, masks, a, b))
        scratch = self._scratch
        failed = self._each(
            lambda n, a, b: c.uuv_kernel_reset(memory, begin, masks, scratch[n], a, b)
        )
        if parts is not None:
            own = parts.address
            self._each(lambda _, a, b: c.uuv_kernel_copy_parts(memory, own, 0, masks, a, b))
        if chosen is None:
            self._raised[:] = False
        else:
            self._raised &= ~chosen
        if check and any(failed):
            self._check()

    def step(self, n: int = 1, *, check: bool = True) -> None:
        """Make `n` communication steps in all environments.

        Raises ComponentFailed once for environments that fail, after all have made their n steps.
        The values of those in `failed` are not valid until they are reset. Without `check` nothing
        is raised.
        """
        if self.advance(n) and check:
            self._check()

    def advance(self, n: int = 1) -> bool:
        """Make `n` steps as `step` does without a check; return whether any is in `failed`."""
        if n < 0:
            raise InputInvalid(f"{n} steps", "0 or more")
        c, memory, own, parts = self.kernel.c, self._address, self._sharing.address, self._parts
        if parts is not None:
            if n == 0:
                return bool(self.failed.any())
            address, work = parts.address, self._scratch
            failed = any(
                self._each(
                    lambda i, a, b: c.uuv_kernel_step_parts(memory, own, address, work[i], a, b, n)
                )
            )
        elif self._threads is None:
            failed = bool(c.uuv_kernel_step(memory, own, 0, self._n_blocks, n))
        else:
            failed = any(self._each(lambda _, a, b: c.uuv_kernel_step(memory, own, a, b, n)))
        return failed

    @property
    def tick(self) -> np.ndarray:
        """Return the communication point that each environment has reached, (n_envs,)."""
        return self._words.word(TICK).astype(np.int64)

    @property
    def time(self) -> np.ndarray:
        """Return each environment's time, (n_envs,) [s]."""
        numerator, denominator = self._tick_length
        return (self._words.word(TICK) * np.uint64(numerator)).astype(float) / denominator

    @property
    def failed(self) -> np.ndarray:
        """Return which environments have had a value that is not finite since their reset.

        The shape is (n_envs,).
        """
        return np.asarray(self._words.word(FAILED) != 0)

    def failure(self, e: int) -> ComponentFailed | None:
        """Return the first failure of environment `e` since its reset, if it has failed."""
        if not -self.n_envs <= e < self.n_envs:
            raise InputInvalid(f"environment {e}", f"one of 0 to {self.n_envs - 1}")
        return self._failure(index(e) % self.n_envs, "")

    # ---- values ---------------------------------------------------------------------------

    @property
    def variables(self) -> Mapping[str, Variable]:
        """Return every variable by its full name, "hull.eta"."""
        return self.kernel.variables

    @property
    def cells(self) -> np.ndarray:
        """Return all values in memory, (blocks, cells, lanes); `Fused` has their places.

        You may write them. From now on, each environment therefore reads its own parameters in a
        step, also those that have the same value in all environments, which takes longer.
        """
        self._sharing.end()
        return self.free_cells

    @property
    def free_cells(self) -> np.ndarray:
        """Return `cells`, of which inputs and outputs alone may be written.

        From now on, a step therefore writes all of them to memory, which takes longer. Variables
        that are not in `reads` are valid after the next step.
        """
        self._join()
        return self._memory.cells

    def view(self, name: str) -> np.ndarray:
        """Return the values of a variable in memory, (blocks, elements, lanes).

        You may write those of an input. Reading `cells` or `free_cells` makes it invalid.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> kernel = uuv.fuse(uuv.System("tank").add("hull", "model:sphere"))
        >>> kernel.batch(20).view("hull.eta").shape
        (3, 6, 8)
        """
        signal = self._readable(name)
        if not signal.is_parameter:
            self._sharing.written(signal)
        return signal.own.view()

    def get(self, name: str) -> np.ndarray:
        """Copy the variable `name`, "hull.eta": a row for each environment, in its unit.

        The rows have the kernel's number type.
        """
        return self._readable(name).own.read()

    def set(self, name: str, values: object, mask: ArrayLike | None = None) -> None:
        """Set the unconnected input or the tunable parameter `name`, where the `mask` is true.

        `values` has the variable's shape, or one row for each environment.
        """
        s = self._signals.get(name) or self._signal(name)
        rows = s.checked(values)
        s.own.write(rows, None if mask is None else self._mask(mask))
        if s.is_parameter:
            c, memory = self.kernel.c, self._address
            self._each(lambda _, a, b: c.uuv_kernel_derive(memory, s.member, a, b))
        self._sharing.set(s, equal=mask is None and rows.ndim == len(s.variable.shape))

    # ---- inside ---------------------------------------------------------------------------

    def _each(self, call: Callable[[int, int, int], object]) -> list[object]:
        """Call for each range of blocks, in parallel: C releases the GIL."""
        if self._threads is None:
            return [call(0, 0, self._n_blocks)]
        if self._threads.owner != os.getpid():  # threads do not survive a fork
            self._threads = Threads(len(self._scratch))
        return self._threads.each(call, self._ranges)

    def _signal(self, name: str) -> Signal:
        if name not in self._signals:
            parts = [] if self._parts is None else [self._parts.place]
            self._signals[name] = signal_of(self.kernel, name, self._memory, self._start, *parts)
        return self._signals[name]

    def _readable(self, name: str) -> Signal:
        signal = self._signals.get(name) or self._signal(name)
        if self._reads is not None and name not in self._reads and not signal.is_parameter:
            raise InputInvalid(name, "is not in `reads` of the batch", ", ".join(self._reads))
        return signal

    def _join(self) -> None:
        """Hold all values of a block together from now on."""
        parts, c, memory = self._parts, self.kernel.c, self._address
        if parts is None:
            return
        own = parts.address
        self._each(lambda _, a, b: c.uuv_kernel_copy_parts(memory, own, 1, None, a, b))
        self._parts, self._words = None, self._memory
        self._signals.clear()

    def _seeds(self, seeds: Seeds) -> np.ndarray:
        """Return one seed for each lane; a single seed s stands for s, s + 1, …."""
        n = self.n_envs
        if getattr(seeds, "dtype", None) == np.uint64 and np.shape(seeds) == (n,):
            return np.ascontiguousarray(self._memory.padded(np.asarray(seeds)))
        each = np.ndim(seeds) > 0
        try:
            if each:
                given = [index(s) for s in seeds]  # type: ignore[union-attr]
            else:
                first = index(seeds)  # type: ignore[arg-type]
                given = [*range(first, first + n)]
        except TypeError:
            raise InputInvalid("seeds", f"{seeds!r}", f"a whole number, or {n} of them") from None
        if len(given) != n:
            raise InputInvalid("seeds", len(given), f"one, or {n}")
        return self._memory.padded(seed_words(given))

    def _mask(self, mask: ArrayLike) -> np.ndarray:
        chosen = np.asarray(mask)
        if chosen.shape != (self.n_envs,) or chosen.dtype != bool:
            raise InputInvalid(
                "mask", f"{chosen.dtype} of shape {chosen.shape}", f"{self.n_envs} Booleans"
            )
        return chosen

    def _check(self) -> None:
        """Raise for environments that have failed since the last call."""
        new = self.failed & ~self._raised
        if not new.any():
            return
        self._raised |= new
        count = int(new.sum())
        more = f", and {count - 1} others fail" if count > 1 else ""
        failure = self._failure(int(np.flatnonzero(new)[0]), more)
        assert failure is not None
        raise failure

    def _failure(self, e: int, more: str) -> ComponentFailed | None:
        cell = int(self._words.word(FAILED)[e]) - 1
        if cell < 0:
            return None
        fused = self.kernel.fused
        place, path = fused.name_of(cell)
        tick = int(self._words.word(FAILED_TICK)[e])
        time = float(tick * fused.plan.tick.numerator) / float(fused.plan.tick.denominator)
        return ComponentFailed(path, time, f"{place} is not finite in environment {e}{more}")
