"""Shafts: five models of how the speed n follows the commanded speed n_d.

first    dn/dt = (n_d - n) / T_n
second   d²n/dt² = omega_n² (n_d - n) - 2 zeta omega_n dn/dt
third    n = (b_1 s + a_0) / (s³ + a_2 s² + a_1 s + a_0) n_d: identified for the T200 (von Benzon
         et al. 2022, An Open-Source Benchmark Simulator, J. Mar. Sci. Eng. 10(12), 1898)
yoerger  dn/dt = alpha (|n_d| n_d - |n| n): torque against the propeller's own drag (Yoerger,
         Cooke and Slotine 1990, IEEE J. Oceanic Eng. 15(3), 167-178)
bessa    J dn/dt = k_t / R_m (u V - k_t n) - k_v |n| n: a motor at a voltage that may sag
         (Bessa, Dutra and Kreuzer 2006, with the motor's equation for its lumped constants)
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import abs_

__all__ = ["SHAFTS", "shaft"]

SHAFTS = ("first", "second", "third", "yoerger", "bessa")

_ASSUMED = "assumption, a T200 at 16 V"
_PAIR = "the complex pair of von Benzon et al. (2022)"


def shaft(
    m: Model,
    kind: str,
    n_d: ca.SX,
    T_n: ca.SX | None,
    u: ca.SX | None = None,
    voltage: ca.SX | None = None,
) -> ca.SX:
    """Declare a shaft of a kind; give its speed n [rad/s]. `u` and `voltage` are for bessa."""
    if kind not in SHAFTS or (kind == "bessa" and u is None):
        known = [s for s in SHAFTS if s != "bessa" or u is not None]
        raise InputInvalid(f"shaft={kind!r}", ", ".join(known))
    if kind == "third":
        source = "von Benzon et al. (2022)"
        a_0 = _parameter(m, "a_0", 108700.0, "1/s3", source)
        a_1 = _parameter(m, "a_1", 9258.0, "1/s2", source)
        a_2 = _parameter(m, "a_2", 89.0, "1/s", source)
        b_1 = _parameter(m, "b_1", 6136.0, "1/s2", source)
        units = ("rad/s", "rad/s2", "rad/s3")
        x = m.state("shaft", (0.0, 0.0, 0.0), unit=units, description="chain of integrators")
        m.der(x, ca.vertcat(x[1], x[2], a_0 * (n_d - x[0]) - a_1 * x[1] - a_2 * x[2]))
        return x[0] + b_1 / a_0 * x[1]
    n = m.state("shaft", unit="rad/s", description="shaft speed; its sign is the thrust's")
    if kind == "first":
        assert T_n is not None
        m.der(n, (n_d - n) * m.derived("rate", 1.0 / T_n))
    elif kind == "second":
        omega_n = _parameter(m, "omega_n", 90.9, "rad/s", f"natural frequency ({_PAIR})")
        zeta = _parameter(m, "zeta", 0.417, "1", f"damping ratio ({_PAIR})")
        turn = m.state("shaft_rate", unit="rad/s2", description="rate of the shaft speed")
        m.der(n, turn)
        m.der(turn, omega_n * (omega_n * (n_d - n) - 2.0 * zeta * turn))
    elif kind == "yoerger":
        alpha = _parameter(m, "alpha", 0.0471, "1/rad", "1 / (2 n_max T_n) (assumption)")
        m.der(n, alpha * (abs_(n_d) * n_d - abs_(n) * n))
    else:
        J = _parameter(m, "J", 1.6e-4, "kg.m2", f"inertia of shaft and water ({_ASSUMED})")
        k_t = _parameter(m, "k_t", 0.0195, "N.m/A", f"torque constant ({_ASSUMED})")
        R_m = _parameter(m, "R_m", 0.238, "Ohm", f"resistance ({_ASSUMED})")
        k_v = _parameter(m, "k_v", 5.27e-6, "N.m.s2/rad2", f"torque of |n| n ({_ASSUMED})")
        assert u is not None
        assert voltage is not None
        m.der(n, (k_t / R_m * (u * voltage - k_t * n) - k_v * abs_(n) * n) / J)
    return n


def _parameter(m: Model, name: str, value: float, unit: str, words: str) -> ca.SX:
    return m.parameter(name, value, unit=unit, min=1e-9, description=words)
