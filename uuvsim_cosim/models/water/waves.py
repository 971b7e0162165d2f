"""Waves of linear theory: one regular wave, or a JONSWAP sea of many, over deep or shoal water.

A component of amplitude a, frequency omega and phase epsilon, run along (cos beta, sin beta), has

    omega² = g k,    theta = k (N cos beta + E sin beta) - omega t + epsilon,    e = exp(-k depth)
    zeta = a cos(theta),  v_h = a omega e cos(theta),  v_D = -a omega e sin(theta),  a_c = dv/dt

(Faltinsen 1990, Sea Loads on Ships and Offshore Structures, table 2.1, with z = -depth; above the
mean level e stays 1). Over a bottom at the depth h, of the same table,

    omega² = g k tanh(k h),   e = cosh k(h - depth) / sinh kh in v_h,   sinh k(h - depth) / sinh kh
    in v_D

There is no drift, and hulls must be short compared with the waves. In a directional sea, each
component has its own direction, distributed as cos^2s(theta/2) (Longuet-Higgins, Cartwright and
Smith 1963). With one direction per frequency, components do not interfere (Miles and Funke 1989).
The hull's options `waves` and `surface` turn a_c and zeta into forces.
"""

from __future__ import annotations

from math import pi, sqrt

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.vectors import ETA

__all__ = ["waves"]

GOLDEN = 0.5 * (sqrt(5.0) - 1.0)
LOWEST, HIGHEST = 0.6, 3.0  # of the peak frequency


def waves(
    components: int | str = 16, bottom: bool | str = False, spreading: float | str = ""
) -> Model:
    """Declare waves at the hull; with components=1 a regular one of height H_s and period T_p.

    With `bottom` there is a parameter h, the depth of the water. `spreading` is the exponent s of
    a directional sea: 1 for a confused sea, 10 for a wind sea, 75 for long swell; without it, waves
    are long-crested.

    With more components, each has its own band of the spectrum and a position in the band that no
    other component has, so that the sea does not repeat. The amplitudes give the variance
    H_s² / 16. Phases are drawn at the first sample; before it, the water is at rest.
    """
    n = int(components) if str(components).isdigit() else 0
    if n < 1:
        raise InputInvalid("waves", f"components={components!r}", "a whole number from 1")
    shoal = is_on("bottom", bottom)
    water = "water with a bottom" if shoal else "deep water"
    m = Model("waves", f"Waves on {water}, linear theory: at the hull, in NED", h_max=1.0)
    m.peers["eta"] = "hull.eta"
    eta = m.input("eta", 6, unit=ETA, description="of the hull")
    v = m.input("v", 3, unit="m/s", description="current without waves, in n")
    H_s = m.parameter("H_s", 0.5, unit="m", min=0, description="significant height; n=1: height")
    T_p = m.parameter("T_p", 5.0, unit="s", min=0.1, description="period of the peak")
    beta = m.parameter("direction", 0.0, unit="rad", description="waves run to, from N to E")
    gamma = m.parameter(
        "gamma",
        3.3,
        unit="1",
        min=1,
        max=7,
        description="peakedness (JONSWAP; 1: Pierson-Moskowitz)",
    )
    g = m.parameter("g", 9.80665, unit="m/s2", min=0.1, description="acceleration of gravity")
    phase_0 = m.parameter("phase", 0.0, unit="rad", description="of a regular wave")
    ratio, width = [1.0], [1.0]  # each component's frequency and band, over the peak frequency
    if n > 1:
        width = [(HIGHEST - LOWEST) / n] * n
        places = [(i * GOLDEN) % 1.0 for i in range(1, n + 1)]
        ratio = [LOWEST + (i + x) * width[0] for i, x in enumerate(places)]
    omega_p = 2.0 * pi / T_p
    omega = m.derived("omega", omega_p * ca.DM(ratio))
    a = m.derived("a", _amplitudes(H_s, gamma, ratio, width))
    depth = None
    if shoal:
        depth = m.parameter("h", 20.0, unit="m", min=0.1, description="depth of the water")
        k = m.derived("k", _numbers_of(omega, g, depth, n))
    else:
        k = m.derived("k", omega_p * omega_p / g * ca.DM([x * x for x in ratio]))
    turned = _directions(n, spreading)
    along = m.derived("along", ca.vertcat(ca.cos(beta), ca.sin(beta)))
    ways = [along] * n
    if turned is not None:
        each = m.derived(
            "ways", ca.vertcat(*(x for d in turned for x in (ca.cos(beta + d), ca.sin(beta + d))))
        )
        ways = [each[2 * i : 2 * i + 2] for i in range(n)]
    phase, there = phase_0, ca.SX(1.0)  # of each component, and 1 once they are drawn
    if n > 1:
        sample = m.clock("sample", "1")
        w = m.normal(sample, 2 * n)
        there = m.discrete("started", unit="1", description="0 before the first sample")
        phase = m.discrete("phases", (0.0,) * n, unit="rad", description="of each component")
        drawn = ca.vertcat(*(ca.atan2(w[2 * i], w[2 * i + 1]) for i in range(n)))
        m.update(sample, phase, ca.if_else(there > 0.5, phase, drawn))
        m.update(sample, there, 1.0)

    below = clip(eta[2], 0.0, 1e6 if depth is None else depth)
    zeta, v_D, a_D = ca.SX(0.0), ca.SX(0.0), ca.SX(0.0)
    v_h, a_h = ca.SX.zeros(2), ca.SX.zeros(2)
    level_v, level_a = ca.SX(0.0), ca.SX(0.0)  # of long crests: along all of them
    distance = ca.dot(along, eta[:2])
    for i in range(n):
        if turned is not None:
            distance = ca.dot(ways[i], eta[:2])
        theta = k[i] * distance - omega[i] * m.t + phase[i]
        c, s = ca.cos(theta), ca.sin(theta)
        zeta += a[i] * c
        if depth is None:
            orbit = rising = a[i] * omega[i] * ca.exp(-k[i] * below)
        else:
            near, far = ca.exp(-k[i] * below), ca.exp(-k[i] * (2.0 * depth - below))
            share = a[i] * omega[i] / (1.0 - ca.exp(-2.0 * k[i] * depth))
            orbit, rising = share * (near + far), share * (near - far)
        v_D -= rising * s
        a_D += omega[i] * rising * c
        if turned is None:
            level_v += orbit * c
            level_a += omega[i] * orbit * s
        else:
            v_h += orbit * c * ways[i]
            a_h += omega[i] * orbit * s * ways[i]
    if turned is None:
        v_h, a_h = level_v * along, level_a * along
    m.output("v_c", v + there * ca.vertcat(v_h, v_D), unit="m/s",
             description="current and waves, at CO in n")  # fmt: skip
    acceleration = there * ca.vertcat(a_h, a_D)
    m.output("a_c", acceleration, unit="m/s2", description="of the water, at CO in n")
    m.output("zeta", there * zeta, unit="m", description="rise of the surface above CO")
    return m


