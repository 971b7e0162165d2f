"""The NPS AUV against npsauv.m of MSS: mass, hull, planes, propeller and acceleration.

The right-hand side of npsauv.m is written here in its own order, so that each difference can be
corrected separately: two signs against Newton's law, strips of eleven stations, eta by the speed
over ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.checks.comparison import Checked, compared, number, reference_values
from uuvsim_cosim.models.checks.compiled_run import end_of, prepared
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.hull.damping import cross_flow
from uuvsim_cosim.models.vehicles.closed_forms import total_mass

__all__ = ["control", "force_of_hull", "mss_force", "npsauv"]

Array = NDArray[np.float64]
ADDRESS = "npsauv@healey_lienard_1993"
L, RHO, W = 5.3, 1025.0, 53400.0
V_C = np.array([0.3 * np.cos(0.7 - 0.5), 0.3 * np.sin(0.7 - 0.5), 0.05])  # in b, by yaw alone
SIGNS = "npsauv.m has Z by 2 m (u q - v p + ...) and M by 2 (I_z - I_x) p r against Newton's law"
STRIPS = "npsauv.m sums 11 stations for 10 strips, and has w + x q in the pitching moment"
EQUAL = partial(compared, "mss", ADDRESS)


def npsauv() -> Iterator[Checked]:
    """Yield every comparison with npsauv.m: unchanged, then with known differences corrected."""
    mss = reference_values("mss_values.yaml")
    case = mss["npsauv_xdot_test_state"]
    nu, published = np.array(mss["nu_test"], dtype=float), mss["npsauv_xdot_at_test_state"][0][:6]
    model = declare(ADDRESS, surface=False)
    M = total_mass(model)
    nu_r = nu - np.array([*V_C, 0, 0, 0])
    act = [float(a) for a in case["u_actual"]]

    # Its terms put together as npsauv.m does, to see that they are typed as in that file.
    phi, theta, psi = case["euler"]
    down = [-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)]
    force = mss_force(nu_r) + mss_control(nu_r, act, nu[0]) + mss_strips(nu_r)
    force[3:] += W * np.cross([0, 0, 0.061], down)
    typed = np.linalg.solve(np.array(mss["npsauv_M_total"], dtype=float), force)
    typed = typed + np.array([nu[5] * V_C[1], -nu[5] * V_C[0], 0, 0, 0, 0])
    yield EQUAL("the comparison is with the results of npsauv.m", typed, published, 1e-9)
    yield EQUAL("M", M, mss["npsauv_M_total"], 1e-9, relative=True)
    for text, v in (("", nu), (" in a current", nu_r)):
        ours = force_of_hull(model, M, v)
        theirs = mss_force(v) - _strips(v)
        what = f"force of the hull without strips{text}"
        yield EQUAL(f"{what}, unchanged", ours, theirs, 1e-8, relative=True, known=SIGNS)
        right = theirs + sign_errors(v)
        yield EQUAL(f"{what}, two signs corrected", ours, right, 1e-8, relative=True)
    yield EQUAL("force of the strips", _strips(nu), -mss_strips(nu), 0.01, relative=True,
                known=STRIPS)  # fmt: skip
    for rpm in (800.0, 1500.0):
        steered = [0.1, -0.05, 0.02, 0.03, rpm]
        what = f"planes and propeller with every printed term at {rpm:g} rpm"
        theirs = mss_control(nu, steered, nu[0])
        yield EQUAL(what, control(nu, steered), theirs, 1e-8, relative=True)
    # Moments of the planes without a slipstream, n = 0, at 1 m/s.
    planes = declare("fins", vehicle="npsauv", form="derivatives")
    at_rest = {"n": 0.0, "nu_r": [1.0, 0, 0, 0, 0, 0]}
    slopes = []
    for i in range(4):
        there, back = (
            _settled(planes, at_rest | {"u": [delta * (j == i) for j in range(4)]}, 3.0)
            for delta in (1e-4, -1e-4)
        )
        slopes.append((there - back)[[4, 5]] / 2e-4)
    what = "B_delta: moments of the planes"
    yield EQUAL(what, np.array(slopes).T, mss["npsauv_B_delta"], 1e-8, relative=True)

    v_c = (number(R_zyx(phi, theta, psi)) @ V_C).ravel()
    act[4] *= nu_r[0] / nu[0]  # its eta is by the speed over ground
    start: dict[str, Any] = {"eta_0": [0, 0, 9, phi, theta, psi], "nu_0": nu}
    tau = control(nu_r, act)
    run = simulate(model, at=[0.0], inputs={"v_c": v_c}, tau=tau, parameters=start)
    known = sign_errors(nu_r) - _strips(nu_r) - mss_strips(nu_r)
    turned = -np.cross(nu[3:], V_C) - np.array([nu[5] * V_C[1], -nu[5] * V_C[0], 0])
    right = np.array(published) + np.linalg.solve(M, known) + [*turned, 0, 0, 0]
    what = "acceleration in a current"
    four = f"{SIGNS}; {STRIPS}; it turns the current by yaw alone"
    yield EQUAL(f"{what}, unchanged", run["nu_dot"][0], published, 1e-8, known=four)
    yield EQUAL(f"{what}, these differences corrected", run["nu_dot"][0], right, 1e-8)


def force_of_hull(model: Any, M: Array, nu_r: Array) -> Array:
    """Return M nu_dot of the water and the centripetal terms at nu_r, weightless, without tau."""
    f, p, d, x = prepared(model, {"W": 0.0, "B": 0.0})
    x[7:13] = nu_r
    nu_dot = np.array(f.rhs(0.0, f.values_of("input", {}), p, d, x, [])).ravel()[7:13]
    return np.asarray(M @ nu_dot)


def control(nu: Array, act: Sequence[float]) -> Array:
    """Return the planes' force as printed and the propeller's, settled at their commands."""
    n = act[4] * np.pi / 30
    planes = declare("fins", vehicle="npsauv", form="derivatives")
    tau = _settled(planes, {"u": act[:4], "nu_r": nu, "n": n}, 4.0)
    given = {"u": n / (50 * np.pi), "nu_r": nu}
    return tau + _settled(declare("propeller", vehicle="npsauv"), given, 4.0)


def _settled(model: Any, inputs: Any, until: float) -> Array:
    return end_of(model, until, 0.02, inputs)["tau"]


def _strips(nu: Array) -> Array:
    k_y, k_z = 0.5 * RHO * 0.5 * 0.53, 0.5 * RHO * 0.6 * 0.53
    return np.asarray(number(cross_flow(nu, -L / 2, L / 2, k_y, k_z)).ravel())


def mss_force(nu: Array) -> Array:
    """Healey and Lienard's hull as npsauv.m sums it: derivatives, rigid body, no cross-flow."""
    u, v, w, p, q, r = nu
    m, z, I = 53400 / 9.81, 0.061, {"x": 2038.0, "y": 13587.0, "z": 13587.0, "xy": -13.58}  # noqa: E741
    r2, r3, r4, r5 = (0.5 * RHO * L**k for k in (2, 3, 4, 5))
    I_off = I["xy"]
    X = r2 * (0.053 * v * v + 0.17 * w * w) + r3 * (0.02 * v * r - 0.2 * w * q - 0.003 * v * p)
    X += r4 * (-0.015 * q * q + 0.004 * r * r + 7.5e-4 * p * r + 7e-3 * p * p)
    X += m * (v * r - w * q) - m * z * p * r - r2 * 0.00385 * u * u
    Y = r2 * (-0.1 * u * v + 0.068 * v * w)
    Y += r3 * (0.003 * u * p + 0.03 * u * r + 0.024 * v * q + 0.23 * w * p - 0.019 * w * r)
    Y += r4 * (0.004 * p * q - 0.0065 * q * r) - m * (u * r - w * p + z * q * r)
    Z = r2 * (-0.3 * w * u - 0.068 * v * v) + r3 * (-0.14 * u * q - 0.048 * v * p + 0.045 * v * r)
    Z += r4 * (1.3e-4 * p * p + 6.7e-3 * p * r - 7.4e-3 * r * r)
    Z += m * (v * p - u * q - z * (p * p + q * q))
    K = r3 * (3.1e-3 * u * v - 0.19 * v * w)
    K += r4 * (-1.1e-2 * u * p - 8.4e-4 * u * r - 5.1e-3 * v * q - 1.3e-4 * w * p + 1.4e-2 * w * r)
    K += r5 * (-6.9e-5 * p * q + 1.7e-2 * q * r)
    K += (I["y"] - I["z"]) * q * r + I_off * (p * q - p * r - r * r + q * q)
    K += m * z * (u * r - w * p)
    M = r3 * (0.1 * u * w - 0.026 * v * v) + r4 * (-0.068 * u * q + 1.2e-3 * v * p + 1.7e-2 * v * r)
    M += r5 * (5.3e-5 * p * p + 5e-3 * p * r + 2.9e-3 * r * r)
    M += -(I["z"] - I["x"]) * p * r + I_off * (q * r - p * q - p * p + r * r)
    M += -m * z * (w * q - v * r)
    N = r3 * (-7.4e-3 * u * v - 2.7e-2 * v * w)
    N += r4 * (-8.4e-4 * u * p - 1.6e-2 * u * r - 1e-2 * v * q - 1.7e-2 * w * p + 7.4e-3 * w * r)
    N += r5 * (-2.1e-2 * p * q + 2.7e-3 * q * r)
    N += (I["x"] - I["y"]) * p * q + I_off * (p * p - q * q + p * r - q * r)
    return np.array([X, Y, Z, K, M, N])


