"""Newton's method for an algebraic loop, by get and set in Initialization Mode.

With x the inputs inside the loop, y(x) the outputs, and T the transfers from outputs to inputs,
the residual is r(x) = T(y(x)) - x and the Jacobian dr/dx = T dy/dx - I. Derivatives are the
components' own where they provide them, else finite differences.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.errors import FmuError, LoopNotConverged
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.plan.plan import Transfer

__all__ = ["feedthrough", "is_singular", "solve_loop"]

_ITERATIONS = 50
_TOLERANCE = 1e-10  # of a residual, relative to 1 + |x|
_SINGULAR = 1e-7  # below it, finite differences cannot distinguish a singular value from 0
_FLOATS = ("Float64", "Float32")


@dataclass(frozen=True)
class _Link:
    """One scalar connection inside the loop: x[j] gets factor · output element + offset."""

    source: int
    output: Variable
    output_element: int
    target: int
    input: Variable
    input_element: int
    factor: float
    offset: float


def solve_loop(
    transfers: Sequence[Transfer], components: Sequence[Component], time: float
) -> list[Transfer]:
    """Make inputs and outputs agree, and return the transfers that are now set, those of floats.

    Components are in Initialization Mode. The search starts from the inputs' present values.
    Raises LoopNotConverged.
    """
    loop = _Loop(transfers, components, time)
    if loop.links:
        loop.solve()
    return [t for t in transfers if _links(t, components)]


def feedthrough(
    transfers: Sequence[Transfer], components: Sequence[Component], time: float
) -> tuple[np.ndarray, list[list[int]]]:
    """Return G = d(new x)/dx at the present values, and the rows of each transfer.

    x are the floating-point inputs that the transfers feed, element by element; new x are their
    values once the transfers are applied to the members' outputs. A transfer of other types has
    no rows.
    """
    loop = _Loop(transfers, components, time)
    rows: list[list[int]] = []
    n = 0
    for t in transfers:
        count = len(_links(t, components))
        rows.append(list(range(n, n + count)))
        n += count
    return loop.feedthrough(loop.present()), rows


def is_singular(matrix: np.ndarray) -> bool:
    """Return whether x = G x + b has no unique solution: the loop's gain is 1."""
    if not matrix.size:
        return False
    sizes = np.linalg.svd(np.eye(len(matrix)) - matrix, compute_uv=False)
    return bool(sizes[-1] <= _SINGULAR * max(1.0, float(sizes[0])))


