"""Resolution of the names of a randomisation in a system: elements of variables, and draws."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.randomisation.distributions import Choice, Constant, Distribution
from uuvsim_cosim.envs.task.signals import variables_of
from uuvsim_cosim.errors import InputInvalid, Problem
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.values.endpoints import Endpoint, resolve_endpoint
from uuvsim_cosim.orchestrator.values.values import Misfit, conversion, flat

__all__ = ["Declared", "Places", "Quantity", "Target", "Vary", "resolved", "varies"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Vary:
    """Parameter, unconnected input or start value that is drawn, and its distribution.

    `name` is a variable ("hull.m"), one element or a slice of it ("hull.D_l[1]"), or a pattern over
    instances ("thruster_*.T_n"). `unit` is the unit of the `distribution`, by default that of the
    variable. With `relative`, the distribution is that of a factor on the value in the system. With
    `together`, one draw decides all named elements; otherwise, every element of every instance has
    a draw of its own. `sources` are the publications of the distribution, as pairs of a file and
    its text. Raises InputInvalid for fields of wrong types.

    Example:

    >>> from uuvsim_cosim.envs import Uniform, Vary
    >>> mass = Vary("hull.m", Uniform(12.5, 14.5), unit="kg")
    >>> strength = Vary("thruster_*.K_n", Uniform(0.8, 1.1), relative=True, together=True)
    >>> strength.name, strength.distribution.limits  # all thrusters get the same factor
    ('thruster_*.K_n', (0.8, 1.1))
    """

    name: str
    distribution: Distribution
    unit: str | None = None
    relative: bool = False
    together: bool = False
    sources: tuple[tuple[str, str], ...] = field(
        default=(), kw_only=True, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        """Check the types of the fields."""
        if not isinstance(self.name, str):
            raise InputInvalid("Vary", f"name {self.name!r}", "a text, such as 'hull.m'")
        if not isinstance(self.distribution, Distribution):
            number = isinstance(self.distribution, int | float)
            expected = f"Constant({self.distribution})" if number else "Uniform(low, high)"
            raise InputInvalid(
                self.name, f"{self.distribution!r}", f"a distribution, such as {expected}"
            )
        if self.unit is not None and not isinstance(self.unit, str):
            raise InputInvalid(self.name, f"unit {self.unit!r}", "a text, or None")
        for option in ("relative", "together"):
            value = getattr(self, option)
            if not isinstance(value, bool):
                raise InputInvalid(self.name, f"{option} {value!r}", "True or False")


class Declared(NamedTuple):
    """Parameters to draw, and the correlation of their draws by pairs of labels; of no system."""

    parameters: Sequence[Vary]
    correlation: Mapping[tuple[str, str], float] = MappingProxyType({})


def varies(given: object, name: str = "parameters") -> tuple[Vary, ...]:
    """Return the elements of a list of Vary; raises InputInvalid for anything else."""
    if isinstance(given, str | Vary) or not isinstance(given, Iterable):
        raise InputInvalid(name, f"{given!r}", "a list of Vary")
    listed = tuple(given)
    for each in listed:
        if not isinstance(each, Vary):
            raise InputInvalid(name, f"{each!r}", "a Vary, such as Vary('hull.m', Uniform(13, 14))")
    return listed


@dataclass(frozen=True)
class Target:
    """One element that is set to  offset + factor · quantile(u)."""

    name: str
    element: int  # flat, from 0
    distribution: Distribution
    factor: float = 1.0
    offset: float = 0.0

    def value(self, u: Array) -> Array:
        """Return the value that a draw decides, of the shape of u."""
        return self.offset + self.factor * self.distribution.quantile(u)

    def between(self, pair: tuple[float, float]) -> tuple[float, float]:
        """Return limits of the distribution as limits of the value."""
        a, b = (self.offset + self.factor * x if self.factor else self.offset for x in pair)
        return min(a, b), max(a, b)


@dataclass(frozen=True)
class Quantity:
    """One draw: a label, and the elements that it decides."""

    label: str
    targets: tuple[Target, ...]

    @property
    def limits(self) -> tuple[float, float]:
        """Return finite limits of its first element's value."""
        return self.targets[0].between(self.targets[0].distribution.range)


