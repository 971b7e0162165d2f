"""Signals as fields of ROS messages: units of REP 103, frames ENU and FLU, covariances.

Each type of message has a conversion: it takes signals by their role (arrays with n rows, in the
project's frames) and figures of the sensor, and returns columns by the path of a field. Standard
deviations are the sensor's own; a covariance that is not known is 0 everywhere, or has -1 in front
where the value itself is missing, as sensor_msgs defines it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import (
    Array,
    body,
    euler_quaternion,
    quaternion,
    world,
    world_variance,
)
from uuvsim_cosim.bridge.ros2.messages.conversion import Conversion, Values, diagonal
from uuvsim_cosim.bridge.ros2.messages.earth import geodetic, geodetic_of_grid
from uuvsim_cosim.bridge.ros2.messages.ray_messages import RAY_CONVERSIONS
from uuvsim_cosim.bridge.ros2.messages.sonar_messages import SONAR_CONVERSIONS
from uuvsim_cosim.bridge.ros2.messages.state_messages import STATE_CONVERSIONS

__all__ = ["CONVERSIONS", "GENERIC", "sensor_figures"]

Figures = Mapping[str, float]
NOT_MEASURED = 1e3  # deviation of what a message has to state and the sensor does not measure


def _same(n: int, *deviations: float) -> Array:
    return diagonal(np.tile(np.square(deviations), (n, 1)))


def _pose(prefix: str, eta: Array, q: Array | None) -> dict[str, Array]:
    turned = quaternion(euler_quaternion(eta[:, 3:]) if q is None else q)
    return {f"{prefix}.position": world(eta[:, :3]), f"{prefix}.orientation": turned}


def _twist(prefix: str, nu: Array) -> dict[str, Array]:
    return {f"{prefix}.linear": body(nu[:, :3]), f"{prefix}.angular": body(nu[:, 3:])}


def _odometry(v: Values, _: Figures) -> dict[str, Array]:
    columns = _pose("pose.pose", v["eta"], v.get("q")) | _twist("twist.twist", v["nu"])
    if (sigma := v.get("sigma")) is not None:
        variance = np.square(sigma)
        pose = np.concatenate([world_variance(variance[:, :3]), variance[:, 3:6]], axis=1)
        columns["pose.covariance"] = diagonal(pose)
        columns["twist.covariance"] = diagonal(variance[:, 6:])
    return columns


def _transform(v: Values, _: Figures) -> dict[str, Array]:
    pose = _pose("p", v["eta"], v.get("q"))
    at = "transforms.0.transform"
    return {f"{at}.translation": pose["p.position"], f"{at}.rotation": pose["p.orientation"]}


def _imu(v: Values, figures: Figures) -> dict[str, Array]:
    n = len(v["gyro"])
    return {
        "orientation.w": np.ones(1),
        "orientation_covariance": np.array([[-1.0, *[0.0] * 8]]),  # there is no orientation
        "angular_velocity": body(v["gyro"]),
        "angular_velocity_covariance": _same(n, *[figures.get("gyro", 0.0)] * 3),
        "linear_acceleration": body(v["acc"]),
        "linear_acceleration_covariance": _same(n, *[figures.get("acc", 0.0)] * 3),
    }


def _twist_covariance(v: Values, figures: Figures) -> dict[str, Array]:
    n = len(v["velocity"])
    across, along = figures.get("across", 0.0), figures.get("along", 0.0)
    columns = _twist("twist.twist", np.concatenate([v["velocity"], 0 * v["velocity"]], axis=1))
    return columns | {"twist.covariance": _same(n, across, across, along, *[NOT_MEASURED] * 3)}


def _position(v: Values, _: Figures) -> dict[str, Array]:
    n = len(v["position"])
    variance = world_variance(np.square(v["sigma"]))
    unknown = np.full((n, 3), NOT_MEASURED**2)
    return {
        "pose.pose.position": world(v["position"]),
        "pose.pose.orientation.w": np.ones(1),
        "pose.covariance": diagonal(np.concatenate([variance, unknown], axis=1)),
    }


def _range(v: Values, figures: Figures) -> dict[str, Array]:
    return {
        "range": v["altitude"],
        "radiation_type": np.zeros(1),  # ULTRASOUND
        "field_of_view": np.array([figures.get("beam_width", 0.0)]),
        "min_range": np.array([figures.get("range_min", 0.0)]),
        "max_range": np.array([figures.get("range_max", 0.0)]),
        "variance": np.square(
            figures.get("sigma_range", 0.0)
            + figures.get("sigma_range_relative", 0.0) * v["altitude"]
        ),
    }


def _battery(v: Values, figures: Figures) -> dict[str, Array]:
    capacity = figures.get("Q", np.nan) / 3600.0  # Ah
    missing = np.full(1, np.nan)
    return {
        "voltage": v["voltage"],
        "percentage": v["state_of_charge"],
        "charge": v["state_of_charge"] * capacity,
        "capacity": np.array([capacity]),
        "design_capacity": np.array([capacity]),
        "present": np.ones(1),
        "temperature": missing,
        "current": missing,
    }


def _fix(v: Values, facts: Mapping[str, Array]) -> dict[str, Array]:
    """Return a GPS fix; without one, all numbers are NaN and the status is STATUS_NO_FIX."""
    valid = v["valid"] > 0
    code, *origin = facts["@place"].tolist()
    known = v["position"]
    place = geodetic_of_grid(known, int(code), *origin) if code else geodetic(known, *origin)
    latitude, longitude, height = np.where(valid[:, None], place, np.nan).T
    variance = world_variance(np.square(v["sigma"]))
    return {
        "status.status": np.where(valid, 0, -1),
        "status.service": np.ones(1),  # SERVICE_GPS
        "latitude": latitude,
        "longitude": longitude,
        "altitude": height,
        "position_covariance": diagonal(np.where(valid[:, None], variance, 0.0)),
        "position_covariance_type": np.where(valid, 2, 0),  # the diagonal is known, or nothing is
    }


def _wrench(v: Values, _: Figures) -> dict[str, Array]:
    return {"wrench.force": body(v["tau"][:, :3]), "wrench.torque": body(v["tau"][:, 3:])}


CONVERSIONS: dict[str, Conversion] = {
    "nav_msgs/msg/Odometry": Conversion(
        {"eta": 6, "nu": 6, "q": 4, "sigma": 12}, _odometry, frozenset({"q", "sigma"})
    ),
    "tf2_msgs/msg/TFMessage": Conversion({"eta": 6, "q": 4}, _transform, frozenset({"q"})),
    "geometry_msgs/msg/PoseStamped": Conversion(
        {"eta": 6, "q": 4}, lambda v, _: _pose("pose", v["eta"], v.get("q")), frozenset({"q"})
    ),
    "geometry_msgs/msg/PoseWithCovarianceStamped": Conversion(
        {"position": 3, "sigma": 3}, _position
    ),
    "geometry_msgs/msg/TwistStamped": Conversion({"nu": 6}, lambda v, _: _twist("twist", v["nu"])),
    "geometry_msgs/msg/TwistWithCovarianceStamped": Conversion({"velocity": 3}, _twist_covariance),
    "geometry_msgs/msg/WrenchStamped": Conversion({"tau": 6}, _wrench),
    "sensor_msgs/msg/Imu": Conversion({"gyro": 3, "acc": 3}, _imu),
    "sensor_msgs/msg/FluidPressure": Conversion(
        {"pressure": 1},
        lambda v, f: {
            "fluid_pressure": v["pressure"],
            "variance": np.array([f.get("pressure", 0.0) ** 2]),
        },
    ),
    "sensor_msgs/msg/MagneticField": Conversion(
        {"B": 3},
        lambda v, f: {
            "magnetic_field": body(v["B"]),
            "magnetic_field_covariance": _same(len(v["B"]), *[f.get("B", 0.0)] * 3),
        },
    ),
    "sensor_msgs/msg/Range": Conversion({"altitude": 1}, _range),
    "sensor_msgs/msg/BatteryState": Conversion({"voltage": 1, "state_of_charge": 1}, _battery),
    "sensor_msgs/msg/NavSatFix": Conversion(
        {"position": 3, "sigma": 3, "valid": 1}, _fix, needs=frozenset({"@place"}), lost=True
    ),
    **RAY_CONVERSIONS,
    **SONAR_CONVERSIONS,
    **STATE_CONVERSIONS,
}
# Types of signals without a conversion, by the kind of their numbers and whether they are arrays.
GENERIC = {
    ("f", False): "std_msgs/msg/Float64", ("f", True): "std_msgs/msg/Float64MultiArray",
    ("i", False): "std_msgs/msg/Int64", ("i", True): "std_msgs/msg/Int64MultiArray",
    ("u", False): "std_msgs/msg/Int64", ("u", True): "std_msgs/msg/Int64MultiArray",
    ("b", False): "std_msgs/msg/Bool", ("b", True): "std_msgs/msg/UInt8MultiArray",
}  # fmt: skip

# Parameters of white noise and bias, by type of message: prefix of their names, and role.
_NOISE = {
    "sensor_msgs/msg/Imu": (("gyro_", "gyro"), ("acc_", "acc")),
    "sensor_msgs/msg/FluidPressure": (("", "pressure"),),
    "sensor_msgs/msg/MagneticField": (("", "B"),),
}
_LIMITS = ("beam_width", "range_min", "range_max", "sigma_range", "sigma_range_relative", "Q")


def sensor_figures(type_: str, parameters: Mapping[str, Array], period: float) -> dict[str, float]:
    """Return what a sensor's parameters say about its messages: standard deviations, limits.

    A deviation is that of white noise with the samples' `period` [s], the wandering bias, and the
    bias at start together: sqrt(N²/T + sigma_b² + sigma_on²); it is missing while the period is
    not known (infinite). A DVL of four beams at `tilt` has
    sigma_v / (√2 sin t) across its axis and sigma_v / (2 cos t) along it.
    """
    p = {name: float(np.max(value)) for name, value in parameters.items() if np.size(value)}
    made = {name: p[name] for name in _LIMITS if name in p}
    for prefix, role in _NOISE.get(type_, ()):
        if f"{prefix}noise_density" in p and np.isfinite(period):
            parts = (p[f"{prefix}noise_density"] / period**0.5, p.get(f"{prefix}bias_sigma", 0.0),
                     p.get(f"{prefix}turn_on_sigma", 0.0))  # fmt: skip
            made[role] = sum(part**2 for part in parts) ** 0.5
    if "sigma_v" in p and "tilt" in p:
        made["across"] = p["sigma_v"] / (2**0.5 * np.sin(p["tilt"]))
        made["along"] = p["sigma_v"] / (2 * np.cos(p["tilt"]))
    return made