class _Loop:
    """Scalar connections of a loop, and the search for inputs that agree with its outputs."""

    def __init__(
        self, transfers: Sequence[Transfer], components: Sequence[Component], time: float
    ) -> None:
        self.components = components
        self.time = time
        self.transfers = transfers
        self.links = [link for t in transfers for link in _links(t, components)]

    def solve(self) -> None:
        """Set the inputs to the solution; raises LoopNotConverged."""
        x = self._outputs(
            range(len(self.links))
        )  # if the cycle has no feedthrough, one pass around solves it
        self._set(x)
        best = self._residual(x)
        if not best.any():
            return
        for count in range(1, _ITERATIONS + 1):
            size = self._size(best, x)
            x_new, r_new = self._damped(x, self._newton_step(x, best), best)
            if x_new is None:
                if size <= _TOLERANCE:
                    self._set(x)
                    return
                raise self._not_converged(best, count)
            x, best = x_new, r_new
            if not best.any():
                return
        if self._size(best, x) > _TOLERANCE:
            raise self._not_converged(best, _ITERATIONS)

    def _damped(
        self, x: np.ndarray, step: np.ndarray, r: np.ndarray
    ) -> tuple[np.ndarray | None, np.ndarray]:
        """Return the first of x + step, x + step/2, … whose residual is smaller, else None."""
        norm = float(np.linalg.norm(r))
        for k in range(12):
            x_new = x + step * 0.5**k
            if not np.all(np.isfinite(x_new)):
                continue
            try:
                self._set(x_new)
                r_new = self._residual(x_new)
            except FmuError:  # outside the range of an input, or of the equations
                r_new = np.full(len(x), math.inf)
            if np.all(np.isfinite(r_new)) and float(np.linalg.norm(r_new)) < norm:
                return x_new, r_new
            if k == 0 and self._size(r, x) <= _TOLERANCE:
                break  # the residual is at the level of rounding
        self._set(x)
        return None, r

    def _size(self, r: np.ndarray, x: np.ndarray) -> float:
        return float(np.max(np.abs(r) / (1.0 + np.abs(x))))

    def _newton_step(self, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        jacobian = self._jacobian(x)
        try:
            step: np.ndarray = np.linalg.solve(jacobian, -r)
        except np.linalg.LinAlgError:  # the smallest step that minimizes the residual
            step = np.linalg.lstsq(jacobian, -r, rcond=None)[0]
        return step

    def _jacobian(self, x: np.ndarray) -> np.ndarray:
        jacobian: np.ndarray = self.feedthrough(x) - np.eye(len(self.links))
        return jacobian

    def present(self) -> np.ndarray:
        """Return the present values of the inputs."""
        read: dict[tuple[int, str], np.ndarray] = {}
        for link in self.links:
            value = self.components[link.target].get(link.input)
            read[link.target, link.input.name] = np.asarray(value, float).ravel()
        return np.array([read[k.target, k.input.name][k.input_element] for k in self.links])

    def feedthrough(self, x: np.ndarray) -> np.ndarray:
        """Return d(new inputs)/d(inputs), of the shape (number of links,) twice."""
        jacobian = np.zeros((len(self.links), len(self.links)))
        for i in sorted({link.target for link in self.links}):
            outputs = [k for k, link in enumerate(self.links) if link.source == i]
            inputs = [k for k, link in enumerate(self.links) if link.target == i]
            if not outputs:
                continue
            columns = self._own_derivatives(i, outputs, inputs)
            if columns is None:
                columns = self._differences(x, i, outputs, inputs)
            jacobian[np.ix_(outputs, inputs)] += columns
        return jacobian

    def _own_derivatives(self, i: int, outputs: list[int], inputs: list[int]) -> np.ndarray | None:
        """Return a component's d(transferred outputs)/d(inputs); None if it provides none."""
        component = self.components[i]
        if not component.description.provides_directional_derivatives:
            return None
        unknowns = list({self.links[k].output.name: self.links[k].output for k in outputs}.values())
        knowns = list({self.links[k].input.name: self.links[k].input for k in inputs}.values())
        rows, columns = _offsets(unknowns), _offsets(knowns)
        result = np.zeros((len(outputs), len(inputs)))
        for c, k in enumerate(inputs):
            seed = np.zeros(sum(v.size for v in knowns))
            seed[columns[self.links[k].input.name] + self.links[k].input_element] = 1.0
            given = np.asarray(component.directional_derivative(unknowns, knowns, seed))
            for r, m in enumerate(outputs):
                link = self.links[m]
                result[r, c] = link.factor * given[rows[link.output.name] + link.output_element]
        return result

    def _differences(
        self, x: np.ndarray, i: int, outputs: list[int], inputs: list[int]
    ) -> np.ndarray:
        """Return the same by finite differences; the inputs are `x` again afterwards."""
        result = np.zeros((len(outputs), len(inputs)))
        base = self._outputs(outputs)
        for c, k in enumerate(inputs):
            h = math.sqrt(np.finfo(float).eps) * (1.0 + abs(x[k]))
            moved = x.copy()
            moved[k] += h
            try:
                self._set(moved, only=i)
            except FmuError:  # outside the range of the input
                moved[k] = x[k] - h
                self._set(moved, only=i)
            result[:, c] = (self._outputs(outputs) - base) / (moved[k] - x[k])
        self._set(x, only=i)
        return result

    def _residual(self, x: np.ndarray) -> np.ndarray:
        r: np.ndarray = self._outputs(range(len(self.links))) - x
        return r

    def _outputs(self, which: Sequence[int] | range) -> np.ndarray:
        """Return the inputs of these links that follow from the present outputs, T(y(x))."""
        read: dict[tuple[int, str], np.ndarray] = {}
        values = np.zeros(len(which))
        for n, k in enumerate(which):
            link = self.links[k]
            key = (link.source, link.output.name)
            if key not in read:
                value = self.components[link.source].get(link.output)
                read[key] = np.asarray(value, float).ravel()
            value = float(read[key][link.output_element])
            exact = (link.factor, link.offset) == (1.0, 0.0)
            values[n] = value if exact else link.factor * value + link.offset
        return values

    def _set(self, x: np.ndarray, only: int | None = None) -> None:
        pending: dict[tuple[int, str], tuple[Variable, np.ndarray]] = {}
        for k, link in enumerate(self.links):
            if only is not None and link.target != only:
                continue
            key = (link.target, link.input.name)
            if key not in pending:
                present = np.array(self.components[link.target].get(link.input), float)
                pending[key] = (link.input, present.ravel())
            pending[key][1][link.input_element] = x[k]
        for (i, _), (v, flat) in pending.items():
            self.components[i].set(v, flat.reshape(v.shape) if v.shape else float(flat[0]))

    def _not_converged(self, r: np.ndarray, iterations: int) -> LoopNotConverged:
        hops = [
            f"{self.components[t.source].path}.{t.source_variable.name} -> "
            f"{self.components[t.target].path}.{t.target_variable.name}"
            for t in self.transfers
        ]
        try:
            singular = is_singular(self.feedthrough(self.present()))
        except (FmuError, np.linalg.LinAlgError):
            singular = False
        why = ", because the gain of the loop is 1" if singular else ""
        return LoopNotConverged(
            f"algebraic loop {', '.join(hops)}: no solution found at t = {self.time:.9g} s; "
            f"residual {float(np.max(np.abs(r))):.3g} after {iterations} iterations{why}; "
            "expected start values nearer to a solution, or a component without direct "
            "feedthrough (a state) in the loop"
        )


def _offsets(variables: Sequence[Variable]) -> dict[str, int]:
    offsets, at = {}, 0
    for v in variables:
        offsets[v.name] = at
        at += v.size
    return offsets


def _links(t: Transfer, components: Sequence[Component]) -> list[_Link]:
    """Return a transfer's scalar connections; none if its values are not floating-point."""
    output = components[t.source].description.variables[t.source_variable.name]
    input_ = components[t.target].description.variables[t.target_variable.name]
    if output.type not in _FLOATS or input_.type not in _FLOATS:
        return []
    return [
        _Link(t.source, output, a, t.target, input_, b, t.factor, t.offset)
        for a, b in zip(t.source_elements, t.target_elements, strict=True)
    ]
