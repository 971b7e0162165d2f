"""Units of the vectors that components share, element by element (SNAME)."""

from __future__ import annotations

__all__ = ["ETA", "INERTIA", "NU", "NU_DOT", "TAU", "per"]

ETA = ("m",) * 3 + ("rad",) * 3  # N E D phi theta psi
NU = ("m/s",) * 3 + ("rad/s",) * 3  # u v w p q r
NU_DOT = ("m/s2",) * 3 + ("rad/s2",) * 3
TAU = ("N",) * 3 + ("N.m",) * 3  # X Y Z K M N
INERTIA = ("kg",) * 3 + ("kg.m2",) * 3  # the diagonal of M


def per(linear: str, angular: str) -> tuple[str, ...]:
    """Return the units of a gain's diagonal: of three forces, and of three moments."""
    return (linear,) * 3 + (angular,) * 3
