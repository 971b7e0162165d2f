"""Signals by name: the variables that a task reads, as rows of one array, and moments of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid, Problem
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.values.endpoints import resolve_endpoint
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = ["Instant", "Named", "Signals", "mixed", "refuse", "resolved", "variables_of"]

Array = NDArray[np.float64]
# A view: its rows, its shape, and the type of the variable unless it is float64.
View = tuple[slice | NDArray[np.intp], tuple[int, ...], type[np.generic] | None]
_TYPES: dict[str, type[np.generic]] = {"Boolean": np.bool_, "Int32": np.int32, "Int64": np.int64}


@dataclass(frozen=True)
class Named:
    """The meaning of a name such as "hull.eta[1:3]": elements (flat, from 0) of a variable."""

    key: str  # the variable's full name, "hull.eta"
    path: str
    variable: Variable
    elements: tuple[int, ...]
    shape: tuple[int, ...]


def variables_of(plan: Plan) -> Mapping[str, Variable]:
    """Return the variables of a plan by path and name, "hull.eta"."""
    return {
        f"{c.path}.{v.name}": v for c in plan.components for v in c.description.variables.values()
    }


def resolved(plan: Plan, name: str) -> Named:
    """Find the elements that a name means; raises Misfit with the near names."""
    if not isinstance(name, str):
        raise Misfit(f"{name!r}", "a name such as 'hull.eta'")
    point = resolve_endpoint(name, {c.path: c.description for c in plan.components})
    if point.variable.type in ("String", "Binary", "Clock"):
        raise Misfit(f"a variable of type {point.variable.type}", "a number")
    single = len(point.elements) == 1 and ":" not in name.rpartition("[")[2]
    shape = point.variable.shape if point.whole else () if single else (len(point.elements),)
    key = f"{point.element}.{point.variable.name}"
    return Named(key, point.element, point.variable, point.elements, shape)


def refuse(place: str, problems: Sequence[Problem]) -> None:
    """Raise InputInvalid with every problem, if there are any."""
    if problems:
        head = "" if len(problems) == 1 else f"{len(problems)} problems:\n  "
        raise InputInvalid(f"{place}: {head}" + "\n  ".join(str(p) for p in problems))


@final
class Signals:
    """Variables in rows of an array of shape (size, n), and views of them by name."""

    def __init__(self, plan: Plan, names: Iterable[str]) -> None:
        self.plan = plan
        self._first: dict[str, int] = {}
        self.size = 0
        self.problems: list[Problem] = []
        for name in names:
            try:
                named = resolved(plan, name)
            except Misfit as misfit:
                self.problems.append(misfit.at(f"signal {name!r}"))
                continue
            if named.key not in self._first:
                self._first[named.key] = self.size
                self.size += named.variable.size
        self._views: dict[str, View] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """The variables in order."""
        return tuple(self._first)

    def rows(self, named: Named) -> NDArray[np.intp]:
        """Return the rows of elements."""
        return self._first[named.key] + np.array(named.elements, np.intp)

    def view(self, values: Array, name: str) -> NDArray[Any]:
        """Return a signal, of shape (n, *shape); raises InputInvalid for one that is not read."""
        rows, shape, type_ = self._view(name)
        n = values.shape[1]
        part = values[rows]
        if shape == ():
            part = part[0]
        elif len(shape) == 1:
            part = part.T
        else:
            part = np.moveaxis(part.reshape(*shape, n), -1, 0)
        return part if type_ is None else part.astype(type_)

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of a signal; raises InputInvalid for one that is not read."""
        return self._view(name)[1]

    def _view(self, name: str) -> View:
        if name not in self._views:
            try:
                named = resolved(self.plan, name)
            except Misfit as misfit:
                raise InputInvalid(str(misfit.at(f"signal {name!r}"))) from None
            if named.key not in self._first:
                read = f"is not read by this task, which reads {', '.join(self._first) or 'none'}"
                raise InputInvalid(f"signal {name!r}", read, "it among the task's signals=")
            index = self.rows(named)
            # A slice of consecutive rows is a view of the values, where an index would be a copy.
            consecutive = len(index) > 0 and bool(np.all(np.diff(index) == 1))
            chosen = slice(int(index[0]), int(index[-1]) + 1) if consecutive else index
            self._views[name] = chosen, named.shape, _TYPES.get(named.variable.type)
        return self._views[name]


T = TypeVar("T", bound=np.generic)


def mixed(old: NDArray[T], new: NDArray[T], rows: NDArray[np.intp]) -> NDArray[T]:
    """Copy values (…, n) of all environments, with the new ones of some."""
    both = old.copy()
    both[..., rows] = new[..., rows]
    return both


@final
class Instant:
    """The `Moment` protocol over an array of signals, of shape (size, n)."""

    __slots__ = ("_before", "_fresh", "_seconds", "action", "signals", "start", "step", "values")

    def __init__(
        self,
        signals: Signals,
        values: Array,
        step: NDArray[np.int64],
        seconds: tuple[int, int],
        action: Mapping[str, Array],
        start: Mapping[str, Array],
        before: Instant | None = None,
        fresh: NDArray[np.intp] | None = None,
    ) -> None:
        values.flags.writeable = False
        self.signals = signals
        self.values = values
        self.step = step
        self._seconds = seconds  # of an action, as numerator and denominator
        self.action = action
        self.start = start
        self._before = before
        self._fresh = fresh  # episodes that have begun since `before`

    @property
    def n(self) -> int:
        """The number of environments."""
        return len(self.step)

    @property
    def time(self) -> Array:
        """The seconds since the reset, of shape (n,)."""
        numerator, denominator = self._seconds
        return np.asarray(self.step * numerator / denominator)

    @property
    def before(self) -> Instant:
        """The moment when the action began; after a reset this moment itself."""
        if self._before is None:
            return self
        if self._fresh is not None:
            old, fresh = self._before, self._fresh
            self._before = Instant(
                self.signals,
                mixed(old.values, self.values, fresh),
                mixed(old.step, self.step, fresh),
                self._seconds,
                {k: mixed(a.T, self.action[k].T, fresh).T for k, a in old.action.items()},
                self.start,
            )
            self._fresh = None
        return self._before

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a signal of the task, in the variable's own unit, of shape (n, *shape)."""
        return self.signals.view(self.values, name)

    def alone(self) -> Instant:
        """Forget the moment before, so that no chain of moments is kept in memory."""
        self._before = self._fresh = None
        return self
