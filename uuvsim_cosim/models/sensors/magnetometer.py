"""Magnetometer: the Earth's field in the sensor's axes, through hard and soft iron, with errors.

With F the strength of the field, I its inclination (down) and D its declination (east of north),

    B_n = F (cos I cos D, cos I sin D, sin I)
    reading = clip(A R_bs^T R^T B_n + b + error, ± range)

where A is soft iron and b hard iron, both in the sensor's axes.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import saturate
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.sensors.sensor import mounting, validity_and_time
from uuvsim_cosim.models.sensors.sensor_error import ErrorParameters, sensor_error

__all__ = ["magnetometer"]


def magnetometer(id: str = "hmc5883l", period: str = "0.1") -> Model:
    """Declare the magnetometer of a preset, sampled every `period` seconds."""
    p = preset("sensors", id, "magnetometer")
    m = Model("magnetometer", "Three-axis magnetometer with hard and soft iron")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    F = m.parameter("field", 50e-6, unit="T", min=0, description="strength of the Earth's field")
    inclination = m.parameter(
        "inclination", 1.1345, unit="rad", min=-1.5708, max=1.5708, description="positive down"
    )
    declination = m.parameter("declination", 0.0, unit="rad", description="positive east")
    _, R_bs = mounting(m, p, r=(0.0, 0.0, 0.0))
    b = p.parameter(m, "hard_iron", "T", "b", 3)
    A = m.parameter(
        "soft_iron",
        np.reshape(p.vector("soft_iron", "1", 9), (3, 3)),
        unit="1",
        description="A, row by row",
    )
    limit = p.parameter(m, "range", "T", "largest reading, either way", min=0)
    error = ErrorParameters.of(p, "T")
    level = ca.cos(inclination)
    B_n = m.derived(
        "B_n",
        F
        * ca.vertcat(level * ca.cos(declination), level * ca.sin(declination), ca.sin(inclination)),
    )
    sample = m.clock("sample", period)
    field = ca.mtimes(A, ca.mtimes(R_bs.T, ca.mtimes(R(q).T, B_n))) + b
    reading = saturate(field + sensor_error(m, sample, "", error, 3, "T"), limit)
    held_output(m, sample, "B", reading, unit="T", description="magnetic field, sensor axes")
    validity_and_time(m, sample)
    p.complete()
    return m
