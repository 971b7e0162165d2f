"""A link that carries samples with delay, noise and loss.

At sample k, x_k + sigma w_k is sent, and the sample of d samples ago arrives, where d is the delay
divided by the sample period, rounded up. The output is then the arrived sample, with the time at
which it was sent. If a sample is lost, the output keeps its value. Before the first arrival, the
output is the first sample, as if the sender had not moved before.
"""

from __future__ import annotations

import math
from fractions import Fraction

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import norm
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST
from uuvsim_cosim.models.sensors.sensor_error import uniform

__all__ = ["link"]

LARGEST = 256  # samples under way


def link(
    size: int | str = 3,
    unit: str = "m",
    period: str = "0.02",
    delay_max: str = "0.4",
    ranged: bool | str = False,
    id: str = "",
) -> Model:
    """Declare a link for `size` numbers; `delay` can be set up to `delay_max` [s].

    `unit` is one for all, or one for each, with commas between. A preset `id` gives the delay, the
    loss and the noise, the same of all numbers.

    With `ranged`, the transmitted value is a position, and the input `receiver` (3) is the position
    of the receiver: beyond `range_max` every sample is lost.
    """
    n = int(size)
    units = tuple(unit.split(",")) if "," in unit else (unit,) * n
    slots = math.ceil(Fraction(delay_max) / Fraction(period)) + 1
    if n < 1 or not 1 <= slots <= LARGEST:
        raise ParameterInvalid(
            "link",
            f"{n} numbers, delay_max {delay_max} s at a period of {period} s",
            f"at least 1, and at most {LARGEST - 1} samples under way",
        )
    sigma_0, delay_0, loss_0 = [0.0] * n, 0.0, 0.0  # a link that changes nothing
    if id:
        p = preset("sensors", id, "link")
        sigma_0 = [p.number("sigma", each) for each in units]
        delay_0, loss_0 = p.number("delay", "s"), p.number("loss", "1")
        p.complete()
    m = Model("link", "Link: delay, noise and loss")
    x = m.input("x", n, unit=units, description="what is sent")
    delay = m.parameter(
        "delay",
        delay_0,
        unit="s",
        min=0,
        max=float(Fraction(delay_max)),
        description="until it shows",
    )
    sigma = m.parameter(
        "sigma", sigma_0, unit=units, min=0, description="deviation of the noise of each number"
    )
    loss = m.parameter(
        "loss", loss_0, unit="1", min=0, max=1, description="probability of a sample"
    )
    sample = m.clock("sample", period)
    T = float(sample.period)
    age = m.derived("age", -ca.floor(1e-9 - delay / T))

    sent = x + sigma * m.normal(sample, n)
    heard = ca.if_else(uniform(m, sample) > loss, 1.0, 0.0)
    if is_on("ranged", ranged):
        receiver = m.input("receiver", 3, unit="m", description="its position")
        range_max = m.parameter("range_max", 100.0, unit="m", min=0, description="of the link")
        heard = ca.if_else(norm(x[:3] - receiver) > range_max, 0.0, heard)

    started = m.discrete("started", unit="1", description="0 before the first sample")
    running = started > 0.5
    y = m.discrete("y_held", (0.0,) * n, unit=units)
    t_held = m.discrete("t_held", BEFORE_FIRST, unit="s")
    first, t = ca.if_else(running, y, sent), ca.if_else(running, t_held, m.t)
    arriving: tuple[ca.SX, ...] = (sent, heard, m.t)
    line: list[tuple[ca.SX, ca.SX, ca.SX]] = []
    for i in range(1, slots):
        line.append(
            (
                m.discrete(f"x_{i}", (0.0,) * n, unit=units),
                m.discrete(f"heard_{i}", unit="1"),
                m.discrete(f"t_{i}", unit="s"),
            )
        )
        now = ca.fabs(age - i) < 0.5
        arriving = tuple(ca.if_else(now, a, b) for a, b in zip(line[-1], arriving, strict=True))
    lands = arriving[1] > 0.5
    m.update(sample, y, ca.if_else(lands, arriving[0], first))
    m.update(sample, t_held, ca.if_else(lands, arriving[2], t))
    m.update(sample, started, 1.0)
    newest = (sent, heard, m.t)
    for slot in line:
        for state, value in zip(slot, newest, strict=True):
            m.update(sample, state, value)
        newest = slot
    m.output("y", y, unit=units, discrete=True, description="what has arrived")
    m.output(
        "t_sample", t_held, unit="s", discrete=True, description="when it was sent; -1: not yet"
    )
    return m
