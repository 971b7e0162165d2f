"""Compass: magnetic heading of the hull, tilt-compensated, with hard and soft iron and errors.

The horizontal field, in units of its strength and in levelled body axes, is
m = (cos psi_m, -sin psi_m) with psi_m = psi - declination; iron makes it A m + b:

    reading = atan2(-(A m + b)_y, (A m + b)_x) + error.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import atan2_or, wrap
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import ETA
from uuvsim_cosim.models.sensors.sensor import validity_and_time
from uuvsim_cosim.models.sensors.sensor_error import ErrorParameters, sensor_error

__all__ = ["compass"]


def compass(id: str = "fluxgate", period: str = "0.1") -> Model:
    """Declare the compass of a preset, sampled every `period` seconds."""
    p = preset("sensors", id, "compass")
    m = Model("compass", "Tilt-compensated magnetic compass")
    eta = m.input("eta", 6, unit=ETA, description="of the hull: N E D [m], phi theta psi [rad]")
    declination = p.parameter(
        m, "declination", "rad", "of the place: magnetic north, positive east of true north"
    )
    b = p.parameter(m, "hard_iron", "1", "b", 2)
    iron = p.vector("soft_iron", "1", 4)
    A = m.parameter("soft_iron", np.reshape(iron, (2, 2)), unit="1", description="A")
    error = ErrorParameters.of(p, "rad")
    sample = m.clock("sample", period)
    psi_m = eta[5] - declination
    field = ca.mtimes(A, ca.vertcat(ca.cos(psi_m), -ca.sin(psi_m))) + b
    heading = atan2_or(-field[1], field[0], 0.0)
    reading = wrap(heading + sensor_error(m, sample, "", error, 1, "rad"))
    held_output(m, sample, "psi", reading, unit="rad", description="magnetic heading")
    validity_and_time(m, sample)
    p.complete()
    return m
