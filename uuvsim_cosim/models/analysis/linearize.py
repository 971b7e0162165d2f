"""A declaration linearised at a point, as a `control.StateSpace` whose signals have names.

Continuous states:  dx/dt = A x + B u,  y = C x + D u  (deviations from the point), exact
derivatives by CasADi. A sampled law alone (a controller) becomes its discrete-time model, in
which y[k] is what the tick at k·T makes of u[k].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.operating_point import (
    Coordinates,
    OperatingPoint,
    place_of,
)
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.model import Kind, Model

if TYPE_CHECKING:
    import control

__all__ = ["linear_model", "state_space"]

Array = NDArray[np.float64]
At = Mapping[str, ArrayLike] | OperatingPoint | None


def linear_model(
    model: Model,
    at: At = None,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
) -> control.StateSpace:
    """Linearise a declaration at `at` (states and inputs by name; the rest at their start).

    `inputs` and `outputs` choose signals, whole (``tau``) or by element (``tau[1]``); all, if
    left out. States of a hull are N E D phi theta psi (``eta[1]`` …) and ``nu[1]`` …, SI and rad.
    Raises InputInvalid for a name that does not exist, and for a model that is continuous and
    sampled at once.
    """
    if isinstance(at, OperatingPoint) and parameters is None:
        parameters = at.parameters
    continuous, sampled = model.of_kind("state"), model.clocks
    if continuous and sampled:
        raise InputInvalid(
            "linearize",
            f"{model.name} is continuous and sampled at once",
            "one of either, or a system that holds it",
        )
    if sampled:
        return _sampled(model, at, inputs, outputs, parameters or {})
    c = Coordinates(model, parameters)
    x, u = c.point(at)
    f, jacobians = c.functions
    rates = np.array(f(x, u)[0]).ravel()
    if not np.all(np.isfinite(rates)):
        raise InputInvalid(f"linearize: {model.name}: the rates at the point are not finite")
    A, B, C, D = (np.array(j).reshape(n, m) for j, n, m in zip(
        jacobians(x, u),
        (len(x), len(x), len(c.outputs), len(c.outputs)),
        (len(x), len(u), len(x), len(u)), strict=True,
    ))  # fmt: skip
    return state_space(
        (A, B, C, D), c.states, c.inputs, c.outputs, model.name, inputs, outputs, dt=0
    )


def _sampled(
    model: Model,
    at: At,
    inputs: Sequence[str] | None,
    outputs: Sequence[str] | None,
    parameters: Mapping[str, ArrayLike],
) -> control.StateSpace:
    if len(model.clocks) > 1:
        raise InputInvalid("linearize", f"{model.name} has {len(model.clocks)} clocks", "one")
    f = Evaluation(model)
    p = f.values_of("parameter", parameters)
    d = np.array(f.derived(p)).ravel()
    z_0 = np.array(f.initial(p, d)).ravel()

    def names(kind: Kind) -> list[str]:
        return [n for v in model.of_kind(kind) for n in element_names(v.name, v.shape)]

    known = names("input")
    u_0 = f.values_of("input", {})
    if isinstance(at, OperatingPoint):
        at = {**at.states, **at.inputs}
    states = names("discrete")
    for name, value in (at or {}).items():
        places = place_of("state or input", name, [*states, *known], model.name)
        for place, number in zip(
            places, np.broadcast_to(np.asarray(value, dtype=float).ravel(), len(places)),
            strict=True,
        ):  # fmt: skip
            if place < len(z_0):
                z_0[place] = number
            else:
                u_0[place - len(z_0)] = number
    z, u = ca.SX.sym("z", len(z_0)), ca.SX.sym("u", len(u_0))
    none, w = ca.SX(0, 1), ca.SX.zeros(sum(x.numel() for x in model.clocks[0].draws))
    fixed = [ca.SX(ca.DM(v)) if len(v) else none for v in (p, d)]
    z_new = f.updates[0].call([0.0, u, *fixed, none, z, w], True, False)[0]
    y = f.outputs.call([0.0, u, *fixed, none, z_new], True, False)[0]
    j = ca.Function(
        "j", [z, u], [ca.densify(ca.jacobian(e, by)) for e in (z_new, y) for by in (z, u)]
    )
    matrices = tuple(np.array(m) for m in j(z_0, u_0))
    period = float(model.clocks[0].period)
    return state_space(
        matrices, states, known, names("output"), model.name, inputs, outputs, dt=period
    )


def state_space(
    matrices: tuple[Array, ...],
    states: list[str],
    inputs: list[str],
    outputs: list[str],
    name: str,
    chosen_inputs: Sequence[str] | None,
    chosen_outputs: Sequence[str] | None,
    dt: float,
) -> control.StateSpace:
    """Return the `control.StateSpace` of A, B, C, D with names, of the chosen signals.

    `control` allows no dots in names: ``hull.eta[1]`` becomes ``hull:eta[1]``.
    """
    import control

    A, B, C, D = matrices
    columns = _chosen("input", chosen_inputs, inputs, name)
    rows = _chosen("output", chosen_outputs, outputs, name)
    return control.StateSpace(
        A,
        B[:, columns],
        C[rows, :],
        D[np.ix_(rows, columns)],
        dt,
        states=[n.replace(".", ":") for n in states],
        inputs=[inputs[i].replace(".", ":") for i in columns],
        outputs=[outputs[i].replace(".", ":") for i in rows],
        name=name.replace(".", "_"),
        remove_useless_states=False,
    )


def _chosen(kind: str, chosen: Sequence[str] | None, known: list[str], where: str) -> list[int]:
    if chosen is None:
        return list(range(len(known)))
    if isinstance(chosen, str):
        chosen = [chosen]
    return [i for name in chosen for i in place_of(kind, name, known, f"linearize: {where}")]
