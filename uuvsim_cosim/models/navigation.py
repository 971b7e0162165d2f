"""Navigation: an error-state Kalman filter of IMU, DVL, pressure, compass and USBL.

It holds position and velocity of the IMU in NED, attitude, gyro and accelerometer bias (15
errors, see `strapdown`), and the wandering biases of compass and depth (2). Each new IMU reading
advances it to that reading's sample time; each new reading of another sensor corrects it, the
DVL beam by beam. A USBL fix is compared with the position at the time that the fix carries,
out of a history of 1.5 s. A reading is new when its sample time has changed and it is valid.
Readings beyond 5 deviations are left out; after `patience` such in a row they are believed.

Known limit: while station is kept, tilt cannot be told from the accelerometers' bias. Over 1000 s
of it pitch drifts by 0.017 rad on average, more than its deviation (0.015 rad) says.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from uuvsim_cosim.models.kalman import Correction, pack, propagated, unpack
from uuvsim_cosim.models.kinematics import R, S, T_zyx, euler_of_q, q_of_euler
from uuvsim_cosim.models.model import Clock, Model
from uuvsim_cosim.models.navigation_aiding import Aiding, aiding, history_states
from uuvsim_cosim.models.navigation_parameters import Figures, figures
from uuvsim_cosim.models.safe_math import safe_sqrt
from uuvsim_cosim.models.sampled import BEFORE_FIRST
from uuvsim_cosim.models.strapdown import (
    Inertial,
    error_transition,
    mechanised,
    multiply,
    q_of_rotation,
)
from uuvsim_cosim.models.vectors import ETA, NU

__all__ = ["N_ERRORS", "navigation"]

N_ERRORS = 17


def navigation(
    period: str = "0.01",
    imu: str = "adis16448",
    dvl: str = "a50_class",
    pressure: str = "bar_100m",
    compass: str = "fluxgate",
    usbl: str = "usbl_class",
) -> Model:
    """Declare the filter, with the nominal figures of the named sensor presets."""
    m = Model("navigation", "Error-state Kalman filter: IMU, DVL, pressure, compass, USBL")
    acc = m.input("imu_acc", 3, unit="m/s2", description="specific force, sensor axes")
    gyro = m.input("imu_gyro", 3, unit="rad/s", description="angular velocity, sensor axes")
    imu_valid = m.input("imu_valid", unit="1", type="Boolean", description="there is a reading")
    imu_time = m.input("imu_t_sample", unit="s", start=BEFORE_FIRST, description="its sample time")
    c = figures(m, imu, dvl, pressure, compass, usbl)
    step = m.clock("step", period)
    remember = m.clock("remember", "0.1")

    # What it starts from.
    q_0 = q_of_euler(c.eta_0[3], c.eta_0[4], c.eta_0[5])
    upper_0 = pack(ca.diag(c.sigma_0**2))
    p_0 = c.eta_0[:3] + ca.mtimes(R(q_0), c.r_imu)
    p = m.discrete("p", p_0, unit="m")
    v = m.discrete("v", (0, 0, 0), unit="m/s")
    q = m.discrete("q", q_0, unit="1")
    b_g = m.discrete("b_g", (0, 0, 0), unit="rad/s")
    b_a = m.discrete("b_a", (0, 0, 0), unit="m/s2")
    b_s = m.discrete("b_s", (0, 0), unit="1", description="biases of compass [rad], depth [m]")
    upper = m.discrete("P", upper_0, unit="1", description="covariance, upper triangle by rows")
    omega = m.discrete("omega", (0, 0, 0), unit="rad/s", description="of the hull")
    reading = m.discrete("reading", (0,) * 6, unit="1", description="of the IMU before this one")
    t_k = m.discrete("t_k", BEFORE_FIRST, unit="s", description="to which the estimate belongs")

    # Advance to the IMU's sample time, with the mean of the last two readings.
    is_new = ca.logic_and(imu_valid > 0.5, imu_time > t_k + 1e-9)
    first = t_k < 0
    now = ca.vertcat(ca.mtimes(c.R_imu, gyro), ca.mtimes(c.R_imu, acc))
    dt = ca.if_else(ca.logic_and(is_new, ca.logic_not(first)), imu_time - t_k, 0.0)
    t_new = ca.if_else(is_new, imu_time, t_k)
    mean = 0.5 * (now + reading)
    x = Inertial(p, v, q, b_g, b_a)
    omega_mean, f_mean = mean[:3] - b_g, mean[3:] - b_a
    decay = 1.0 - dt / c.tau_aiding
    F = error_transition(x, omega_mean, c.g, dt, decay)
    P = propagated(unpack(upper, N_ERRORS), F, _process_noise(c, x, dt))
    x = mechanised(x, omega_mean, f_mean, c.g, dt)
    b_wandered = decay * b_s  # a Gauss-Markov bias is expected to return, as F says of its error
    rate = ca.if_else(is_new, now[:3], reading[:3]) - b_g

    # Correct.
    past, past_time = history_states(m, p_0)
    correction = Correction(P, c.gate)
    aid = Aiding(m, step, correction, c, t_new)
    quality = aiding(aid, x, rate, b_wandered, past, past_time)
    dx = correction.dx
    q_new = multiply(x.q, q_of_rotation(dx[6:9]))
    q_new = q_new / ca.sqrt(ca.sumsqr(q_new))
    new = replace(
        x,
        p=x.p + dx[:3],
        v=ca.mtimes(R(q_new), ca.mtimes(R(x.q).T, x.v) + dx[3:6]),
        q=q_new,
        b_g=x.b_g + dx[9:12],
        b_a=x.b_a + dx[12:15],
    )
    for state, value in (
        (p, new.p),
        (v, new.v),
        (q, new.q),
        (b_g, new.b_g),
        (b_a, new.b_a),
        (b_s, b_wandered + dx[15:]),
        (upper, pack(correction.P)),
        (omega, rate - dx[9:12]),
        (reading, ca.if_else(is_new, now, reading)),
        (t_k, t_new),
        (past, past + ca.repmat(dx[:3], past.numel() // 3, 1)),
    ):
        m.update(step, state, value)
    m.update(remember, past, ca.vertcat(p, past[:-3]))
    m.update(remember, past_time, t_k)
    _outputs(m, step, Inertial(p, v, q, b_g, b_a), omega, upper, t_k, quality, c)
    return m


def _process_noise(c: Figures, x: Inertial, dt: Any) -> Any:
    """Give Q over dt: velocity and angle random walk, biases that wander.

    The turning noise of `b` shifts dy by -S(y) n_g: with dtheta, the one term off the diagonal.
    """
    one = ca.SX.ones(3)
    Q = ca.diag(
        dt
        * ca.vertcat(
            1e-10 * one,
            c.acc_noise**2 * one,
            c.gyro_noise**2 * one,
            2.0 * c.gyro_bias_sigma**2 / c.gyro_bias_tau * one,
            2.0 * c.acc_bias_sigma**2 / c.acc_bias_tau * one,
            2.0 * c.sigma_aiding**2 / c.tau_aiding,
        )
    )
    n_g = dt * c.gyro_noise**2
    Sy = S(ca.mtimes(R(x.q).T, x.v))
    Q[3:6, 3:6] += n_g * ca.mtimes(Sy, Sy.T)
    Q[3:6, 6:9] = n_g * Sy
    Q[6:9, 3:6] = n_g * Sy.T
    return Q


def _outputs(
    m: Model,
    step: Clock,
    x: Inertial,
    omega: Any,
    upper: Any,
    t_k: Any,
    quality: Any,
    c: Figures,
) -> None:
    """Declare the outputs, about CO: estimate, its deviations, biases, and what was refused."""
    Rnb = R(x.q)
    Theta = euler_of_q(x.q)
    v_imu = ca.mtimes(Rnb.T, x.v)
    eta = ca.vertcat(x.p - ca.mtimes(Rnb, c.r_imu), Theta)
    nu = ca.vertcat(v_imu - ca.cross(omega, c.r_imu), omega)
    P = unpack(upper, N_ERRORS)
    T = T_zyx(Theta[0], Theta[1])
    of_angles = ca.mtimes(ca.mtimes(T, P[6:9, 6:9]), T.T)
    of_rates = ca.diag(P)[9:12] + c.gyro_noise**2 / float(step.period)
    variances = ca.vertcat(ca.diag(P)[:3], ca.diag(of_angles), ca.diag(P)[3:6], of_rates)
    m.output(
        "eta", eta, unit=ETA, discrete=True, description="of CO: N E D [m], phi theta psi [rad]"
    )
    m.output("nu", nu, unit=NU, discrete=True, description="of CO in b [m/s, rad/s]")
    m.output(
        "sigma",
        safe_sqrt(variances),
        unit=(*ETA, *NU),
        discrete=True,
        description="deviations of eta (6), then of nu (6)",
    )
    m.output("t_sample", t_k, unit="s", discrete=True, description="time of the estimate")
    m.output("gyro_bias", x.b_g, unit="rad/s", discrete=True, description="estimate, body axes")
    m.output("acc_bias", x.b_a, unit="m/s2", discrete=True, description="estimate, body axes")
    m.output(
        "refused",
        quality[:, 0],
        unit="1",
        discrete=True,
        description="scalars left out so far: DVL beams, pressure, compass, USBL",
    )
    m.output(
        "nis",
        quality[:, 1],
        unit="1",
        discrete=True,
        description="innovation²/variance of the latest reading, mean of its scalars",
    )
