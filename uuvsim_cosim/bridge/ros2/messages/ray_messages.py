"""Messages of instruments that see along rays: clouds, scans, depth images, pings of sonars.

A point is reading · scale · direction in the instrument's axes `s` (facts.py). Clouds have the
frame ``…_link`` (x ahead, y to port, z up where the instrument is mounted upright), images
``…_optical``, which is `s` itself: x to the right, y down, z along the view (REP 103), pings
``…_sonar``, which is `s`, too. A scan has the frame ``…_scan``: x along the view, y along that of
`s`, so that angles grow from port to starboard. A reading without an echo is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array, body
from uuvsim_cosim.bridge.ros2.messages.conversion import ANY, Conversion, Shape, Values
from uuvsim_cosim.models.declaration.kinematics import R_zyx

__all__ = ["RAY_CONVERSIONS"]

Facts = Mapping[str, Array]
_FLOAT32 = 7  # sensor_msgs/msg/PointField
_BOTTOM = 1  # DVL_MODE_BOTTOM
_BAD = 1  # DETECT_BAD_SONAR


def _echoes(readings: Array) -> Array:
    return np.where(readings > 0, readings, np.nan)


def _bytes(values: Array) -> Array:
    """Return numbers (n, k) as bytes (n, 4 k) of float32."""
    return np.ascontiguousarray(values, "<f4").view(np.uint8).reshape(len(values), -1)


def _size(f: Facts) -> tuple[int, int]:
    """Return height and width of an instrument's image, or of its row of beams."""
    rows, columns = f["@grid"].tolist() if "@grid" in f else (1, len(f["@scale"]))
    return int(rows), int(columns)


def _cloud(v: Values, f: Facts) -> dict[str, Array]:
    echoes, directions = _echoes(v["range"]), body(f["@directions"])
    points = np.empty((*echoes.shape, 3), "<f4")
    for i in range(3):  # without arrays in between: 100,000 points are 2.4 MB
        along = directions[:, i] * f["@scale"]
        np.multiply(echoes, along, out=points[:, :, i], casting="same_kind")
    height, width = _size(f)
    fields = {
        f"fields.{i}.{name}": np.array([value])
        for i in range(3)
        for name, value in (("offset", 4 * i), ("datatype", _FLOAT32), ("count", 1))
    }
    return fields | {
        "height": np.array([height]),
        "width": np.array([width]),
        "point_step": np.array([12]),
        "row_step": np.array([12 * width]),
        "data": points.view(np.uint8).reshape(len(points), -1),
    }


def _scan(v: Values, f: Facts) -> dict[str, Array]:
    first, step = f["@fan"]
    return {
        "angle_min": np.array([first]),
        "angle_max": np.array([first + step * (len(f["@scale"]) - 1)]),
        "angle_increment": np.array([step]),
        "range_min": f["range_min"].reshape(1),
        "range_max": f["range_max"].reshape(1),
        "ranges": _echoes(v["range"]),
    }


def _ranges(v: Values, f: Facts) -> dict[str, Array]:
    """Return a ping; frequency and speed of sound are 0, which means that they are not known."""
    n = len(f["@scale"])
    return {
        "flags": np.where(v["range"] > 0, 0, _BAD),
        "transmit_delays": np.zeros((1, n)),
        "beam_unit_vec": f["@directions"].reshape(1, -1),
        "ranges": _echoes(v["range"]),
    }


def _image(v: Values, f: Facts) -> dict[str, Array]:
    height, width = _size(f)
    size = {"height": np.array([height]), "width": np.array([width])}
    if "@pixels" in f:
        levels = np.asarray(v["image"]).astype(np.uint8)
        return size | {"step": np.array([3 * width]), "data": levels.reshape(len(levels), -1)}
    return size | {"step": np.array([4 * width]), "data": _bytes(_echoes(v["image"]))}


def _image_shape(_: Values, f: Facts) -> Shape:
    height, width = _size(f)
    encoding, size = ("rgb8", 3) if "@pixels" in f else ("32FC1", 4)
    return Shape({"encoding": encoding}, {"data": size * height * width})


def _camera(_: Values, f: Facts) -> dict[str, Array]:
    """Return the pinhole camera whose pixel (row i, column j) looks along (x_j, y_i, 1)."""
    height, width = _size(f)
    if "@pixels" in f:
        focal, k1, k2 = f["@lens"].tolist()
        return _camera_info(height, width, focal, focal, (k1, k2))
    d = f["@directions"].reshape(height, width, 3)
    (x, y) = (d[0, :, 0] / d[0, :, 2], d[:, 0, 1] / d[:, 0, 2])
    # The edges of the image are half a pixel beyond the first one's middle, and symmetric.
    fx, fy = ((n - 1) / np.ptp(u) if n > 1 else np.nan for n, u in ((width, x), (height, y)))
    fx, fy = (fy if np.isnan(fx) else fx), (fx if np.isnan(fy) else fy)
    return _camera_info(height, width, float(fx), float(fy))


