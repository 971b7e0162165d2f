"""SNAME's products of two velocities: a force coefficient times u v, w q, p r and so on.

    (force)_i  =  sum  F_ab a b,     F in X Y Z K M N,   a, b in u v w p q r (in this order)

`Y_pq` is the coefficient of p q in Y, with the sign of SNAME: it adds to the force. Products are
what a published set has beside M_A, D_l and D_q. C_A is made of M_A here, so that a product that a
publication lists *combined* stands here less its part of C_A. What should brake or lift in either
direction is no product: |u| v belongs to `D_u` (lift.py), |v| v to `D_q` (damping.py).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

__all__ = ["Product", "product_of", "products"]

FORCES, VELOCITIES = "XYZKMN", "uvwpqr"
_NAME = re.compile(rf"([{FORCES}])_([{VELOCITIES}])([{VELOCITIES}])$")
_PER = ("m2", "(m.rad)", "rad2")  # by the number of angular rates


@dataclass(frozen=True)
class Product:
    """One coefficient: rows from 0 of the force and of both velocities, unit and words."""

    force: int
    a: int
    b: int
    unit: str
    words: str


def product_of(name: str) -> Product | None:
    """Give what a name such as `Y_pq` stands for; None if it is no product in rising order."""
    match = _NAME.match(name)
    if match is None:
        return None
    force, a, b = FORCES.index(match[1]), VELOCITIES.index(match[2]), VELOCITIES.index(match[3])
    if a > b:
        return None
    unit = ("N.s2/" if force < 3 else "N.m.s2/") + _PER[(a > 2) + (b > 2)]
    square = f"{match[2]} {match[3]}" if a != b else f"{match[2]} squared"
    return Product(force, a, b, unit, f"coefficient of {square} in {match[1]}")


def products(p: Mapping[str, Any], nu_r: Any) -> Any:
    """Give the generalised force (6) [N, N.m] of all products among the parameters."""
    force = ca.SX(6, 1)
    for name, coefficient in p.items():
        product = product_of(name)
        if product is not None:
            force[product.force] += coefficient * (nu_r[product.a] * nu_r[product.b])
    return force
