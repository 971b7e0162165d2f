"""A declaration linearised at a point, as a `control.StateSpace` whose signals have names.

Continuous states:  dx/dt = A x + B u,  y = C x + D u  (deviations from the point), exact
derivatives by CasADi. A sampled law alone (a controller) becomes a discrete-time model, in which
y[k] is the output of the tick at k·T for the input u[k].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.operating_point import (
    Coordinates,
    OperatingPoint,
    place_of,
)
from uuvsim_cosim.models.declaration.model import Model

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
    if model.of_kind("state") and model.clocks:
        raise InputInvalid(
            "linearize",
            f"{model.name} is continuous and sampled at once",
            "one of either, or a system that holds it",
        )
    if len(model.clocks) > 1:
        raise InputInvalid("linearize", f"{model.name} has {len(model.clocks)} clocks", "one")
    c = Coordinates(model, parameters)
    x, u = c.point(at)
    f, jacobians = c.functions
    if not model.clocks and not np.all(np.isfinite(np.array(f(x, u)[0]))):
        raise InputInvalid(f"linearize: {model.name}: the rates at the point are not finite")
    rows, columns = (len(x), len(c.outputs)), (len(x), len(u))
    matrices = tuple(
        np.array(j).reshape(shape)
        for j, shape in zip(jacobians(x, u), product(rows, columns), strict=True)
    )
    dt = float(model.clocks[0].period) if model.clocks else 0
    return state_space(matrices, c.states, c.inputs, c.outputs, model.name, inputs, outputs, dt=dt)


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
