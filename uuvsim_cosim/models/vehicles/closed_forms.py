"""Closed-form checks of a hull's parameters: mass, energy and balance, each as one deviation.

A hull is checked as a whole, by the equations that it is simulated with:

* M is symmetric and positive definite (its symmetric part; else added mass would add energy);
* no principal moment of inertia about CG exceeds the sum of the other two;
* without weight and tau, nu' M nu_dot <= 0: damping removes energy and Coriolis does no work;
* at level attitude, weight and buoyancy make no moment; at a tilt, they restore the attitude;
* weight is close to the weight of the displaced water.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.inertia import rigid_mass
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["ClosedForm", "closed_forms", "total_mass"]

Array = NDArray[np.float64]
SAMPLES = 4000
SPAN = np.array([2.0, 0.7, 0.7, 0.5, 0.5, 0.5])  # m/s and rad/s, of velocities tried


@dataclass(frozen=True)
class ClosedForm:
    """One claim: how far off it is, and what is allowed."""

    name: str
    off: float
    tolerance: float


def closed_forms(model: Model) -> Iterator[ClosedForm]:
    """Yield each claim for a hull; `off` is relative, 0 where it holds exactly."""
    M = total_mass(model)
    size = np.sqrt(np.maximum(np.abs(np.diag(M)), 1e-12))
    scale = np.outer(size, size)
    yield ClosedForm("M is symmetric", float(np.max(np.abs(M - M.T) / scale)), 1e-9)
    values = np.linalg.eigvalsh(0.5 * (M + M.T) / scale)
    yield ClosedForm("M is positive definite", max(0.0, 1e-6 - float(values[0])), 0.0)
    numbers = {v.name: float(v.start[0]) for v in model.of_kind("parameter") if len(v.start) == 1}
    M_RB = np.array(ca.evalf(ca.densify(ca.SX(rigid_mass(numbers)))))
    about_CG = M_RB[3:, 3:] - M_RB[3:, :3] @ M_RB[:3, 3:] / M_RB[0, 0]
    moments = np.linalg.eigvalsh(0.5 * (about_CG + about_CG.T))
    beyond = moments[2] / max(moments[0] + moments[1], 1e-12) - 1.0
    yield ClosedForm("inertia is of a body", float(max(0.0, beyond)), 1e-9)
    yield ClosedForm("water takes energy only", _energy_gained(model, M), 1e-9)
    n = defaultdict(float, numbers)  # a parameter that is not there is 0
    W, B = n["W"], n["B"]
    if "W" not in numbers:
        W, B = n["m"] * n["g"], n["rho"] * n["g"] * n["nabla"]
    lever = [W * n[f"{a}_g"] - B * n[f"{a}_b"] for a in "xyz"]
    yield ClosedForm("level is neutral", float(np.hypot(lever[0], lever[1])) / max(W, 1e-9), 1e-3)
    yield ClosedForm("upright is stable", max(0.0, -float(lever[2])), 0.0)
    yield ClosedForm("weight is near buoyancy", abs(B - W) / W, 0.03)


def total_mass(model: Model) -> Array:
    """Return M (6, 6) of a hull at its start values."""
    f = Evaluation(model)
    p = ca.vertcat(*(v.symbol for v in model.of_kind("parameter")))
    M = ca.Function("M", [p], [ca.densify(model.variables["M"].start)])
    return np.array(M(f.values_of("parameter", {})))


def _energy_gained(model: Model, M: Array) -> float:
    """Return the largest power that a moving hull gets from still water, over what turns over."""
    f = Evaluation(model)
    weightless: dict[str, float] = {n: 0.0 for n in ("W", "B", "g") if n in model.variables}
    p = f.values_of("parameter", weightless)
    d = np.array(f.derived(p)).ravel()
    x = np.array(f.initial(p, d)).ravel()
    random = np.random.default_rng(1)
    nu = random.uniform(-1.0, 1.0, (SAMPLES, 6)) * SPAN
    nu[: SAMPLES // 2, 0] = np.abs(nu[: SAMPLES // 2, 0])
    states = np.repeat(x[:, None], SAMPLES, axis=1)
    states[7:13] = nu.T
    u = f.values_of("input", {})
    rates = np.array(f.rhs.map(SAMPLES)(0.0, u, p, d, states, np.zeros((0, SAMPLES))))
    force = M @ rates[7:13]
    power = np.sum(nu.T * force, axis=0)
    turned = np.sum(np.abs(nu.T * force), axis=0)
    return float(max(0.0, np.max(power / np.maximum(turned, 1e-12))))
