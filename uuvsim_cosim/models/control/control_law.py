"""Common parts of control laws: connectors, errors in body axes, and a nominal hull.

With R of eta, and the wanted velocity nu_b turned into body axes,

    e = (R^T (p_d - p), T^-1 (Theta_d - Theta)),        nu_b = R^T R_d nu_d
    de/dt = nu_b - nu - (S(omega) e_p, 0)               near e = 0
    dnu_b/dt = R^T R_d (dnu_d/dt + S(omega_d) v_d) - (S(omega) v_b, 0)

dnu_d/dt is the difference of two samples through a first-order lag of T_ff. The nominal hull is
M, D_l, D_q and the restoring of a vehicle's file; lift, strips and products are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.parameter_files import parameter_set, split_address
from uuvsim_cosim.models.declaration.preset import Preset
from uuvsim_cosim.models.declaration.safe_math import abs_, saturate, wrap
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import ETA, INERTIA, NU, NU_DOT, TAU, per
from uuvsim_cosim.models.hull.coriolis import m2c
from uuvsim_cosim.models.hull.matrices import nominal, structure
from uuvsim_cosim.models.hull.restoring import g

__all__ = [
    "Loop",
    "NominalHull",
    "attitude_error",
    "feed_forward",
    "gains",
    "law",
    "loop_inputs",
    "nominal_hull",
    "nominal_matrices",
]

_MASS = ("kg", "kg.m", "kg.m", "kg.m2")
_LINEAR = ("N.s/m", "N.s/rad", "N.m.s/m", "N.m.s/rad")
_QUADRATIC = ("N.s2/m2", "N.s2/rad2", "N.m.s2/m2", "N.m.s2/rad2")


def nominal_matrices(vehicle: str) -> dict[str, np.ndarray]:
    """Return M, D_l, D_q (6, 6), W, B, r_g and r_b of a vehicle's file, in SI about CO."""
    numbers = {k: q.value for k, q in parameter_set(*split_address(vehicle)).quantities.items()}
    names = ("M", "W", "B", "r_g", "r_b", "D_l", "D_q")
    values = dict(zip(names, structure(numbers), strict=True))
    return {n: np.array(ca.evalf(ca.densify(ca.SX(v)))) for n, v in values.items()}


@dataclass(frozen=True)
class NominalHull:
    """The hull as a controller knows it; each method takes and gives vectors of 6 in b."""

    M: ca.SX
    D_l: ca.SX
    D_q: ca.SX
    W: ca.SX
    B: ca.SX
    r_g: ca.SX
    r_b: ca.SX

    def C(self, nu: ca.SX) -> ca.SX:
        """Return the skew-symmetric 6x6 matrix of Coriolis, of M = M_RB + M_A."""
        return m2c(self.M, nu)

    def D(self, nu: ca.SX) -> ca.SX:
        """Return the 6x6 damping  D_l + D_q diag(|nu|)."""
        return self.D_l + ca.mtimes(self.D_q, ca.diag(abs_(nu)))

    def g(self, eta: ca.SX) -> ca.SX:
        """Return the restoring force of the submerged hull at the attitude of eta."""
        down = R_zyx(eta[3], eta[4], eta[5])[2, :].T
        return g(self.W, self.B, self.r_g, self.r_b, down)


def nominal_hull(m: Model, vehicle: str) -> NominalHull:
    """Declare the nominal hull of a vehicle as parameters of a controller."""
    v = nominal_matrices(vehicle)

    def matrix(name: str, units: tuple[str, ...], words: str) -> ca.SX:
        each = [units[2 * (i > 2) + (j > 2)] for i in range(6) for j in range(6)]
        return m.parameter(name, v[name], unit=each, description=f"{words}, as the law knows it")

    return NominalHull(
        M=matrix("M", _MASS, "M_RB + M_A"),
        D_l=matrix("D_l", _LINEAR, "linear damping"),
        D_q=matrix("D_q", _QUADRATIC, "quadratic damping"),
        W=m.parameter("W", float(v["W"].item()), unit="N", min=0, description="weight"),
        B=m.parameter("B", float(v["B"].item()), unit="N", min=0, description="buoyancy"),
        r_g=m.parameter("r_g", v["r_g"].ravel(), unit="m", description="CG from CO"),
        r_b=m.parameter("r_b", v["r_b"].ravel(), unit="m", description="CB from CO"),
    )


