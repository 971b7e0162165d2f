"""The measurements that correct the navigation filter, each as scalars with their rows H.

With l = r_sensor - r_imu and errors as in `strapdown`:

    DVL beam   d' (R' v + omega x l)   H = [(R d)', d' S(l)]           on zeta, db_g
    depth      (p + R l)_D + bias      H = [1, -S(R l)_D, 1]           on dD, eta, bias
    compass    psi(q) + bias           H = [(c_psi, s_psi) t_theta, 1, 1]   on eta, bias
    USBL       p(t_sample) + R l       H = [1, -S(R l)]                on dp, eta

A reading is used at the first tick after it has arrived. A USBL fix, which is late anyway, waits
for the next correction, at most `WAIT`, so that the covariance need not be propagated to its own
tick.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.kinematics import S
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.safe_math import abs_, wrap
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST
from uuvsim_cosim.models.navigation.kalman import Correction, Measured
from uuvsim_cosim.models.navigation.nominal_sensors import Figures
from uuvsim_cosim.models.navigation.strapdown import Inertial
from uuvsim_cosim.models.water.seawater import depth_of_pressure

__all__ = ["WAIT", "Aiding", "History"]

WAIT = 0.1  # s, the longest time between corrections
LENGTH = 16  # remembered positions
SPACING = 0.1  # s between them


@dataclass(frozen=True)
class History:
    """Past positions of the IMU, newest first, and the time of the newest."""

    past: ca.SX
    newest: ca.SX

    @classmethod
    def declare(cls, m: Model, p_0: ca.SX) -> History:
        """Declare it, at p_0 before it begins."""
        past = m.discrete("past", ca.repmat(p_0, LENGTH, 1), unit="m")
        return cls(past, m.discrete("past_time", BEFORE_FIRST, unit="s"))

    def at(self, t_sample: ca.SX, now: ca.SX, x: Inertial) -> tuple[ca.SX, ca.SX]:
        """Return the position at a time before now, when the estimate is x; and if it is known."""
        steps_back = (self.newest - t_sample) / SPACING
        then = ca.SX.zeros(3)
        for j in range(LENGTH):
            distance = abs_(steps_back - j)
            weight = ca.if_else(distance < 1.0, 1.0 - distance, 0.0)
            then = then + weight * self.past[3 * j : 3 * j + 3]
        recent = x.p - (now - t_sample) * x.v
        return ca.if_else(steps_back < 0.0, recent, then), steps_back <= LENGTH - 1

    def moved(self, dp: ca.SX) -> ca.SX:
        """Return all positions shifted by dp."""
        return self.past + ca.repmat(dp, LENGTH, 1)


@dataclass
class Aiding:
    """The sensors that correct the filter: their readings, and the corrections so far."""

    m: Model
    step: Clock
    c: Figures
    is_new: dict[str, ca.SX] = field(default_factory=dict)
    reading: dict[str, ca.SX] = field(default_factory=dict)
    now_due: ca.SX | None = None

    def __post_init__(self) -> None:
        m = self.m
        self.reading["beam"] = m.input(
            "dvl_beam_velocity", 4, unit="m/s", description="towards the bottom"
        )
        self.reading["heard"] = m.input(
            "dvl_beam_valid", 4, unit="1", description="1: a bottom echo"
        )
        self._declare_sampling("dvl")
        self.reading["pressure"] = m.input(
            "pressure", unit="Pa", start=101325.0, description="absolute"
        )
        self._declare_sampling("pressure")
        self.reading["compass"] = m.input("compass_psi", unit="rad", description="magnetic heading")
        self._declare_sampling("compass")
        self.reading["fix"] = m.input(
            "usbl_position", 3, unit="m", description="of the transponder in NED"
        )
        self.reading["sigma"] = m.input(
            "usbl_sigma", 3, unit="m", start=(1, 1, 1), description="of N, E, D"
        )
        self._declare_sampling("usbl")

    def _declare_sampling(self, name: str) -> None:
        """Declare a sensor's `valid` and `t_sample`; its reading is new if that has changed."""
        valid = None  # the DVL states it for each beam
        if name != "dvl":
            valid = self.m.input(
                f"{name}_valid", unit="1", type="Boolean", description="the reading can be used"
            )
        t_sample = self.m.input(
            f"{name}_t_sample", unit="s", start=BEFORE_FIRST, description="of the reading"
        )
        last = self.m.discrete(f"{name}_t_last", BEFORE_FIRST, unit="s")
        self.reading[f"{name}_t"] = t_sample
        is_new = t_sample > last + 1e-9
        self.is_new[name] = is_new if valid is None else ca.logic_and(valid > 0.5, is_new)
        if name != "usbl":  # its fixes wait until a correction is due
            self.m.update(self.step, last, t_sample)

    def due(self, since: ca.SX) -> ca.SX:
        """Return whether a reading cannot wait, or the time `since` the last correction is long."""
        urgent = (self.is_new[name] for name in ("dvl", "pressure", "compass"))
        due = since >= WAIT - 1e-6
        for is_new in urgent:
            due = ca.logic_or(due, is_new)
        last = self.m.variables["usbl_t_last"].symbol
        self.m.update(self.step, last, ca.if_else(due, self.reading["usbl_t"], last))
        self.now_due = due
        return due

    def correct(
        self,
        by: Correction,
        x: Inertial,
        Rnb: ca.SX,
        omega: ca.SX,
        b_s: ca.SX,
        past: History,
        now: ca.SX,
    ) -> ca.SX:
        """Correct by DVL, pressure, compass, USBL; return a row (refused, nu²/S) of each (4, 2)."""
        c = self.c
        lever = c.r_dvl - c.r_imu
        there = ca.mtimes(Rnb.T, x.v) + ca.cross(omega, lever)
        beams = []
        for k in range(4):
            d = c.beams[:, k]
            expected = ca.dot(d, there)
            H = _row({3: ca.mtimes(Rnb, d), 9: ca.mtimes(d.T, S(lever))})
            variance = c.sigma_beam**2 + (c.sigma_beam_relative * expected) ** 2 + 1e-12
            is_new = ca.logic_and(self.reading["heard"][k] > 0.5, self.is_new["dvl"])
            beams.append(Measured(self.reading["beam"][k] - expected, H, variance, is_new))

        p_atm, salinity, temperature, g = c.water
        depth = depth_of_pressure(self.reading["pressure"] - p_atm, salinity, temperature, g)
        lever = ca.mtimes(Rnb, c.r_pressure - c.r_imu)
        H = _row({2: 1.0, 6: -S(lever)[2, :], 16: 1.0})
        innovation = depth - (x.p[2] + lever[2] + b_s[1])
        pressure = Measured(innovation, H, c.sigma_depth**2 + 1e-12, self.is_new["pressure"])

        level = Rnb[0, 0] ** 2 + Rnb[1, 0] ** 2  # cos(theta)²
        upright = level > 0.01  # near the pole, heading is undefined
        slope = -Rnb[2, 0] / ca.if_else(upright, level, 1.0)
        H = _row({6: ca.horzcat(slope * Rnb[0, 0], slope * Rnb[1, 0], 1.0), 15: 1.0})
        psi = ca.atan2(Rnb[1, 0], Rnb[0, 0])
        innovation = wrap(self.reading["compass"] + c.declination - psi - b_s[0])
        is_new = ca.logic_and(self.is_new["compass"], upright)
        compass = Measured(innovation, H, c.sigma_psi**2 + 1e-12, is_new)

        then, known = past.at(self.reading["usbl_t"], now, x)
        lever = ca.mtimes(Rnb, c.r_usbl - c.r_imu)
        innovation = self.reading["fix"] - (then + lever)
        is_new = ca.logic_and(self.is_new["usbl"], known)
        fix = [
            Measured(
                innovation[k],
                _row({k: 1.0, 6: -S(lever)[k, :]}),
                self.reading["sigma"][k] ** 2 + 1e-12,
                is_new,
            )
            for k in range(3)
        ]
        measured = {"dvl": beams, "pressure": [pressure], "compass": [compass], "usbl": fix}
        return ca.vertcat(*(self._take(name, by, scalars) for name, scalars in measured.items()))

    def _take(self, name: str, by: Correction, measured: Sequence[Measured]) -> ca.SX:
        """Correct by a reading's scalars; return (refused so far, mean nu²/S of the latest)."""
        assert self.now_due is not None  # `due` comes first
        in_a_row = self.m.discrete(f"{name}_in_a_row", unit="1", description="readings refused")
        total = self.m.discrete(f"{name}_refused", unit="1", description="scalars refused")
        insists = in_a_row >= self.c.patience
        consistency = self.m.discrete(f"{name}_nis", 1.0, unit="1", description="mean nu²/S")
        refused, count, sum_nis = ca.SX(0.0), ca.SX(0.0), ca.SX(0.0)
        before = by.P, by.dx
        for z in measured:
            out, nis = by.update(z, insists)
            refused = refused + out
            count = count + ca.if_else(z.is_new, 1.0, 0.0)
            sum_nis = sum_nis + ca.if_else(z.is_new, nis, 0.0)
        by.keep_unless(self.is_new[name], before)
        some = ca.logic_and(self.is_new[name], count > 0.5)
        row = ca.if_else(refused > 0.5, in_a_row + 1.0, 0.0)
        mean = sum_nis / ca.if_else(count > 0.5, count, 1.0)
        for state, value in (
            (in_a_row, row),
            (total, total + refused),
            (consistency, mean),
        ):
            taken = ca.if_else(some, value, state)
            self.m.update(self.step, state, ca.if_else(self.now_due, taken, state))
        return ca.horzcat(total, consistency)


def _row(parts: Mapping[int, Number], n: int = 17) -> ca.SX:
    """Return the sparse row H that has the given row vectors at the given columns."""
    H = ca.SX(1, n)
    for at, part in parts.items():
        part = ca.SX(part)
        for k in range(part.numel()):
            if part.sparsity().has_nz(*((0, k) if part.size1() == 1 else (k, 0))):
                H[0, at + k] = part[k]
    return H
