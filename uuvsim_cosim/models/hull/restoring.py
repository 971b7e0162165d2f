"""Restoring: weight and buoyancy about CO, and the loss of buoyancy as the hull leaves the water.

Fossen (2021), 2nd ed., section 4.1:  g = -(f_g + f_b, r_g x f_g + r_b x f_b).

With volumes (`floating`), buoyancy through the surface is exact for ellipsoids, cylinders and boxes
at any attitude. The flat surface cuts a volume V whose centre is at depth D. With X the depth of
its points relative to D, the energy of the displaced water is  rho g V U,  with  U = E[(D + X)_+],
the mean depth of the points below the surface. Buoyancy and its moment about CO are the gradient,

    f = -B dU/dD down,   m = -B dU/d(down) x down,   dU/dD the share that is under water,

so they are continuous in depth and attitude, and conserve energy. E has a closed form:

* ellipsoid: X is H times the X of a unit ball, with H² = sum (h_i down_i)²;
* box: X is the sum of three uniform variables with half-widths w_i = h_i |down_i|;
* cylinder: X is the sum of a uniform variable along its axis and a semicircle's across it.

Half-widths are kept above 1 % of h: if a face is level, its corners are rounded by this amount.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import pi

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.kinematics import S
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip, smoothstep
from uuvsim_cosim.models.shapes.volumes import Volume

__all__ = ["floating", "g", "mean_depth", "submerged_fraction"]


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


ROUNDED = 0.01


def floating(
    m: Model, volumes: Sequence[Volume], r_b: ca.SX, depth: ca.SX, down: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Declare the volumes; return the share under water and the gradient of U to `down` (3) [m].

    `depth` is that of CO below the surface [m]; r_b (3) is where the whole buoyancy acts.
    """
    total = sum(v.displaced for v in volumes)
    shares = [v.displaced / total for v in volumes]
    r = m.parameter(
        "volume_r", np.array([v.r for v in volumes]), unit="m", description="middles in b"
    )
    size = m.parameter(
        "volume_size",
        np.array([v.size for v in volumes]),
        unit="m",
        min=1e-3,
        description="extents in b",
    )
    middle = sum(s * r[i, :].T for i, s in enumerate(shares))
    s = ca.SX.sym("s", 4)
    U = ca.SX(0.0)
    for i, (v, share) in enumerate(zip(volumes, shares, strict=True)):
        at = r[i, :].T - middle + ca.densify(ca.SX(r_b))
        U += share * mean_depth(v, 0.5 * size[i, :].T, s[0] + ca.dot(at, s[1:]), s[1:])
    found = ca.substitute(ca.gradient(U, s), s, ca.vertcat(depth, down))
    return found[0], found[1:]


def mean_depth(volume: Volume, h: ca.SX, D: ca.SX, down: ca.SX) -> ca.SX:
    """Return U [m] of a volume of half-extents h (3) whose middle is at depth D."""
    if volume.shape == "ellipsoid":
        H = ca.sqrt(ca.sumsqr(h * down))
        y = clip(D / H, -1.0, 1.0)
        part = H * (0.1875 + y * (0.5 + y * (0.375 - 0.0625 * y * y)))
        return ca.if_else(D > H, D, part)
    if volume.shape == "box":
        widths = [_half_width(h[i], down[i]) for i in range(3)]
        reach = widths[0] + widths[1] + widths[2]
        x = clip(D, -reach, reach)
        total = ca.SX(0.0)
        for signs in product((1.0, -1.0), repeat=3):
            edge = x + sum(s * width for s, width in zip(signs, widths, strict=True))
            square = edge * edge
            term = ca.if_else(edge > 0.0, square * square, 0.0)
            total += signs[0] * signs[1] * signs[2] * term
        part = total / (192.0 * widths[0] * widths[1] * widths[2])
        return ca.if_else(reach < D, D, part)
    # A cylinder: the mean over u in [-w, w] of E[(D + u + s W)_+], W of density 2/pi sqrt(1 - W²).
    i, j, k = volume.axis, (volume.axis + 1) % 3, (volume.axis + 2) % 3
    radius = 0.5 * (h[j] + h[k])
    square = (h[j] * down[j]) ** 2 + (h[k] * down[k]) ** 2 + (ROUNDED * radius) ** 2
    s = ca.sqrt(square / (1.0 + ROUNDED**2))
    w = _half_width(h[i], down[i])
    reach = w + s
    x = clip(D, -reach, reach)
    part = (_twice(x + w, s) - _twice(x - w, s)) / (2.0 * w)
    return ca.if_else(reach < D, D, part)


def _half_width(h: ca.SX, d: ca.SX) -> ca.SX:
    return h * ca.sqrt((d * d + ROUNDED**2) / (1.0 + ROUNDED**2))


def _twice(x: ca.SX, s: ca.SX) -> ca.SX:
    """Return 1/2 E[((x + s W)_+)²], the integral over x of E[(x + s W)_+]."""
    y = clip(x / s, -1.0 + 1e-9, 1.0 - 1e-9)
    c = ca.sqrt(1.0 - y * y)
    angle = ca.asin(y)
    I_0 = 0.5 + (y * c + angle) / pi
    I_1 = 2.0 / (3.0 * pi) * c * c * c
    I_2 = (0.5 * pi + angle + y * c * (2.0 * y * y - 1.0)) / (4.0 * pi)
    part = 0.5 * s * s * (y * y * I_0 + 2.0 * y * I_1 + I_2)
    return ca.if_else(x > s, 0.5 * x * x + 0.125 * s * s, ca.if_else(x < -s, 0.0, part))
