"""Glide in the vertical plane: speed through the water of recorded pitch, volume and density.

With the pitch theta prescribed, surge and heave of the hull's equation (models/hull/vehicle.py)
remain. u and w are ahead and down in b, q is the rate of the pitch. With m_1 = m + M_A_11 and
m_3 = m + M_A_33:

    m_1 u_dot = -F sin(theta) + X - m_3 w q
    m_3 w_dot =  F cos(theta) + Z + m_1 u q
    F = g (m - density (nabla (1 - epsilon p) + V))          net weight

X and Z are the lift and the drag of models/hull/wings.py, at no rate. `steady_glide` sets the left
sides and q to zero, `dynamic_glide` integrates. The rate of depth is w cos(theta) - u sin(theta).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.declaration.parameter_files import parameter_set, split_address
from uuvsim_cosim.studies.glider.flight import GliderFlight, depth_rate, smoothed

__all__ = ["Glide", "Motion", "dynamic_glide", "fit_glide", "glide_of", "steady_glide"]

Array = NDArray[np.float64]
STEP = 0.5  # s, of the integration
APART = 10.0  # s: a longer gap begins a new part
AT_SURFACE = 0.5  # m


@dataclass(frozen=True)
class Glide:
    """Coefficients of a glide, by the names of the hull's parameters, in SI."""

    m: float
    nabla: float
    g: float
    epsilon: float  # 1/Pa, relative loss of volume
    S: float
    C_L_alpha: float
    C_D_0: float
    C_D_alpha: float
    C_N: float
    alpha_stall: float
    M_A_11: float
    M_A_33: float


@dataclass(frozen=True)
class Motion:
    """Computed motion at the samples of a flight: u and w in b, and the pitch used."""

    u: Array
    w: Array
    pitch: Array

    @property
    def speed(self) -> Array:
        """Return the speed through the water [m/s]."""
        return np.hypot(self.u, self.w)

    @property
    def depth_rate(self) -> Array:
        """Return the rate of depth [m/s], down is positive."""
        rate: Array = self.w * np.cos(self.pitch) - self.u * np.sin(self.pitch)
        return rate


def glide_of(vehicle: str = "slocum") -> Glide:
    """Return the coefficients of a vehicle's parameter set (``id`` or ``id@set``)."""
    values = {k: q.value for k, q in parameter_set(*split_address(vehicle)).quantities.items()}
    values["epsilon"] = values["beta_nabla"] / (values["rho"] * values["g"])
    return Glide(**{f.name: values[f.name] for f in fields(Glide)})


def net_weight(glide: Glide, flight: GliderFlight) -> Array:
    """Return the weight less the buoyancy [N]."""
    displaced = glide.nabla * (1.0 - glide.epsilon * flight.pressure) + flight.volume
    weight: Array = glide.g * (glide.m - flight.density * displaced)
    return weight


def lift_and_drag(glide: Glide, density: Array, u: Array, w: Array) -> tuple[Array, Array]:
    """Return X and Z [N] in b of hull and wings, as models/hull/wings.py computes them."""
    V = np.maximum(np.hypot(u, w), 1e-12)
    sine = w / V
    limit = np.sin(glide.alpha_stall)
    q_S = 0.5 * density * glide.S
    s = np.clip(sine, -limit, limit)
    lift = q_S * glide.C_L_alpha * s * u
    drag = q_S * (glide.C_D_0 + glide.C_D_alpha * s * s) * V
    normal = q_S * glide.C_N * (sine * sine - s * s) * V * V * np.sign(w)
    return lift * w - drag * u, -lift * u - normal - drag * w


def steady_glide(glide: Glide, flight: GliderFlight) -> Motion:
    """Return the equilibrium of the forces at each sample; no motion where there is none.

    Along the flow, drag balances the net weight; across it, lift does. With a = |alpha| and
    theta = |pitch|, this is  C_L_alpha sin(a) cos(a) tan(theta + a) = C_D, solved by iteration.
    """
    theta = np.abs(flight.pitch)
    a = np.full_like(theta, 0.05)
    for _ in range(60):
        C_D = glide.C_D_0 + glide.C_D_alpha * np.sin(a) ** 2
        slope = glide.C_L_alpha * np.cos(a) * np.tan(np.maximum(theta + a, 0.05))
        a = np.arcsin(np.clip(0.5 * (np.sin(a) + C_D / slope), 0.0, np.sin(glide.alpha_stall)))
    C_D = glide.C_D_0 + glide.C_D_alpha * np.sin(a) ** 2
    along = -np.sign(flight.pitch) * net_weight(glide, flight) * np.sin(theta + a)
    V = np.sqrt(np.maximum(along, 0.0) / (0.5 * flight.density * glide.S * C_D))
    return Motion(V * np.cos(a), -np.sign(flight.pitch) * V * np.sin(a), flight.pitch)


