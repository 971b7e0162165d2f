"""A loop of a system opened at one signal: its frequency response, margins, poles, step responses.

The signal y_k is cut where it leaves its component, and delta_k takes its place. Around the run of
the closed system, with all other loops closed,

    x_{k+1} = A_k x_k + b_k delta_k + e_k delta_{k+1},   y_k = c x_k,   L = -y / delta,

where e_k belongs to components that get the value of the same step (Gauss-Seidel). A_k repeats
after N ticks, N = 1 if all clocks tick at each tick. For delta_k = z^k, z = exp(j omega T), the
response is y_k = z^k times a sequence of period N, and L(j omega) is the mean of that sequence. For
N = 1 this is the transfer function; otherwise harmonics at multiples of 1/(N T) are left out
(Wereley and Hall 1990, 29th IEEE CDC, harmonic transfer functions, element 0, 0). Poles are exact:
the eigenvalues of the map over N ticks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, sparse
from scipy.optimize import brentq, minimize_scalar

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import did_you_mean
from uuvsim_cosim.orchestrator.analysis.system_map import SystemMap
from uuvsim_cosim.orchestrator.analysis.zero_gain import ZeroGain
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Margins", "OpenedLoop", "opened_loops"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
LOWEST = 1e-3  # rad/s, of the frequencies that are searched for margins
LOADED = (
    "Choose a working point with load: a current, as in --set hull.v_c=[0.3,0.2,0.3], or a time at "
    "which the vehicle moves (--at)"
)
PER_DECADE = 150
SLOW = 1e-4  # 1/s: filters have states that hardly forget
INVISIBLE = 1e-9  # share of the largest residue below which a pole is not of this loop


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop L; infinite if no crossing limits them.

    The loop is stable for a factor of L between `gain_down` and `gain_up`, for `phase` [rad] of lag
    more at the `crossover` [rad/s] that is nearest to instability, and for `delay` [s] more.
    `modulus` is the least |1 + L|, the inverse of the peak of the sensitivity. They apply to a
    loop that is stable when it is closed.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> roll = uuv.analyse("bluerov2_hold", "controller.tau_d[4]")[0]
    >>> roll.margins.phase > 0.5, roll.margins.gain_up > 2.0
    (True, True)
    """

    gain_down: float
    gain_up: float
    phase: float
    delay: float
    modulus: float
    crossover: float


