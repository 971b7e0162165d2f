"""Tether: the force of a straight cable on the hull, quasi-static.

The cable runs straight from its upper end p_0 to the hull's eye, over a length l, in a current v_c.
A piece at the fraction s of the length (0 at the upper end) moves with s times the eye's velocity.
With U its velocity relative to the water, along (t) and across (n) the cable, the drag per metre is

    f = -1/2 rho d (C_n |U_n| U_n + pi C_t |U_t| U_t)

(the cross-flow principle: Hoerner 1965, Fluid-Dynamic Drag; the chapter was not checked). C_n = 1.2
is the value of a smooth cylinder; for a tether, Blue Robotics cites measurements near 2.0 (Kojima
et al., in discuss.bluerobotics.com/t/9092). C_t = 0.02 is an assumption. By balance of moments, the
eye carries the integral of s f l ds, half of the weight in water, and, if l exceeds the length l_0
that was paid out, the tension  E_A (l - l_0) / l_0. Sag, inertia and vibration are neglected, and
so are the tension of a slack cable and the drag of its extra length.
"""

from __future__ import annotations

from math import pi, sqrt

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R, q_of_euler
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.safe_math import norm
from uuvsim_cosim.models.declaration.vectors import ETA, NU, TAU

__all__ = ["tether"]

# Gauss and Legendre on [0, 1]: exact for polynomials of degree 5.
_AT = (0.5 - 0.5 * sqrt(0.6), 0.5, 0.5 + 0.5 * sqrt(0.6))
_WEIGHT = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


def tether(contact: bool | str = False) -> Model:
    """Declare a tether; with `contact` an input of that name is added to its generalised force."""
    m = Model("tether", "Tether from a point at the surface to the hull: drag, weight, tension")
    eta = m.input("eta", 6, unit=ETA, description="of the hull")
    nu = m.input("nu", 6, unit=NU, description="of the hull, in b")
    v_c = m.input("v_c", 3, unit="m/s", description="velocity of the water in n")
    p_0 = m.parameter("p_0", (0, 0, 0), unit="m", description="upper end in NED, at rest")
    r = m.parameter("r", (0, 0, 0), unit="m", description="eye of the hull from CO in b")
    d = m.parameter(
        "d", 0.0076, unit="m", min=0, description="diameter (Blue Robotics Fathom ROV tether)"
    )
    # A smooth cylinder; measured on tethers: up to 2. C_t: assumption.
    C_n = m.parameter("C_n", 1.2, unit="1", min=0, description="drag coefficient across the cable")
    C_t = m.parameter("C_t", 0.02, unit="1", min=0, description="friction coefficient along it")
    rho = m.parameter("rho", 1025.0, unit="kg/m3", min=0, description="density of the water")
    w = m.parameter("w", 0.0, unit="N/m", description="weight in water of each metre")
    l_0 = m.parameter("l_0", 100.0, unit="m", min=1e-3, description="length paid out")
    E_A = m.parameter("E_A", 1e4, unit="N", min=0, description="tension per strain when taut")

    Rnb = R(q_of_euler(eta[3], eta[4], eta[5]))
    eye = eta[:3] + ca.mtimes(Rnb, r)
    velocity = ca.mtimes(Rnb, nu[:3] + ca.cross(nu[3:], r))
    span = eye - p_0
    length = norm(span)
    along = span / ca.if_else(length > 1e-9, length, 1.0)
    drag = ca.SX.zeros(3)
    for s, weight in zip(_AT, _WEIGHT, strict=True):
        U = s * velocity - v_c
        U_t = ca.dot(U, along) * along
        U_n = U - U_t
        drag -= weight * s * (C_n * norm(U_n) * U_n + pi * C_t * norm(U_t) * U_t)
    drag *= 0.5 * rho * d * length
    tension = ca.if_else(length > l_0, E_A * (length - l_0) / l_0, 0.0)
    force = drag + ca.vertcat(0, 0, 0.5 * w * length) - tension * along
    body = ca.mtimes(Rnb.T, force)
    tau = ca.vertcat(body, ca.cross(r, body))
    if is_on("contact", contact):
        tau += m.input("contact", 6, unit=TAU, description="of others, about CO in b, added")
    m.output("tau", tau, unit=TAU, description="X Y Z [N], K M N [N.m] in b")
    m.output("tension", tension, unit="N", description="of the taut cable")
    m.output("length", length, unit="m", description="from its upper end to the eye")
    return m
