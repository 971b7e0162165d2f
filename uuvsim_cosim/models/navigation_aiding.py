"""The measurements that correct the navigation filter, each as scalars with their rows H.

With l = r_sensor - r_imu, y = R' v and errors as in `strapdown`:

    DVL beam   d' (y + omega x l)          H = d' [1, S(l)]          on dy, db_g
    depth      (p + R l)_D + bias          H = [1, -(R S(l))_D, 1]   on dD, dtheta, bias
    compass    psi(q) + bias               H = [T_psi, 1]            on dtheta, bias
    USBL       p(t_sample) + R l           H = [1, -R S(l)]          on dp, dtheta
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from uuvsim_cosim.models.angle import wrap
from uuvsim_cosim.models.kalman import Correction, Measured
from uuvsim_cosim.models.kinematics import R, S, T_zyx, euler_of_q
from uuvsim_cosim.models.model import Clock, Model
from uuvsim_cosim.models.navigation_parameters import Figures
from uuvsim_cosim.models.safe_math import abs_
from uuvsim_cosim.models.sampled import BEFORE_FIRST
from uuvsim_cosim.models.seawater import depth_of_pressure
from uuvsim_cosim.models.strapdown import Inertial

__all__ = ["Aiding", "aiding", "history_states"]

HISTORY = 16  # remembered positions
SPACING = 0.1  # s between them


@dataclass
class Aiding:
    """Where measurements go: the model, the clock, the correction under way."""

    m: Model
    step: Clock
    correction: Correction
    c: Figures
    t: Any  # to which the estimate belongs

    def sensor(self, name: str) -> tuple[Any, Any]:
        """Declare a sensor's `valid` and `t_sample`; gives (is new, sample time)."""
        valid = self.m.input(
            f"{name}_valid", unit="1", type="Boolean", description="the reading can be used"
        )
        is_new, t_sample = self.sampled(name)
        return ca.logic_and(valid > 0.5, is_new), t_sample

    def sampled(self, name: str) -> tuple[Any, Any]:
        """Declare a sensor's `t_sample`; gives (has changed, sample time)."""
        t_sample = self.m.input(
            f"{name}_t_sample", unit="s", start=BEFORE_FIRST, description="of the reading"
        )
        last = self.m.discrete(f"{name}_t_last", BEFORE_FIRST, unit="s")
        self.m.update(self.step, last, t_sample)
        return t_sample > last + 1e-9, t_sample

    def take(self, name: str, measured: Sequence[Measured]) -> Any:
        """Correct by a reading's scalars; gives (refused so far, mean nu²/S of the latest)."""
        in_a_row = self.m.discrete(f"{name}_in_a_row", unit="1", description="readings refused")
        total = self.m.discrete(f"{name}_refused", unit="1", description="scalars refused")
        insists = in_a_row >= self.c.patience
        consistency = self.m.discrete(f"{name}_nis", 1.0, unit="1", description="mean nu²/S")
        refused, count, sum_nis = ca.SX(0.0), ca.SX(0.0), ca.SX(0.0)
        for z in measured:
            out, nis = self.correction.update(z, insists)
            refused = refused + out
            count = count + ca.if_else(z.is_new, 1.0, 0.0)
            sum_nis = sum_nis + ca.if_else(z.is_new, nis, 0.0)
        some = count > 0.5
        row = ca.if_else(refused > 0.5, in_a_row + 1.0, 0.0)
        self.m.update(self.step, in_a_row, ca.if_else(some, row, in_a_row))
        self.m.update(self.step, total, total + refused)
        mean = sum_nis / ca.if_else(some, count, 1.0)
        self.m.update(self.step, consistency, ca.if_else(some, mean, consistency))
        return ca.horzcat(total, consistency)


def history_states(m: Model, p_0: Any) -> tuple[Any, Any]:
    """Declare past positions of the IMU, newest first, and the time of the newest."""
    past = m.discrete("past", ca.repmat(p_0, HISTORY, 1), unit="m")
    return past, m.discrete("past_time", BEFORE_FIRST, unit="s")


def aiding(aid: Aiding, x: Inertial, omega: Any, b_s: Any, past: Any, past_time: Any) -> Any:
    """Correct by DVL, pressure, compass, USBL; gives a row (refused, nu²/S) for each (4, 2)."""
    return ca.vertcat(
        aid.take("dvl", _dvl(aid, x, omega)),
        aid.take("pressure", _pressure(aid, x, b_s[1])),
        aid.take("compass", _compass(aid, x, b_s[0])),
        aid.take("usbl", _usbl(aid, x, past, past_time)),
    )


