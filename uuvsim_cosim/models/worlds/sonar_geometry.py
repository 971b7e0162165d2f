"""Geometry of a sonar: its rays, the pattern of its array over bearing, and its pulse over range.

A line array along y of the sensor measures u, the sine of the angle between an echo and the x-z
plane. Its two-way pattern about a beam at u_b is that of the receiving aperture of length L,

    B(u) = sinc(L / lambda (u - u_b)),  sinc(x) = sin(pi x) / (pi x),

of which the width at half the power is 0.886 lambda / L and the first side lobe -13.3 dB. A shading
of the aperture, a + (1 - a) cos, lowers the side lobes and needs a longer array for the same width.
Along the other axis the transmitted beam has the pattern sinc of its own width.

Weights are rounded to 1e-6: results do not depend on the mathematical library of a machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, ceil, cos, inf, log, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid

__all__ = [
    "AMPLITUDES",
    "SHADINGS",
    "TABLE",
    "TURNS",
    "SonarGeometry",
    "array_pattern",
    "sonar_geometry",
]

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]
TABLE = 4096  # UUV_SONAR_TABLE
# a of each shading, and the width of the main lobe at half the power in lambda / L
SHADINGS = {"none": (1.0, 0.885893), "hamming": (0.54, 1.302982), "hann": (0.5, 1.440583)}
LEAST_WEIGHT = 1e-3  # a pattern below it is left out: -60 dB
LOBES = 3  # of the response of the matched filter, to each side
FINEST = 4  # range cells within the resolution
MOST_COLUMNS = 8192  # of rays, and beams
MOST_RAYS = 2_000_000  # of a ping

TURNS = np.array(
    [[cos(2 * pi * (i + 0.5) / TABLE), sin(2 * pi * (i + 0.5) / TABLE)] for i in range(TABLE)],
    np.float32,
)
# Quantiles of the amplitude of a complex Gaussian number of unit variance.
AMPLITUDES = np.array([sqrt(-log((i + 0.5) / TABLE)) for i in range(TABLE)], np.float32)


@dataclass(frozen=True, eq=False)
class SonarGeometry:
    """Rays and beams of an instrument in its own axes: x ahead, y along the array, z down."""

    bearings: Array  # (beams,) rad, from x towards y
    first: float  # m, near edge of bin 0
    step: float  # m, length of a bin
    bins: int
    u: Array  # (columns,) sine of the angle from the x-z plane
    du: Array  # (columns,)
    theta: Array  # (rays,) rad, elevation of a column's rays, positive down
    d_theta: float
    gain: Array  # (rays,) power of the transmitted beam
    weight: Float32  # (columns, beams)
    window: NDArray[np.int16]  # (beams, 2) first column that a beam receives, one after the last
    nearest: NDArray[np.int16]  # (columns, 2) beams whose labels a column gives
    pulse: Float32  # (2 pad + 1, fine)
    resolution: float  # m

    @property
    def ranges(self) -> Array:
        """Return the middle of each bin [m]."""
        return np.asarray(self.first + self.step * (np.arange(self.bins) + 0.5))

    @property
    def fine(self) -> int:
        """Return the number of range cells of a bin."""
        return int(self.pulse.shape[1])

    @property
    def pad(self) -> int:
        """Return the number of bins that the response of the matched filter reaches."""
        return int(self.pulse.shape[0]) // 2


def _sinc(x: Array) -> Array:
    return np.asarray(
        [1.0 if v == 0.0 else sin(pi * v) / (pi * v) for v in np.ravel(x).tolist()]
    ).reshape(np.shape(x))


def array_pattern(du: Array, beam_width: float, shading: str = "none") -> Array:
    """Return the amplitude B of an aperture at sines `du` from a beam's own, 1 in the middle.

    `beam_width` [rad] is that of the power's half, of a beam at right angles to the array.
    """
    a, width = SHADINGS[shading]
    x = np.asarray(du, float) * (width / (2.0 * sin(beam_width / 2.0)))
    return np.asarray(_sinc(x) + (1.0 - a) / (2.0 * a) * (_sinc(x - 1.0) + _sinc(x + 1.0)))


def sonar_geometry(
    *,
    beams: int,
    swath: float,
    beam_width: float,
    shading: str,
    elevation: float,
    bins: int,
    range_min: float,
    range_max: float,
    resolution: float,
    columns: int = 0,
    rays: int = 64,
) -> SonarGeometry:
    """Return the geometry of `beams` over a `swath` [rad], and of `bins` over a range [m].

    `elevation` [rad] is the width of the transmitted beam at half its power; rays cover twice as
    much, up to -18 dB. The range resolution is c / 2B; a bin that is longer replaces it.
    """
    path = "sonar"
    if shading not in SHADINGS:
        raise ParameterInvalid(path, f"shading = {shading!r}", ", ".join(SHADINGS))
    if beams < 1 or bins < 1:
        raise ParameterInvalid(path, f"{beams} beams of {bins} bins", "1 or more of each")
    if beams > MOST_COLUMNS:
        raise ParameterInvalid(path, f"{beams} beams", f"at most {MOST_COLUMNS}")
    if not (0.0 <= swath < pi and 0.0 < beam_width < pi / 2 and 0.0 < elevation < pi):
        raise ParameterInvalid(
            path,
            f"{beams} beams of width {beam_width:g} rad, swath {swath:g} rad, "
            f"elevation {elevation:g} rad",
            "a swath and an elevation below pi, and a width below pi / 2, thus more beams",
        )
    if not 0.0 < range_min < range_max < inf or not resolution > 0.0:
        raise ParameterInvalid(
            path,
            f"ranges {range_min:g} to {range_max:g} m, resolution {resolution:g} m",
            "rising, above 0, finite",
        )
    bearings = np.array(
        [swath * (i / (beams - 1) - 0.5) if beams > 1 else 0.0 for i in range(beams)]
    )
    u_b = np.array([sin(b) for b in bearings])
    edge = min(swath / 2 + 1.5 * beam_width, 0.98 * pi / 2)
    n = columns or max(4, ceil(2 * edge / (beam_width / 4)))
    least = max(1, round(swath / beam_width))
    if n < least or rays < 1:
        raise ParameterInvalid(
            path,
            f"{n} columns of {rays} rays",
            f"{least} columns, one within a beam's width, of 1 ray",
        )
    if n > MOST_COLUMNS or n * rays > MOST_RAYS:
        raise ParameterInvalid(
            path,
            f"{n} columns of {rays} rays",
            f"at most {MOST_COLUMNS} columns, and {MOST_RAYS} rays of a ping",
        )
    angles = [2 * edge * ((i + 0.5) / n - 0.5) for i in range(n)]
    u = np.array([sin(a) for a in angles])
    edges = np.array([sin(2 * edge * (i / n - 0.5)) for i in range(n + 1)])
    weight = np.round(array_pattern(u[:, None] - u_b, beam_width, shading), 6)
    kept = np.abs(weight) >= LEAST_WEIGHT
    window = np.stack([kept.argmax(axis=0), n - kept[::-1].argmax(axis=0)], axis=1)
    inside = (np.arange(n)[:, None] >= window[:, 0]) & (np.arange(n)[:, None] < window[:, 1])
    span = min(2.0 * elevation, 0.98 * pi)
    d_theta = span / rays
    theta = np.array([span * ((i + 0.5) / rays - 0.5) for i in range(rays)])
    wide = 0.885893 / (2.0 * sin(elevation / 2.0))
    gain = np.round(_sinc(np.array([sin(t) * wide for t in theta])) ** 2, 9)
    step = (range_max - range_min) / bins
    shown = max(resolution, step)
    fine = max(1, round(FINEST * step / shown))
    pad = ceil(LOBES * shown / step)
    return SonarGeometry(
        bearings, range_min, step, bins, u, np.diff(edges), theta, d_theta, gain,
        np.where(inside, weight, 0.0).astype(np.float32), window.astype(np.int16),
        _nearest(u, u_b), _pulse(step, shown, fine, pad), shown,
    )  # fmt: skip


def _nearest(u: Array, u_b: Array) -> NDArray[np.int16]:
    """Return the beams to which each column is the nearest, or the one that is nearest to it."""
    own = np.abs(u[:, None] - u_b).argmin(axis=1)
    of_beam = np.abs(u[:, None] - u_b).argmin(axis=0)
    low, high = own.copy(), own + 1
    for beam, column in enumerate(of_beam):
        low[column], high[column] = min(low[column], beam), max(high[column], beam + 1)
    return np.stack([low, high], axis=1).astype(np.int16)


def _pulse(step: float, resolution: float, fine: int, pad: int) -> Float32:
    """Return the response (2 pad + 1, fine) at the middle of a bin, 1 of an echo there.

    It is the sinc of a chirp's matched filter, within its third zeros, tapered by Lanczos' window.
    """
    t = np.arange(-pad * fine, (pad + 1) * fine)
    x = (step / 2 - (t + 0.5) * step / fine) / resolution
    response = np.where(np.abs(x) < LOBES, _sinc(x) * _sinc(x / LOBES), 0.0)
    return np.asarray(np.round(response, 6), np.float32).reshape(2 * pad + 1, fine)


def bearing_of(u: float) -> float:
    """Return the bearing [rad] at which a beam has the sine `u`."""
    return asin(u)
