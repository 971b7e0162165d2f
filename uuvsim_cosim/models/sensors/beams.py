"""Rays of a ranging instrument in its own axes, with z along its axis of view.

Multibeam: n beams at equal angles across the swath, in the y-z plane, port (-y) first. Camera:
a pinhole whose image has its rows along x and its columns along y, from the top left; pixel (i, j)
looks along (x_j, y_i, 1), its middle, where the image's edges are at the tangents of half the
fields of view.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, tan

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.preset import Preset, preset

__all__ = ["MOST", "PRESETS", "Beams", "beams_of", "camera_rays", "fan"]

Array = NDArray[np.float64]
PRESETS = {"multibeam": "norbit_wbms", "depth_camera": "camera_class"}  # where none is named
MOST = 20_000  # rays of a component: their readings are discrete states of it


@dataclass(frozen=True, eq=False)
class Beams:
    """Unit vectors (n, 3) in sensor axes; position (3,) [m] and rotation (3, 3) from `s` to `b`."""

    directions: Array
    r_s: Array
    R_bs: Array


def beams_of(kind: str, id: str = "", **options: int | str) -> Beams:
    """Return the rays and the mounting of a `multibeam` or `depth_camera` preset.

    `options` are those of the component: `beams`, or `columns` and `rows`.
    """
    if kind not in PRESETS:
        raise ParameterInvalid(f"beams of {kind!r}", "multibeam or depth_camera")
    p = preset("sensors", id or PRESETS[kind], kind)
    if kind == "multibeam":
        directions = fan(p, options.get("beams", 0))
    else:
        directions = camera_rays(p, options.get("columns", 16), options.get("rows", 12))
    R = np.array(ca.DM(R_zyx(*p.vector("Theta_s", "rad", 3))))
    return Beams(directions, np.array(p.vector("r_s", "m", 3)), R)


def fan(p: Preset, beams: int | str = 0) -> Array:
    """Return the beams of a multibeam; 0 of them: as many as its preset says."""
    n = int(beams) or int(p.number("beams", "1"))
    p.has("beams")
    swath = p.number("swath", "rad")
    if not (1 < n <= MOST and 0 < swath < 2 * np.pi):
        raise ParameterInvalid(p.path, f"{n} beams over {swath} rad", f"2 to {MOST} over 0 to 2 pi")
    angles = [swath * (i / (n - 1) - 0.5) for i in range(n)]
    return np.array([[0.0, sin(a), cos(a)] for a in angles])


def camera_rays(p: Preset, columns: int | str, rows: int | str) -> Array:
    """Return the rays of a pinhole camera, row by row."""
    n, m = int(columns), int(rows)
    if not (n > 0 and m > 0 and n * m <= MOST):
        raise ParameterInvalid(
            "depth_camera",
            f"{n} x {m} pixels",
            (
                f"1 to {MOST} together; larger images are cast by "
                "uuvsim_cosim.scene.shared.ray_casting.Caster"
            ),
        )
    wide, tall = (tan(p.number(f"fov_{k}", "rad") / 2) for k in ("horizontal", "vertical"))
    x, y = (np.arange(n) + 0.5) / n * 2 - 1, (np.arange(m) + 0.5) / m * 2 - 1
    grid = np.stack([*np.meshgrid(x * wide, y * tall), np.ones((m, n))], axis=-1).reshape(-1, 3)
    return np.asarray(grid / np.sqrt(np.sum(grid**2, axis=1, keepdims=True)))