def dynamic_glide(
    glide: Glide, flight: GliderFlight, samples: int = 9, surface: float = AT_SURFACE
) -> Motion:
    """Return the motion by integration, from 0.3 m/s ahead at the begin of each part.

    A part ends at the surface and at a gap of the record. The pitch is the mean over `samples` of
    them, because its rate is needed. At the surface, which is above a depth of `surface` [m], the
    motion is NaN.
    """
    pitch = smoothed(flight.pitch, samples)
    F = net_weight(glide, flight)
    parts = _parts(flight, surface)
    steps = int(max(flight.t[b - 1] - flight.t[a] for a, b in parts) / STEP) + 2
    grid = np.array([flight.t[a] + STEP * np.arange(steps) for a, _ in parts])
    theta, force, density = (np.interp(grid, flight.t, x) for x in (pitch, F, flight.density))
    q = np.gradient(theta, STEP, axis=1)
    inputs = np.array([np.sin(theta), np.cos(theta), q, force, density])
    middle = 0.5 * (inputs[..., 1:] + inputs[..., :-1])
    m_1, m_3 = glide.m + glide.M_A_11, glide.m + glide.M_A_33

    def rate(x: Array, at: Array) -> Array:
        sine, cosine, q, force, density = at
        X, Z = lift_and_drag(glide, density, x[0], x[1])
        return np.array(
            [
                (X - force * sine - m_3 * x[1] * q) / m_1,
                (Z + force * cosine + m_1 * x[0] * q) / m_3,
            ]
        )

    x = np.array([np.full(len(parts), 0.3), np.zeros(len(parts))])
    path = np.empty((2, len(parts), steps))
    path[..., 0] = x
    for k in range(steps - 1):
        k_1 = rate(x, inputs[..., k])
        k_2 = rate(x + 0.5 * STEP * k_1, middle[..., k])
        k_3 = rate(x + 0.5 * STEP * k_2, middle[..., k])
        k_4 = rate(x + STEP * k_3, inputs[..., k + 1])
        x = x + STEP / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)
        path[..., k + 1] = x
    u, w = np.full_like(F, np.nan), np.full_like(F, np.nan)
    for i, (a, b) in enumerate(parts):
        u[a:b] = np.interp(flight.t[a:b], grid[i], path[0, i])
        w[a:b] = np.interp(flight.t[a:b], grid[i], path[1, i])
    return Motion(u, w, pitch)


def _parts(flight: GliderFlight, surface: float) -> list[tuple[int, int]]:
    """Return first and last sample + 1 of each part below the surface."""
    below = flight.depth > surface
    new = np.diff(flight.t, prepend=flight.t[0]) > APART
    parts: list[tuple[int, int]] = []
    begin = -1
    for i, under in enumerate(below):
        if begin >= 0 and (not under or new[i]):
            parts.append((begin, i))
            begin = -1
        if under and begin < 0:
            begin = i
    if begin >= 0:
        parts.append((begin, len(below)))
    return [(a, b) for a, b in parts if b - a > 1]


def fit_glide(
    flight: GliderFlight,
    rows: NDArray[np.bool_],
    start: Glide,
    names: Sequence[str] = ("C_D_0", "nabla"),
    *,
    steady: bool = False,
    samples: int = 11,
    surface: float = AT_SURFACE,
) -> Glide:
    """Return `start` with the named coefficients fitted to the rate of depth at `rows`.

    Least squares on means over `samples` of the measured rate.
    """
    from scipy.optimize import least_squares

    measured = depth_rate(flight, samples)[rows]
    last = int(np.flatnonzero(rows)[-1]) + 1
    flight, rows = flight.until(last), rows[:last]
    first = np.array([getattr(start, name) for name in names])

    def glide(x: Array) -> Glide:
        return replace(start, **dict(zip(names, (x * first).tolist(), strict=True)))

    def difference(x: Array) -> Array:
        moved = glide(x)
        motion = (
            steady_glide(moved, flight) if steady
            else dynamic_glide(moved, flight, surface=surface)
        )  # fmt: skip
        return np.nan_to_num(motion.depth_rate[rows] - measured)

    # nabla acts through its difference to m / density, of 1e-3: small relative steps.
    scale = [1e-4 if name in ("nabla", "m") else 0.1 for name in names]
    found = least_squares(
        difference, np.ones(len(names)), x_scale=scale, diff_step=[1e-6] * len(names)
    )
    return glide(found.x)
