"""Multibeam and depth camera: a frame of rays over a scene, taken at the instrument's own rate.

Ray i from the sensor's place meets the first solid at the distance r_i, and the reading is

    r_i + b_k + sqrt(sigma² + (sigma_rel r_i)²) w_i,k,

white noise w of each ray's own, and b common to all, which is the shared Gauss-Markov error
(sensor_error.py). No echo, reading 0: nothing within its range, incidence too flat, by chance,
from within or below a solid, from the water's surface, outside of the terrain and over its holes.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.sampled import held_output, sample_time
from uuvsim_cosim.models.declaration.vectors import ETA
from uuvsim_cosim.models.sensors.beams import PRESETS, camera_rays, fan
from uuvsim_cosim.models.sensors.mounting import Pose, mounting
from uuvsim_cosim.models.sensors.sensor_error import ErrorParameters, sensor_error
from uuvsim_cosim.models.worlds.rays import declare_others, frame

__all__ = ["depth_camera", "multibeam"]


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
    return _declare(m, p, scene, fan(p, beams), "range", words, period, others)


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
    directions, depth = camera_rays(p, columns, rows), reading == "depth"
    return _declare(m, p, scene, directions, "image", words, period, others, depth)


def _declare(
    m: Model,
    p: Preset,
    scene: str,
    directions: NDArray[np.float64],
    name: str,
    words: str,
    period: str,
    others: int | str,
    depth: bool = False,
) -> Model:
    eta = m.input("eta", 6, unit=ETA, description="of the hull: N E D [m], phi theta psi [rad]")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    r, R_bs = mounting(m, Pose(p.vector("r_s", "m", 3), p.vector("Theta_s", "rad", 3)))
    noise = {
        "sigma_range": ("m", "constant part of a ray's own noise"),
        "sigma_range_relative": ("1", "and the part that grows with range"),
        "range_min": ("m", "no echo nearer"),
        "range_max": ("m", "no echo farther"),
        "incidence_max": ("rad", "from the normal"),
        "dropout": ("1", "probability that a reading is lost"),
    }
    sigma, relative, low, high, flat, lost = (
        m.parameter(name, p.number(name, unit), unit=unit, min=0, description=text)
        for name, (unit, text) in noise.items()
    )
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
    held_output(
        m, shot, "valid", values[n] > 0.5, unit="1", type="Boolean", description="any has one"
    )
    sample_time(m, shot)
    p.complete(optional=("beams", "swath", "fov_horizontal", "fov_vertical"))
    return m
