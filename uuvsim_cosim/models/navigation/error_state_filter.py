"""Navigation: an error-state Kalman filter of IMU, DVL, pressure, compass and USBL.

The filter estimates position and velocity of the IMU in NED, attitude, gyro and accelerometer bias
(15 errors, see `strapdown`), and the drifting biases of compass and depth (2). Each new IMU reading
advances the estimate to that reading's sample time. Each new reading of another sensor corrects the
estimate, the DVL beam by beam. The covariance is propagated only before a correction, and at least
every 0.1 s, in one step over the time since the last propagation. A USBL fix is compared with the
position at the sample time of the fix, from a history of 1.5 s. A reading is new if it is valid and
its sample time has changed. Readings with innovations beyond 5 standard deviations are rejected;
after `patience` rejections in a row, a reading is accepted.

Known limit: during station keeping, tilt cannot be separated from the accelerometers' bias. Over
1000 s of station keeping, pitch drifts by 0.013 rad on average, about its deviation (0.015 rad).
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R, S, T_zyx, euler_of_q, q_of_euler
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import safe_sqrt
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST
from uuvsim_cosim.models.declaration.vectors import ETA, NU
from uuvsim_cosim.models.navigation.aiding import Aiding, History
from uuvsim_cosim.models.navigation.kalman import Correction, pack, propagated, unpack
from uuvsim_cosim.models.navigation.nominal_sensors import Figures, figures
from uuvsim_cosim.models.navigation.strapdown import (
    ErrorTransition,
    Inertial,
    corrected,
    mechanised,
    transported,
)

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
    aid = Aiding(m, step, c)

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
    omega = m.discrete("omega", (0, 0, 0), unit="rad/s", description="of the hull")
    reading = m.discrete("reading", (0,) * 6, unit="1", description="of the IMU before this one")
    t_k = m.discrete("t_k", BEFORE_FIRST, unit="s", description="to which the estimate belongs")
    history = History.declare(m, p_0)
    # What was when it was corrected for the last time.
    upper = m.discrete("P", upper_0, unit="1", description="covariance, upper triangle by rows")
    p_P = m.discrete("p_P", p_0, unit="m", description="position that P belongs to")
    q_P = m.discrete("q_P", q_0, unit="1", description="attitude that P belongs to")
    t_P = m.discrete("t_P", BEFORE_FIRST, unit="s", description="time that P belongs to")
    t_due = m.discrete("t_due", BEFORE_FIRST, unit="s", description="tick of that correction")
    start_sigma = _sigma(upper_0, q_0, c, float(step.period))
    sigma = m.discrete("sigma_held", start_sigma, unit=(*ETA, *NU))

    # Advance to the IMU's sample time, with the mean of the last two readings.
    is_new = ca.logic_and(imu_valid > 0.5, imu_time > t_k + 1e-9)
    first = t_k < 0
    now = ca.vertcat(ca.mtimes(c.R_imu, gyro), ca.mtimes(c.R_imu, acc))
    t_new = ca.if_else(is_new, imu_time, t_k)
    dt = t_new - ca.if_else(first, t_new, t_k)
    mean = 0.5 * (now + reading)
    x = mechanised(Inertial(p, v, q, b_g, b_a), mean[:3] - b_g, mean[3:] - b_a, c.g, dt)
    shown = ca.if_else(is_new, now, reading)
    rate = shown[:3] - b_g

    # Bring the covariance up to that time, and correct.
    due = aid.due(m.t - t_due)
    span = t_new - ca.if_else(first, t_new, t_P)
    Rnb = R(x.q)
    ratio = span / c.tau_aiding
    decay = 1.0 / (1.0 + ratio * (1.0 + 0.5 * ratio))  # a Gauss-Markov bias is expected to return
    transition = ErrorTransition(span, x.p - p_P, 0.5 * (R(q_P) + Rnb), c.g, decay)
    P = propagated(unpack(upper, N_ERRORS), transition, _process_noise(c, x.v, span))
    correction = Correction(P, c.gate)
    b_wandered = decay * b_s
    quality = aid.correct(correction, x, Rnb, rate, b_wandered, history, t_new)
    dx = correction.dx
    new = corrected(x, dx)
    new_upper = pack(transported(correction.P, x.q, new.q))
    for state, value, otherwise in (
        (p, new.p, x.p),
        (v, new.v, x.v),
        (q, new.q, x.q),
        (b_g, new.b_g, b_g),
        (b_a, new.b_a, b_a),
        (b_s, b_wandered + dx[15:], b_s),
        (omega, rate - dx[9:12], rate),
        (upper, new_upper, upper),
        (history.past, history.moved(dx[:3]), history.past),
        (p_P, new.p, p_P),
        (q_P, new.q, q_P),
        (t_P, t_new, ca.if_else(first, t_new, t_P)),
        (t_due, m.t, t_due),
        (sigma, _sigma(new_upper, new.q, c, float(step.period)), sigma),
    ):
        m.update(step, state, ca.if_else(due, value, otherwise))
    m.update(step, reading, shown)
    m.update(step, t_k, t_new)
    m.update(remember, history.past, ca.vertcat(p, history.past[:-3]))
    m.update(remember, history.newest, t_k)

    # Outputs, about CO.
    Rnb = R(q)
    eta = ca.vertcat(p - ca.mtimes(Rnb, c.r_imu), euler_of_q(q))
    nu = ca.vertcat(ca.mtimes(Rnb.T, v) - ca.cross(omega, c.r_imu), omega)
    for name, value, unit, words in (
        ("eta", eta, ETA, "of CO: N E D [m], phi theta psi [rad]"),
        ("nu", nu, NU, "of CO in b [m/s, rad/s]"),
        ("sigma", sigma, (*ETA, *NU), "deviations of eta (6), nu (6); 0.1 s old at most"),
        ("t_sample", t_k, "s", "time of the estimate"),
        ("gyro_bias", b_g, "rad/s", "estimate, body axes"),
        ("acc_bias", b_a, "m/s2", "estimate, body axes"),
        ("refused", quality[:, 0], "1", "scalars left out so far: DVL, pressure, compass, USBL"),
        ("nis", quality[:, 1], "1", "innovation²/variance of the latest reading, mean of scalars"),
    ):  # fmt: skip
        m.output(name, value, unit=unit, discrete=True, description=words)
    return m


def _process_noise(c: Figures, v: ca.SX, t: ca.SX) -> ca.SX:
    """Return Q over t: velocity and angle random walk, biases that wander.

    The turning noise of `b` shifts zeta by -S(v) R n_g: with eta, the one term off the diagonal.
    """
    one = ca.SX.ones(3)
    Q = ca.diag(
        t
        * ca.vertcat(
            1e-10 * one,
            c.acc_noise**2 * one,
            c.gyro_noise**2 * one,
            2.0 * c.gyro_bias_sigma**2 / c.gyro_bias_tau * one,
            2.0 * c.acc_bias_sigma**2 / c.acc_bias_tau * one,
            2.0 * c.sigma_aiding**2 / c.tau_aiding,
        )
    )
    n_g = t * c.gyro_noise**2
    Sv = S(v)
    Q[3:6, 3:6] += n_g * ca.mtimes(Sv, Sv.T)
    Q[3:6, 6:9] = n_g * Sv
    Q[6:9, 3:6] = n_g * Sv.T
    return Q


def _sigma(upper: ca.SX, q: ca.SX, c: Figures, T: float) -> ca.SX:
    """Return the deviations of eta, then of nu, of the covariance and the attitude."""
    P, Rnb, Theta = unpack(upper, N_ERRORS), R(q), euler_of_q(q)
    T_n = ca.mtimes(T_zyx(Theta[0], Theta[1]), Rnb.T)
    of_angles = ca.mtimes(ca.mtimes(T_n, P[6:9, 6:9]), T_n.T)
    of_velocity = ca.mtimes(ca.mtimes(Rnb.T, P[3:6, 3:6]), Rnb)
    of_rates = ca.diag(P)[9:12] + c.gyro_noise**2 / T
    return safe_sqrt(ca.vertcat(ca.diag(P)[:3], ca.diag(of_angles), ca.diag(of_velocity), of_rates))