def _row(n: int, parts: dict[int, Any]) -> Any:
    """Give the sparse row H that has the given row vectors at the given columns."""
    H = ca.SX(1, n)
    for at, part in parts.items():
        part = ca.SX(part)
        for k in range(part.numel()):
            H[0, at + k] = part[k]
    return H


def _dvl(aid: Aiding, x: Inertial, omega: Any) -> list[Measured]:
    c, n = aid.c, aid.correction.n
    beam = aid.m.input("dvl_beam_velocity", 4, unit="m/s", description="towards the bottom")
    ok = aid.m.input("dvl_beam_valid", 4, unit="1", description="1: a bottom echo")
    pinged, _ = aid.sampled("dvl")
    lever = c.r_dvl - c.r_imu
    there = ca.mtimes(R(x.q).T, x.v) + ca.cross(omega, lever)
    out = []
    for k in range(4):
        d = c.beams[:, k].T
        expected = ca.mtimes(d, there)
        H = _row(n, {3: d, 9: ca.mtimes(d, S(lever))})
        variance = c.sigma_beam**2 + (c.sigma_beam_relative * expected) ** 2 + 1e-12
        is_new = ca.logic_and(ok[k] > 0.5, pinged)
        out.append(Measured(beam[k] - expected, H, variance, is_new))
    return out


def _pressure(aid: Aiding, x: Inertial, bias: Any) -> list[Measured]:
    c = aid.c
    reading = aid.m.input("pressure", unit="Pa", start=101325.0, description="absolute")
    is_new, _ = aid.sensor("pressure")
    p_atm, salinity, temperature, g = c.water
    depth = depth_of_pressure(reading - p_atm, salinity, temperature, g)
    lever = c.r_pressure - c.r_imu
    down = R(x.q)[2, :]
    expected = x.p[2] + ca.mtimes(down, lever) + bias
    H = _row(aid.correction.n, {2: 1.0, 6: -ca.mtimes(down, S(lever)), 16: 1.0})
    return [Measured(depth - expected, H, c.sigma_depth**2 + 1e-12, is_new)]


def _compass(aid: Aiding, x: Inertial, bias: Any) -> list[Measured]:
    c = aid.c
    reading = aid.m.input("compass_psi", unit="rad", description="magnetic heading")
    is_new, _ = aid.sensor("compass")
    Theta = euler_of_q(x.q)
    upright = abs_(ca.cos(Theta[1])) > 0.1  # near the pole, heading says nothing
    H = _row(aid.correction.n, {6: T_zyx(Theta[0], Theta[1])[2, :], 15: 1.0})
    innovation = wrap(reading + c.declination - Theta[2] - bias)
    return [Measured(innovation, H, c.sigma_psi**2 + 1e-12, ca.logic_and(is_new, upright))]


def _usbl(aid: Aiding, x: Inertial, past: Any, past_time: Any) -> list[Measured]:
    c = aid.c
    fix = aid.m.input("usbl_position", 3, unit="m", description="of the transponder in NED")
    sigma = aid.m.input("usbl_sigma", 3, unit="m", start=(1, 1, 1), description="of N, E, D")
    is_new, t_sample = aid.sensor("usbl")
    steps_back = (past_time - t_sample) / SPACING
    then = ca.SX.zeros(3)
    for j in range(HISTORY):
        distance = abs_(steps_back - j)
        weight = ca.if_else(distance < 1.0, 1.0 - distance, 0.0)
        then = then + weight * past[3 * j : 3 * j + 3]
    then = ca.if_else(steps_back < 0.0, x.p - (aid.t - t_sample) * x.v, then)
    is_new = ca.logic_and(is_new, steps_back <= HISTORY - 1)
    lever = c.r_usbl - c.r_imu
    Rnb = R(x.q)
    turn = -ca.mtimes(Rnb, S(lever))
    expected = then + ca.mtimes(Rnb, lever)
    out = []
    for k in range(3):
        H = _row(aid.correction.n, {k: 1.0, 6: turn[k, :]})
        out.append(Measured(fix[k] - expected[k], H, sigma[k] ** 2 + 1e-12, is_new))
    return out
