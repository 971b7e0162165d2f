"""The outline of a vehicle: an arrow-shaped hull from above, a slim one from the side."""

from __future__ import annotations

import numpy as np

from uuvsim_cosim.envs.pictures.canvas_coverage import Floats
from uuvsim_cosim.envs.pictures.drawn import Vehicle

__all__ = ["from_above", "from_the_side", "shown_size"]


def shown_size(vehicle: Vehicle, scale: float, size: float) -> tuple[float, float]:
    """Return length and breadth [px]: to scale, but never too small to be seen."""
    grow = max(1.0, 2.1 * size / (vehicle.length * scale))
    length = vehicle.length * scale * grow
    return length, max(vehicle.breadth * scale * grow, min(0.8 * size, length))


def from_above(length: float, breadth: float, psi: float) -> Floats:
    """Return the outline (n, 2) in x right, y down around its middle, bow towards psi, N up."""
    t = np.linspace(0.0, 1.0, 6)[:, None]
    bow, shoulder, beam = np.array([0.5, 0.0]), np.array([0.34, 0.46]), np.array([-0.08, 0.5])
    side = (1.0 - t) ** 2 * bow + 2.0 * t * (1.0 - t) * shoulder + t**2 * beam
    half = np.concatenate([side, [[-0.5, 0.4], [-0.36, 0.0]]])  # ahead, starboard
    other = half[-2:0:-1] * np.array([1.0, -1.0])
    ahead, starboard = (np.concatenate([half, other]) * np.array([length, breadth])).T
    c, s = np.cos(psi), np.sin(psi)
    return np.column_stack([s * ahead + c * starboard, -c * ahead + s * starboard])


def from_the_side(length: float, height: float, theta: float) -> Floats:
    """Return the outline (n, 2) in x right, y down, bow to the right and up by theta."""
    t = np.linspace(0.0, 1.0, 6)[:, None]
    bow, shoulder, deck = np.array([0.5, 0.0]), np.array([0.45, 0.5]), np.array([0.15, 0.5])
    side = (1.0 - t) ** 2 * bow + 2.0 * t * (1.0 - t) * shoulder + t**2 * deck
    half = np.concatenate([side, [[-0.36, 0.5], [-0.5, 0.15]]])  # ahead, up
    other = half[:0:-1] * np.array([1.0, -1.0])
    ahead, up = (np.concatenate([half, other]) * np.array([length, height])).T
    c, s = np.cos(theta), np.sin(theta)
    return np.column_stack([c * ahead - s * up, -s * ahead - c * up])
