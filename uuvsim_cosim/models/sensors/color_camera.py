"""Colour camera under water: an image of a scene in linear light, with the noise of its sensor.

fmus/runtime/worlds/uuv_camera.h states the model, models/worlds/water_optics.py the water's
coefficients. The instrument's axes: x to the right of the image, y down, z along the view. The
middle of pixel (i, j) of an image of m rows and n columns is at

    (j + 1/2 - n/2, i + 1/2 - m/2) / f = (1 + k1 u² + k2 u⁴) (X, Y) / Z,   u = |(X, Y)| / Z,

with the focal length f in pixels, in water, and a point (X, Y, Z) that the pixel shows. Behind a
flat port, f is in air, and (X, Y) / Z is the ray's direction there: at the port it bends by Snell's
law. With a rolling shutter, the last row is exposed at the sample's time, the others before it.
"""

from __future__ import annotations

from math import cos

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import NU
from uuvsim_cosim.models.sensors.sensor import hull_pose, mounting, validity_and_time
from uuvsim_cosim.models.worlds.camera_image import LAMPS, WATER_INDEX, CameraImage, camera_image
from uuvsim_cosim.models.worlds.ground import ground_named
from uuvsim_cosim.models.worlds.rays import MOVING, declare_others
from uuvsim_cosim.models.worlds.water_optics import water_optics

__all__ = ["REFLECTANCE", "SUN", "TEXTURE_SIZE", "color_camera"]

CAMERA = "rov_class"  # where none is named
MOST = 250_000  # values of an image: they are discrete states of the component
SUN = (100.0, 100.0, 90.0)  # W/m2 in each channel: clear sky, sun high (assumption)
REFLECTANCE = {"seabed": (0.30, 0.27, 0.20), "solid": (0.25, 0.25, 0.25)}  # invented
TEXTURE_SIZE = 1.6  # m, longest wave of the invented texture
SOFT = 0.1  # rad, edge of a lamp's cone


