"""Pressure sensor: absolute pressure of real sea water at the depth where the sensor sits.

    p = p_atm + p_gauge(depth; salinity, temperature, latitude) + error

with the density of EOS-80, which grows with depth; a pool or a lake has salinity 0. Where the
preset states a largest pressure, the reading saturates there and is not valid.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.sensors.sensor import hull_pose, mounting, validity_and_time
from uuvsim_cosim.models.sensors.sensor_error import ErrorParameters, sensor_error
from uuvsim_cosim.models.water.seawater import gravity, pressure_at_depth

__all__ = ["pressure", "water_column"]


def water_column(m: Model) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Declare the water above as parameters; return (p_atm, salinity, temperature [degC], g)."""
    p_atm = m.parameter("p_atm", 101325.0, unit="Pa", description="pressure at the surface")
    S = m.parameter("salinity", 35.0, unit="1", min=0, max=42, description="practical salinity")
    T = m.parameter("temperature", 10.0, unit="degC", min=-2, max=40, description="of the water")
    latitude = m.parameter(
        "latitude", 0.7854, unit="rad", min=-1.5708, max=1.5708, description="gives gravity"
    )
    return p_atm, S, T, m.derived("g_latitude", gravity(latitude))


def pressure(id: str = "bar_100m", period: str = "0.1") -> Model:
    """Declare the pressure sensor of a preset, sampled every `period` seconds."""
    p = preset("sensors", id, "pressure")
    m = Model("pressure", "Absolute pressure sensor in sea water (EOS-80)")
    eta, q = hull_pose(m)
    p_atm, S, T, g = water_column(m)
    r, _ = mounting(m, p)
    error = ErrorParameters.of(p, "Pa", noise_unit="1")
    sample = m.clock("sample", period)
    depth = eta[2] + ca.dot(R(q)[2, :].T, r)
    gauge = pressure_at_depth(clip(depth, 0.0, 12000.0), S, T, g)
    reading = p_atm + gauge + sensor_error(m, sample, "", error, 1, "Pa")
    valid: Number = 1.0
    if p.has("pressure_max"):
        limit = p.parameter(m, "pressure_max", "Pa", "absolute, at which it saturates", min=0)
        valid, reading = reading <= limit, clip(reading, 0.0, limit)
    held_output(
        m, sample, "pressure", reading, unit="Pa", start=101325.0, description="absolute pressure"
    )
    validity_and_time(m, sample, valid)
    p.complete()
    return m
