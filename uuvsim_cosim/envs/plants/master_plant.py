"""Plant of one master for each copy, in this process: for any system, FMUs included."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.plants.plant import Seeds
from uuvsim_cosim.envs.task.signals import variables_of
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, UuvsimError
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.resources import refuse_beyond, resident
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent

__all__ = ["MasterPlant"]

Array = NDArray[np.float64]
_TRIED = 64  # masters, after which the memory of one master is measured


@final
class MasterPlant:
    """The `Plant` protocol over masters of one plan, stepped one after the other.

    `reads` names the variables of `gather`, `acts` the inputs (and their elements, flat, from 0)
    of `scatter`.
    """

    def __init__(
        self,
        plan: Plan,
        instantiate: Callable[[PlannedComponent], Component],
        n: int,
        *,
        reads: Sequence[str],
        acts: Sequence[tuple[str, int]],
    ) -> None:
        self.n = n
        self.tick = plan.tick
        self.variables = variables_of(plan)
        self._plan, self._first = plan, instantiate
        self._known: dict[str, Native] = {}  # an instance of each declaration
        self._reads, self._acts = tuple(reads), tuple(acts)
        self._failures: list[ComponentFailed | None] = [None] * n
        self._failed = np.zeros(n, bool)
        self._rows: list[_Row] = []
        try:
            before = None
            for i in range(n):
                self._rows.append(self._row())
                # The first masters load what all share: memory is measured over the second half.
                if n > _TRIED and i == _TRIED // 2:
                    before = resident()
                elif i == _TRIED and before is not None and (now := resident()) is not None:
                    refuse_beyond(n - i, (now - before) // (_TRIED // 2))
        except BaseException:
            self.close()
            raise

    def gather(self) -> Array:
        """Copy the variables that are read, of shape (size, n)."""
        if self.n == 1:
            return self._rows[0].gather()[:, None]
        return np.stack([row.gather() for row in self._rows], axis=1)

    def scatter(self, values: Array) -> None:
        """Set the inputs that are acted on, of shape (width, n)."""
        for row, column in zip(self._rows, values.T, strict=True):
            row.scatter(column)

    def step(self, ticks: int) -> None:
        """Make communication steps in all copies that have not failed."""
        for i, row in enumerate(self._rows):
            if self._failures[i] is None:
                try:
                    row.master.step(ticks)
                except ComponentFailed as failure:
                    self._fail(i, failure)
                except UuvsimError as error:
                    self._fail(i, ComponentFailed("", row.master.time, str(error)))

    def reset(
        self, mask: NDArray[np.bool_], seeds: Seeds, start: Mapping[str, NDArray[np.generic]]
    ) -> None:
        """Go back to time 0 where the mask is true."""
        places = [(*name.rpartition(".")[::2], values) for name, values in start.items()]
        for i in np.flatnonzero(mask).tolist():
            values: dict[str, dict[str, object]] = {}
            for path, own, rows in places:
                value = rows[i]
                values.setdefault(path, {})[own] = value.item() if value.ndim == 0 else value
            if self._failures[i] is not None:  # a failed component may not accept a reset
                self._rows[i].master.free()
                self._rows[i] = self._row()
                self._failures[i], self._failed[i] = None, False
            try:
                self._rows[i].master.reset(int(seeds[i]), values)
                self._rows[i].check_start()
            except ComponentFailed as failure:
                self._fail(i, failure)
            except InputInvalid as error:
                self._fail(i, ComponentFailed("", 0.0, str(error)))
                raise
            except UuvsimError as error:
                self._fail(i, ComponentFailed("", 0.0, str(error)))

    @property
    def failed(self) -> NDArray[np.bool_]:
        """The copies that have failed since their reset."""
        return self._failed

    def failure(self, row: int) -> ComponentFailed | None:
        """Return the failure of a copy, or None."""
        return self._failures[row]

    def close(self) -> None:
        """Free the masters; a second call does nothing."""
        rows, self._rows = self._rows, []
        for row in rows:
            row.master.free()

    def _fail(self, row: int, failure: ComponentFailed) -> None:
        self._failures[row], self._failed[row] = failure, True

    def _instance(self, planned: PlannedComponent) -> Component:
        known = self._known.get(planned.source)
        if known is not None:
            return known.another(planned.path)
        made = self._first(planned)
        if isinstance(made, Native):
            self._known[planned.source] = made
        return made

    def _row(self) -> _Row:
        live = [_split(name) for name in self._reads]
        held = list(dict.fromkeys(_split(name) for name, _ in self._acts))
        master = Master(self._plan, self._instance, live=live, held=held, measured=False)
        try:
            master.initialize()
            return _Row(master, live, self._acts)
        except BaseException:
            master.free()
            raise


class _Row:
    """One master, with the slots of the variables that are read and acted on."""

    def __init__(
        self, master: Master, reads: Sequence[tuple[str, str]], acts: Sequence[tuple[str, int]]
    ) -> None:
        self.master = master
        self._reads = [(path, name, master.slots(path, name)) for path, name in reads]
        self._all: Array | None = None
        self._index = np.zeros(0, np.intp)
        views = [view for _, _, view in self._reads if view is not None and view.dtype == float]
        if views and len(views) == len(self._reads):  # all are slots: one take reads them
            self._all = master.all_slots
            self._index = np.concatenate([_places(view, self._all) for view in views])
        self._held = master.all_slots
        held = {name: master.slots(*_split(name)) for name, _ in acts}
        places = {
            name: _places(view, self._held) for name, view in held.items() if view is not None
        }
        self._at = np.array([places[name][i] for name, i in acts], np.intp)

    def gather(self) -> Array:
        if self._all is not None:
            return self._all.take(self._index)
        if not self._reads:
            return np.zeros(0)
        parts = (
            self.master.get(path, name) if view is None else view
            for path, name, view in self._reads
        )
        return np.concatenate([np.asarray(part, float).ravel() for part in parts])

    def check_start(self) -> None:
        """Raise ComponentFailed for a start that is not finite, as a kernel finds it."""
        for component in self.master.components:
            if isinstance(component, Native):
                component.check_outputs(0.0)
        values = self.gather()
        if not np.isfinite(values).all():
            raise ComponentFailed("", 0.0, "a signal that is read is not finite")

    def scatter(self, values: Array) -> None:
        self._held[self._at] = values


def _places(view: NDArray[np.generic], base: NDArray[np.generic]) -> NDArray[np.intp]:
    first = (view.ctypes.data - base.ctypes.data) // 8
    return np.arange(first, first + view.size)


def _split(name: str) -> tuple[str, str]:
    path, _, own = name.rpartition(".")
    return path, own
