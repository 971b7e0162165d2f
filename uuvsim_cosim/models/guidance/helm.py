"""The helm: a scripted pilot that follows a moving point, with the outputs of a policy.

The wanted velocity is that of the point and a share of the distance to it,
w = v_d + k (p_d - p), |w| <= speed_max; the bow turns to it, and the surge speed becomes
|w| cos(psi_d - psi), 0 when looking away.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import atan2_or, clip, norm, saturate, wrap
from uuvsim_cosim.models.declaration.vectors import ETA, NU

__all__ = ["helm"]


def helm() -> Model:
    """Declare the helm: a and omega for a `pilot`, at every communication point."""
    m = Model("helm", "Scripted pilot that follows a moving point in the horizontal plane")
    eta = m.input("eta", 6, unit=ETA, description="estimate of N E D phi theta psi")
    nu = m.input("nu", 6, unit=NU, description="estimate, in b")
    p_d = m.input("position_d", 3, unit="m", description="of the point, in NED")
    v_d = m.input("velocity_d", 3, unit="m/s", description="of the point, in NED")
    k = m.parameter("k", 0.8, unit="1/s", min=0, description="share of the distance to make good")
    k_u = m.parameter("k_u", 2.0, unit="1/s", min=0, description="of the error of surge speed")
    k_psi = m.parameter("k_psi", 2.0, unit="1/s", min=0, description="of the error of heading")
    speed_max = m.parameter("speed_max", 0.3, unit="m/s", min=0, description="limit of |w|")
    a_max = m.parameter("a_max", 0.4, unit="m/s2", min=0, description="limit of a")
    omega_max = m.parameter("omega_max", 1.5, unit="rad/s", min=0, description="limit of omega")

    w = v_d[:2] + k * (p_d[:2] - eta[:2])
    speed = norm(w)
    error = wrap(atan2_or(w[1], w[0], eta[5]) - eta[5])
    u_d = clip(speed, 0.0, speed_max) * clip(ca.cos(error), 0.0, 1.0)
    m.output("a", saturate(k_u * (u_d - nu[0]), a_max), unit="m/s2", description="for the pilot")
    omega = saturate(k_psi * error, omega_max)
    m.output("omega", omega, unit="rad/s", description="for the pilot")
    return m
