"""USBL: position fixes of a transponder on the hull, which arrive when sound has brought them.

The transponder replies at each tick of `ping`; its signal travels to the transceiver, and the
fix travels back, so it is shown 2 range / c later and carries the time of the reply. While one
fix is under way, the next ping is not answered: far away, fixes come less often.

In the frame of the line of sight, range has the deviation sigma_range, and both directions
across it range · sigma_angle. `sigma` holds the deviations of N, E, D.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model, Value
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import norm
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST
from uuvsim_cosim.models.sensors.sensor import hull_pose, output_when
from uuvsim_cosim.models.sensors.sensor_error import uniform
from uuvsim_cosim.models.water.seawater import sound_speed

__all__ = ["usbl"]


def usbl(id: str = "usbl_class", period: str = "1", publish_period: str = "0.01") -> Model:
    """Declare the USBL of a preset: one ping every `period` seconds."""
    p = preset("sensors", id, "usbl")
    m = Model("usbl", "Ultra-short baseline acoustic positioning with latency")
    eta, q = hull_pose(m)
    r = p.parameter(m, "r_s", "m", "transponder from CO", 3)
    p_t = p.parameter(m, "p_transceiver", "m", "in NED, known", 3)
    sigma_range = p.parameter(m, "sigma_range", "m", "noise of the range", min=0)
    sigma_angle = p.parameter(m, "sigma_angle", "rad", "noise of both angles", min=0)
    range_max = p.parameter(m, "range_max", "m", "no fix beyond it", min=0)
    lost = p.parameter(m, "dropout", "1", "by chance", min=0, max=1)
    T = p.parameter(m, "temperature", "degC", "of the water")
    S = p.parameter(m, "salinity", "1", "practical, of the water", min=0)
    c = m.derived("c", sound_speed(T, S, p_t[2]))

    ping = m.clock("ping", period)
    publish = m.clock("publish", publish_period)
    w = m.normal(ping, 3)
    line = eta[:3] + ca.mtimes(R(q), r) - p_t
    distance = norm(line)
    along = line / ca.if_else(distance > 1e-3, distance, 1.0)
    noise = w - along * ca.dot(along, w)  # across the line of sight, unit variance each way
    fix = p_t + line + sigma_range * ca.dot(along, w) * along + distance * sigma_angle * noise
    variance = sigma_range**2 * along**2 + (distance * sigma_angle) ** 2 * (1.0 - along**2)

    on_way = m.discrete("on_way", unit="1", description="1: a fix is under way")
    due = m.discrete("due", unit="s", description="when it arrives")
    reply = m.discrete("reply", unit="s", description="when the transponder replied")
    fix_on_way = m.discrete("fix_on_way", (0, 0, 0), unit="m")
    sigma_on_way = m.discrete("sigma_on_way", (0, 0, 0), unit="m")
    answered = ca.logic_and(on_way < 0.5, ca.logic_and(distance < range_max, distance > 1e-3))
    answered = ca.logic_and(answered, uniform(m, ping) >= lost)
    m.update(ping, on_way, ca.if_else(answered, 1.0, on_way))
    m.update(ping, due, ca.if_else(answered, m.t + 2.0 * distance / c, due))
    m.update(ping, reply, ca.if_else(answered, m.t, reply))
    m.update(ping, fix_on_way, ca.if_else(answered, fix, fix_on_way))
    m.update(ping, sigma_on_way, ca.if_else(answered, ca.sqrt(variance + 1e-12), sigma_on_way))

    arrived = ca.logic_and(on_way > 0.5, m.t >= due)
    m.update(publish, on_way, ca.if_else(arrived, 0.0, on_way))
    outputs: tuple[tuple[str, ca.SX, Value, str, str], ...] = (
        ("position", fix_on_way, (0, 0, 0), "m", "of the transponder in NED"),
        ("sigma", sigma_on_way, (0, 0, 0), "m", "deviations of N, E, D"),
        ("valid", ca.SX(1.0), 0.0, "1", "a fix has come"),
        ("t_sample", reply, BEFORE_FIRST, "s", "when the position held; -1 before the first fix"),
    )
    for name, value, start, unit, words in outputs:
        output_when(
            m, publish, arrived, name, value, unit=unit, start=start, description=words,
            type="Boolean" if name == "valid" else "Float64",
        )  # fmt: skip
    p.complete()
    return m
