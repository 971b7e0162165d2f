"""Common parts of sensors: pose of the hull, mounting on it, and the outputs of a reading."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Clock, Model, Type, Value
from uuvsim_cosim.models.declaration.preset import Preset
from uuvsim_cosim.models.declaration.sampled import held_output, sample_time
from uuvsim_cosim.models.declaration.vectors import ETA

__all__ = ["hull_pose", "mounting", "output_when", "validity_and_time"]


def hull_pose(m: Model) -> tuple[ca.SX, ca.SX]:
    """Declare the inputs eta (6,) and q (4,): pose of the hull in `n`, and attitude b to n."""
    eta = m.input("eta", 6, unit=ETA, description="of the hull: N E D [m], phi theta psi [rad]")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    return eta, q


def mounting(
    m: Model, p: Preset, name: str = "s", r: Sequence[float] | None = None
) -> tuple[ca.SX, ca.SX]:
    """Declare the mounting of a preset (r_s, Theta_s); return r [m] in `b`, and R from `s` to `b`.

    `r` is the position from CO if the preset states none.
    """
    place = p.vector("r_s", "m", 3) if r is None else r
    r_s = m.parameter(f"r_{name}", place, unit="m", description="position from CO, body axes")
    Theta = m.parameter(
        f"Theta_{name}", p.vector("Theta_s", "rad", 3), unit="rad",
        description="its axes: phi, theta, psi from b",
    )  # fmt: skip
    return r_s, m.derived(f"R_b{name}", R_zyx(Theta[0], Theta[1], Theta[2]))


def validity_and_time(
    m: Model, clock: Clock, valid: Number = 1.0, description: str = "a reading is there"
) -> None:
    """Declare the outputs `valid` and `t_sample` of readings that are taken at a clock."""
    held_output(m, clock, "valid", valid, unit="1", type="Boolean", description=description)
    sample_time(m, clock)


def output_when(
    m: Model,
    clock: Clock,
    condition: ca.SX,
    name: str,
    value: ca.SX,
    *,
    unit: str,
    start: Value = 0.0,
    shape: tuple[int, ...] = (),
    type: Type = "Float64",
    description: str,
) -> None:
    """Declare an output that takes `value` at the ticks at which a condition holds."""
    held = m.discrete(f"{name}_held", start, shape, unit=unit)
    m.update(clock, held, ca.if_else(condition, value, held))
    m.output(name, held, unit=unit, type=type, description=description, discrete=True)
