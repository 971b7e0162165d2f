"""LBL: ranges to beacons on the bottom, by the time that sound takes there and back.

The vehicle calls at a tick of `ping`; beacon i answers after its turnaround, and its reply is
there at t + 2 d_i / c + turnaround. When the last that will come has come, all ranges are shown:

    range_i = c_assumed / c · d_i + noise,

so that a wrong speed of sound stretches them all. The next call waits for that. The vehicle's way
between call and reply is left out. A reply is lost beyond its range, or by chance.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import norm
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST
from uuvsim_cosim.models.sensors.sensor import hull_pose, output_when
from uuvsim_cosim.models.sensors.sensor_error import uniform
from uuvsim_cosim.models.water.seawater import sound_speed

__all__ = ["lbl"]


def lbl(
    id: str = "lbl_class",
    beacons: int | str = 4,
    period: str = "2",
    publish_period: str = "0.01",
) -> Model:
    """Declare the LBL of a preset with this many beacons: one call every `period` seconds."""
    n = int(beacons)
    if not 1 <= n <= 16:
        raise ParameterInvalid("lbl", f"{n} beacons", "1 to 16")
    p = preset("sensors", id, "lbl")
    m = Model("lbl", "Long baseline acoustic ranges with latency")
    eta, q = hull_pose(m)
    r = p.parameter(m, "r_s", "m", "transducer from CO", 3)
    turn = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    circle = np.column_stack([100.0 * np.cos(turn), 100.0 * np.sin(turn), np.full(n, 25.0)])
    places = m.parameter("p_beacon", circle, unit="m", description="beacons in NED, one a row")
    words = {
        "sigma_range": ("m", "noise of a range"),
        "range_max": ("m", "no reply beyond it"),
        "turnaround": ("s", "of each beacon, between call and reply"),
        "dropout": ("1", "probability that a reply is lost"),
        "c_assumed": ("m/s", "speed of sound that ranges are computed with"),
    }
    sigma, high, turnaround, lost, c_assumed = p.parameters(m, words).values()
    T = m.parameter("temperature", 10.0, unit="degC", min=-2, max=40, description="of the water")
    S = m.parameter("salinity", 35.0, unit="1", min=0, max=42, description="of the water")
    c = m.derived("c", sound_speed(T, S, places[0, 2]))

    ping = m.clock("ping", period)
    publish = m.clock("publish", publish_period)
    place = eta[:3] + ca.mtimes(R(q), r)
    d = ca.vertcat(*(norm(places[i, :].T - place) for i in range(n)))
    heard = ca.logic_and(d < high, uniform(m, ping, n) > lost)
    back = ca.if_else(heard, 2.0 * d / c + turnaround, ca.SX.zeros(n))
    last = back[0]
    for i in range(1, n):
        last = ca.if_else(back[i] > last, back[i], last)

    on_way = m.discrete("on_way", unit="1", description="1: replies are under way")
    shape = () if n == 1 else (n,)
    states = (
        (m.discrete("called", unit="s", description="when it called"), m.t),
        (m.discrete("due", unit="s", description="when the last reply is there"), m.t + last),
        (
            m.discrete("range_on_way", 0.0, shape, unit="m"),
            d * (c_assumed / c) + sigma * m.normal(ping, n),
        ),
        (m.discrete("heard_on_way", 0.0, shape, unit="1"), ca.if_else(heard, ca.SX.ones(n), 0.0)),
    )
    call = on_way < 0.5
    for state, value in states:
        m.update(ping, state, ca.if_else(call, value, state))
    m.update(ping, on_way, 1.0)

    called, due, ranges, replied = (state for state, _ in states)
    arrived = ca.logic_and(on_way > 0.5, m.t >= due)
    m.update(publish, on_way, ca.if_else(arrived, 0.0, on_way))
    any_reply = ca.sum1(replied) > 0.5
    shown: tuple[tuple[str, ca.SX, ca.SX, float, str, str], ...] = (
        ("range", ranges, replied > 0.5, 0.0, "m", "to each beacon"),
        ("range_valid", replied, arrived, 0.0, "1", "1: it is of the last call"),
        ("valid", ca.if_else(any_reply, 1.0, 0.0), arrived, 0.0, "1", "a range of the last call"),
        ("t_sample", called, any_reply, BEFORE_FIRST, "s", "of the last call heard; -1 before"),
    )
    for name, value, condition, start, unit, text in shown:
        output_when(
            m, publish, ca.logic_and(arrived, condition), name, value, unit=unit, start=start,
            shape=() if name in ("valid", "t_sample") else shape, description=text,
            type="Boolean" if name == "valid" else "Float64",
        )  # fmt: skip
    p.complete()
    return m