def color_camera(
    id: str = CAMERA,
    scene: str = "flat",
    period: str = "0.1",
    columns: int | str = 32,
    rows: int | str = 24,
    water: str = "II",
    noise: bool | str = True,
    depth: bool | str = False,
    labels: bool | str = False,
    normals: bool | str = False,
    port: bool | str = False,
    rolling: bool | str = False,
    texture_seed: int | str = 1,
    others: int | str = 0,
) -> Model:
    """Declare the colour camera of a preset, which takes an image every `period` seconds.

    `columns` and `rows` are the pixels of an image; the view across is that of the preset. `water`
    is a type of Jerlov: I, IA, IB, II, III, 1C, 3C, 5C, 7C or 9C. `noise` is that of photons and of
    reading. `depth`, `labels` and `normals` add an output each. `port` puts a flat port before the
    lens, whose focal length is then that in air. `rolling` exposes rows one after another, and adds
    the input `nu`. The texture is invented; `texture_seed` draws it. `others` is the number of
    other vehicles that it sees.
    """
    p = preset("sensors", id, "color_camera")
    m = Model("color_camera", "Colour camera under water over a scene")
    n, k = int(columns), int(rows)
    show = (
        is_on("noise", noise), is_on("depth", depth), is_on("labels", labels),
        is_on("normals", normals),
    )  # fmt: skip
    values = n * k * (3 + show[1] + show[2] + 3 * show[3])
    if not (n > 0 and k > 0 and values <= MOST):
        raise ParameterInvalid(
            m.name,
            f"{n} x {k} pixels, {values} values",
            f"1 to {MOST} values, as an instance keeps them all; larger images are made by "
            "uuvsim_cosim.scene.shared.camera.Camera",
        )
    seed = int(texture_seed)
    if seed < 0:
        raise InputInvalid(m.name, f"texture_seed = {texture_seed}", "0 or more")
    eta, q = hull_pose(m)
    r, R_bs = mounting(m, p)
    length, width = p.number("focal_length", "1"), p.number("width", "1")
    if not (length > 0.0 and width > 0.0):
        raise ParameterInvalid(
            p.path, f"focal_length {length:g}, width {width:g} pixels", "more than 0"
        )
    flat = is_on("port", port)
    away, index = ca.SX(0), 1.0
    if flat:
        length, index = length / WATER_INDEX, WATER_INDEX  # the view across stays, near the axis
        away = m.parameter(
            "port_distance", 0.03, unit="m", min=0.0, description="of the flat port from the lens"
        )
    row_time, moves = ca.SX(0), ca.SX.zeros(6)
    if is_on("rolling", rolling):
        row_time = m.parameter(
            "row_time", round(0.02 / k, 9), unit="s", min=0.0,
            description="between two rows (assumption); the last one is that of t_sample",
        )  # fmt: skip
        nu = m.input("nu", 6, unit=NU, description="of CO in b [m/s, rad/s]")
        moves = ca.vertcat(ca.mtimes(R(q), nu[:3] + ca.cross(nu[3:], r)), ca.mtimes(R(q), nu[3:]))
    f = m.parameter(
        "focal_length", round(length * n / width, 9), unit="1", min=0.001,
        description=f"in pixels of the {n} columns, in {'air' if flat else 'water'}",
    )  # fmt: skip
    lens = p.parameter(m, "distortion", "1", "radial: k1, k2", 2)
    time = p.parameter(m, "exposure_time", "s", "of an image", min=0.0)
    numbers = {
        "sensitivity": ("1", "electrons per second and W/(m2 sr)"),
        "read_noise": ("1", "standard deviation in electrons"),
        "gain": ("1", "grey levels an electron"),
    }
    sensitivity, read, gain = p.parameters(m, numbers).values()
    optics = water_optics(water)
    words = "of red, green and blue"
    coefficients = [
        m.parameter(name, value, unit=unit, min=0.0, description=f"{text}, {words}; Jerlov {water}")
        for name, value, unit, text in (
            ("beta_D", optics.beta_D, "1/m", "attenuation of the light from an object"),
            ("beta_B", optics.beta_B, "1/m", "coefficient of the veiling light"),
            ("K_d", optics.K, "1/m", "attenuation of daylight over depth"),
            ("sun", SUN, "W/m2", "daylight at the surface"),
            ("veil", optics.V, "1", "radiance of infinite water over the daylight, per sr"),
            ("scattering", optics.b, "1/m", "of the light of lamps"),
        )
    ]
    g = m.parameter(
        "asymmetry", 0.924, unit="1", min=0.0, max=0.999,
        description="mean cosine of the scattering of lamps' light",
    )  # fmt: skip
    contrast = m.parameter(
        "contrast", 0.5, unit="1", min=0.0, max=1.0, description="of the invented texture"
    )
    places = p.vector("lamp_positions", "m")
    lamps = len(places) // 3
    if len(places) != 3 * lamps or lamps > LAMPS:
        raise ParameterInvalid(
            p.path,
            f"lamp_positions: {len(places)} numbers",
            f"3 of each lamp, {LAMPS} lamps at most",
        )
    angle = p.number("lamp_angle", "rad")
    r_l = m.parameter(
        "lamp_positions", np.reshape(places, (lamps, 3)), unit="m",
        description="of each lamp from CO, body axes; they shine along the view",
    )  # fmt: skip
    power = p.parameter(m, "lamp_intensity", "1", f"of each lamp, W/sr, {words}", 3, min=0.0)
    dimmer = m.input("lamp", unit="1", start=1.0, min=0.0, max=1.0, description="share of light")
    moving = declare_others(m, others)
    movers = moving.numel() // MOVING
    ground = ground_named(scene)
    solids = np.tile(REFLECTANCE["solid"], (len(ground.names) + movers, 1)).reshape(-1, 3)
    image = camera_image(
        CameraImage(
            "", ground, k, n, lamps, movers, p.number("range_max", "m"), TEXTURE_SIZE, seed,
            np.array(REFLECTANCE["seabed"]), solids, *show[1:],
        )
    )  # fmt: skip
    m.description += "; reflectances and texture are invented"
    shot = m.clock("image", period)
    Rnb = R(q)
    R_ns = ca.mtimes(Rnb, R_bs)
    head = ca.vertcat(
        eta[:3] + ca.mtimes(Rnb, r), ca.vec(R_ns.T), f, lens, *coefficients, g, contrast,
        sensitivity * time, read, gain, float(show[0]), m.normal(shot, 2),
        index, away, row_time, moves,
    )  # fmt: skip
    cones = ca.DM([cos(max(angle - SOFT, 0.0)), cos(angle)])
    each = [
        ca.vertcat(eta[:3] + ca.mtimes(Rnb, r_l[i, :].T), R_ns[:, 2], dimmer * power, cones)
        for i in range(lamps)
    ]
    seen = image(ca.vertcat(head, *each, moving))
    pixels = n * k
    order = f"{k} rows of {n} columns from the top left"
    held_output(
        m, shot, "image", seen[: 3 * pixels], unit="1", type="Int32",
        description=f"grey levels 0 to 255, in linear light: {order}, {words}",
    )  # fmt: skip
    first = 3 * pixels + 3
    if show[1]:
        held_output(
            m, shot, "depth", seen[first : first + pixels], unit="m",
            description=f"along the view; 0: nothing: {order}",
        )  # fmt: skip
        first += pixels
    if show[2]:
        held_output(
            m, shot, "label", seen[first : first + pixels], unit="1", type="Int32",
            description=f"0 nothing, 1 seabed, 2 + i solid or mesh i: {order}",
        )  # fmt: skip
        first += pixels
    if show[3]:
        held_output(
            m, shot, "normal", seen[first : first + 3 * pixels], unit="1",
            description=f"x, y, z in the camera's axes; 0: nothing: {order}",
        )  # fmt: skip
    held_output(m, shot, "mean", seen[3 * pixels], unit="1", description="of the grey levels")
    held_output(
        m, shot, "saturated", seen[3 * pixels + 1], unit="1", description="share of levels of 255"
    )
    m.only_arrays |= {
        each for name in ("image", "depth", "label", "normal") for each in (name, f"{name}_held")
    } & m.variables.keys()
    wet = head[2] >= 0.0
    validity_and_time(m, shot, wet, "the camera is in the water")
    p.complete()
    return m
