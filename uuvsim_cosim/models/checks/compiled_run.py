"""A run of a model without sample clocks as one CasADi function: all its steps in one call.

The steps are those of `simulate` (RK4, inputs at start, middle and end), some ten times as fast.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import ceil
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["end_of", "outputs_by_name", "prepared", "rows_of"]

Array = NDArray[np.float64]


def prepared(
    model: Model, parameters: Mapping[str, ArrayLike] | None = None
) -> tuple[Evaluation, Array, Array, Array]:
    """Return a model's functions, its parameters, derived values and the state it starts from."""
    f = Evaluation(model)
    p = f.values_of("parameter", parameters or {})
    d = np.array(f.derived(p)).ravel()
    return f, p, d, np.array(f.initial(p, d)).ravel()


def end_of(
    model: Model,
    until: float,
    h: float,
    inputs: Mapping[str, ArrayLike],
    parameters: Mapping[str, ArrayLike] | None = None,
) -> dict[str, Array]:
    """Return the outputs at `until` [s], by RK4 of steps of at most h [s] from t = 0.

    For models without sample clocks. Raises ComponentFailed where a value is not finite.
    """
    f, p, d, start = prepared(model, parameters)
    u = f.values_of("input", inputs)
    n_x = sum(v.size for v in model.of_kind("state"))
    x_end, z = start[:n_x], start[n_x:]
    steps = ceil(until / h)
    if steps and n_x:
        x = ca.SX.sym("x", n_x)
        step = f.rk4.call([0.0, until / steps, u, u, u, p, d, x, z], True, False)[0]
        run = ca.Function("step", [x], [step]).fold(steps)
        x_end = np.array(run(x_end)).ravel()
    y = np.array(f.outputs(until, u, p, d, x_end, z)).reshape(1, -1)
    return {name: values[0] for name, values in _named(model, np.array([until]), y).items()}


def rows_of(
    model: Model,
    t: Array,
    h: float,
    inputs: Callable[[Array], Array],
    parameters: Mapping[str, ArrayLike] | None = None,
) -> dict[str, Array]:
    """Return the outputs at the times t (n,), each (n, size), by steps of at most h [s].

    `inputs` gives all inputs (m, size) at m times, in the order in which they are declared. Raises
    ComponentFailed where a value is not finite.
    """
    f, p, d, start = prepared(model, parameters)
    parts = np.maximum(np.ceil(np.round(np.diff(t) / h, 9)).astype(int), 1)
    length = np.repeat(np.diff(t) / parts, parts)
    begin = np.concatenate(
        [a + (b - a) * np.arange(n) / n for a, b, n in zip(t, t[1:], parts, strict=False)]
    )
    end = np.append(begin[1:], t[-1])
    u = [inputs(s).T for s in (begin, 0.5 * (begin + end), np.nextafter(end, begin))]
    x, w = ca.SX.sym("x", len(start)), [ca.SX.sym(f"u{i}", len(u[0])) for i in range(3)]
    s, h_s = ca.SX.sym("t"), ca.SX.sym("h")
    step = ca.Function(
        "step", [x, s, h_s, *w], [f.rk4.call([s, h_s, *w, p, d, x, []], True, False)[0]]
    )
    states = np.array(
        step.mapaccum(len(begin))(start, begin.reshape(1, -1), length.reshape(1, -1), *u)
    )
    states = np.column_stack([start, states[:, np.cumsum(parts) - 1]])
    outputs = f.outputs.map(len(t))(t.reshape(1, -1), inputs(t).T, p, d, states, [])
    return _named(model, t, np.array(outputs).T)


def _named(model: Model, t: Array, rows: Array) -> dict[str, Array]:
    finite = np.all(np.isfinite(rows), axis=1)
    if not np.all(finite):
        at = float(t[int(np.argmin(finite))])
        raise ComponentFailed(model.name, at, "a value is not finite")
    return {name: columns.T for name, columns in outputs_by_name(model, rows.T).items()}


def outputs_by_name(model: Model, y: Any) -> dict[str, Any]:
    """Return the rows of each output of all outputs y (size, ...), arrays or expressions."""
    values, at = {}, 0
    for v in model.of_kind("output"):
        values[v.name] = y[at : at + v.size]
        at += v.size
    return values
