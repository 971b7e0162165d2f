"""Trim: the states and inputs at which a model is in equilibrium.

In  0 = f(x, u),  the unknowns are the elements of x and u that are not given, except those on which
no equation depends. A hull may move: the rates of N, E and psi are free, so that trim can be
computed for a speed or a steady turn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.operating_point import Coordinates, OperatingPoint, place_of
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["trim_model"]

Array = NDArray[np.float64]
TOLERANCE = 1e-9  # of a rate, SI units
MOVING = ("eta[1]", "eta[2]", "eta[6]")  # of a hull: N, E, psi


def trim_model(
    model: Model,
    fixed: Mapping[str, ArrayLike] | None = None,
    *,
    free: Sequence[str] = (),
    moving: Sequence[str] | None = None,
    guess: Mapping[str, ArrayLike] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
) -> OperatingPoint:
    """Find the equilibrium at which `fixed` holds, by changing states and the inputs in `free`.

    `fixed` holds states (``{"nu[1]": 1.5}``, SI and rad) and inputs; inputs that are neither
    fixed nor free keep their start value. `moving` names states whose rates may be anything, by
    default N, E and psi of a hull. Of many solutions that nearest to `guess` is given. Raises
    InputInvalid, with the rates that stay, where there is none nearby.
    """
    if model.clocks:
        raise InputInvalid("trim", f"{model.name} is sampled", "continuous states alone")
    c = Coordinates(model, parameters)
    if not c.states:
        raise InputInvalid("trim", f"{model.name} has no states", "some")
    fixed = dict(fixed or {})
    x_0, u_0 = c.point({**(guess or {}), **fixed})
    known = [*c.states, *c.inputs]
    fixed_places, free_places = (
        [i for n in names for i in place_of("state or input", n, known, model.name)]
        for names in (fixed, free)
    )
    if moving is None:
        moving = MOVING if c.hull else ()
    resting = sorted(
        set(range(len(c.states)))
        - {i for n in moving for i in place_of("state", n, c.states, model.name)}
    )
    x, u, rates, _ = c.symbols
    sparsity = ca.jacobian_sparsity(rates[resting], ca.vertcat(x, u))
    depends = np.any(np.array(ca.DM(sparsity, 1)) != 0, axis=0).tolist()
    unknown = sorted(
        {i for i in range(len(known)) if depends[i] and (i < len(x_0) or i in free_places)}
        - set(fixed_places)
    )
    both = ca.vertcat(x, u)
    f = ca.Function("f", [both], [rates[resting]])
    J = ca.Function("J", [both], [ca.densify(ca.jacobian(rates[resting], both))])
    start = np.concatenate([x_0, u_0])
    found, residual = _solved(f, J, start, unknown)
    worst = np.array(f(found)).ravel()
    if not residual <= TOLERANCE * max(1.0, float(np.max(np.abs(found)))):
        largest = sorted(zip(np.abs(worst), (c.states[i] for i in resting), strict=True))[:-4:-1]
        rest = ", ".join(f"d{n}/dt = {r:.3g}" for r, n in largest if r > TOLERANCE)
        raise InputInvalid(
            "trim",
            (
                f"{model.name} has no equilibrium near the guess: {rest} remain; "
                f"unknown were {', '.join(known[i] for i in unknown) or 'none'}"
            ),
            "more in `free`, other values in `fixed`, or another guess",
        )
    n = len(x_0)
    return c.named(found[:n], found[n:], parameters=dict(parameters or {}), residual=residual)


def _solved(
    f: ca.Function, J: ca.Function, start: Array, unknown: list[int]
) -> tuple[Array, float]:
    """Return the nearest point that least squares finds from the start, and its largest rate."""
    from scipy.optimize import least_squares

    def at(v: Array) -> Array:
        full = start.copy()
        full[unknown] = v
        return full

    def rates(v: Array) -> Array:
        return np.array(f(at(v))).ravel()

    def slopes(v: Array) -> Array:
        return np.array(J(at(v)))[:, unknown]

    if unknown:
        result = least_squares(
            rates,
            start[unknown],
            jac=slopes,
            method="trf",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=400,
        )
        start = at(result.x)
    return start, float(np.max(np.abs(np.array(f(start)).ravel()), initial=0.0))
