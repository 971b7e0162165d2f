"""Model predictive control: the programme of `mpc_problem.py` solved anew at each sample.

Of the solution, N forces over N steps of h, the first is given; moved on by one step it is where
the next solution begins. What the nominal hull does not know of (a current, a fault) is the unknown
force b, learnt from what the last prediction got wrong,

    b <- b + b_gain M (nu - nu predicted) / h,      in n, its moment in b.

CasADi's sqpmethod with qrqp solves it, `iterations` steps from where it begins (a real-time
iteration); its C is CasADi's own. It is exported as an FMU, and is no part of a kernel.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.control.control_law import loop_inputs, nominal_matrices
from uuvsim_cosim.models.control.mpc_problem import ITERATIONS, programme, solver
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import saturate
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import NU, TAU, per
from uuvsim_cosim.models.intrinsics.optimiser import optimiser

__all__ = ["PRESET", "Q_UNITS", "S_UNITS", "mpc", "solution"]

PRESET = "bluerov2_mpc"
HUGE = 1e100
Q_UNITS = (*per("1/m", "1/rad"), *per("s/m", "s/rad"))
S_UNITS = per("1/N", "1/(N.m)")


def mpc(
    id: str = PRESET,
    vehicle: str = "bluerov2_heavy",
    N: int | str = 10,
    h: float | str = "0.1",
    iterations: int | str = ITERATIONS,
) -> Model:
    """Declare the law: N steps of h [s], which is the sample period as well."""
    p = preset("controllers", id, "controller")
    steps, tries = int(N), int(iterations)
    if not (1 <= steps <= 30 and 1 <= tries <= 10):
        raise InputInvalid(
            "mpc", f"N = {N}, iterations = {iterations}", "1 to 30 steps, 1 to 10 iterations"
        )
    m = Model("mpc", f"Model predictive control, {steps} steps of {float(h):g} s")
    eta_d, nu_d, eta, nu = loop_inputs(m)
    words = "square roots of the weights of errors, and of velocity errors"
    Q = p.parameter(m, "Q", Q_UNITS, words, 12, min=0)
    words = "square roots of the weights of a change of force from step to step"
    S = p.parameter(m, "S", S_UNITS, words, 6, min=0)
    tau_max = p.parameter(m, "tau_max", TAU, "limit of tau_d", 6, min=0)
    b_max = p.parameter(m, "b_max", TAU, "limit of b", 6, min=0)
    words = "share of a wrong prediction that is learnt at each sample"
    b_gain = p.parameter(m, "b_gain", "1", words, min=0, max=1)
    p.complete()
    sample = m.clock("sample", h)
    T = float(sample.period)
    started = m.discrete("started", unit="1")
    plan = m.discrete("plan", (0,) * 6 * steps, unit=TAU * steps, description="N forces")
    predicted = m.discrete("nu_predicted", (0,) * 6, unit=NU)
    before = m.discrete("tau_before", (0,) * 6, unit=TAU)
    b = m.discrete("b", (0,) * 6, unit=TAU, description="unknown force in n, its moment in b")

    R = R_zyx(eta[3], eta[4], eta[5])
    M = ca.DM(nominal_matrices(vehicle)["M"])
    wrong = b_gain * ca.mtimes(M, ca.if_else(started > 0.5, nu - predicted, ca.SX.zeros(6))) / T
    learnt = saturate(b + ca.vertcat(ca.mtimes(R, wrong[:3]), wrong[3:]), b_max)
    limit = ca.repmat(tau_max, steps, 1)
    guess = saturate(ca.vertcat(plan[6:], plan[-6:]), limit)
    data = ca.vertcat(eta, nu, eta_d, nu_d, learnt, before, Q, S)
    best, ahead, cost = solution(vehicle, steps, T, tries)(data, guess, tau_max)
    solved = cost < HUGE  # false for NaN as well
    found = ca.if_else(solved, best, guess)
    m.update(sample, started, solved)
    m.update(sample, plan, found)
    m.update(sample, predicted, ca.if_else(solved, ahead, nu))
    m.update(sample, before, found[:6])
    m.update(sample, b, learnt)
    words = "X Y Z [N], K M N [N.m]"
    held_output(m, sample, "tau_d", found[:6], unit=TAU, start=(0,) * 6, description=words)
    words = "1; 0: the prediction is not finite, the last plan goes on"
    held_output(m, sample, "solved", solved, unit="1", start=1.0, description=words)
    return m


@shared_until_changed
def solution(
    vehicle: str, N: int, h: float, iterations: int
) -> Callable[[ca.SX, ca.SX, ca.SX], list[ca.SX]]:
    """Return data (54), guess (6 N), tau_max (6)  ->  the N forces (6 N), nu after h (6), cost."""
    of = programme(vehicle, N, h)
    data, guess, limit = ca.MX.sym("p", 54), ca.MX.sym("guess", 6 * N), ca.MX.sym("tau_max", 6)
    bound = ca.repmat(limit, N, 1)
    solve = solver(of, iterations=iterations)
    answer = solve(x0=guess, p=data, lbx=-bound, ubx=bound)
    found, cost = answer["x"], answer["f"]
    ahead = of.step(data[:12], found[:6], data[24:30])[6:]
    numbers = [np.asarray(x, float).tobytes() for x in nominal_matrices(vehicle).values()]
    digest = hashlib.sha256(repr((N, h, iterations, numbers)).encode()).hexdigest()[:12]
    return optimiser(ca.Function(f"mpc_{digest}", [data, guess, limit], [found, ahead, cost]))
