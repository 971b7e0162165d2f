"""SNAME's products of two velocities: a force coefficient times u v, w q, p r and so on.

    (force)_i  =  sum  F_ab a b,     F in X Y Z K M N,   a, b in u v w p q r (in this order)

`Y_pq` is the coefficient of p q in Y, with the sign of SNAME: it adds to the force. Products are
what a published set has beside M_A, D_l and D_q. C_A is made of M_A here, so that a product that a
publication lists *combined* stands here less its part of C_A. What should brake or lift in either
direction is no product: |u| v belongs to `D_u` (lift.py), |v| v to `D_q` (damping.py).
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from uuvsim_cosim.models.declaration.hull_parameters import product_of

__all__ = ["products"]


def products(p: Mapping[str, ca.SX], nu_r: ca.SX) -> ca.SX:
    """Return the generalised force (6) [N, N.m] of all products among the parameters."""
    force = ca.SX(6, 1)
    for name, coefficient in p.items():
        product = product_of(name)
        if product is not None:
            force[product.force] += coefficient * (nu_r[product.a] * nu_r[product.b])
    return force