@dataclass(frozen=True)
class OpenedLoop:
    """The loop that is opened at `signal`, with all others closed; `tick` is its sample time [s].

    `remark` states a dead band that makes an unstable loop of this working point doubtful.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> roll = uuv.analyse("bluerov2_hold", "controller.tau_d[4]")[0]
    >>> roll.signal, roll.unit, roll.tick, roll.period
    ('controller.tau_d[4]', 'N.m', 0.01, 2)
    >>> roll.stable
    True
    >>> abs(roll.response(100.0)[0]) < 1.0  # L at 100 rad/s
    True
    """

    signal: str
    unit: str
    tick: float
    steps: tuple[tuple[Any, Array, Array], ...]  # A_k, b_k and e_k over one period
    place: int  # of y in x
    remark: str = ""

    @property
    def period(self) -> int:
        """Return the number of ticks after which the linear system repeats."""
        return len(self.steps)

    @cached_property
    def _closed(self) -> list[Any]:
        """Return the matrices A_k with the loop closed."""
        closed = []
        for A, b, e in self.steps:
            of_y = sparse.csr_matrix(([1.0], ([0], [self.place])), shape=(1, len(b)))
            late = A + sparse.csr_matrix(b[:, None]) @ of_y
            closed.append((late + sparse.csr_matrix(e[:, None]) @ (of_y @ late)).tocsr())
        return closed

    def _over_a_period(self, matrices: Sequence[Any]) -> tuple[Array, Array, Array, Array]:
        """Return phi, X, R, D:  x_N = phi x_0 + X delta,  y_k = R_k x_0 + D_k delta.

        `delta` are the N + 1 values at the cut; `matrices` are A_k, of the opened or closed loop.
        """
        n, N = len(self.steps[0][1]), self.period
        phi, X = np.eye(n), np.zeros((n, N + 1))
        R, D = np.zeros((N, n)), np.zeros((N, N + 1))
        for k, (A, (_, b, e)) in enumerate(zip(matrices, self.steps, strict=True)):
            R[k], D[k] = phi[self.place], X[self.place]
            phi, X = A @ phi, A @ X
            X[:, k] += b
            X[:, k + 1] += e
        return phi, X, R, D

    @cached_property
    def _schur(self) -> tuple[Complex, Complex, Complex, Complex]:
        """Return T, Q* X, R Q and D, with phi = Q T Q*: T is triangular."""
        phi, X, R, D = self._over_a_period([A for A, _, _ in self.steps])
        T, Q = linalg.schur(phi, output="complex")
        return T, Q.conj().T @ X, R @ Q, D.astype(complex)

    def response(self, omega: ArrayLike) -> Complex:
        """Return L(j omega) at frequencies `omega` [rad/s] below pi / tick; negative feedback.

        Example:

        >>> import numpy as np
        >>> import uuvsim_cosim as uuv
        >>> heave = uuv.analyse("bluerov2_hold", "controller.tau_d[3]")[0]
        >>> decibels = 20 * np.log10(np.abs(heave.response([0.1, 1.0, 10.0])))
        >>> bool(np.all(np.diff(decibels) < 0))
        True
        """
        T, QX, RQ, D = self._schur
        N = self.period
        eye = np.eye(len(T))
        out = []
        for w in np.atleast_1d(np.asarray(omega, dtype=float)):
            E = np.exp(1j * w * self.tick * np.arange(N + 1))
            x = linalg.solve_triangular(E[N] * eye - T, QX @ E, check_finite=False)
            out.append(-np.mean((RQ @ x + D @ E) / E[:N]))
        return np.array(out)

    @cached_property
    def frequencies(self) -> Array:
        """Return the frequencies [rad/s] that margins are searched over, up to pi / tick."""
        high = 0.999 * np.pi / self.tick
        count = int(PER_DECADE * np.log10(high / LOWEST))
        return np.geomspace(LOWEST, high, count)

    @cached_property
    def open_poles(self) -> Complex:
        """Return the poles of the opened loop [1/s], ln(z) / (N T) of the poles z over a period."""
        return self._poles([A for A, _, _ in self.steps])

    @cached_property
    def closed_poles(self) -> Complex:
        """Return the poles of the closed loop [1/s] that this signal excites and contains."""
        return self._poles(self._closed)

    def _poles(self, matrices: Sequence[Any]) -> Complex:
        phi, X, R, _ = self._over_a_period(matrices)
        found: Any = linalg.eig(phi, left=True, right=True)
        values, left, right = found
        seen = np.linalg.norm(R @ right, axis=0) * np.linalg.norm(left.conj().T @ X, axis=1)
        z = values[(seen > INVISIBLE * seen.max()) & (np.abs(values) > 1e-12)]
        s: Complex = np.log(z.astype(complex)) / (self.period * self.tick)
        return s[np.argsort(-s.real)]

    @property
    def stable(self) -> bool:
        """Return whether no closed pole grows faster than 1e-4 1/s, which rounding can cause."""
        return bool(np.all(self.closed_poles.real < SLOW))

    @cached_property
    def margins(self) -> Margins:
        """Return the stability margins, found on `frequencies` and refined between them."""
        w, L = self.frequencies, self.response(self.frequencies)

        def at(omega: float) -> complex:
            return complex(self.response(omega)[0])

        def roots(values: Array, of: Any, where: Any = None) -> list[float]:
            changes = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
            if where is not None:
                changes = changes[where[changes]]
            return [float(brentq(of, w[i], w[i + 1], xtol=1e-9 * w[i])) for i in changes]

        crossings = roots(np.log(np.abs(L)), lambda o: np.log(abs(at(o))))
        lags = [(float(np.angle(-at(o))), o) for o in crossings]
        phase, crossover = min(((abs(a), o) for a, o in lags), default=(np.inf, np.nan))
        delays = [(a % (2 * np.pi)) / o for a, o in lags]
        gains = [1 / abs(at(o)) for o in roots(L.imag, lambda o: at(o).imag, L.real < 0)]
        i = int(np.argmin(np.abs(1 + L)))
        low, high = w[max(i - 1, 0)], w[min(i + 1, len(w) - 1)]
        best = minimize_scalar(lambda o: abs(1 + at(o)), bounds=(low, high), method="bounded")
        return Margins(
            gain_down=max((g for g in gains if g < 1), default=0.0),
            gain_up=min((g for g in gains if g > 1), default=np.inf),
            phase=phase,
            delay=min(delays, default=np.inf),
            modulus=float(min(best.fun, np.abs(1 + L).min())),
            crossover=crossover,
        )

    def step(self, seconds: float | None = None, *, closed: bool = True) -> tuple[Array, Array]:
        """Return times [s] and the response to a unit step at the signal.

        If `closed`, it is T = L / (1 + L), which goes to 1 with integral action; otherwise L. The
        default length is twenty times the inverse of the crossover frequency, at least 1 s.
        """
        if seconds is None:
            crossover = self.margins.crossover
            seconds = max(20.0 / crossover, 1.0) if np.isfinite(crossover) else 60.0
        if not 0 < seconds < float("inf"):
            raise InputInvalid("step response", f"{seconds} s", "more than 0")
        count = int(np.ceil(seconds / self.tick))
        x, y = np.zeros(len(self.steps[0][1])), np.zeros(count + 1)
        for k in range(count):
            A, b, e = self.steps[k % self.period]
            x = A @ x + b * (1.0 + closed * y[k])
            y[k + 1] = x[self.place]
            x = x + e * (1.0 + closed * y[k + 1])
        return np.arange(count + 1, dtype=float) * self.tick, -y


