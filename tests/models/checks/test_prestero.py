"""REMUS against Prestero's equations of motion, typed term by term: no matrix M, C or D in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from uuvsim_cosim.content import content

Array = np.ndarray[Any, np.dtype[np.float64]]


def rates(x: Array, tau: Array, v_c: Array) -> Array:
    """Return d(eta, nu)/dt by Prestero (2001), chapter 4, Yvv, Mqq and Nrr as he derives them.

    In a current the terms of the water are of the velocity through it, and the current turns in b.
    """
    (phi, theta, psi), (u, v, w, p, q, r) = x[3:6], x[6:]
    (sf, cf), (st, ct), (ss, cs) = ((np.sin(a), np.cos(a)) for a in (phi, theta, psi))
    R = np.array([
        [cs * ct, -ss * cf + cs * st * sf, ss * sf + cs * cf * st],
        [ss * ct, cs * cf + sf * st * ss, -cs * sf + st * ss * cf],
        [-st, ct * sf, ct * cf],
    ])  # fmt: skip
    flow = R.T @ v_c
    ua, va, wa = (u, v, w) - flow  # through the water
    W, B, z_g, I_xx, I_yy = 299.0, 306.0, 0.0196, 0.177, 3.45
    m = 30.479
    X = -(W - B) * st - 1.62 * ua * abs(ua) - 35.5 * wa * q - 1.93 * q * q
    X += 35.5 * va * r - 1.93 * r * r
    Y = (W - B) * ct * sf - 131.0 * va * abs(va) + 0.632 * r * abs(r) + 5.22 * ua * r
    Y += 35.5 * wa * p + 1.93 * p * q - 28.6 * ua * va
    Z = (W - B) * ct * cf - 131.0 * wa * abs(wa) - 0.632 * q * abs(q) - 5.22 * ua * q
    Z += -35.5 * va * p + 1.93 * r * p - 28.6 * ua * wa
    K = -z_g * W * ct * sf - 0.130 * p * abs(p)
    M = -z_g * W * st + 3.18 * wa * abs(wa) - 9.40 * q * abs(q) - 2.0 * ua * q
    M += -1.93 * va * p + 4.86 * r * p + 24.0 * ua * wa
    N = -3.18 * va * abs(va) - 9.40 * r * abs(r) - 2.0 * ua * r
    N += -1.93 * wa * p - 4.86 * p * q - 24.0 * ua * va
    # Newton and Euler with the centre of gravity z_g below: moved over.
    X += m * (v * r - w * q - z_g * p * r)
    Y += m * (w * p - u * r - z_g * q * r)
    Z += m * (u * q - v * p + z_g * (p * p + q * q))
    K += m * z_g * (u * r - w * p)  # I_yy = I_zz
    M += (I_yy - I_xx) * p * r + m * z_g * (v * r - w * q)
    N -= (I_yy - I_xx) * p * q
    force = np.array([X, Y, Z, K, M, N]) + tau
    added = np.diag([0.930, 35.5, 35.5, 0.0704, 4.88, 4.88])
    added[1, 5] = added[5, 1] = -1.93
    added[2, 4] = added[4, 2] = 1.93
    force -= added @ np.r_[np.cross([p, q, r], flow), 0, 0, 0]
    mass = added + np.diag([m, m, m, I_xx, I_yy, I_yy])
    mass[0, 4] = mass[4, 0] = m * z_g
    mass[1, 3] = mass[3, 1] = -m * z_g
    turning = [p + (q * sf + r * cf) * st / ct, q * cf - r * sf, (q * sf + r * cf) / ct]
    return np.r_[R @ (u, v, w), turning, np.linalg.solve(mass, force)]


def file_of(name: str) -> Path:
    return content("models", "vehicles", "remus100", "reference") / f"prestero_2001_{name}.csv"


@pytest.mark.parametrize("name", ["multisine", "current"])
def test_the_shipped_trajectories_are_those_of_presteros_equations(name: str) -> None:
    """`models check` compares the hull with the file; here the file is made again."""
    rows = np.loadtxt(file_of(name), delimiter=",", skiprows=4)
    t = rows[:, 0]
    tau = make_interp_spline(t, rows[:, 13:19], k=5)
    v_c = rows[0, 19:22] if rows.shape[1] > 19 else np.zeros(3)
    made = solve_ivp(
        lambda s, x: rates(x, tau(s), v_c), (0, t[-1]), rows[0, 1:13], "DOP853", t,
        rtol=1e-9, atol=1e-10,
    ).y.T  # fmt: skip
    off = made - rows[:, 1:13]
    off[:, 3:6] = np.remainder(off[:, 3:6] + np.pi, 2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-6
    assert np.ptp(rows[:, 8]) > 0.05  # it was moved across
