"""Inertial measurement unit: specific force and angular velocity where it sits, with errors.

With the sensor at r from CO, R from `b` to `n`, and nu = (v, omega) of CO in `b`:

    a = dv/dt + omega x v + domega/dt x r + omega x (omega x r)
    f = R_bs^T (a - R^T g),   g = (0, 0, +g) in `n`

so that at rest and level it reads f = (0, 0, -g). Its biases move on every 0.1 s.
"""

from __future__ import annotations

from fractions import Fraction

import casadi as ca

from uuvsim_cosim.models.kinematics import R
from uuvsim_cosim.models.model import Model
from uuvsim_cosim.models.mounting import Pose, mounting
from uuvsim_cosim.models.preset import preset
from uuvsim_cosim.models.sampled import held_output, sample_time
from uuvsim_cosim.models.sensor_error import ErrorParameters, sensor_error
from uuvsim_cosim.models.vectors import ETA, NU, NU_DOT

__all__ = ["imu"]


def imu(id: str = "adis16448", period: str = "0.01") -> Model:
    """Declare the IMU of a preset, sampled every `period` seconds."""
    p = preset("sensors", id, "imu")
    m = Model("imu", "Inertial measurement unit: specific force and angular velocity")
    m.input("eta", 6, unit=ETA, description="unused: attitude is taken from q")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    nu = m.input("nu", 6, unit=NU, description="of CO in b [m/s, rad/s]")
    nu_dot = m.input("nu_dot", 6, unit=NU_DOT, description="its derivative in b [m/s2, rad/s2]")
    g = m.parameter("g", 9.81, unit="m/s2", min=0, description="acceleration of gravity")
    r, R_bs = mounting(m, Pose(p.vector("r_s", "m", 3), p.vector("Theta_s", "rad", 3)))
    errors = {
        axis: ErrorParameters(
            p.number(f"{axis}_noise_density", "1"),
            p.number(f"{axis}_bias_sigma", unit),
            p.number(f"{axis}_bias_tau", "s"),
            p.number(f"{axis}_turn_on_sigma", unit),
        )
        for axis, unit in (("acc", "m/s2"), ("gyro", "rad/s"))
    }
    wander = m.clock("wander", str(max(Fraction(period), Fraction("0.1"))))
    sample = m.clock("sample", period)
    v, omega = nu[:3], nu[3:]
    lever = ca.cross(nu_dot[3:], r) + ca.cross(omega, ca.cross(omega, r))
    a = nu_dot[:3] + ca.cross(omega, v) + lever
    f = ca.mtimes(R_bs.T, a - g * R(q)[2, :].T)
    acc_error = sensor_error(m, sample, "acc", errors["acc"], 3, "m/s2", wander)
    gyro_error = sensor_error(m, sample, "gyro", errors["gyro"], 3, "rad/s", wander)
    held_output(
        m, sample, "acc", f + acc_error, unit="m/s2", description="specific force, sensor axes"
    )
    held_output(
        m,
        sample,
        "gyro",
        ca.mtimes(R_bs.T, omega) + gyro_error,
        unit="rad/s",
        description="angular velocity, sensor axes",
    )
    held_output(m, sample, "valid", 1.0, unit="1", type="Boolean", description="a reading is there")
    sample_time(m, sample)
    return m
