"""Added mass and drag of a hull estimated from its surface: an ellipsoid, and its faces by strips.

Added mass is that of the ellipsoid with the solid's second moments in proportion and its volume
(Lamb, ellipsoid.py), turned to its principal axes. Drag along axis i is 1/2 rho C_D A_i: C_D is
1.05 of the flat part that meets the flow, and for the round rest between that of a sphere (0.5),
a long cylinder across the flow (1.1) and a streamlined body along it (0.44/e + 0.02 e, the form
that Hoerner 1965, Fluid-Dynamic Drag, gives for ellipsoids, with friction 0.005). In rotation each
element of surface that advances pushes with its own normal velocity:
D_q = 1/2 rho s ∫ |n·(e x r)|³ dA, which is the strips' formula for a box and 0 for a sphere.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.shapes.ellipsoid import added_mass
from uuvsim_cosim.models.shapes.mesh import Mesh, Solid

__all__ = ["added_mass_of", "drag_coefficients", "quadratic_drag"]

Array = NDArray[np.float64]
BLUNT = 1.05  # C_D of a cube's face


def added_mass_of(solid: Solid, rho: float) -> tuple[Array, Array]:
    """Return M_A (6, 6) [kg, kg.m2] about the centre of volume, and the semi-axes [m] used."""
    values, axes = np.linalg.eigh(solid.second)
    values = np.maximum(values, 1e-9 * values.max())
    # Nearly equal second moments (sphere, cube) have no axes of their own: keep the body's.
    if np.ptp(values) < 1e-3 * values.max():
        axes = np.eye(3)
    order = np.argmax(np.abs(axes), axis=0)
    if len(set(order.tolist())) == 3:  # name the axes as the body's that they are nearest to
        back = np.argsort(order)
        values, axes = values[back], axes[:, back]
    semi = np.sqrt(5.0 * values / solid.volume)
    semi *= (solid.volume / (4.0 / 3.0 * pi * semi.prod())) ** (1.0 / 3.0)
    a, b, c = (float(s) for s in semi)
    diagonal: Array = np.array(added_mass(a, b, c, rho), dtype=float)
    M_A = np.zeros((6, 6))
    for k in (0, 3):
        block = axes @ np.diag(diagonal[k : k + 3]) @ axes.T
        small = np.abs(block) < 1e-4 * np.abs(diagonal[k : k + 3]).max()
        block[small & ~np.eye(3, dtype=bool)] = 0.0
        M_A[k : k + 3, k : k + 3] = block
    return M_A, semi


def _surface(mesh: Mesh) -> tuple[Array, Array, Array]:
    """Return outward unit normals (n, 3), areas (n,) [m2] and middles (n, 3) [m]."""
    t = mesh.triangles
    cross = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-300)[:, None], 0.5 * length, t.mean(axis=1)


def drag_coefficients(mesh: Mesh, solid: Solid) -> Array:
    """Return C_D (3,) of the areas seen along x, y and z."""
    normals, areas, _ = _surface(mesh)
    out = np.zeros(3)
    for i in range(3):
        j, k = (a for a in range(3) if a != i)
        seen = float(solid.areas[i])
        flat = 0.5 * sum(float(areas[s * normals[:, i] > 0.999].sum()) for s in (1.0, -1.0))
        blunt = min(1.0, flat / seen)
        e = float(solid.extent[i]) / (2.0 * sqrt(seen / pi))
        if e >= 1.0:
            round_ = min(0.5, 0.44 / e + 0.02 * e + 0.02 / sqrt(e))
        else:
            slender = float(max(solid.extent[j], solid.extent[k]))
            slender /= float(min(solid.extent[j], solid.extent[k]))
            round_ = 1.1 - 0.6 / slender
        out[i] = blunt * BLUNT + (1.0 - blunt) * round_
    return out


def quadratic_drag(mesh: Mesh, solid: Solid, rho: float, C_D: Array) -> Array:
    """Return the diagonal of D_q (6,) [N.s2/m2, N.m.s2/rad2] about the centre of volume."""
    normals, areas, _ = _surface(mesh)
    D_q = np.zeros(6)
    D_q[:3] = 0.5 * rho * C_D * solid.areas
    impact = np.array(
        [float((np.maximum(normals[:, i], 0.0) ** 3 * areas).sum()) for i in range(3)]
    )
    share = C_D * solid.areas / np.maximum(impact, 1e-12)
    fine = Mesh(_fine(mesh.triangles, float(solid.extent.max()) / 24.0))
    normals, areas, _ = _surface(fine)
    s = (normals**2) @ share
    points: Array = np.einsum("kc,nci->nki", _POINTS, fine.triangles) - solid.centre
    for i in range(3):
        turning = np.cross(np.eye(3)[i], points)  # (n, 7, 3)
        advance = np.maximum(np.einsum("nki,ni->nk", turning, normals), 0.0) ** 3
        D_q[3 + i] = 0.5 * rho * float((s * areas * (advance @ _WEIGHTS)).sum())
    D_q[3:][D_q[3:] < 1e-6 * rho * float(solid.extent.max()) ** 5] = 0.0
    return D_q


def _fine(triangles: Array, edge: float) -> Array:
    """Cut triangles into four until none has a longer edge: then |r|³ is smooth over each."""
    done = []
    for _ in range(6):
        sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
        small = sides <= edge
        done.append(triangles[small])
        t = triangles[~small]
        if not len(t):
            break
        m = 0.5 * (t + np.roll(t, -1, axis=1))  # middles of 01, 12, 20
        triangles = np.concatenate(
            [
                np.stack([t[:, 0], m[:, 0], m[:, 2]], axis=1),
                np.stack([m[:, 0], t[:, 1], m[:, 1]], axis=1),
                np.stack([m[:, 2], m[:, 1], t[:, 2]], axis=1),
                m,
            ]
        )
    else:
        done.append(triangles)
    return np.concatenate(done)


# Seven points in a triangle, exact to fifth degree (Dunavant 1985): a flat face keeps |r|³.
_A, _B = (6.0 - sqrt(15.0)) / 21.0, (6.0 + sqrt(15.0)) / 21.0
_POINTS = np.array(
    [
        [1 / 3] * 3,
        *([_A if j != i else 1 - 2 * _A for j in range(3)] for i in range(3)),
        *([_B if j != i else 1 - 2 * _B for j in range(3)] for i in range(3)),
    ]
)
_WEIGHTS = np.array([0.225, *[(155 - sqrt(15)) / 1200] * 3, *[(155 + sqrt(15)) / 1200] * 3])
