"""GPS: position and velocity of an antenna while it is above the water, and long enough.

    position = p + R r + e,   velocity = R (v + omega x r) + noise,   in NED

where e is white noise with a Gauss-Markov drift, larger along D than along N and E. A fix needs an
antenna at least `clearance` above the surface for `reacquisition`. Under water the last fix stays,
and is not valid. Its connectors are those of a USBL.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model, Value
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST, held_output
from uuvsim_cosim.models.declaration.vectors import NU
from uuvsim_cosim.models.sensors.sensor import hull_pose, output_when
from uuvsim_cosim.models.sensors.sensor_error import ErrorParameters, sensor_error

__all__ = ["gps"]


def gps(id: str = "neo_m9n", period: str = "1") -> Model:
    """Declare the GPS of a preset, one fix every `period` seconds."""
    p = preset("sensors", id, "gps")
    m = Model("gps", "GPS receiver: fixes at the surface only")
    eta, q = hull_pose(m)
    nu = m.input("nu", 6, unit=NU, description="of CO in b [m/s, rad/s]")
    r = p.parameter(m, "r_s", "m", "antenna from CO", 3)
    words = {
        "clearance": ("m", "height above the surface that an antenna needs"),
        "reacquisition": ("s", "time above the surface until the first fix"),
        "vertical": ("1", "error along D over that along N or E"),
        "sigma_v": ("m/s", "noise of each part of the velocity"),
    }
    clearance, wait, vertical, sigma_v = p.parameters(m, words).values()
    sample = m.clock("sample", period)
    figures = ErrorParameters(
        p.number("noise_density", "m"), p.number("bias_sigma", "m"), p.number("bias_tau", "s"), 0.0
    )
    error = sensor_error(m, sample, "", figures, 3, "m")  # along N and E
    names = ("noise_density", "bias_sigma", "turn_on_sigma")
    N, sigma_b, on = (m.variables[name].symbol for name in names)
    T = float(sample.period)
    sigma = m.derived("sigma_level", ca.sqrt(N**2 / T + sigma_b**2 + on**2 + 1e-12))
    shape = ca.vertcat(1.0, 1.0, vertical)
    Rnb = R(q)
    position = eta[:3] + ca.mtimes(Rnb, r)
    velocity = ca.mtimes(Rnb, nu[:3] + ca.cross(nu[3:], r)) + sigma_v * m.normal(sample, 3)

    above = position[2] <= -clearance
    since = m.discrete("above_since", unit="s", description="when the antenna came up")
    was = m.discrete("above", unit="1", description="1: it was above the water at the last tick")
    since_new = ca.if_else(was > 0.5, since, m.t)
    m.update(sample, since, since_new)
    m.update(sample, was, ca.if_else(above, 1.0, 0.0))
    fixed = ca.logic_and(above, m.t - since_new >= wait - 1e-9)
    outputs: tuple[tuple[str, ca.SX, Value, str, str], ...] = (
        ("position", position + shape * error, (0, 0, 0), "m", "of the antenna in NED"),
        ("velocity", velocity, (0, 0, 0), "m/s", "of the antenna in NED"),
        ("sigma", shape * sigma, (0, 0, 0), "m", "deviations of N, E, D"),
        ("t_sample", m.t, BEFORE_FIRST, "s", "when the fix held; -1 before the first"),
    )
    for name, value, start, unit, text in outputs:
        output_when(m, sample, fixed, name, value, unit=unit, start=start, description=text)
    held_output(
        m, sample, "valid", ca.if_else(fixed, 1.0, 0.0), unit="1", type="Boolean",
        description="a fix of this tick is there",
    )  # fmt: skip
    p.complete()
    return m