def sign_errors(nu: Array) -> Array:
    """What npsauv.m has with the other sign than Newton's law: our force less that of MSS.

    Z: m (v p - u q - z_G (p² + q²)) for its negative; M: -(I_z - I_x) p r for (I_z - I_x) p r.
    """
    u, v, _, p, q, r = nu
    m, z = 53400 / 9.81, 0.061
    off = np.zeros(6)
    off[2] = -2 * m * (v * p - u * q - z * (p * p + q * q))
    off[4] = 2 * (13587 - 2038) * p * r
    return off


def mss_control(nu: Array, act: Sequence[float], U: float) -> Array:
    """Return the planes' and the propeller's part of npsauv.m (nu is relative to the water)."""
    u, v, w, _, q, r = nu
    dr, ds, dbp, dbs, rpm = act
    n, db = rpm / 60 * 2 * np.pi, dbp + dbs
    r2, r3, r4 = (0.5 * RHO * L**k for k in (2, 3, 4))
    eta = 0.012 * n / U
    root, root_1 = (np.sqrt(0.004 * L**2 * x + 1) - 1 for x in (eta * abs(eta), 1.0))
    eps = -1 + root / (root_1 + 1e-10)
    X = r3 * (-1e-3 * u * r * dr + (2.5e-2 * ds - 1.3e-3 * db) * u * q)
    X += r2 * (1.7e-3 * u * v * dr + (4.6e-2 * ds + 5e-3 * db) * u * w)
    X += r2 * (-1e-2 * ds * ds - 1e-2 * dr * dr) * u * u + r3 * 2e-3 * u * q * ds * eps
    X += r2 * (3.5e-3 * u * w * ds - 1.6e-3 * u * u * ds * ds) * eps
    X += r2 * u * u * 0.00385 * eta * abs(eta)  # its - 1 is in the hull's drag
    Z = r2 * u * u * (-7.3e-2 * ds - 1.3e-2 * db) + r3 * -2.9e-3 * u * q * eps
    Z += r2 * (-5.1e-3 * u * w - 1e-2 * u * u * ds) * eps
    K = r4 * -5.7e-4 * u * nu[3] * eps
    M = r4 * -1.6e-3 * u * q * eps + r3 * (-2.9e-3 * w * u - 5.2e-3 * u * u * ds) * eps
    M += r3 * u * u * (-4.1e-2 * ds + 3.5e-3 * db)
    return np.array([X, r2 * 2.7e-2 * u * u * dr, Z, K, M, r3 * u * u * -1.3e-2 * dr])


def mss_strips(nu: Array) -> Array:
    """Return its cross-flow drag: eleven stations for ten strips, and (w + x q) in pitch."""
    _, v, w, _, q, r = nu
    x = np.linspace(-L / 2, L / 2, 11)
    U = np.hypot(v + x * r, w - x * q) + 1e-6
    k = 0.5 * RHO * 0.53 * (0.5 * (v + x * r) ** 2 + 0.6 * (w - x * q) ** 2) / U * L / 10
    Y, Z, M = k * (v + x * r), k * (w - x * q), k * (w + x * q)
    return -np.array([0, Y.sum(), Z.sum(), 0, (x * M).sum(), (x * Y).sum()])