def opened_loops(
    system: System, signal: str, at: float = 20.0
) -> tuple[list[OpenedLoop], dict[str, str]]:
    """Return the loop at each element of a signal, opened alone, `at` seconds after the start.

    The second result is the reason for each element that has no loop, by its name. The signal is an
    output ("controller.tau_d": all its connections are cut), or an input ("hull.tau[3]": only its
    own connection). Raises InputInvalid if it does not exist, if it is not connected, or if no
    loop passes through any of its elements.
    """
    m = SystemMap(flatten(system), "analyse")
    names, links = _elements(m, signal)
    m.cut = tuple(n for of_element in links for n in of_element)
    first, x, u = m.trajectory(at)
    places = [m.links[of_element[0]].source for of_element in links]
    sums = np.zeros((len(m.cut), len(names)))  # which links belong to which element
    sums[np.arange(len(m.cut)), np.repeat(np.arange(len(names)), [len(e) for e in links])] = 1.0
    steps, points = [], []
    for k in range(first, first + m.period):
        j = m.jacobian(k, x, u)
        steps.append((j.A.tocsr(), j.late @ sums, j.early @ sums))
        points.append((k, x, j))
        x = m.advance(k, x, u)
    if any(np.any(early[places]) for _, _, early in steps):
        raise InputInvalid(
            f"analyse: elements of {signal} follow from each other in one step",
            f"one element, such as {names[0]}",
        )
    units = _units(m, places)
    zero_gain = ZeroGain(m, points, u)
    loops, without = [], {}
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        closed = _alone(steps, places, i)
        kept = _in_the_loop(closed, places[i])
        if len(kept):
            reduced = tuple((A[kept][:, kept], b[kept], e[kept]) for A, b, e in closed)
            place = int(np.searchsorted(kept, places[i]))
            loops.append(OpenedLoop(name, unit, float(m.plan.tick), reduced, place))
            continue
        reached = _influenced(closed)
        reached[places[i]] = True
        if ends := zero_gain.after(reached):
            without[name] = f"no gain after {at:g} s: {ends}. {LOADED}"
        else:
            without[name] = "it is in no loop"
    if not loops:
        raise InputInvalid(
            "analyse: " + "; ".join(f"{name}: {why}" for name, why in without.items()),
            "a signal that acts on itself",
        )
    if not all(loop.stable for loop in loops) and (found := zero_gain.beside()):
        remark = (
            f"after {at:g} s, {found}: a vehicle at rest oscillates about it with little thrust, "
            f"and the gain there is not that of the design. {LOADED}"
        )
        loops = [loop if loop.stable else replace(loop, remark=remark) for loop in loops]
    return loops, without


