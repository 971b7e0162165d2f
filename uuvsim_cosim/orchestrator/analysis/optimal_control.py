"""Optimal control of a system by direct collocation on the equations that are simulated.

The time is divided into equal intervals. Inputs are linear in an interval and continuous; states
are polynomials of degree 3 through Gauss-Legendre points (order 6; Betts 2010, Practical Methods
for Optimal Control, SIAM, chapter 4). The programme is solved by IPOPT (EPL-2.0, in CasADi's
wheel).
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.analysis.dynamics import Dynamics

__all__ = ["Bounds", "OptimalPlan", "collocate"]

Array = NDArray[np.float64]
Bounds = Mapping[str, tuple[ArrayLike, ArrayLike]]
Named = Callable[[Mapping[str, ca.MX]], Any]
DEGREE = 3


@dataclass(frozen=True)
class OptimalPlan:
    """Result of `uuv.optimal_control`: times `t` (n,) [s], and states and inputs by element, (n,).

    `cost` is the minimum, `iterations` those of IPOPT. Between the times, inputs are linear.
    `leads` [s] are the delays of inputs in the co-simulation, which `write` makes up for.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> plan = uuv.optimal_control("sphere", until=4.0, end={"eta[1]": 1.0, "nu": 0.0},
    ...     inputs={"tau[1]": (-20.0, 20.0)}, intervals=10)
    >>> plan.t.shape, f"{plan['eta[1]'][-1]:.6f} m"
    ((11,), '1.000000 m')
    """

    t: Array
    values: Mapping[str, Array]
    inputs: Sequence[str]
    cost: float
    iterations: int
    leads: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Array:
        """Return the values of an element of a state or an input; raises InputInvalid."""
        if name not in self.values:
            raise InputInvalid("plan", f"there is no {name!r}", ", ".join(self.values))
        return self.values[name]

    def write(self, file: str | Path) -> Path:
        """Write the inputs as CSV for ``uuv.run(…, inputs=[file])``, and return the path.

        Each input is written earlier by its `leads`: half a communication step, because it is held
        over a step, and one step for each connection until it reaches a component with states.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> plan = uuv.optimal_control("sphere", until=4.0, end={"eta[1]": 1.0, "nu": 0.0},
        ...     inputs={"tau[1]": (-20.0, 20.0)}, intervals=10)
        >>> plan.write("plan.csv").read_text().splitlines()[0]
        'time,tau[1]'
        """
        path = Path(file)
        with path.open("w", newline="", encoding="utf-8") as out:
            writer = csv.writer(out)
            writer.writerow(["time", *self.inputs])
            corners = {t - lead for t in self.t for lead in (0.0, *self.leads.values())}
            for t in sorted(t for t in corners if t >= 0):
                at = [np.interp(t + self.leads.get(n, 0.0), self.t, self[n]) for n in self.inputs]
                writer.writerow([repr(float(t)), *(repr(float(v)) for v in at)])
        return path


def collocate(
    d: Dynamics,
    until: float | tuple[float, float],
    *,
    start: Mapping[str, ArrayLike] | None = None,
    end: Mapping[str, ArrayLike] | None = None,
    inputs: Bounds | None = None,
    bounds: Bounds | None = None,
    cost: Literal["effort", "time"] | Named = "effort",
    keep: Named | None = None,
    intervals: int = 40,
    guess: Mapping[str, ArrayLike] | None = None,
) -> OptimalPlan:
    """Solve the optimal control problem; see `running/analysis.py`."""
    if d.period:
        raise InputInvalid(
            f"optimal control: {d.name}: a component samples",
            "continuous components: hull, thrusters, water; the plan replaces the controller",
        )
    if cost not in ("effort", "time") and not callable(cost):
        raise InputInvalid(
            "optimal control: cost",
            f"{cost!r}",
            "'effort', 'time', or a function of the named values that returns the running cost",
        )
    if intervals < 1:
        raise InputInvalid("optimal control", f"{intervals} intervals", "1 or more")
    problem = _Problem(d, until, inputs or {}, intervals)
    problem.fix(
        problem.X[:, 0], {**dict(zip(_names(d.states), d.x_0, strict=True)), **_flat(d, start)}
    )
    problem.fix(problem.X[:, -1], _flat(d, end))
    problem.bound(bounds or {})
    problem.collocate(cost)
    if keep is not None:
        problem.keep(keep)
    return problem.solve(_flat(d, end), _flat(d, guess))


def _names(elements: Sequence[Any]) -> list[str]:
    return [e.name for e in elements]


def _flat(d: Dynamics, given: Mapping[str, ArrayLike] | None) -> dict[str, float]:
    """Return values by element; raises InputInvalid for an unknown name or a wrong number."""
    states = _names(d.states)
    flat: dict[str, float] = {}
    for name, value in (given or {}).items():
        places = d.index(name)
        known = states if name in states or f"{name}[1]" in states else _names(d.inputs)
        values = np.asarray(value, dtype=float).ravel()
        if values.size not in (1, len(places)) or not np.all(np.isfinite(values)):
            n = len(places)
            raise InputInvalid(
                f"optimal control: {name}",
                f"{value!r}",
                "a finite number" if n == 1 else f"{n} finite numbers",
            )
        flat |= {
            known[i]: float(v)
            for i, v in zip(places, np.broadcast_to(values, len(places)), strict=True)
        }
    return flat


class _Problem:
    """The nonlinear programme: states X at the ends of intervals and at collocation points."""

    def __init__(
        self, d: Dynamics, until: float | tuple[float, float], inputs: Bounds, intervals: int
    ) -> None:
        self.d, self.N = d, intervals
        self.opti = ca.Opti()
        low, high = until if isinstance(until, tuple) else (until, until)
        if not 0 < low <= high < float("inf"):
            raise InputInvalid("optimal control: until", f"{until} s", "0 < low <= high")
        self.free_time = low < high
        self.T: Any = self.opti.variable() if self.free_time else float(low)
        if self.free_time:
            self.opti.subject_to(self.opti.bounded(low, self.T, high))
            self.opti.set_initial(self.T, 0.5 * (low + high))
        self.middle = 0.5 * (low + high)
        self.X = self.opti.variable(len(d.states), intervals + 1)
        self.K = [self.opti.variable(len(d.states), DEGREE) for _ in range(intervals)]
        names = _names(d.inputs)
        self.chosen: dict[str, tuple[float, float]] = {}
        for name, pair in inputs.items():
            places = d.index(name)
            if not any(n == name or n.startswith(f"{name}[") for n in names):
                raise InputInvalid(f"optimal control: {name}", "is no input", ", ".join(names))
            for i, lo, hi in zip(places, *_pair(name, pair, len(places)), strict=True):
                self.chosen[names[i]] = (lo, hi)
        if not self.chosen:
            raise InputInvalid(
                f"optimal control: {d.name}", "no input is chosen",
                "inputs={name: (low, high)} with names such as " + ", ".join(names[:6]),
            )  # fmt: skip
        self.U = self.opti.variable(len(self.chosen), intervals + 1)
        place = {n: i for i, n in enumerate(names)}
        self.rows = [place[n] for n in self.chosen]
        # A variable of the programme is about 1: a bounded input is divided by its bound.
        self.scale = np.array([_size(lo, hi) for lo, hi in self.chosen.values()])
        for i, (lo, hi) in enumerate(self.chosen.values()):
            s = self.scale[i]
            if np.isfinite(lo) or np.isfinite(hi):
                self.opti.subject_to(self.opti.bounded(lo / s, self.U[i, :], hi / s))

    def inputs_at(self, k: int, share: float) -> Any:
        """Return all inputs (m, 1) in interval k, at a share of its length."""
        u = ca.MX(ca.DM(self.d.u_0))
        chosen = ((1 - share) * self.U[:, k] + share * self.U[:, k + 1]) * self.scale
        for i, row in enumerate(self.rows):
            u[row] = chosen[i]
        return u

    def fix(self, x: Any, values: Mapping[str, float]) -> None:
        """Require values of states; angles are not taken modulo a turn."""
        names = _names(self.d.states)
        for name, value in values.items():
            if name not in names:
                raise InputInvalid(f"optimal control: {name}", "is no state", ", ".join(names))
            self.opti.subject_to(x[names.index(name)] == value)

    def bound(self, bounds: Bounds) -> None:
        """Keep states between bounds at the ends of all intervals."""
        names = _names(self.d.states)
        for name, pair in bounds.items():
            places = self.d.index(name)
            if not any(n == name or n.startswith(f"{name}[") for n in names):
                raise InputInvalid(f"optimal control: {name}", "is no state", ", ".join(names))
            for i, lo, hi in zip(places, *_pair(name, pair, len(places)), strict=True):
                self.opti.subject_to(self.opti.bounded(lo, self.X[i, 1:], hi))

    def collocate(self, cost: Literal["effort", "time"] | Named) -> None:
        """Require the dynamics in all intervals, and set the cost."""
        tau = np.array(ca.collocation_points(DEGREE, "legendre"))
        C, D, B = (np.array(m) for m in ca.collocation_coeff(list(tau)))
        h = self.T / self.N
        total: Any = 0.0
        for k in range(self.N):
            Z = ca.horzcat(self.X[:, k], self.K[k])
            rates = Z @ C
            for j in range(DEGREE):
                u = self.inputs_at(k, float(tau[j]))
                self.opti.subject_to(rates[:, j] == h * self.d.f(self.K[k][:, j], u))
                if cost == "time":
                    continue
                if cost == "effort":
                    v = (1 - tau[j]) * self.U[:, k] + tau[j] * self.U[:, k + 1]
                    running = ca.sumsqr(v)
                else:
                    running = cost(self._named(self.K[k][:, j], u))
                total += h * float(B.ravel()[j]) * running
            self.opti.subject_to(self.X[:, k + 1] == Z @ D.reshape(-1, 1))
        if cost == "time" and not self.free_time:
            raise InputInvalid(
                "optimal control: cost 'time'", "the time is fixed", "until=(shortest, longest)"
            )
        self.opti.minimize(self.T if cost == "time" else total)

    def keep(self, keep: Named) -> None:
        """Require ``keep(values) >= 0`` at the ends of all intervals."""
        for k in range(1, self.N + 1):
            last = k - (k == self.N)
            u = self.inputs_at(last, float(k == self.N))
            value = keep(self._named(self.X[:, k], u))
            for each in value if isinstance(value, list | tuple) else [value]:
                self.opti.subject_to(each >= 0)

    def _named(self, x: Any, u: Any) -> dict[str, Any]:
        """Return states, inputs and outputs by element, for the functions of a user."""
        y = self.d.h(x, u)
        found = {n: y[i] for i, n in enumerate(_names(self.d.outputs))}
        found |= {n: u[i] for i, n in enumerate(_names(self.d.inputs))}
        return found | {n: x[i] for i, n in enumerate(_names(self.d.states))}

    def solve(self, end: Mapping[str, float], guess: Mapping[str, float]) -> OptimalPlan:
        """Solve from a straight line between start and end; raises ComponentFailed."""
        names = _names(self.d.states)
        first = self.d.x_0
        last = np.array([end.get(n, guess.get(n, x)) for n, x in zip(names, first, strict=True)])
        for k in range(self.N + 1):
            share = k / self.N
            self.opti.set_initial(self.X[:, k], first + share * (last - first))
            if k < self.N:
                for j in range(DEGREE):
                    self.opti.set_initial(self.K[k][:, j], first + share * (last - first))
        for i, n in enumerate(self.chosen):
            self.opti.set_initial(self.U[i, :], guess.get(n, 0.0) / self.scale[i])
        quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
        self.opti.solver("ipopt", {**quiet, "ipopt.max_iter": 500, "expand": True})
        try:
            found = self.opti.solve()
        except RuntimeError:
            stats = self.opti.stats()
            status = stats.get("return_status", "failed")
            raise InputInvalid(
                f"optimal control: {self.d.name}",
                f"IPOPT ended with {status} after {stats.get('iter_count', 0)} iterations",
                "an end that can be reached within the bounds and the time, or another `guess`",
            ) from None
        X, U = np.array(found.value(self.X)), np.array(found.value(self.U)).reshape(-1, self.N + 1)
        T = float(found.value(self.T)) if self.free_time else float(self.T)
        values = dict(zip(names, X.reshape(len(names), -1), strict=True))
        values |= dict(zip(self.chosen, U * self.scale[:, None], strict=True))
        return OptimalPlan(
            np.linspace(0.0, T, self.N + 1),
            values,
            tuple(self.chosen),
            float(found.value(self.opti.f)),
            int(found.stats()["iter_count"]),
            {n: self.d.delays[row] for n, row in zip(self.chosen, self.rows, strict=True)},
        )


def _pair(name: str, pair: tuple[ArrayLike, ArrayLike], n: int) -> tuple[list[float], list[float]]:
    try:
        low, high = (np.broadcast_to(np.asarray(v, dtype=float), n).tolist() for v in pair)
    except (TypeError, ValueError):
        low, high = [], []
    if not low or not all(a <= b for a, b in zip(low, high, strict=True)):  # NaN is refused
        raise InputInvalid(f"optimal control: {name}", f"{pair!r}", "(low, high) with low <= high")
    return low, high


def _size(low: float, high: float) -> float:
    finite = [abs(v) for v in (low, high) if np.isfinite(v) and v != 0]
    return max(finite, default=1.0)