def _camera_info(
    height: int, width: int, fx: float, fy: float, radial: tuple[float, float] = (0.0, 0.0)
) -> dict[str, Array]:
    cx, cy = (width - 1) / 2, (height - 1) / 2
    return {
        "height": np.array([height]),
        "width": np.array([width]),
        "d": np.array([[*radial, 0.0, 0.0, 0.0]]),
        "k": np.array([[fx, 0, cx, 0, fy, cy, 0, 0, 1]]),
        "r": np.eye(3).reshape(1, 9),
        "p": np.array([[fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]]),
    }


def _dvl(v: Values, f: Facts) -> dict[str, Array]:
    """Return a ping; its covariance is that of the least squares over the beams with an echo."""
    d, sigma, valid = f["@directions"], float(f["sigma_v"]), v["beam_valid"] > 0
    relative = float(f.get("sigma_v_relative", np.zeros(())))
    variance = sigma**2 + (relative * v["beam_velocity"]) ** 2
    outer = d[:, :, None] * d[:, None, :]
    normal = np.linalg.inv(np.einsum("ni,ijk->njk", valid, outer) + 1e-9 * np.eye(3))
    covariance = normal @ np.einsum("ni,ijk->njk", valid * variance, outer) @ normal
    turn = np.array(R_zyx(*f["Theta_s"]), float).reshape(3, 3)
    velocity = v["velocity"] @ turn  # R_bs^T v
    return {
        "velocity_mode": np.array([_BOTTOM]),
        "velocity": velocity,
        "velocity_covar": covariance.reshape(len(velocity), 9),
        "altitude": v["altitude"],
        "course_gnd": np.arctan2(velocity[:, 1], velocity[:, 0]),
        "speed_gnd": np.hypot(velocity[:, 0], velocity[:, 1]),
        "num_good_beams": valid.sum(axis=1),
        "sound_speed": np.full(1, float(f.get("c", np.array(np.nan)))),
        "beam_ranges_valid": np.ones(1),
        "beam_velocities_valid": np.ones(1),
        **{f"beam_unit_vec.{i}": d[None, i] for i in range(4)},
        "range": np.where(valid, v["range"], np.nan),
        "range_covar": np.full((1, 4), float(f["sigma_range"]) ** 2),
        "beam_quality": valid.astype(float),
        "beam_velocity": np.where(valid, v["beam_velocity"], np.nan),
        "beam_velocity_covar": variance,
    }


RAY_CONVERSIONS = {
    "sensor_msgs/msg/PointCloud2": Conversion(
        {"range": ANY},
        _cloud,
        needs=frozenset({"@directions", "@scale"}),
        shape=lambda _, f: Shape(
            {f"fields.{i}.name": axis for i, axis in enumerate("xyz")},
            {"fields": 3, "data": 12 * len(f["@scale"])},
        ),
    ),
    "sensor_msgs/msg/LaserScan": Conversion(
        {"range": ANY},
        _scan,
        needs=frozenset({"@scale", "@fan", "range_min", "range_max"}),
        shape=lambda _, f: Shape(lengths={"ranges": len(f["@scale"])}),
    ),
    "sensor_msgs/msg/Image": Conversion(
        {"image": ANY},
        _image,
        needs=frozenset({"@grid", "@seen"}),
        shape=_image_shape,
    ),
    "sensor_msgs/msg/CameraInfo": Conversion(
        {"image": ANY},
        _camera,
        needs=frozenset({"@grid", "@seen", "@lens"}),
        shape=lambda _, f: Shape({"distortion_model": "plumb_bob"}, {"d": 5}),
    ),
    "marine_acoustic_msgs/msg/SonarRanges": Conversion(
        {"range": ANY},
        _ranges,
        needs=frozenset({"@directions", "@scale", "@fan"}),
        shape=lambda _, f: Shape(
            lengths=dict.fromkeys(
                ("flags", "transmit_delays", "beam_unit_vec", "ranges"), len(f["@scale"])
            )
        ),
    ),
    "marine_acoustic_msgs/msg/Dvl": Conversion(
        {"velocity": 3, "altitude": 1, "range": 4, "beam_velocity": 4, "beam_valid": 4},
        _dvl,
        needs=frozenset({"@directions", "Theta_s", "sigma_v", "sigma_range"}),
    ),
}
