"""Angles on the circle."""

from __future__ import annotations

import casadi as ca

__all__ = ["wrap"]

TURN = 6.283185307179586


def wrap(angle: ca.SX) -> ca.SX:
    """Return the angle in [-pi, pi); its gradient is 1."""
    return angle - TURN * ca.floor((angle + 0.5 * TURN) / TURN)
