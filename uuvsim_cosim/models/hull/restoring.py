"""Restoring: weight and buoyancy about CO, and the loss of buoyancy as the hull leaves the water.

Fossen (2021), 2nd ed., section 4.1:  g = -(f_g + f_b, r_g x f_g + r_b x f_b).
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.kinematics import S
from uuvsim_cosim.models.declaration.safe_math import smoothstep

__all__ = ["g", "submerged_fraction"]


def g(W: Number, B: Number, r_g: ca.SX, r_b: ca.SX, down: ca.SX) -> ca.SX:
    """Return the restoring force [N, N.m] of weight W, buoyancy B [N] at r_g, r_b [m] from CO.

    `down` is the unit vector of gravity in `b`: the third row of R.
    """
    lever = W * ca.SX(r_g) - B * ca.SX(r_b)
    return -ca.vertcat((W - B) * down, ca.mtimes(S(lever), down))


def submerged_fraction(D: ca.SX, r_b: ca.SX, down: ca.SX, height: ca.SX) -> ca.SX:
    """Return the submerged part of the volume, C1 in the depth of the centre of buoyancy.

    It rises by a smooth step over the hull's height, from 0 where CB is height/2 above the
    surface to 1 where it is height/2 below. Simplified: r_b stays where it is, the water is
    flat, and added mass and damping stay those of the submerged hull.
    """
    depth = D + ca.dot(ca.densify(ca.SX(r_b)), down) if ca.SX(r_b).nnz() else D
    return smoothstep(depth / height + 0.5)
