"""Mounting pose of a sensor: its position on the hull and its orientation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["ON_CO", "Pose", "mounting"]


@dataclass(frozen=True)
class Pose:
    """Position from CO in `b` [m], and Euler angles phi, theta, psi from `b` to `s` [rad]."""

    r: Sequence[float]
    Theta: Sequence[float]


ON_CO = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def mounting(m: Model, pose: Pose, name: str = "s") -> tuple[ca.SX, ca.SX]:
    """Declare a pose as parameters; gives (r, R): position in `b`, rotation from `s` to `b`."""
    r = m.parameter(f"r_{name}", pose.r, unit="m", description="position from CO, body axes")
    Theta = m.parameter(
        f"Theta_{name}", pose.Theta, unit="rad", description="its axes: phi, theta, psi from b"
    )
    return r, m.derived(f"R_b{name}", R_zyx(Theta[0], Theta[1], Theta[2]))
