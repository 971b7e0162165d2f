"""A batch: environments of one kernel, each with parameters, seed and time of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from difflib import get_close_matches
from itertools import pairwise
from operator import index
from typing import Any, Self, final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.kernels.kernel import Kernel
from uuvsim_cosim.kernels.memory import Lanes, aligned
from uuvsim_cosim.orchestrator.seeds import component_seed

__all__ = ["Batch", "Seeds"]

Seeds = int | Sequence[int] | np.ndarray
TICK, FAILED, FAILED_TICK = 0, 1, 2  # cells, as in fmus/kernels/uuv_lane_steps.h


@final
class Batch:
    """Environments that step together; see `Kernel.batch`.

    An environment keeps its seed and its start values until `reset` is given others; what `set`
    changes lasts until its next reset.
    """

    def __init__(
        self,
        kernel: Kernel,
        n_envs: int,
        *,
        seeds: Seeds | None = None,
        start: Mapping[str, Any] | None = None,
        threads: int = 1,
    ) -> None:
        if n_envs < 1 or threads < 1:
            raise InputInvalid(f"{n_envs} environments in {threads} threads; expected at least 1")
        self.kernel = kernel
        self.n_envs = n_envs
        fused = kernel.fused
        self._plan = fused.plan
        self._index = {m.path: i for i, m in enumerate(fused.members)}
        self._memory = Lanes(n_envs, fused.n_cells, kernel.lanes)
        self._start = Lanes(n_envs, fused.n_start, kernel.lanes)
        n_ranges = min(threads, self._memory.n_blocks)
        bounds = np.linspace(0, self._memory.n_blocks, n_ranges + 1).astype(int).tolist()
        self._ranges = list(pairwise(bounds))
        self._scratch = aligned((n_ranges, fused.n_cells, kernel.lanes))
        self._pool = ThreadPoolExecutor(n_ranges - 1) if n_ranges > 1 else None
        self._raised = np.zeros(n_envs, bool)
        self._connected: dict[tuple[int, str], int] = {}
        for t in self._plan.transfers:
            key = (t.target, t.target_variable.name)
            self._connected[key] = self._connected.get(key, 0) + len(t.target_elements)
        self._set_plan_start()
        self.reset(seeds=0 if seeds is None else seeds, start=start)

    def close(self) -> None:
        """End the threads; a second call does nothing."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
            self._ranges = [(0, self._memory.n_blocks)]

    def __enter__(self) -> Self:
        """Give the batch."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the threads."""
        self.close()

    # ---- life -----------------------------------------------------------------------------

    def reset(
        self,
        mask: Any = None,
        *,
        seeds: Seeds | None = None,
        start: Mapping[str, Any] | None = None,
    ) -> None:
        """Go back to time 0 where the mask is true, with other seeds or start values if given."""
        chosen = self._mask(mask)
        values = [(*self._place(name), value) for name, value in (start or {}).items()]
        rows = [(i, v, self._rows(i, v, value)) for i, v, value in values]
        for i, variable, _ in rows:
            if variable.causality not in ("input", "parameter"):
                raise self._wrong(i, variable, "an input or a parameter")
        if seeds is not None:
            self._set_seeds(self._seeds(seeds), chosen)
        for i, variable, row in rows:
            first = self.kernel.fused.members[i].start_cell + variable.value_references[0]
            self._start.write(first, row, chosen)
        lanes = np.ascontiguousarray(self._memory.padded(chosen).astype(np.uint8))
        c, memory, begin = self.kernel.c, self._memory.address, self._start.address

        def reset_range(n: int, first: int, last: int) -> None:
            scratch = self._scratch[n].ctypes.data
            c.uuv_kernel_reset(memory, begin, lanes.ctypes.data, scratch, first, last)

        self._each(reset_range)
        self._raised &= ~chosen
        self._check()

    def step(self, n: int = 1) -> None:
        """Make n communication steps in all environments.

        Raises ComponentFailed once for environments that fail; all make their n steps. Those in
        `failed` mean nothing until they are reset.
        """
        c, memory = self.kernel.c, self._memory.address
        if any(self._each(lambda _, a, b: c.uuv_kernel_step(memory, a, b, n))):
            self._check()

    @property
    def tick(self) -> np.ndarray:
        """Give the communication point that each environment has reached."""
        return self._memory.read(TICK, 1, bits=True)[:, 0].astype(np.int64)

    @property
    def time(self) -> np.ndarray:
        """Give each environment's time [s]."""
        tick = self._plan.tick
        return (self.tick * tick.numerator).astype(float) / float(tick.denominator)

    @property
    def failed(self) -> np.ndarray:
        """Say which environments have a value that is not finite, since their reset."""
        return np.asarray(self._memory.read(FAILED, 1, bits=True)[:, 0] != 0)

    # ---- values ---------------------------------------------------------------------------

    def get(self, name: str) -> np.ndarray:
        """Copy a variable, "hull.eta": one row an environment."""
        i, v = self._place(name)
        flat = self._memory.read(self.kernel.fused.members[i].cell + v.value_references[0], v.size)
        if v.type != "Float64":
            flat = flat.astype(bool if v.type == "Boolean" else np.int32)
        return flat.reshape(self.n_envs, *v.shape)

    def set(self, name: str, values: Any, mask: Any = None) -> None:
        """Set an unconnected input or a tunable parameter, where the mask is true.

        `values` has the variable's shape, or one row an environment.
        """
        i, v = self._place(name)
        tunable = v.causality == "parameter" and v.variability == "tunable"
        if v.causality != "input" and not tunable:
            raise self._wrong(i, v, "an input or a tunable parameter (others: start= of reset)")
        if self._connected.get((i, v.name), 0) == v.size:
            raise InputInvalid(f"{name}: is connected; expected an unconnected input")
        rows = self._rows(i, v, values)
        member = self.kernel.fused.members[i]
        chosen = None if mask is None else self._mask(mask)
        self._memory.write(member.cell + v.value_references[0], rows, chosen)
        if tunable:
            c, memory = self.kernel.c, self._memory.address
            self._each(lambda _, a, b: c.uuv_kernel_derive(memory, i, a, b))

    # ---- inside ---------------------------------------------------------------------------

    def _each(self, call: Callable[[int, int, int], Any]) -> list[Any]:
        """Call for each range of blocks, side by side; C lets go of the GIL."""
        if self._pool is None:
            return [call(0, 0, self._memory.n_blocks)]
        waiting = [self._pool.submit(call, n, *r) for n, r in enumerate(self._ranges[1:], 1)]
        return [call(0, *self._ranges[0]), *(w.result() for w in waiting)]

    def _set_plan_start(self) -> None:
        every = np.ones(self.n_envs, bool)
        for i, m in enumerate(self.kernel.fused.members):
            start = np.zeros(m.n_start)
            for p in m.layout.placed:
                if p.variable.kind in ("input", "parameter"):
                    start[p.offset : p.offset + p.variable.size] = p.variable.start
            self._start.write(m.start_cell, np.broadcast_to(start, (self.n_envs, m.n_start)))
            for name, value in self._plan.components[i].start.items():
                variable = self._plan.components[i].description.variables[name]
                first = m.start_cell + variable.value_references[0]
                self._start.write(first, self._rows(i, variable, value), every)

    def _set_seeds(self, seeds: Sequence[int], chosen: np.ndarray) -> None:
        for planned, m in zip(self._plan.components, self.kernel.fused.members, strict=True):
            own = planned.description.variables.get("seed")
            if own is None or (own.causality, own.shape) != ("parameter", (2,)):
                continue
            if "seed" in planned.start:
                continue
            keys = np.zeros((self.n_envs, 2))
            for e in np.flatnonzero(chosen):
                keys[e] = component_seed(seeds[int(e)], planned.path)
            self._start.write(m.start_cell + own.value_references[0], keys, chosen)

    def _seeds(self, seeds: Seeds) -> list[int]:
        each = np.ndim(seeds) > 0
        try:
            given = [index(s) for s in seeds] if each else [index(seeds)]  # type: ignore[union-attr, arg-type]
        except TypeError:
            raise InputInvalid(
                f"seeds: {seeds!r}; expected a whole number, or {self.n_envs} of them"
            ) from None
        if not each:
            return [given[0] + e for e in range(self.n_envs)]
        if len(given) != self.n_envs:
            raise InputInvalid(f"seeds: {len(given)}; expected one, or {self.n_envs}")
        return given

    def _mask(self, mask: Any) -> np.ndarray:
        if mask is None:
            return np.ones(self.n_envs, bool)
        chosen = np.asarray(mask)
        if chosen.shape != (self.n_envs,) or chosen.dtype != bool:
            raise InputInvalid(
                f"mask: {chosen.dtype} of shape {chosen.shape}; expected {self.n_envs} Booleans"
            )
        return chosen

    def _rows(self, i: int, v: Variable, values: Any) -> np.ndarray:
        place = f"{self._plan.components[i].path}.{v.name}"
        try:
            array = np.asarray(values, dtype=float)
        except (TypeError, ValueError):
            raise InputInvalid(f"{place}: value {values!r}; expected numbers") from None
        whole = (self.n_envs, *v.shape)
        if array.shape not in (v.shape, whole):
            raise InputInvalid(
                f"{place}: values of shape {array.shape}; expected {v.shape} or {whole}"
            )
        low = -np.inf if v.min is None else v.min
        high = np.inf if v.max is None else v.max
        right = np.isfinite(array) & (array >= low) & (array <= high)
        if not np.all(right):
            wrong = array[~right].flat[0]
            raise InputInvalid(
                f"{place}: value {wrong}; expected finite numbers in [{low}, {high}]"
            )
        return np.broadcast_to(array, whole).reshape(self.n_envs, v.size)

    def _place(self, name: str) -> tuple[int, Variable]:
        path, _, own = name.rpartition(".")
        if path in self._index:
            i = self._index[path]
            variables = self._plan.components[i].description.variables
            if own in variables:
                return i, variables[own]
            near = get_close_matches(own, variables, 3) or sorted(variables)
            near = [f"{path}.{n}" for n in near]
        else:
            near = [f"{n}.…" for n in get_close_matches(path, self._index, 3) or self._index]
        raise InputInvalid(f"no variable {name!r}; expected one of {', '.join(near)}")

    def _wrong(self, i: int, v: Variable, expected: str) -> InputInvalid:
        place = f"{self._plan.components[i].path}.{v.name}"
        return InputInvalid(f"{place}: is a {v.variability} {v.causality}; expected {expected}")

    def _check(self) -> None:
        """Raise for environments that have failed since the last call."""
        new = self.failed & ~self._raised
        if not new.any():
            return
        self._raised |= new
        e = int(np.flatnonzero(new)[0])
        cell = int(self._memory.read(FAILED, 1, bits=True)[e, 0]) - 1
        tick = int(self._memory.read(FAILED_TICK, 1, bits=True)[e, 0])
        m = next(m for m in reversed(self.kernel.fused.members) if m.cell <= cell)
        p = next(p for p in reversed(m.layout.placed) if p.offset <= cell - m.cell)
        element = f"[{cell - m.cell - p.offset + 1}]" if p.variable.shape else ""
        count = int(new.sum())
        more = f", and {count - 1} others fail" if count > 1 else ""
        time = float(tick * self._plan.tick.numerator) / float(self._plan.tick.denominator)
        raise ComponentFailed(
            m.path,
            time,
            f"{p.variable.name}{element} is not finite in environment {e}{more}",
        )
