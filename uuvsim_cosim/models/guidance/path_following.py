"""Path following by line of sight: the bow steers the vehicle onto the path, without a clock.

With the path-tangential frame of a leg from A to B (course chi), the cross-track error is
y = -sin(chi) (N - N_A) + cos(chi) (E - E_A), and the wanted heading is

    LOS     psi_d = chi - atan(y / Delta)
    ILOS    psi_d = chi - atan((y + kappa y_i) / Delta),
            dy_i/dt = Delta y / (Delta² + (y + kappa y_i)²)
    ALOS    psi_d = chi - b - atan(y / Delta),
            db/dt = gamma Delta y / sqrt(Delta² + y²)

LOS leaves an offset in a current; ILOS and ALOS learn the crab angle that takes it away. Sources:
LOS Fossen 2021, 2nd ed., chapter 12; ILOS Borhaug, Pavlov and Pettersen 2008 (47th IEEE CDC); ALOS
Fossen 2023 (IEEE Trans. Control Systems Technology 31(6), 2887-2894).

Heading is followed with limited rate and acceleration. N and E of eta_d are the estimate's own:
nothing but the bow corrects y, as on a vehicle that cannot push sideways. Depth follows the leg;
at the end it holds station.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import atan2_or, clip, norm, saturate, wrap
from uuvsim_cosim.models.guidance.guidance import (
    declare_follower,
    declare_wanted,
    row_of,
    turn_rate,
)

__all__ = ["METHODS", "path_following"]

METHODS = ("los", "ilos", "alos")
FIGURES = {
    "speed": ("m/s", "wanted surge speed"),
    "acceleration": ("m/s2", "of the wanted speed"),
    "lookahead": ("m", "Delta, distance of the point on the path that the bow looks at"),
    "radius": ("m", "the next leg begins within it of a waypoint"),
    "r_max": ("rad/s", "largest yaw rate"),
    "r_dot_max": ("rad/s2", "largest yaw acceleration"),
    "kappa": ("m/s", "of the integral of ILOS"),
    "gamma": ("rad/(m.s)", "adaptation gain of ALOS"),
    "crab_max": ("1", "limit of what is learnt"),
}


def path_following(
    method: str = "alos",
    id: str = "path",
    period: str = "0.02",
    waypoints: Sequence[Sequence[float]] | None = None,
) -> Model:
    """Declare the guidance by a preset; `method` is los, ilos or alos."""
    if method not in METHODS:
        raise ParameterInvalid("path_following", f"method {method!r}", ", ".join(METHODS))
    p = preset("controllers", id, "path_following")
    m = Model("path_following", f"Path following along waypoints by {method.upper()}")
    eta, table, count, figure = declare_follower(m, p, FIGURES, waypoints)
    sample = m.clock("sample", period)
    T = float(sample.period)
    started = m.discrete("started", unit="1")
    index = m.discrete("index", unit="1", description="of the waypoint ahead, from 0")
    A_k = m.discrete("A", (0, 0, 0), unit="m", description="where the leg began")
    U_k = m.discrete("U", unit="m/s", description="wanted surge speed")
    psi_k = m.discrete("psi_d", unit="rad")
    r_k = m.discrete("r_d", unit="rad/s")
    learnt = m.discrete("learnt", unit="1", description="b of ALOS; kappa y_i / Delta of ILOS")
    done = m.discrete("done_held", unit="1")

    position, running, finished = eta[:3], started > 0.5, done > 0.5
    A = ca.if_else(running, A_k, position)
    psi_d = ca.if_else(running, psi_k, eta[5])
    B = row_of(table, index).T
    last = index >= count - 1
    leg = B - A
    L = norm(leg[:2])
    chi = ca.if_else(L > 0.1, atan2_or(leg[1], leg[0], psi_d), psi_d)
    offset = position - A
    x = ca.cos(chi) * offset[0] + ca.sin(chi) * offset[1]
    y = -ca.sin(chi) * offset[0] + ca.cos(chi) * offset[1]
    # The wanted heading, and the rate of what is learnt: kappa y_i / Delta of ILOS, b of ALOS.
    Delta = figure["lookahead"]
    wanted, rate = chi - ca.atan(y / Delta), ca.SX(0.0)
    if method == "ilos":
        total = y + Delta * learnt
        rate = figure["kappa"] * y / (Delta**2 + total**2)
        wanted = chi - ca.atan(total / Delta)
    elif method == "alos":
        rate = figure["gamma"] * Delta * y / ca.sqrt(Delta**2 + y**2)
        wanted = chi - learnt - ca.atan(y / Delta)
    turn = ca.if_else(L > 0.1, wrap(wanted - psi_d), 0.0)
    r = r_k + saturate(turn_rate(turn, figure) - r_k, T * figure["r_dot_max"])
    psi = wrap(psi_d + T * r)

    share = clip(x / ca.if_else(L > 0.1, L, 1.0), 0.0, 1.0)
    D_d = ca.if_else(L > 0.1, A[2] + share * leg[2], B[2])
    climb = ca.if_else(L > 0.1, leg[2] / ca.if_else(L > 0.1, L, 1.0), 0.0)
    goal = figure["speed"] * clip(ca.cos(turn), 0.0, 1.0)
    U = U_k + saturate(goal - U_k, T * figure["acceleration"])
    near = norm((B - position)[:2]) < figure["radius"]
    arrived = ca.logic_or(near, ca.logic_and(L > 0.1, x >= L))
    arrived = ca.logic_and(arrived, ca.fabs(B[2] - position[2]) < 4.0 * figure["radius"])
    onward = ca.logic_and(arrived, ca.logic_not(last))
    ends = ca.logic_or(finished, ca.logic_and(arrived, last))
    grown = ca.if_else(ca.fabs(turn) < 0.5, learnt + T * rate, learnt)  # not while it turns round

    m.update(sample, started, 1.0)
    m.update(sample, index, ca.if_else(onward, index + 1.0, index))
    m.update(sample, A_k, ca.if_else(onward, B, A))
    m.update(sample, U_k, ca.if_else(ends, 0.0, U))
    m.update(sample, psi_k, ca.if_else(ends, psi_d, psi))
    m.update(sample, r_k, ca.if_else(ends, 0.0, r))
    m.update(sample, learnt, ca.if_else(onward, 0.0, saturate(grown, figure["crab_max"])))
    m.update(sample, done, ca.if_else(ends, 1.0, 0.0))
    here = ca.vertcat(position[:2], D_d, 0, 0, psi)
    station = ca.vertcat(B, 0, 0, psi_d)
    nu_d = ca.vertcat(U, 0, climb * U, 0, 0, r)
    declare_wanted(
        m,
        sample,
        ca.if_else(ends, station, here),
        ca.if_else(ends, ca.SX.zeros(6), nu_d),
        index,
        done,
        y,
        "; N and E are the estimate's",
    )
    return m