def _elements(m: SystemMap, signal: str) -> tuple[list[str], list[list[int]]]:
    """Return the names of a signal's elements and the links of each, which are cut."""
    found: dict[str, list[int]] = {}
    inputs = {
        (i, e): n for i, p in enumerate(m.parts) for e, n in enumerate(p.names("input"))
    }  # names by component and element
    for n, link in enumerate(m.links):
        for name in (m.names[link.source], inputs[link.target, link.element]):
            if name == signal or name.startswith(f"{signal}["):
                found.setdefault(name, []).append(n)
    if not found:
        known = sorted({m.names[link.source].partition("[")[0] for link in m.links})
        exists = any(
            n == signal or n.startswith(f"{signal}[") for n in [*m.names, *inputs.values()]
        )
        raise InputInvalid(
            f"analyse: {signal}",
            "is not connected"
            if exists
            else f"there is no such signal{did_you_mean(signal, known)}",
            "a connected output or input, such as " + ", ".join(known[:5]),
        )
    return list(found), list(found.values())


def _units(m: SystemMap, places: Sequence[int]) -> list[str]:
    """Return the unit of each place of the state."""
    units = []
    for place in places:
        part = next(p for p in m.parts if place < p.end)
        name = m.names[place].removeprefix(f"{part.path}.")
        variable = part.model.variables[name.partition("[")[0]]
        element = place - part.y_at - part.offset[variable.name]
        units.append(variable.units[element] if variable.units else variable.unit)
    return units


def _alone(
    steps: Sequence[tuple[Any, Array, Array]], places: Sequence[int], i: int
) -> list[tuple[Any, Array, Array]]:
    """Return the steps with element i opened and those of all other elements closed again."""
    others = [j for j in range(len(places)) if j != i]
    n = steps[0][0].shape[0]
    C = sparse.csr_matrix(
        (np.ones(len(others)), (np.arange(len(others)), [places[j] for j in others])),
        shape=(len(others), n),
    )
    closed = []
    for A, late, early in steps:
        back = sparse.csr_matrix(early[:, others]) @ C
        A_1 = A + sparse.csr_matrix(late[:, others]) @ C
        closed.append(((A_1 + back @ A_1).tocsr(), late[:, i] + back @ late[:, i], early[:, i]))
    return closed


def _in_the_loop(steps: Sequence[tuple[Any, Array, Array]], place: int) -> NDArray[np.int64]:
    """Return the states that depend on the cut signal and act on it, in order."""
    acts = np.zeros(steps[0][0].shape[0], dtype=bool)
    acts[place] = True
    both = _influenced(steps) & _spread(acts, _follows(steps).T)
    return np.flatnonzero(both) if both[place] else np.zeros(0, dtype=np.int64)


def _influenced(steps: Sequence[tuple[Any, Array, Array]]) -> NDArray[np.bool_]:
    """Return which states depend on the cut signal."""
    fed = np.any([(b != 0) | (e != 0) for _, b, e in steps], axis=0)
    return _spread(fed, _follows(steps))


def _follows(steps: Sequence[tuple[Any, Array, Array]]) -> Any:
    """Return which state (row) depends on which (column) in one of the steps."""
    n = steps[0][0].shape[0]
    return sum((abs(A) > 0 for A, _, _ in steps), sparse.csr_matrix((n, n), dtype=bool))


def _spread(seen: NDArray[np.bool_], graph: Any) -> NDArray[np.bool_]:
    while True:
        wider = seen | (graph @ seen)
        if np.array_equal(wider, seen):
            return seen
        seen = wider
