"""Line-of-sight guidance: a reference point runs along the waypoints, and the bow follows the line.

The reference moves on the leg from A to B by its arc length s with a trapezoidal speed and slows to
`corner_speed` before each waypoint. It waits while the vehicle lags by `lag_max` and while the bow
turns. The next leg starts when the reference has reached B and the vehicle is within `radius` of B.
Heading is proportional line of sight (Fossen 2021, 2nd ed., chapter 12),

    psi_t = chi - atan(e / lookahead),   e = -sin(chi) (N - N_A) + cos(chi) (E - E_A),

followed with limited yaw rate and yaw acceleration. After the last waypoint, it holds station.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.safe_math import (
    abs_,
    atan2_or,
    clip,
    norm,
    safe_sqrt,
    saturate,
    wrap,
)
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import ETA, NU

__all__ = [
    "MAX_WAYPOINTS",
    "declare_follower",
    "declare_wanted",
    "guidance",
    "lawn_mower",
    "row_of",
    "turn_rate",
]

MAX_WAYPOINTS = 32
FIGURES = {
    "speed": ("m/s", "along the legs"),
    "corner_speed": ("m/s", "at a waypoint that is not the last"),
    "acceleration": ("m/s2", "of the reference"),
    "lookahead": ("m", "distance of the point on the line that the bow looks at"),
    "radius": ("m", "a waypoint counts as reached within it"),
    "lag_max": ("m", "the reference waits for a vehicle this far behind"),
    "r_max": ("rad/s", "largest yaw rate"),
    "r_dot_max": ("rad/s2", "largest yaw acceleration"),
}


def lawn_mower(
    length: float, spacing: float, legs: int, depth: float, start: Sequence[float] = (0.0, 0.0)
) -> list[tuple[float, float, float]]:
    """Return waypoints N E D of parallel legs northwards and back, shifted east by `spacing`."""
    points = []
    for i in range(legs):
        near, far = start[0], start[0] + length
        ends = (near, far) if i % 2 == 0 else (far, near)
        points += [(n, start[1] + i * spacing, depth) for n in ends]
    return points


def guidance(
    id: str = "survey",
    period: str = "0.02",
    waypoints: Sequence[Sequence[float]] | None = None,
) -> Model:
    """Declare the guidance of a preset; without waypoints, a lawn-mower pattern of four legs."""
    p = preset("controllers", id, "guidance")
    m = Model("guidance", "Line-of-sight guidance along waypoints")
    eta, table, count, figure = declare_follower(m, p, FIGURES, waypoints)
    sample = m.clock("sample", period)
    T = float(sample.period)
    started = m.discrete("started", unit="1")
    index = m.discrete("index", unit="1", description="of the waypoint ahead, from 0")
    A_k = m.discrete("A", (0, 0, 0), unit="m", description="where the leg began")
    s_k = m.discrete("s", unit="m", description="way of the reference along the leg")
    U_k = m.discrete("U", unit="m/s", description="speed of the reference")
    psi_k = m.discrete("psi_d", unit="rad")
    r_k = m.discrete("r_d", unit="rad/s")

    position, running = eta[:3], started > 0.5
    A = ca.if_else(running, A_k, position)
    psi_d = ca.if_else(running, psi_k, eta[5])
    B = row_of(table, index).T
    last = index >= count - 1
    leg = B - A
    L = norm(leg)
    along = leg / ca.if_else(L > 1e-6, L, 1.0)

    # Heading.
    level = norm(leg[:2]) > 0.1
    chi = ca.if_else(level, atan2_or(leg[1], leg[0], psi_d), psi_d)
    offset = position - A
    e = -ca.sin(chi) * offset[0] + ca.cos(chi) * offset[1]
    moving = clip(U_k / figure["speed"], 0.0, 1.0)
    wanted = chi - moving * ca.atan(e / figure["lookahead"])
    turn = ca.if_else(level, wrap(wanted - psi_d), 0.0)  # a leg straight down has no course
    r = r_k + saturate(turn_rate(turn, figure) - r_k, T * figure["r_dot_max"])
    psi = wrap(psi_d + T * r)

    # Way along the leg.
    lag = s_k - ca.dot(along, offset)
    waits = clip(2.0 - 2.0 * lag / figure["lag_max"], 0.0, 1.0)
    aligned = ca.if_else(level, clip(1.5 - abs_(turn) / 0.4, 0.0, 1.0), 1.0)
    U_end = ca.if_else(last, 0.0, figure["corner_speed"])
    brake = safe_sqrt(U_end**2 + 2.0 * figure["acceleration"] * (L - s_k))
    goal = figure["speed"] * waits * aligned
    U = U_k + saturate(ca.if_else(goal < brake, goal, brake) - U_k, T * figure["acceleration"])
    s = clip(s_k + T * U, 0.0, L)
    arrived = ca.logic_and(s >= L - 1e-6, norm(B - position) < figure["radius"])
    onward = ca.logic_and(arrived, ca.logic_not(last))

    m.update(sample, started, 1.0)
    m.update(sample, index, ca.if_else(onward, index + 1.0, index))
    m.update(sample, A_k, ca.if_else(onward, B, A))
    m.update(sample, s_k, ca.if_else(onward, 0.0, s))
    m.update(sample, U_k, ca.if_else(s >= L - 1e-6, ca.if_else(last, 0.0, U), U))
    m.update(sample, psi_k, psi)
    m.update(sample, r_k, r)

    done = m.discrete("done_held", unit="1")
    m.update(sample, done, ca.if_else(ca.logic_and(arrived, last), 1.0, done))
    v_n = along * ca.if_else(s >= L - 1e-6, 0.0, U)
    c, si = ca.cos(psi), ca.sin(psi)
    nu_d = ca.vertcat(c * v_n[0] + si * v_n[1], c * v_n[1] - si * v_n[0], v_n[2], 0, 0, r)
    declare_wanted(m, sample, ca.vertcat(A + along * s, 0, 0, psi), nu_d, index, done, e)
    return m


def declare_follower(
    m: Model,
    p: Preset,
    table: Mapping[str, tuple[str, str]],
    waypoints: Sequence[Sequence[float]] | None,
    eta_words: str = "estimate: N E D [m], phi theta psi [rad]",
) -> tuple[ca.SX, ca.SX, ca.SX, dict[str, ca.SX]]:
    """Declare the inputs and parameters of a guidance; return eta, waypoints, count, figures.

    Without waypoints, they are a lawn-mower pattern of four legs.
    """
    eta = m.input("eta", 6, unit=ETA, description=eta_words)
    m.input("nu", 6, unit=NU, description="unused: estimate [m/s, rad/s]")
    points = [list(map(float, w)) for w in waypoints or lawn_mower(20.0, 5.0, 4, 5.0)]
    if not 1 <= len(points) <= MAX_WAYPOINTS or any(len(w) != 3 for w in points):
        raise ParameterInvalid(
            m.name, f"{len(points)} waypoints", f"1 to {MAX_WAYPOINTS} of N, E, D"
        )
    rows = np.array(points + [points[-1]] * (MAX_WAYPOINTS - len(points)))
    words = "N E D, `count` rows are used"
    places = m.parameter("waypoints", rows, unit="m", description=words)
    count = m.parameter(
        "count", len(points), unit="1", type="Int32", min=1, max=MAX_WAYPOINTS,
        description="rows of waypoints in use",
    )  # fmt: skip
    return eta, places, count, p.parameters(m, table, min=1e-6)


def declare_wanted(
    m: Model,
    sample: Clock,
    eta_d: ca.SX,
    nu_d: ca.SX,
    index: ca.SX,
    done: ca.SX,
    cross_track: ca.SX | None = None,
    more: str = "",
) -> None:
    """Declare the outputs of a guidance: wanted pose and velocity, waypoint ahead, and `done`."""
    words = f"wanted N E D [m], phi theta psi [rad]{more}"
    held_output(m, sample, "eta_d", eta_d, unit=ETA, start=(0,) * 6, description=words)
    words = "wanted, in axes of eta_d [m/s, rad/s]"
    held_output(m, sample, "nu_d", nu_d, unit=NU, start=(0,) * 6, description=words)
    if cross_track is not None:
        words = "of the estimate, level"
        held_output(m, sample, "cross_track", cross_track, unit="m", description=words)
    m.output("waypoint", index + 1.0, unit="1", type="Int32", description="ahead, from 1")
    m.output("done", done, unit="1", type="Boolean", description="holds the last waypoint")


def row_of(table: ca.SX, index: ca.SX, first: int = 0) -> ca.SX:
    """Return the row of a whole number `index`, by halves: one selection a row, not three."""
    n = table.size1()
    if n == 1:
        return table
    low, high = table[: n // 2, :], table[n // 2 :, :]
    middle = first + n // 2
    return ca.if_else(index < middle, row_of(low, index, first), row_of(high, index, middle))


def turn_rate(turn: ca.SX, figure: dict[str, ca.SX]) -> ca.SX:
    """Return the yaw rate that can still be braked within `turn`, at most r_max."""
    size = abs_(turn)
    braking = safe_sqrt(figure["r_dot_max"] * size)
    gentle = ca.if_else(size < braking, size, braking)  # exponential close to the goal
    rate = ca.if_else(gentle < figure["r_max"], gentle, figure["r_max"])
    return ca.if_else(turn < 0, -rate, rate)
