"""Multibeam and depth camera: a frame of rays over a scene, taken at the instrument's own rate.

Ray i from the sensor's place meets the first solid at the distance r_i, and the reading is

    r_i + b_k + sqrt(sigma² + (sigma_rel r_i)²) w_i,k,

white noise w of each ray's own, and b common to all, which is the shared Gauss-Markov error
(sensor_error.py). No echo, reading 0: nothing within its range, incidence too flat, by chance,
from within or below a solid, from the water's surface, outside of the terrain and over its holes.

Rays are given in the instrument's axes, with z along its axis of view.
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
from uuvsim_cosim.models.declaration.kinematics import R, R_zyx
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.sensors.sensor import hull_pose, mounting, validity_and_time
from uuvsim_cosim.models.sensors.sensor_error import ErrorParameters, sensor_error
from uuvsim_cosim.models.worlds.rays import declare_others, frame

__all__ = ["PRESETS", "Beams", "beams_of", "depth_camera", "multibeam"]

Array = NDArray[np.float64]
PRESETS = {"multibeam": "norbit_wbms", "depth_camera": "camera_class"}  # where none is named
MOST = 20_000  # rays of a component: their readings are discrete states of it


def multibeam(
    id: str = PRESETS["multibeam"],
    scene: str = "flat",
    period: str = "0.1",
    beams: int | str = 0,
    others: int | str = 0,
) -> Model:
    """Declare the multibeam echosounder of a preset, which pings every `period` seconds.

    `beams` replaces the preset's number of them.
    """
    p = preset("sensors", id, "multibeam")
    m = Model("multibeam", "Multibeam echosounder over a scene")
    words = "along each beam, port first"
    return _declare(m, p, scene, _fan(p, beams), "range", words, period, others)


def depth_camera(
    id: str = PRESETS["depth_camera"],
    scene: str = "flat",
    period: str = "0.2",
    columns: int | str = 16,
    rows: int | str = 12,
    reading: str = "depth",
    others: int | str = 0,
) -> Model:
    """Declare the depth camera of a preset, which takes an image every `period` seconds.

    Its `reading` is "depth", along the optical axis, or "range", along each pixel's ray.
    """
    if reading not in ("depth", "range"):
        raise ParameterInvalid("depth_camera", f"reading = {reading!r}", "depth or range")
    p = preset("sensors", id, "depth_camera")
    m = Model("depth_camera", "Depth camera over a scene")
    words = f"{reading} of {rows} rows of {columns} pixels, from the top left"
    directions, depth = _camera_rays(p, columns, rows), reading == "depth"
    return _declare(m, p, scene, directions, "image", words, period, others, depth)


def _declare(
    m: Model,
    p: Preset,
    scene: str,
    directions: Array,
    name: str,
    words: str,
    period: str,
    others: int | str,
    depth: bool = False,
) -> Model:
    eta, q = hull_pose(m)
    r, R_bs = mounting(m, p)
    noise = {
        "sigma_range": ("m", "constant part of a ray's own noise"),
        "sigma_range_relative": ("1", "and the part that grows with range"),
        "range_min": ("m", "no echo nearer"),
        "range_max": ("m", "no echo farther"),
        "incidence_max": ("rad", "from the normal"),
        "dropout": ("1", "probability that a reading is lost"),
    }
    sigma, relative, low, high, flat, lost = p.parameters(m, noise).values()
    moving = declare_others(m, others)
    shot = m.clock("ping" if name == "range" else "image", period)
    error = ErrorParameters(
        0.0,
        p.number("bias_sigma", "m"),
        p.number("bias_tau", "s"),
        p.number("turn_on_sigma", "m"),
    )
    bias = sensor_error(m, shot, name, error, 1, "m")
    Rnb = R(q)
    R_ns = ca.mtimes(Rnb, R_bs)
    place = eta[:3] + ca.mtimes(Rnb, r)
    n = len(directions)
    seen = frame(scene, directions, depth, moving.numel() // 10)
    head = ca.vertcat(place, ca.vec(R_ns.T), sigma, relative, bias, low, high, ca.cos(flat), lost)
    values = seen(ca.vertcat(head, moving, m.normal(shot, n)))
    held_output(m, shot, name, values[:n], unit="m", description=f"{words}; 0: no echo")
    held_output(m, shot, "heard", values[n], unit="1", description="readings that have an echo")
    validity_and_time(m, shot, values[n] > 0.5, "any has one")
    p.complete(optional=("beams", "swath", "fov_horizontal", "fov_vertical"))
    return m


@dataclass(frozen=True, eq=False)
class Beams:
    """Unit vectors (n, 3) in sensor axes; position (3,) [m] and rotation (3, 3) from `s` to `b`."""

    directions: Array
    r_s: Array
    R_bs: Array


def beams_of(kind: str, id: str = "", **options: int | str) -> Beams:
    """Return the rays and the mounting of a sensor, whose `kind` is multibeam or depth_camera.

    `id` is the preset, by default the usual one. `options` are those of the component: ``beams``,
    or ``columns`` and ``rows``. The result has `directions` (n, 3) in sensor axes `s`, the position
    `r_s` (3,) [m] and the rotation `R_bs` (3, 3) from `s` to `b`. Raises ParameterInvalid for
    another kind or too many rays.

    Example:

    >>> from uuvsim_cosim.models import beams_of
    >>> beams = beams_of("multibeam", beams=3)
    >>> beams.directions.round(2)
    array([[ 0.  , -0.91,  0.42],
           [ 0.  ,  0.  ,  1.  ],
           [ 0.  ,  0.91,  0.42]])
    """
    if kind not in PRESETS:
        raise ParameterInvalid(f"beams of {kind!r}", "multibeam or depth_camera")
    p = preset("sensors", id or PRESETS[kind], kind)
    if kind == "multibeam":
        directions = _fan(p, options.get("beams", 0))
    else:
        directions = _camera_rays(p, options.get("columns", 16), options.get("rows", 12))
    R = np.array(ca.DM(R_zyx(*p.vector("Theta_s", "rad", 3))))
    return Beams(directions, np.array(p.vector("r_s", "m", 3)), R)


def _fan(p: Preset, beams: int | str = 0) -> Array:
    """Return the beams of a multibeam; 0 of them: the number of the preset."""
    n = int(beams) or int(p.number("beams", "1"))
    p.has("beams")
    swath = p.number("swath", "rad")
    if not (1 < n <= MOST and 0 < swath < 2 * np.pi):
        raise ParameterInvalid(p.path, f"{n} beams over {swath} rad", f"2 to {MOST} over 0 to 2 pi")
    angles = [swath * (i / (n - 1) - 0.5) for i in range(n)]
    return np.array([[0.0, sin(a), cos(a)] for a in angles])


def _camera_rays(p: Preset, columns: int | str, rows: int | str) -> Array:
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
