"""Inertial measurement unit: specific force and angular velocity where it sits, with errors.

With the sensor at r from CO, R from `b` to `n`, and nu = (v, omega) of CO in `b`:

    a = dv/dt + omega x v + domega/dt x r + omega x (omega x r)
    f = R_bs^T (a - R^T g),   g = (0, 0, +g) in `n`

so that at rest and level it reads f = (0, 0, -g). What is read of f, and of omega likewise, is

    clip((I + E) f + b_on + b + white noise, ± range)

with E of scale errors (diagonal) and misalignments (the rest), drawn once, and b a Gauss-Markov
bias, which moves on every 0.1 s. E and the range are declared where the preset has figures.
"""

from __future__ import annotations

from fractions import Fraction

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.safe_math import saturate
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import ETA, NU, NU_DOT
from uuvsim_cosim.models.sensors.allan import sigma_of_instability
from uuvsim_cosim.models.sensors.sensor import mounting, validity_and_time
from uuvsim_cosim.models.sensors.sensor_error import ErrorParameters, sensor_error

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
    r, R_bs = mounting(m, p)
    errors = {axis: _errors(p, axis, unit) for axis, unit in (("acc", "m/s2"), ("gyro", "rad/s"))}
    wander = m.clock("wander", str(max(Fraction(period), Fraction("0.1"))))
    sample = m.clock("sample", period)
    v, omega = nu[:3], nu[3:]
    lever = ca.cross(nu_dot[3:], r) + ca.cross(omega, ca.cross(omega, r))
    a = nu_dot[:3] + ca.cross(omega, v) + lever
    f = ca.mtimes(R_bs.T, a - g * R(q)[2, :].T)
    acc_error = sensor_error(m, sample, "acc", errors["acc"], 3, "m/s2", wander)
    gyro_error = sensor_error(m, sample, "gyro", errors["gyro"], 3, "rad/s", wander)
    acc = _scaled(m, p, wander, "acc", f) + acc_error
    gyro = _scaled(m, p, wander, "gyro", ca.mtimes(R_bs.T, omega)) + gyro_error
    held_output(
        m,
        sample,
        "acc",
        _limited(m, p, "acc", "m/s2", acc),
        unit="m/s2",
        description="specific force, sensor axes",
    )
    held_output(
        m,
        sample,
        "gyro",
        _limited(m, p, "gyro", "rad/s", gyro),
        unit="rad/s",
        description="angular velocity, sensor axes",
    )
    validity_and_time(m, sample)
    p.complete()
    return m


def _errors(p: Preset, axis: str, unit: str) -> ErrorParameters:
    """Read an error; its bias is given by deviation, or by the data sheet's bias instability."""
    N = p.number(f"{axis}_noise_density", "1")
    tau = p.number(f"{axis}_bias_tau", "s")
    if p.has(f"{axis}_bias_instability"):
        try:
            sigma = sigma_of_instability(N, p.number(f"{axis}_bias_instability", unit), tau)
        except ParameterInvalid as error:
            raise ParameterInvalid(f"{p.path}: {axis}: {error}") from None
    else:
        sigma = p.number(f"{axis}_bias_sigma", unit)
    return ErrorParameters(N, sigma, tau, p.number(f"{axis}_turn_on_sigma", unit))


def _scaled(m: Model, p: Preset, wander: Clock, axis: str, value: ca.SX) -> ca.SX:
    """Return (I + E) value, E drawn at the first tick; without figures of E the value itself."""
    named = (f"{axis}_scale_sigma", f"{axis}_misalignment_sigma")
    given = [p.has(name) for name in named]
    if not any(given):
        return value
    words = ("deviation of the scale errors", "deviation of the small angles between axes")
    scale, angle = (
        p.parameter(m, name, unit, text, min=0)
        for name, unit, text in zip(named, ("1", "rad"), words, strict=True)
    )
    E = m.discrete(f"{axis}_E", 0.0, 9, unit="1")  # column by column
    drawn = m.discrete(f"{axis}_E_drawn", unit="1", description="0 before the first tick")
    eye = ca.SX.eye(3)
    deviation = ca.vec(ca.densify(scale * eye + angle * (1.0 - eye)))
    m.update(wander, E, ca.if_else(drawn > 0.5, E, deviation * m.normal(wander, 9)))
    m.update(wander, drawn, 1.0)
    return value + ca.mtimes(ca.reshape(E, 3, 3), value)


def _limited(m: Model, p: Preset, axis: str, unit: str, value: ca.SX) -> ca.SX:
    """Hold a reading within its range, where the preset states one."""
    if not p.has(f"{axis}_range"):
        return value
    limit = p.parameter(m, f"{axis}_range", unit, "largest reading, either way", min=0)
    return saturate(value, limit)
