"""Sample and hold: a value that is taken at the ticks of a clock and shown until the next."""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.model import Clock, Model, Type, Units, Value

__all__ = ["BEFORE_FIRST", "held_output", "only_when", "sample_time"]

BEFORE_FIRST = -1.0  # the sample time of a reading that has not been taken yet [s]


def held_output(
    m: Model,
    clock: Clock,
    name: str,
    value: Number,
    *,
    unit: Units,
    start: Value = 0.0,
    type: Type = "Float64",
    description: str = "",
) -> ca.SX:
    """Declare an output that takes `value` at each tick; return the discrete state behind it."""
    size = int(ca.SX(value).numel())
    shape: tuple[int, ...] = () if size == 1 else (size,)
    held = m.discrete(f"{name}_held", start, shape, unit=unit)
    m.update(clock, held, value)
    m.output(name, held, unit=unit, type=type, description=description, discrete=True)
    return held


def sample_time(m: Model, clock: Clock) -> ca.SX:
    """Declare the output `t_sample`: when the reading that is shown was taken."""
    return held_output(
        m,
        clock,
        "t_sample",
        m.t,
        unit="s",
        start=BEFORE_FIRST,
        description="when the reading was taken; -1 before the first",
    )


def only_when(clock: Clock, condition: ca.SX) -> None:
    """Make all updates of a clock so far happen only at the ticks at which a condition holds."""
    clock.updates[:] = [
        (declared, ca.if_else(condition, value, declared.symbol))
        for declared, value in clock.updates
    ]