@final
class Places:
    """The variables of a system by path and name, and what may be drawn of them."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.plan: Plan = flatten(system)
        self._descriptions = {c.path: c.description for c in self.plan.components}
        self._given = {
            f"{c.path}.{name}": value
            for c in self.plan.components
            for name, value in c.start.items()
        }
        self.variables = variables_of(self.plan)
        self._fed: dict[str, dict[int, str]] = {}
        for t in self.plan.transfers:
            source = f"{self.plan.components[t.source].path}.{t.source_variable.name}"
            name = f"{self.plan.components[t.target].path}.{t.target_variable.name}"
            self._fed.setdefault(name, {}).update(dict.fromkeys(t.target_elements, source))

    def start(self, name: str) -> Array:
        """Return the start value of a variable, of its shape; NaN where there is none."""
        variable = self.variables[name]
        value = self._given.get(name, variable.start)
        elements = [np.nan] * variable.size if value is None else flat(value)
        if len(elements) == 1 != variable.size:
            elements *= variable.size
        return np.array(elements, dtype=float).reshape(variable.shape)

    def quantities(self, vary: Vary) -> list[Quantity]:
        """Return the draws of a parameter; Misfit or InputInvalid if it cannot be drawn."""
        points = list(self._points(vary.name))
        own = [[self._target(vary, p, i, k) for k, i in enumerate(p.elements)] for p in points]
        if vary.together:
            return [Quantity(vary.name, tuple(t for targets in own for t in targets))]
        found: list[Quantity] = []
        for point, targets in zip(points, own, strict=True):
            if vary.distribution.joint or len(targets) == 1:
                stem = f"{point.element}.{point.variable.name}"
                label = stem if point.whole or len(targets) > 1 else point.texts()[0]
                found.append(Quantity(label, tuple(targets)))
            else:
                found += [
                    Quantity(text, (t,)) for text, t in zip(point.texts(), targets, strict=True)
                ]
        return found

    def assembled(self, quantities: Sequence[Quantity], u: Mapping[str, Array]) -> dict[str, Array]:
        """Return start values by variable, of shape (n, *shape), from draws by label."""
        names = list(dict.fromkeys(t.name for q in quantities for t in q.targets))
        n = len(next(iter(u.values()))) if u else 0
        flat_ = {m: np.tile(self.start(m).reshape(-1), (n, 1)) for m in names}
        for q in quantities:
            for t in q.targets:
                flat_[t.name][:, t.element] = t.value(u[q.label])
        return {m: a.reshape(n, *self.variables[m].shape) for m, a in flat_.items()}

    # ---- inside ---------------------------------------------------------------------------

    def _points(self, name: str) -> Iterator[Endpoint]:
        stem, bracket, index = name.partition("[")
        if "*" not in stem and "?" not in stem:
            yield resolve_endpoint(name, self._descriptions)
            return
        matching = [n for n in self.variables if fnmatchcase(n, stem) and self._may(n) is None]
        if not matching:
            settable = [n for n in self.variables if self._may(n) is None]
            own = [n for n in settable if n.rpartition(".")[2] == stem.rpartition(".")[2]]
            raise Misfit(f"no variable matches {name!r}",
                         expected_names(stem, own or settable, "a pattern of names"))  # fmt: skip
        for found in matching:
            yield resolve_endpoint(f"{found}{bracket}{index}", self._descriptions)

    def _may(self, name: str) -> Misfit | None:
        v = self.variables[name]
        fed = self._fed.get(name, {})
        if v.causality not in ("parameter", "input"):
            return Misfit(f"a {v.variability} {v.causality}",
                          "a parameter, a start value or an unconnected input")  # fmt: skip
        if v.variability == "constant" or v.type in ("String", "Binary", "Clock"):
            return Misfit(f"a {v.variability} of type {v.type}", "a number that may be set")
        if len(fed) == v.size:
            return Misfit(f"is fed by {next(iter(fed.values()))}",
                          "a parameter, or an unconnected input")  # fmt: skip
        return None

    def _target(self, vary: Vary, point: Endpoint, i: int, k: int) -> Target:
        """Return the target of element i, the k-th of the named elements."""
        name = f"{point.element}.{point.variable.name}"
        v = point.variable
        wrong = self._may(name)
        if wrong is not None:
            raise wrong
        if i in self._fed.get(name, {}):
            raise Misfit(f"is fed by {self._fed[name][i]}", "an unconnected element")
        size = vary.distribution.size
        if size not in (None, len(point.elements)):
            raise Misfit(f"a distribution over {size} elements",
                         f"one over {len(point.elements)}, or of one number")  # fmt: skip
        distribution = vary.distribution if size is None else vary.distribution.element(k)
        if v.type not in ("Float64", "Float32"):
            values = distribution.values if isinstance(distribution, Choice) else ()
            values = distribution.limits if isinstance(distribution, Constant) else values
            if vary.relative or not values or any(x != int(x) for x in values):
                raise Misfit(f"{distribution!r} for a {v.type}", "a Choice of whole numbers")
        target = self._scaled(vary, Target(name, i, distribution), v, i)
        low, high = target.between(distribution.limits)
        least = -np.inf if v.min is None else v.min
        most = np.inf if v.max is None else v.max
        if not (low >= least and high <= most):
            unit = f" {v.unit}" if v.unit not in (None, "1") else ""
            read = f"{point.element}.{v.element_name(i)} is drawn from [{low:g}, {high:g}]{unit}"
            raise Misfit(read, f"values in its range [{least:g}, {most:g}]{unit}")
        return target

    def _scaled(self, vary: Vary, t: Target, v: Variable, i: int) -> Target:
        if vary.relative:
            if vary.unit is not None:
                raise Misfit(f"relative, with the unit {vary.unit!r}", "a factor without unit")
            base = float(self.start(t.name).reshape(-1)[i])
            if not np.isfinite(base):
                raise Misfit("relative to a start value that is not known", "a distribution of it")
            return Target(t.name, i, t.distribution, base)
        wanted = v.unit_of_element(i)
        if vary.unit is None or wanted is None or vary.unit == wanted:
            return t
        element = t.name.removesuffix(f".{v.name}")
        pair = conversion(vary.unit, wanted, self._descriptions[element].units)
        if pair is None:
            raise Misfit(f"the unit {vary.unit!r}", f"{wanted!r} or a unit of its kind")
        return Target(t.name, i, t.distribution, *pair)


def resolved(places: Places, parameters: Iterable[Vary]) -> tuple[list[Quantity], list[Problem]]:
    """Return the draws of parameters in a system, and every problem."""
    quantities: list[Quantity] = []
    problems: list[Problem] = []
    owner: dict[tuple[str, int], tuple[int, str]] = {}
    for i, vary in enumerate(parameters):
        try:
            found = places.quantities(vary)
        except (Misfit, InputInvalid) as error:
            problems.append(problem_of(vary.name, error))
            continue
        for t in (t for q in found for t in q.targets):
            before, other = owner.setdefault((t.name, t.element), (i, vary.name))
            if before != i:
                where = f"also drawn by {other!r}: {t.name}"
                problems.append(Problem(vary.name, where, "each element drawn once"))
                break
        quantities += found
    return quantities, problems


def problem_of(name: str, error: Misfit | InputInvalid) -> Problem:
    """Return the problem of a parameter that cannot be drawn."""
    if isinstance(error, Misfit):
        return error.at(name)
    return error.at(name, "another value")