@dataclass(frozen=True)
class Loop:
    """One sample of a loop: what a law may use, in body axes, and how to keep its states."""

    m: Model
    sample: Clock
    T: float  # s, the period
    eta_d: ca.SX
    eta: ca.SX
    nu: ca.SX
    e: ca.SX  # error of eta
    e_dot: ca.SX
    nu_b: ca.SX  # wanted velocity
    a_b: ca.SX  # wanted acceleration
    tau_max: ca.SX

    def in_body(self, x: ca.SX) -> ca.SX:
        """Turn a vector, force in n and moment in b, into b."""
        return ca.vertcat(ca.mtimes(self._R.T, x[:3]), x[3:])

    def in_ned(self, x: ca.SX) -> ca.SX:
        """Turn the force of a vector into n; the moment stays in b."""
        return ca.vertcat(ca.mtimes(self._R, x[:3]), x[3:])

    @property
    def _R(self) -> ca.SX:
        return R_zyx(self.eta[3], self.eta[4], self.eta[5])

    def integral(self, name: str, unit: tuple[str, ...] = TAU) -> ca.SX:
        """Declare an integral, held in n (its moment in b), which starts at 0."""
        return self.m.discrete(name, (0,) * 6, unit=unit, description="held in n, moment in b")

    def close(self, tau: ca.SX, z: ca.SX, rate: Callable[[ca.SX], ca.SX], limit: ca.SX) -> None:
        """Declare tau, limited; z grows by rate(tau_d - tau), so that it can stop at a limit."""
        tau_d = saturate(tau, self.tau_max)
        self.m.update(self.sample, z, saturate(z + self.T * rate(tau_d - tau), limit))
        words = "X Y Z [N], K M N [N.m]"
        held_output(
            self.m, self.sample, "tau_d", tau_d, unit=TAU, start=(0,) * 6, description=words
        )


def loop_inputs(m: Model) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Declare the inputs of a motion controller: eta_d, nu_d, eta and nu (6,) each."""
    eta_d = m.input("eta_d", 6, unit=ETA, description="wanted N E D phi theta psi")
    nu_d = m.input("nu_d", 6, unit=NU, description="wanted, in axes of eta_d")
    eta = m.input("eta", 6, unit=ETA, description="estimate of N E D phi theta psi")
    nu = m.input("nu", 6, unit=NU, description="estimate, in b")
    return eta_d, nu_d, eta, nu


def feed_forward(m: Model, vehicle: str) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Declare the diagonals of M, D_l and D_q (6,) of a vehicle's file as parameters."""
    mass, linear, quadratic = nominal(vehicle)
    M = m.parameter("M_ff", mass, unit=INERTIA, description="diagonal of M_RB + M_A")
    D_l = m.parameter(
        "D_l_ff", linear, unit=per("N.s/m", "N.m.s/rad"), description="linear damping, diagonal"
    )
    D_q = m.parameter(
        "D_q_ff", quadratic, unit=per("N.s2/m2", "N.m.s2/rad2"),
        description="quadratic damping, diagonal",
    )  # fmt: skip
    return M, D_l, D_q


def attitude_error(eta: ca.SX, eta_d: ca.SX) -> ca.SX:
    """Return the attitude error in body axes: T(Theta)^-1 (Theta_d - Theta), shortest way."""
    d = wrap(eta_d[3:] - eta[3:])
    phi, theta = eta[3], eta[4]
    return ca.vertcat(
        d[0] - ca.sin(theta) * d[2],
        ca.cos(phi) * d[1] + ca.cos(theta) * ca.sin(phi) * d[2],
        -ca.sin(phi) * d[1] + ca.cos(theta) * ca.cos(phi) * d[2],
    )


def law(m: Model, p: Preset, period: str) -> Loop:
    """Declare the connectors of a controller, its clock and tau_max; return the inputs of a law."""
    eta_d, nu_d, eta, nu = loop_inputs(m)
    tau_max = p.parameter(m, "tau_max", TAU, "limit of tau_d", 6, min=0)
    T_ff = p.parameter(m, "T_ff", "s", "lag of dnu_d/dt", min=1e-3)
    sample = m.clock("sample", period)
    T = float(sample.period)
    R, R_d = R_zyx(eta[3], eta[4], eta[5]), R_zyx(eta_d[3], eta_d[4], eta_d[5])
    turn = ca.mtimes(R.T, R_d)
    e_p = ca.mtimes(R.T, eta_d[:3] - eta[:3])
    e = ca.vertcat(e_p, attitude_error(eta, eta_d))
    nu_b = ca.vertcat(ca.mtimes(turn, nu_d[:3]), ca.mtimes(turn, nu_d[3:]))
    e_dot = nu_b - nu - ca.vertcat(ca.cross(nu[3:], e_p), ca.SX.zeros(3))

    started = m.discrete("started", unit="1")
    before = m.discrete("nu_d_before", (0,) * 6, unit=NU)
    smooth = m.discrete("nu_d_dot", (0,) * 6, unit=NU_DOT, description="smoothed")
    slope = ca.if_else(started > 0.5, (nu_d - before) / T, ca.SX.zeros(6))
    nu_d_dot = smooth + T / (T_ff + T) * (slope - smooth)
    m.update(sample, started, 1.0)
    m.update(sample, before, nu_d)
    m.update(sample, smooth, nu_d_dot)
    linear = ca.mtimes(turn, nu_d_dot[:3] + ca.cross(nu_d[3:], nu_d[:3]))
    a_b = ca.vertcat(linear - ca.cross(nu[3:], nu_b[:3]), ca.mtimes(turn, nu_d_dot[3:]))
    return Loop(m, sample, T, eta_d, eta, nu, e, e_dot, nu_b, a_b, tau_max)


def gains(m: Model, p: Preset, *named: tuple[str, str, str, str]) -> list[ca.SX]:
    """Declare diagonal gains (name, unit of forces, unit of moments, meaning) of a preset."""
    return [p.parameter(m, name, per(f, k), words, 6, min=0) for name, f, k, words in named]
