"""Other vehicles as a component sees them: capsules along their x axes, by inputs."""

from __future__ import annotations

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.vectors import ETA, NU
from uuvsim_cosim.models.worlds.rays import MOVERS

__all__ = ["declare_others"]


def declare_others(m: Model, others: int | str, *, moving: bool = False) -> ca.SX:
    """Declare the others' poses and sizes; gives the numbers of uuv_moving_, 10 for each.

    With `moving` there are inputs of their velocities too.
    """
    n = int(others)
    if not 0 <= n <= MOVERS:
        raise ParameterInvalid(m.name, f"others = {others}", f"0 to {MOVERS}")
    if not n:
        return ca.SX(0, 1)
    poses = [
        m.input(f"other_eta_{i}", 6, unit=ETA, description=f"of vehicle {i}: its hull's eta")
        for i in range(1, n + 1)
    ]
    rates = [
        m.input(f"other_nu_{i}", 6, unit=NU, description=f"of vehicle {i}: its hull's nu")
        if moving
        else ca.SX.zeros(6)
        for i in range(1, n + 1)
    ]
    size = m.parameter(
        "other_size",
        np.zeros((n, 2)),
        unit="m",
        min=0,
        description="of each: radius, and half the length between the ends; radius 0: none",
    )
    each = []
    for i, (eta, nu) in enumerate(zip(poses, rates, strict=True)):
        Rnb = R_zyx(eta[3], eta[4], eta[5])
        half = size[i, 1] * Rnb[:, 0]
        each.append(ca.vertcat(eta[:3], half, size[i, 0], ca.mtimes(Rnb, nu[:3])))
    return ca.vertcat(*each)
