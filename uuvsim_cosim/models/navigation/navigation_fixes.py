"""Navigation between late fixes: an IMU and a compass, and positions received by radio.

Attitude follows the gyro. It is corrected towards the compass and towards the level that the
accelerometer measures after subtraction of  omega x v;  both corrections also estimate the gyro's
bias. With the rotation matrix R of this attitude,

    dv/dt = R (acc - b) + g,   dp/dt = v.

A fix z with the sample time t_s is compared with the estimate at that time, e = z - p(t_s), from a
history of 1.5 s. The errors of p, v and b *at that time* are k e, from a Kalman filter of (p, v, b)
that is advanced from fix to fix, one for all three axes. Over tau = t - t_s, they have become

    p + k_p e + tau k_v e - tau²/2 k_b e,   v + k_v e - tau k_b e,   b + R' k_b e.

A fix beyond `gate` standard deviations is accepted at once and restarts the filter, because the
vehicle has probably touched a wall.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R_zyx, T_zyx
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import abs_, atan2_or, clip, norm, safe_sqrt, wrap
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST
from uuvsim_cosim.models.declaration.vectors import ETA, NU

__all__ = ["navigation_fixes"]

LENGTH, SPACING = 16, 0.1  # past positions, and s between them


def navigation_fixes(period: str = "0.02", imu: str = "adis16448") -> Model:
    """Declare it; `imu` is the preset whose noise and bias it reckons with, mounted at CO."""
    m = Model("navigation_fixes", "Navigation by IMU, compass and late position fixes")
    acc = m.input("imu_acc", 3, unit="m/s2", description="specific force at CO, body axes")
    gyro = m.input("imu_gyro", 3, unit="rad/s", description="angular velocity, body axes")
    imu_time = m.input("imu_t_sample", unit="s", start=BEFORE_FIRST, description="its sample time")
    psi_c = m.input("compass_psi", unit="rad", description="heading")
    psi_time = m.input("compass_t_sample", unit="s", start=BEFORE_FIRST, description="of it")
    fix = m.input("fix", 3, unit="m", description="position of CO in NED that came last")
    fix_time = m.input("fix_t_sample", unit="s", start=BEFORE_FIRST, description="of it; -1: none")
    i = preset("sensors", imu, "imu")

    def positive(name: str, value: float, unit: str, words: str, least: float = 0.0) -> ca.SX:
        return m.parameter(name, value, unit=unit, min=least, description=words)

    eta_0 = m.parameter("eta_0", (0,) * 6, unit=ETA, description="start, N E D phi theta psi")
    g = positive("g", 9.81, "m/s2", "acceleration of gravity")
    sigma = positive("sigma_fix", 0.007, "m", "deviation of a fix, each axis", 1e-6)
    start_b = i.number("acc_turn_on_sigma", "m/s2") ** 2 + i.number("acc_bias_sigma", "m/s2") ** 2
    sigma_p = positive("sigma_p", 0.03, "m", "deviation of the position at the start")
    sigma_v = positive("sigma_v", 0.02, "m/s", "of the velocity")
    sigma_b = positive("sigma_b", start_b**0.5, "m/s2", "of the accelerometer's bias")
    # Beside the accelerometer's noise: a tilt that is wrong by 0.01 rad for half a second.
    q_v = positive("q_v", 0.005, "m2/s3", "density of what else accelerates")
    q_b = positive("q_b", 0.01, "m2/s5", "density of the bias's wandering")
    k_level = positive("k_level", 0.3, "1/s", "rate at which the level is believed")
    k_psi = positive("k_psi", 0.06, "1", "share of a compass reading that is believed")
    k_g = positive("k_g", 0.1, "1/s", "rate at which errors of attitude become gyro bias")
    gate = positive("gate", 6.0, "1", "deviations of a fix that are believed", 1.0)

    p = m.discrete("p", eta_0[:3], unit="m")
    v = m.discrete("v", (0, 0, 0), unit="m/s", description="in NED")
    angles = m.discrete("angles", eta_0[3:], unit="rad", description="phi theta psi")
    b_a = m.discrete("b_a", (0, 0, 0), unit="m/s2", description="bias, body axes")
    b_g = m.discrete("b_g", (0, 0, 0), unit="rad/s", description="bias, body axes")
    omega = m.discrete("omega", (0, 0, 0), unit="rad/s")
    before = m.discrete("before", (0,) * 6, unit="1", description="reading of the IMU before")
    t_k = m.discrete("t_k", BEFORE_FIRST, unit="s", description="of the estimate")
    t_psi = m.discrete("t_psi", BEFORE_FIRST, unit="s", description="of the last heading")
    t_fix = m.discrete("t_fix", BEFORE_FIRST, unit="s", description="of the last fix")
    upper = m.discrete(
        "P", ca.vertcat(sigma_p**2, 0.0, 0.0, sigma_v**2, 0.0, sigma_b**2), unit="1",
        description="of p, v, b at the last fix: upper triangle by rows",
    )  # fmt: skip
    past = m.discrete("past", ca.repmat(eta_0[:3], LENGTH, 1), unit="m", description="newest first")
    t_past = m.discrete("t_past", BEFORE_FIRST, unit="s", description="of the newest")
    lost = m.discrete("lost", unit="1", description="fixes beyond the gate so far")
    step, remember = m.clock("step", period), m.clock("remember", str(SPACING))

    # On to the time of the IMU's reading, with the mean of two.
    first = t_k < 0.0
    t = ca.if_else(imu_time > t_k + 1e-9, imu_time, t_k)
    T = ca.if_else(first, 0.0, t - t_k)
    now = ca.vertcat(gyro, acc)
    mean = 0.5 * (now + ca.if_else(first, now, before))
    turning = mean[:3] - b_g
    Theta = angles + T * ca.mtimes(T_zyx(angles[0], angles[1]), turning)
    middle = 0.5 * (angles + Theta)
    a = ca.mtimes(R_zyx(*ca.vertsplit(middle)), mean[3:] - b_a) + ca.vertcat(0.0, 0.0, g)
    p_t, v_t = p + T * v + 0.5 * T**2 * a, v + T * a

    # Attitude: the level, and the compass.
    Rnb = R_zyx(*ca.vertsplit(Theta))
    f = acc - ca.cross(turning, ca.mtimes(Rnb.T, v_t))
    away = ca.vertcat(
        atan2_or(-f[1], -f[2], 0.0) - Theta[0],
        atan2_or(f[0], safe_sqrt(f[1] ** 2 + f[2] ** 2), 0.0) - Theta[1],
    )
    pointed = psi_time > t_psi + 1e-9
    off = ca.if_else(pointed, wrap(psi_c - Theta[2]), 0.0)
    since = ca.if_else(t_psi < 0.0, 0.0, psi_time - t_psi)
    Theta = Theta + ca.vertcat(T * k_level * away, k_psi * off)
    drift = k_g * ca.vertcat(T * k_level * away, since * off)

    # The fix: the errors at its sample time.
    came = ca.logic_and(fix_time > t_fix + 1e-9, fix_time >= 0.0)
    span = fix_time - ca.if_else(t_fix < 0.0, 0.0, t_fix)
    tau = t - fix_time
    # The position at that time, out of the history; newer than all of it, along the velocity.
    steps_back = (t_past - fix_time) / SPACING
    back = clip(steps_back, 0.0, LENGTH - 1.0)
    then = ca.SX.zeros(3)
    for j in range(LENGTH):
        distance = abs_(back - j)
        weight = ca.if_else(distance < 1.0, 1.0 - distance, 0.0)
        then = then + weight * past[3 * j : 3 * j + 3]
    e = fix - ca.if_else(steps_back < 0.0, p_t - tau * v_t, then)
    P = _grown(upper, span, q_v + i.number("acc_noise_density", "1") ** 2, q_b)
    S = P[0] + sigma**2
    wrong = norm(e) ** 2 > 3.0 * gate**2 * S
    k = ca.vertcat(P[0], P[1], P[2]) / S
    known = ca.vertcat(sigma**2, 0.0, 0.0, 0.1**2, 0.0, sigma_b**2)
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    shrunk = ca.vertcat(*(P[n] - k[a] * P[b] for n, (a, b) in enumerate(pairs)))  # P - k P_1'
    P = ca.if_else(wrong, known, shrunk)
    k = ca.if_else(wrong, ca.vertcat(1.0, 0.0, 0.0), k)
    taken = ca.if_else(came, 1.0, 0.0)
    dp, dv, db = (taken * k[n] * e for n in range(3))
    m.update(step, p, p_t + dp + tau * dv - 0.5 * tau**2 * db)
    m.update(step, v, v_t + dv - tau * db)
    m.update(step, b_a, b_a + ca.mtimes(Rnb.T, db))
    m.update(step, angles, ca.vertcat(Theta[:2], wrap(Theta[2])))
    m.update(step, b_g, b_g - drift)
    m.update(step, omega, gyro - b_g)
    m.update(step, before, now)
    m.update(step, t_k, t)
    m.update(step, t_psi, psi_time)
    m.update(step, t_fix, ca.if_else(came, fix_time, t_fix))
    m.update(step, upper, ca.if_else(came, P, upper))
    m.update(step, lost, lost + taken * ca.if_else(wrong, 1.0, 0.0))
    corrected = [
        past[3 * j : 3 * j + 3] + dp + (t_past - j * SPACING - fix_time) * dv for j in range(LENGTH)
    ]
    m.update(step, past, ca.if_else(came, ca.vertcat(*corrected), past))
    m.update(remember, past, ca.vertcat(p, past[:-3]))
    m.update(remember, t_past, t_k)

    nu = ca.vertcat(ca.mtimes(R_zyx(*ca.vertsplit(angles)).T, v), omega)
    for name, value, unit, words in (
        ("eta", ca.vertcat(p, angles), ETA, "of CO: N E D [m], phi theta psi [rad]"),
        ("nu", nu, NU, "of CO in b [m/s, rad/s]"),
        ("t_sample", t_k, "s", "time of the estimate"),
        ("age", ca.if_else(t_fix < 0.0, 0.0, t_k - t_fix), "s", "of the last fix"),
        ("lost_fixes", lost, "1", "beyond the gate so far"),
    ):
        m.output(name, value, unit=unit, discrete=True, description=words)
    return m


def _grown(P: ca.SX, T: ca.SX, q_v: ca.SX, q_b: ca.SX) -> ca.SX:
    """Return F P F' + Q of (p, v, b), F = [1 T -T²/2; 0 1 -T; 0 0 1], upper triangles by rows."""
    F = ca.vertcat(
        ca.horzcat(1.0, T, -0.5 * T**2), ca.horzcat(0.0, 1.0, -T), ca.horzcat(0.0, 0.0, 1.0)
    )
    full = ca.vertcat(
        ca.horzcat(P[0], P[1], P[2]), ca.horzcat(P[1], P[3], P[4]), ca.horzcat(P[2], P[4], P[5])
    )
    X = ca.mtimes(ca.mtimes(F, full), F.T)
    noise = ca.vertcat(q_v * T**3 / 3.0, q_v * T**2 / 2.0, 0.0, q_v * T, 0.0, q_b * T)
    return ca.vertcat(X[0, 0], X[0, 1], X[0, 2], X[1, 1], X[1, 2], X[2, 2]) + noise
