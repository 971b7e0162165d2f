"""LQR autopilot of a vehicle with fins, with the motion through the water predicted.

    theta_d = theta_0 - asin(dD_d/dt / V) - K_D / K_theta (D - D_d) + z_theta
    delta_e = delta_0 - K_theta (theta - theta_d) - K_w w - K_q q - K_delta (d_e - delta_0)
    r_w     = r_d - K_psi / ((1 + K_delta) delta_psi + K_v v_psi + K_r) (psi - psi_d)
    delta_r = delta_psi r_w - K_v (v - v_psi r_w) - K_r (r - r_w)
              - K_delta (d_r - delta_psi r_w) - z_psi
    delta_a = -K_phi phi - K_p p - K_delta d_a - z_phi
    u       = u_0(u_d) + K_u (u_d - u) + z_u

The gains K, level flight (theta_0, delta_0, u_0) and the steady turn (v_psi, delta_psi) are those
of `fin_design.py`, interpolated over the speed through the water V. Neither V nor w and v relative
to the water are measured; each is predicted by its row of the linear model at the commands,

    dn/dt = (u - n) / T_n,         dV/dt = b_u (n - u_0(V)),
    dw/dt = A_ww w + A_wq q + A_wtheta (theta - theta_0) + B_w (d_e - delta_0),
    d(d_e)/dt = (delta_e - d_e) / T_delta,

and v as w, and d_r and d_a, the deflections, as d_e. So a current, which is in eta and nu, does
not change the gains; only the speed loop holds u over ground, as far as V stays within the speeds
of the design. theta_d is held within theta_max and follows with the largest pitch rate, r_w is
held within the largest yaw rate.
Integrals stop by back-calculation at these limits and at those of the fins and of the propeller.
Pitch and yaw saturate no fin together; roll gets the deflection that they leave.

An input that other controllers lack is `ascend`: above 0.5 it commands an emergency
ascent with full thrust and the largest pitch; the heading still follows the guidance.

With `wave_filter`, pitch, heading and their rates pass a notch at the frequency of encounter of
the waves, h(s) = (s² + 2 zeta omega_e s + omega_e²) / (s + omega_e)² (Fossen 2021, 2nd ed.,
chapter 13). Its lag is not part of the design.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.models.control.control_law import loop_inputs
from uuvsim_cosim.models.control.fin_design import THETA_MAX, design_fins
from uuvsim_cosim.models.declaration.model import Clock, Model, is_on
from uuvsim_cosim.models.declaration.safe_math import clip, saturate, wrap
from uuvsim_cosim.models.declaration.sampled import held_output

__all__ = ["autopilot"]


def autopilot(
    vehicle: str = "remus100", period: str = "0.02", wave_filter: bool | str = False
) -> Model:
    """Declare the autopilot of a vehicle with fins (``id``, ``id@set`` or a folder).

    Outputs are `delta_d`, a deflection [rad] for each fin of ``fins?vehicle=``, and `u`, the
    command of its propeller [1]. Raises ParameterInvalid as `design_fins` does.

    Example:

    >>> from uuvsim_cosim.models import declare
    >>> pilot = declare("autopilot", vehicle="remus100")
    >>> [(v.name, v.size) for v in pilot.of_kind("output")][:2]
    [('delta_d', 4), ('u', 1)]
    """
    d = design_fins(vehicle)
    m = Model("autopilot", f"Autopilot of {vehicle}: depth through pitch, heading, speed, roll")
    eta_d, nu_d, eta, nu = loop_inputs(m)
    ascend = m.input("ascend", unit="1", min=0, max=1, description="1: emergency ascent") > 0.5
    speeds = _rounded(d.V)
    grid = m.parameter("V", speeds, unit="m/s", tunable=False, description="speeds of the design")
    theta_max = m.parameter(
        "theta_max", THETA_MAX, unit="rad", min=0, description="largest wanted pitch (assumption)"
    )
    delta_max = m.parameter("delta_max", d.delta_max, unit="rad", min=0, description="of each fin")
    limit = m.parameter(
        "limit", _rounded(d.limit), unit="rad", min=0, description="roll, pitch, yaw command"
    )
    mix = m.parameter(
        "mix", _rounded(d.mix), unit="1", description="fins by roll, pitch, yaw command"
    )
    sample = m.clock("sample", period)
    T = float(sample.period)
    started = m.discrete("started", unit="1")
    V_k = m.discrete("V_water", unit="m/s", description="predicted speed through the water")
    n_k = m.discrete("n", unit="1", description="predicted shaft speed over n_max")
    running = started > 0.5
    V = ca.if_else(running, V_k, clip(nu[0], grid[0], grid[len(d.V) - 1]))
    width = float(speeds[1] - speeds[0])
    theta, psi, q, r = eta[4], eta[5], nu[4], nu[5]
    if is_on("wave_filter", wave_filter):
        theta, psi, q, r = _notched(m, sample, eta, nu)

    def scheduled(name: str, rows: ArrayLike, unit: str | tuple[str, ...], at: ca.SX) -> ca.SX:
        """Declare a table over the speeds; return its value at a speed, held beyond the ends."""
        table = _rounded(rows)
        table = table.reshape(len(d.V), -1)
        units = unit if isinstance(unit, str) else unit * len(d.V)
        values = m.parameter(name, table, unit=units, tunable=False, description="over V")
        return ca.mtimes(hats(at), values).T

    def hats(at: ca.SX) -> ca.SX:
        place = (clip(at, grid[0], grid[len(d.V) - 1]) - grid[0]) / width
        return ca.horzcat(*(clip(1.0 - ca.fabs(place - i), 0.0, 1.0) for i in range(len(d.V))))

    # Speed.
    u_0 = m.parameter(
        "u_0", _rounded(d.u).reshape(-1, 1), unit="1", tunable=False, description="over V"
    )
    u_d = clip(nu_d[0], grid[0], grid[len(d.V) - 1])
    gain = scheduled("K_u", d.K_u, ("s/m", "1/m"), V)
    z_u = m.discrete("z_u", unit="1", description="integral of the speed's error")
    e_u = u_d - nu[0]
    wanted = ca.mtimes(hats(u_d), u_0) + gain[0] * e_u + z_u
    u = ca.if_else(ascend, 1.0, clip(wanted, u_0[0], 1.0))
    back = gain[1] / (gain[0] + 1e-9) * (clip(wanted, u_0[0], 1.0) - wanted)
    m.update(sample, z_u, ca.if_else(ascend, z_u, z_u + T * (gain[1] * e_u + back)))
    n = ca.if_else(running, n_k, ca.mtimes(hats(V), u_0))
    b_u = scheduled("b_u", d.b_u, "m/s2", V)
    m.update(sample, n_k, n + T / (T + d.shaft) * (u - n))
    m.update(
        sample, V_k, clip(V + T * b_u * (n - ca.mtimes(hats(V), u_0)), grid[0], 1.2 * grid[-1])
    )

    T_delta = m.parameter("T_delta", round(d.lag, 9), unit="s", min=1e-3, tunable=False,
                          description="of the servos, and the delay")  # fmt: skip

    def deflection(name: str, rest: ca.SX) -> tuple[ca.SX, Callable[[ca.SX], None]]:
        """Return the predicted deflection of one command from `rest`, and what gives it this."""
        held = m.discrete(name, unit="rad", description="predicted deflection, from level flight")
        return held, lambda to: m.update(
            sample, held, held + T / (T + T_delta) * (to - rest - held)
        )

    # Depth through pitch.
    K = scheduled("K_depth", d.depth.K, ("rad/(m.s)", "rad/m", "1", "rad.s/m", "s", "1"), V)
    level = scheduled("level", np.column_stack([d.theta, d.delta]), "rad", V)
    rows = np.column_stack([d.depth.A[:, 2, 1:], d.depth.B[:, 2]])
    row = scheduled("A_w", rows, ("m/(s2.rad)", "1/s", "m/(s.rad)", "m/(s2.rad)"), V)
    w, z_D = (
        m.discrete(name, unit=unit, description=words)
        for name, unit, words in (
            ("w_water", "m/s", "predicted, from that of level flight"),
            ("z_theta", "rad", "integral of the depth's error"),
        )
    )
    e_D, pitch = eta[2] - eta_d[2], theta - level[0]
    climb = ca.asin(clip(nu_d[2] / V, -0.5, 0.5))
    wish = level[0] - climb - K[1] / K[2] * e_D + z_D
    fastest = scheduled("rates", d.rates, "rad/s", V)
    before = m.discrete("theta_before", unit="rad")
    start = ca.if_else(running, before, theta)
    goal = ca.if_else(ascend, theta_max, saturate(wish, theta_max))
    theta_d = start + saturate(goal - start, T * fastest[0])
    m.update(sample, before, theta_d)
    d_e, follow_e = deflection("d_e", level[1])
    delta_e = level[1] - K[2] * (theta - theta_d) - K[3] * w - K[4] * q - K[5] * d_e
    held_e = saturate(delta_e, limit[1])
    # A command beyond the limit of theta_d or of the planes holds the integral.
    short = theta_d - wish + (held_e - delta_e) / K[2]
    z_rate = -K[0] / K[2] * e_D + K[0] / K[1] * short
    m.update(sample, z_D, ca.if_else(ascend, z_D, saturate(z_D + T * z_rate, theta_max)))
    pushed = row[0] * pitch + row[2] * q + row[3] * d_e
    follow_e(held_e)
    m.update(sample, w, (w + T * pushed) / (1.0 - T * row[1]))

    # Heading.
    K = scheduled("K_heading", d.heading.K, ("1/s", "1", "rad.s/m", "s", "1"), V)
    turn = scheduled("turn", d.turn, ("m/rad", "s"), V)
    rows = np.column_stack([d.heading.A[:, 1, 1:], d.heading.B[:, 1]])
    row = scheduled("A_v", rows, ("1/s", "m/(s.rad)", "m/(s2.rad)"), V)
    v = m.discrete("v_water", unit="m/s", description="predicted sway through the water")
    z_psi = m.discrete("z_psi", unit="rad", description="integral of the heading's error")
    e_psi = wrap(psi - eta_d[5])
    factor = K[1] / ((1.0 + K[4]) * turn[1] + K[2] * turn[0] + K[3])
    r_wish = nu_d[5] - factor * e_psi
    r_w = saturate(r_wish, fastest[1])
    d_r, follow_r = deflection("d_r", ca.SX(0.0))
    delta_r = (1.0 + K[4]) * turn[1] * r_w - K[2] * (v - turn[0] * r_w) - K[3] * (r - r_w)
    delta_r -= K[4] * d_r + z_psi
    held_r = saturate(delta_r, limit[2])
    short = (r_w - r_wish) / factor + (delta_r - held_r) / K[1]
    grown = saturate(z_psi + T * K[0] * (e_psi + short), limit[2])
    m.update(sample, z_psi, grown)
    m.update(sample, v, (v + T * (row[1] * r + row[2] * d_r)) / (1.0 - T * row[0]))

    follow_r(held_r)

    # Roll, by the deflection that pitch and yaw leave.
    shared = mix[:, 1] * held_e + mix[:, 2] * held_r
    applied_a: ca.SX = ca.SX(0.0)
    if d.roll is not None:
        K = scheduled("K_roll", d.roll.K, ("1/s", "1", "s", "1"), V)
        z_phi = m.discrete("z_phi", unit="rad", description="integral of the roll angle")
        d_a, follow_a = deflection("d_a", ca.SX(0.0))
        delta_a = -K[1] * eta[3] - K[2] * nu[3] - K[3] * d_a - z_phi
        left = (delta_max - ca.fabs(shared)) / (ca.fabs(mix[:, 0]) + 1e-9)
        most = ca.fmax(0.0, ca.fmin(limit[0], ca.mmin(left)))
        applied_a = saturate(delta_a, most)
        follow_a(applied_a)
        tracking = K[0] / (K[1] + 1e-9) * (applied_a - delta_a)
        m.update(sample, z_phi, saturate(z_phi + T * (K[0] * eta[3] - tracking), limit[0]))
    m.update(sample, started, 1.0)
    fins = shared + mix[:, 0] * applied_a
    fins = ca.vertcat(*(saturate(fins[i], delta_max[i]) for i in range(len(d.delta_max))))
    words = f"deflections for the {len(d.delta_max)} fins of {vehicle}"
    rest = (0.0,) * len(d.delta_max)
    held_output(m, sample, "delta_d", fins, unit="rad", start=rest, description=words)
    words = "command of the propeller"
    held_output(m, sample, "u", u, unit="1", start=float(_rounded(d.u)[0]), description=words)
    held_output(m, sample, "theta_d", theta_d, unit="rad", description="wanted pitch")
    m.output("V_through_water", V_k, unit="m/s", description="predicted", discrete=True)
    return m


def _notched(m: Model, sample: Clock, eta: ca.SX, nu: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return pitch, heading and their rates without the motion at the waves' frequency.

    y = x + 2 (zeta - 1) omega_e s / (s + omega_e)² x, by the bilinear transform at omega_e; the
    band of the heading is that of its turns, so that a turn by 360 degrees does not pass through.
    """
    T = float(sample.period)
    omega = m.parameter(
        "omega_e", 0.8, unit="rad/s", min=1e-3, max=0.9 * np.pi / T, description="of encounter"
    )
    zeta = m.parameter("zeta_n", 0.1, unit="1", min=0, max=1, description="depth of the notch")
    g = ca.tan(0.5 * omega * T)
    found = []
    before_psi = m.discrete("psi_before", unit="rad")
    turned = m.discrete("turned", unit="rad", description="heading without jumps")
    started = m.discrete("filter_started", unit="1")
    heading = ca.if_else(started > 0.5, turned + wrap(eta[5] - before_psi), eta[5])
    m.update(sample, before_psi, eta[5])
    m.update(sample, turned, heading)
    m.update(sample, started, 1.0)
    for name, x in (("theta", eta[4]), ("psi", heading), ("q", nu[4]), ("r", nu[5])):
        unit = "rad" if name in ("theta", "psi") else "rad/s"
        x_1, x_2, v_1, v_2 = (
            m.discrete(f"{name}_{k}", unit=unit) for k in ("x1", "x2", "v1", "v2")
        )
        # v = s omega / (s + omega)² x:  (g (1 - z^-2)) / ((1 + g) + (g - 1) z^-1)²
        past = (2.0 * (g * g - 1.0) * v_1 + (g - 1.0) ** 2 * v_2) / (1.0 + g) ** 2
        v = g * (x - ca.if_else(started > 0.5, x_2, x)) / (1.0 + g) ** 2 - past
        v = ca.if_else(started > 0.5, v, 0.0)
        m.update(sample, x_2, ca.if_else(started > 0.5, x_1, x))
        m.update(sample, x_1, x)
        m.update(sample, v_2, v_1)
        m.update(sample, v_1, v)
        found.append(x + 2.0 * (zeta - 1.0) * v)
    return found[0], found[1], found[2], found[3]


def _rounded(values: ArrayLike) -> NDArray[np.float64]:
    """Round a design to six digits, so that another machine's linear algebra gives equal values."""
    exact = np.round(np.asarray(values, dtype=float), 9) + 0.0  # no -0
    digits = [float(f"{x:.6g}") for x in exact.ravel()]
    return np.array(digits).reshape(exact.shape)
