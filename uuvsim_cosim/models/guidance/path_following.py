"""Path following by line of sight: the bow steers the vehicle onto the path, without a clock.

With the path-tangential frame of a leg from A to B (course chi), the cross-track error is
y = -sin(chi) (N - N_A) + cos(chi) (E - E_A), and the wanted heading is

    LOS     psi_d = chi - atan(y / Delta)
    ILOS    psi_d = chi - atan((y + kappa y_i) / Delta),
            dy_i/dt = Delta y / (Delta² + (y + kappa y_i)²)
    ALOS    psi_d = chi - b - atan(y / Delta),
            db/dt = gamma Delta y / sqrt(Delta² + y²)

LOS has a steady offset in a current; ILOS and ALOS estimate the crab angle that removes it.
Sources: LOS Fossen 2021, 2nd ed., chapter 12; ILOS Borhaug, Pavlov and Pettersen 2008 (47th IEEE
CDC); ALOS Fossen 2023 (IEEE Trans. Control Systems Technology 31(6), 2887-2894).

Heading is followed with limited rate and acceleration. N and E of eta_d are those of the estimate:
only the heading corrects y, as on a vehicle without sway force. Depth follows the leg; at the end
the vehicle holds station, or it does what a vehicle without sway force can:

    end=loiter    circle around the last waypoint with `loiter_radius` R (clockwise if positive):
                  at the distance d, the course is the tangent, and y = R - d if clockwise
    end=repeat    go on to the first waypoint: a racetrack

With these, the speed starts at that of the vehicle and is kept while it turns. With
``altitude=true`` there are inputs `altitude` and `altitude_valid` of an altimeter, and the vehicle
follows the seabed at `altitude_d`, filtered with `T_altitude`, but never deeper than the leg.

With ``vertical=los`` the same method acts in the vertical plane. A leg that climbs at pi_v has the
error z = sin(pi_v) x + cos(pi_v) (D - D_A), positive below it, and the wanted flight path is, for
ALOS (the others as above),

    gamma_d = pi_v + b_v + atan(z / Delta),   db_v/dt = gamma Delta z / sqrt(Delta² + z²)

D of eta_d is then that of the estimate, and w of nu_d, which is dD/dt, is -U sin(gamma_d). Source:
Fossen and Aguiar 2024 (Automatica 163, 111556), with the angles of the flight path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import add, sub

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Clock, Model, is_on
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import atan2_or, clip, norm, saturate, wrap
from uuvsim_cosim.models.guidance.line_of_sight import (
    declare_follower,
    declare_wanted,
    row_of,
    turn_rate,
)

__all__ = ["METHODS", "path_following"]

METHODS = ("los", "ilos", "alos")
ENDS = ("station", "loiter", "repeat")
VERTICAL = ("leg", "los")
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
    end: str = "station",
    altitude: bool | str = False,
    vertical: str = "leg",
) -> Model:
    """Declare the guidance by a preset; `method` is los, ilos or alos.

    `end` (station, loiter, repeat) and `vertical` (leg, los) are explained in this module.
    """
    if method not in METHODS:
        raise ParameterInvalid("path_following", f"method {method!r}", ", ".join(METHODS))
    if end not in ENDS:
        raise ParameterInvalid("path_following", f"end {end!r}", ", ".join(ENDS))
    if vertical not in VERTICAL:
        raise ParameterInvalid("path_following", f"vertical {vertical!r}", ", ".join(VERTICAL))
    if vertical == "los" and is_on("altitude", altitude):
        raise ParameterInvalid("path_following", "vertical=los with altitude=true", "one of them")
    flies = end != "station"
    p = preset("controllers", id, "path_following")
    m = Model("path_following", f"Path following along waypoints by {method.upper()}")
    eta, table, count, figure = declare_follower(m, p, FIGURES, waypoints)
    nu = m.variables["nu"].symbol
    R: ca.SX | None = None
    if end == "loiter":
        R = m.parameter("loiter_radius", 20.0, unit="m", description="clockwise if positive")
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
    offset_B, circling = position - B, ca.logic_and(finished, last)
    if R is not None:  # the circle's tangent, and the distance to its left
        side = ca.if_else(R < 0, -1.0, 1.0)
        bearing = atan2_or(offset_B[1], offset_B[0], psi_d)
        chi = ca.if_else(circling, bearing + side * 0.5 * np.pi, chi)
        y = ca.if_else(circling, side * (ca.fabs(R) - norm(offset_B[:2])), y)
    corrections, rate = _line_of_sight(method, y, learnt, figure)
    wanted = reduce(sub, corrections, chi)
    has_course = ca.logic_or(L > 0.1, circling) if flies else L > 0.1
    turn = ca.if_else(has_course, wrap(wanted - psi_d), 0.0)
    r = r_k + saturate(turn_rate(turn, figure) - r_k, T * figure["r_dot_max"])
    psi = wrap(psi_d + T * r)

    share = clip(x / ca.if_else(L > 0.1, L, 1.0), 0.0, 1.0)
    D_d = ca.if_else(L > 0.1, A[2] + share * leg[2], B[2])
    climb = ca.if_else(L > 0.1, leg[2] / ca.if_else(L > 0.1, L, 1.0), 0.0)
    goal, U_0 = figure["speed"] * clip(ca.cos(turn), 0.0, 1.0), U_k
    if flies:  # fins need speed
        goal, U_0 = figure["speed"], ca.if_else(running, U_k, clip(nu[0], 0.0, figure["speed"]))
    U = U_0 + saturate(goal - U_0, T * figure["acceleration"])
    near = norm((B - position)[:2]) < figure["radius"]
    if R is not None:
        near = ca.logic_or(near, ca.logic_and(last, norm(offset_B[:2]) < ca.fabs(R)))
    arrived = ca.logic_or(near, ca.logic_and(L > 0.1, x >= L))
    arrived = ca.logic_and(arrived, ca.fabs(B[2] - position[2]) < 4.0 * figure["radius"])
    onward = arrived if end == "repeat" else ca.logic_and(arrived, ca.logic_not(last))
    ends = ca.logic_or(finished, ca.logic_and(arrived, last))
    holds = ca.SX(0.0) if flies else ends
    following = ca.if_else(last, 0.0, index + 1.0) if end == "repeat" else index + 1.0
    grown = ca.if_else(ca.fabs(turn) < 0.5, learnt + T * rate, learnt)  # not while it turns round

    m.update(sample, started, 1.0)
    m.update(sample, index, ca.if_else(onward, following, index))
    m.update(sample, A_k, ca.if_else(onward, B, A))
    m.update(sample, U_k, ca.if_else(holds, 0.0, U))
    m.update(sample, psi_k, ca.if_else(holds, psi_d, psi))
    m.update(sample, r_k, ca.if_else(holds, 0.0, r))
    m.update(sample, learnt, ca.if_else(onward, 0.0, saturate(grown, figure["crab_max"])))
    m.update(sample, done, ca.SX(0.0) if end == "repeat" else ca.if_else(ends, 1.0, 0.0))
    if R is not None:
        D_d, climb = ca.if_else(circling, B[2], D_d), ca.if_else(circling, 0.0, climb)
    sink = climb * U
    if vertical == "los":
        # `climb` is positive downwards; on a circle and beyond the last waypoint it is 0.
        learnt_v = m.discrete("learnt_vertical", unit="1", description="as learnt, of the climb")
        pi_v = ca.atan(-climb)
        z = ca.cos(pi_v) * (position[2] - D_d)
        corrections_v, rate_v = _line_of_sight(method, z, learnt_v, figure)
        grown_v = saturate(learnt_v + T * rate_v, figure["crab_max"])
        m.update(sample, learnt_v, ca.if_else(onward, 0.0, grown_v))
        D_d, sink = position[2], -U * ca.sin(reduce(add, corrections_v, pi_v))
    if is_on("altitude", altitude):
        D_d, climb = _above_seabed(m, sample, position[2], D_d, climb)
        sink = climb * U
    here = ca.vertcat(position[:2], D_d, 0, 0, psi)
    station = ca.vertcat(B, 0, 0, psi_d)
    nu_d = ca.vertcat(U, 0, sink, 0, 0, r)
    declare_wanted(
        m,
        sample,
        ca.if_else(holds, station, here),
        ca.if_else(holds, ca.SX.zeros(6), nu_d),
        index,
        done,
        y,
        "; N and E are the estimate's",
    )
    return m


def _line_of_sight(
    method: str, y: ca.SX, learnt: ca.SX, figure: Mapping[str, ca.SX]
) -> tuple[list[ca.SX], ca.SX]:
    """Return the angles towards the path for the error y, and the rate of what is learnt.

    What is learnt is kappa y_i / Delta of ILOS, b of ALOS, and nothing of LOS.
    """
    Delta = figure["lookahead"]
    if method == "ilos":
        total = y + Delta * learnt
        return [ca.atan(total / Delta)], figure["kappa"] * y / (Delta**2 + total**2)
    if method == "alos":
        rate = figure["gamma"] * Delta * y / ca.sqrt(Delta**2 + y**2)
        return [learnt, ca.atan(y / Delta)], rate
    return [ca.atan(y / Delta)], ca.SX(0.0)


def _above_seabed(
    m: Model, sample: Clock, depth: ca.SX, leg: ca.SX, climb: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return the wanted depth at `altitude_d` above the seabed, at most that of the leg, and climb.

    The depth of the seabed is that of the last valid reading, through a first-order lag.
    """
    altitude = m.input("altitude", unit="m", description="above the seabed, of an altimeter")
    valid = m.input("altitude_valid", type="Boolean", unit="1", description="of the reading")
    wanted = m.parameter("altitude_d", 10.0, unit="m", min=0.1, description="above the seabed")
    lag = m.parameter("T_altitude", 2.0, unit="s", min=1e-3, description="of the seabed's depth")
    known = m.discrete("seabed_known", unit="1")
    seabed = m.discrete("seabed", unit="m", description="depth of the seabed")
    T = float(sample.period)
    read, seen = depth + altitude, valid > 0.5
    filtered = ca.if_else(known > 0.5, seabed + T / (T + lag) * (read - seabed), read)
    below = ca.if_else(seen, filtered, seabed)
    known_now = ca.logic_or(known > 0.5, seen)
    m.update(sample, seabed, below)
    m.update(sample, known, ca.if_else(known_now, 1.0, 0.0))
    shallow = ca.logic_and(known_now, below - wanted < leg)
    return ca.if_else(shallow, below - wanted, leg), ca.if_else(shallow, 0.0, climb)
