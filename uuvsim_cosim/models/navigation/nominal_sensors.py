"""The nominal figures that the navigation filter assumes of its sensors, as parameters."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.vectors import ETA
from uuvsim_cosim.models.sensors.dvl import beam_directions
from uuvsim_cosim.models.sensors.pressure import water_column
from uuvsim_cosim.models.sensors.sensor import mounting
from uuvsim_cosim.models.water.seawater import density

__all__ = ["Figures", "figures"]


@dataclass(frozen=True)
class Figures:
    """Symbols of the filter's parameters; positions from CO in `b`, R from sensor to `b`."""

    eta_0: ca.SX
    sigma_0: ca.SX  # 17 deviations of the errors at the start
    g: ca.SX
    r_imu: ca.SX
    R_imu: ca.SX
    gyro_noise: ca.SX
    acc_noise: ca.SX
    gyro_bias_sigma: ca.SX
    gyro_bias_tau: ca.SX
    acc_bias_sigma: ca.SX
    acc_bias_tau: ca.SX
    r_dvl: ca.SX
    beams: ca.SX  # (3, 4) directions in body axes
    sigma_beam: ca.SX
    sigma_beam_relative: ca.SX
    r_pressure: ca.SX
    water: tuple[ca.SX, ca.SX, ca.SX, ca.SX]  # p_atm, salinity, temperature, g of the place
    sigma_depth: ca.SX
    declination: ca.SX
    sigma_psi: ca.SX
    r_usbl: ca.SX
    sigma_aiding: ca.SX  # stationary deviations of the biases of compass [rad] and depth [m]
    tau_aiding: ca.SX
    gate: ca.SX
    patience: ca.SX


def figures(m: Model, imu: str, dvl: str, pressure: str, compass: str, usbl: str) -> Figures:
    """Declare the filter's parameters with the figures of sensor presets."""
    i, d = preset("sensors", imu, "imu"), preset("sensors", dvl, "dvl")
    b, c = preset("sensors", pressure, "pressure"), preset("sensors", compass, "compass")
    a = preset("sensors", usbl, "usbl")

    def positive(name: str, value: float, unit: str, words: str = "") -> ca.SX:
        return m.parameter(name, value, unit=unit, min=0, description=words)

    gyro_sigma, acc_sigma = i.number("gyro_bias_sigma", "rad/s"), i.number("acc_bias_sigma", "m/s2")
    start_g = (i.number("gyro_turn_on_sigma", "rad/s") ** 2 + gyro_sigma**2) ** 0.5
    start_a = (i.number("acc_turn_on_sigma", "m/s2") ** 2 + acc_sigma**2) ** 0.5
    weight = float(density(35.0, 10.0)) * 9.81  # Pa/m
    of_depth, of_psi = b.number("bias_sigma", "Pa") / weight, c.number("bias_sigma", "rad")
    turn_on = (b.number("turn_on_sigma", "Pa") / weight, c.number("turn_on_sigma", "rad"))
    sigma_0 = [
        *(0.5, 0.5, 0.1, 0.05, 0.05, 0.05, 0.03, 0.03, 0.05),
        *([start_g] * 3 + [start_a] * 3),
        (of_psi**2 + turn_on[1] ** 2) ** 0.5,
        (of_depth**2 + turn_on[0] ** 2) ** 0.5,
    ]
    eta_0 = m.parameter(
        "eta_0", (0, 0, 5, 0, 0, 0), unit=ETA, description="start: N E D [m], phi theta psi [rad]"
    )
    start = m.parameter(
        "sigma_0",
        sigma_0,
        unit="1",
        min=0,
        description="deviations at start: position 3, velocity 3, attitude 3, gyro bias 3, "
        "accelerometer bias 3, compass bias, depth bias",
    )
    g = positive("g", 9.81, "m/s2", "acceleration of gravity")
    r_imu, R_imu = mounting(m, i, "imu")
    r_dvl, R_dvl = mounting(m, d, "dvl")
    tilt = m.parameter("dvl_tilt", d.number("tilt", "rad"), unit="rad", description="of the beams")
    azimuth = m.parameter(
        "dvl_azimuth", d.vector("azimuth", "rad", 4), unit="rad", description="of the beams"
    )
    noise = b.number("noise_density", "1") / weight
    return Figures(
        eta_0,
        start,
        g,
        r_imu,
        R_imu,
        positive("gyro_noise_density", i.number("gyro_noise_density", "1"), "1", "rad/s/sqrt(Hz)"),
        positive("acc_noise_density", i.number("acc_noise_density", "1"), "1", "m/s2/sqrt(Hz)"),
        positive("gyro_bias_sigma", gyro_sigma, "rad/s", "of its wandering part"),
        i.parameter(m, "gyro_bias_tau", "s", "its correlation time", min=1.0),
        positive("acc_bias_sigma", acc_sigma, "m/s2", "of its wandering part"),
        i.parameter(m, "acc_bias_tau", "s", "its correlation time", min=1.0),
        r_dvl,
        m.derived("beams", ca.mtimes(R_dvl, beam_directions(tilt, azimuth))),
        positive("sigma_beam", d.number("sigma_v", "m/s"), "m/s", "noise of a beam's velocity"),
        positive("sigma_beam_relative", d.number("sigma_v_relative", "1"), "1", "and its part"),
        m.parameter("r_pressure", b.vector("r_s", "m", 3), unit="m", description="from CO"),
        water_column(m),
        positive("sigma_depth", noise / 0.1**0.5, "m", "white noise of one reading"),
        c.parameter(m, "declination", "rad", "magnetic from true north"),
        positive("sigma_psi", c.number("noise_density", "rad") / 0.1**0.5, "rad", "of one reading"),
        m.parameter("r_usbl", a.vector("r_s", "m", 3), unit="m", description="transponder from CO"),
        m.parameter("sigma_aiding", [of_psi, of_depth], unit="1", min=0, description="[rad, m]"),
        m.parameter(
            "tau_aiding",
            [c.number("bias_tau", "s"), b.number("bias_tau", "s")],
            unit="s",
            min=1.0,
            description="correlation times of the biases of compass and depth",
        ),
        m.parameter("gate", 5.0, unit="1", min=1, description="deviations that are believed"),
        m.parameter("patience", 5.0, unit="1", min=1, description="refusals before believing"),
    )
