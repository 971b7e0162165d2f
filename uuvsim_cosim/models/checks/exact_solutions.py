"""The hull's equation where it has an exact solution: drag, thrust, a pendulum, a rising sphere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from uuvsim_cosim.models.checks.comparison import Checked, compared, reference_values
from uuvsim_cosim.models.checks.compiled_run import end_of
from uuvsim_cosim.models.hull.vehicle import hull

__all__ = ["solutions"]

INERT = {"W": 0.0, "B": 0.0, "I_b_11": 1.0, "I_b_22": 1.0, "I_b_33": 1.0}
EQUAL = partial(compared, "closed_form", "")


def solutions() -> Iterator[Checked]:
    """Yield each solution against RK4 of the equation that vehicles are simulated with."""
    values = reference_values("published_checks.yaml")
    braked, driven, swing, linear = values["closed_form_dynamics"]
    numbers = {"m": braked["m"], "D_q_11": braked["k"]}
    exact = braked["u0"] / (1 + braked["k"] * braked["u0"] * 10 / braked["m"])
    ours = _end(numbers, 10, nu_0=(braked["u0"], 0))["nu"][0]
    yield EQUAL("quadratic drag slows: u0 / (1 + k u0 t / m)", ours, exact, 1e-9)

    F, k, m = driven["F"], driven["k"], driven["m"]
    exact = np.sqrt(F / k) * np.tanh(5 * np.sqrt(F * k) / m)
    ours = _end({"m": m, "D_q_11": k}, 5, X=F)["nu"][0]
    yield EQUAL("thrust against drag: sqrt(F / k) tanh(t sqrt(F k) / m)", ours, exact, 1e-9)

    ours = _end({"m": 10.0, "D_l_11": 1.0}, 10, nu_0=(linear["v0"], 0))["nu"][0]
    yield EQUAL("linear drag slows exponentially", ours, linear["v0"] * np.exp(-1.0), 1e-9)

    body = {"m": 1.0, "W": swing["W"], "B": swing["W"], "z_b": -swing["h"]}
    body |= {f"I_b_{i}{i}": swing["I"] for i in (1, 2, 3)}
    period = 2 * np.pi * np.sqrt(swing["I"] / (swing["W"] * swing["h"]))
    ours = [_end(body, part * period, phi_0=1e-4)["eta"][3] for part in (0.25, 1.0)]
    yield EQUAL("a tilted hull swings as a pendulum", ours, [0.0, 1e-4], 1e-9)

    r, rho = 0.2, 1000.0
    added, drag = 2 / 3 * np.pi * rho * r**3, 0.25 * rho * np.pi * r**2
    m = 2 * added
    numbers = {"m": m, "W": 300.0, "B": 301.0, "D_q_33": drag}
    numbers |= {f"M_A_{i}{i}": added for i in (1, 2, 3)}
    last = np.sqrt(1 / drag)
    exact = -last * np.tanh(10 / ((m + added) * last))
    ours = _end(numbers, 10)["nu"][2]
    yield EQUAL("a sphere of 1 N net buoyancy rises from rest, after 10 s", ours, exact, 1e-9)

    known = values["rexrov_closed_form"]
    numbers = {"m": 1862.87, "D_l_11": 74.82, "D_q_11": 748.22}
    numbers |= {"D_l_33": 728.4, "D_q_33": 1821.01, "B": known["net_buoyancy_N"]}
    nu = _end(numbers, 60, X=1000.0)["nu"]
    theirs = [known["surge_1000N_mps"], -known["ascent_terminal_mps"]]
    what = "RexROV's balances: surge by 1000 N, ascent by its net buoyancy"
    yield EQUAL(what, nu[[0, 2]], theirs, 1e-6)


def _end(
    numbers: Mapping[str, float],
    until: float,
    X: float = 0.0,
    nu_0: Sequence[float] = (0.0, 0.0),
    phi_0: float = 0.0,
) -> Any:
    """Return the outputs of a hull in still water at `until` [s], by steps of 5 ms."""
    model = hull("body", INERT | dict(numbers), surface=False)
    start = {"nu_0": [*nu_0, 0, 0, 0, 0], "eta_0": [0, 0, 9, phi_0, 0, 0]}
    return end_of(model, until, 5e-3, {"tau": [X, 0, 0, 0, 0, 0]}, start)