def _numbers_of(omega: ca.SX, g: ca.SX, h: ca.SX, n: int) -> ca.SX:
    """Return the wave numbers k of omega² = g k tanh(k h).

    y = k h from the start x² (1 - exp(-x^b))^(-1/b), x = omega sqrt(h / g), b = 2.4908, which is
    within 0.75 % (Guo 2002, Coastal Engineering 45), by three steps of Newton.
    """
    b, numbers = 2.4908, []
    for i in range(n):
        x = omega[i] * ca.sqrt(h / g)
        y = x * x * ca.exp(-ca.log(1.0 - ca.exp(-ca.exp(b * ca.log(x)))) / b)
        for _ in range(3):
            T = ca.tanh(y)
            y = y - (y * T - x * x) / (T + y * (1.0 - T * T))
        numbers.append(y / h)
    return ca.vertcat(*numbers)


def _directions(n: int, spreading: float | str) -> list[float] | None:
    """Return each component's direction from the mean one [rad], or None for long crests."""
    if str(spreading) == "":
        return None
    s = float(spreading)
    if not 0.0 < s < 1e4:
        raise InputInvalid("waves", f"spreading={spreading!r}", "more than 0, below 1e4")
    grid = np.linspace(-pi, pi, 20001)
    density = np.cos(0.5 * grid) ** (2.0 * s)
    share = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    places = [((i + 0.5) * sqrt(2.0)) % 1.0 for i in range(n)]
    return [float(x) for x in np.interp(places, share / share[-1], grid)]


def _amplitudes(H_s: ca.SX, gamma: ca.SX, ratio: list[float], width: list[float]) -> ca.SX:
    """Return a_i = sqrt(2 S(omega_i) d_omega) of JONSWAP, scaled so that sum a_i²/2 = H_s²/16.

    S ~ x^-5 exp(-5/4 x^-4) gamma^exp(-(x-1)²/(2 s²)), s = 0.07 below the peak, 0.09 above
    (Hasselmann et al. 1973, Deutsche Hydrographische Zeitschrift A8(12)).
    """
    if len(ratio) == 1:
        return 0.5 * H_s
    shape = []
    for x, w in zip(ratio, width, strict=True):
        s = 0.07 if x <= 1.0 else 0.09
        peak = ca.exp(-((x - 1.0) ** 2) / (2.0 * s * s))
        shape.append(x**-5 * ca.exp(-1.25 * x**-4) * ca.exp(ca.log(gamma) * peak) * w)
    spectrum = ca.vertcat(*shape)
    return ca.sqrt(spectrum / ca.sum1(spectrum)) * H_s / sqrt(8.0)
