"""The NPS AUV against npsauv.m of MSS: mass, hull, planes, propeller and acceleration.

Its right-hand side is typed here in its own order, so that what differs can be set right one by
one: two signs against Newton's law, strips of eleven stations, eta by the speed over ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.checks.comparison import Checked, compared, number, reference_values
from uuvsim_cosim.models.checks.compiled_run import end_of
from uuvsim_cosim.models.checks.npsauv_equations import (
    mss_control,
    mss_force,
    mss_strips,
    sign_errors,
)
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.hull.damping import cross_flow
from uuvsim_cosim.models.vehicles.closed_forms import total_mass

__all__ = ["control", "force_of_hull", "npsauv"]

Array = NDArray[np.float64]
ADDRESS = "npsauv@healey_lienard_1993"
L, RHO, W = 5.3, 1025.0, 53400.0
V_C = np.array([0.3 * np.cos(0.7 - 0.5), 0.3 * np.sin(0.7 - 0.5), 0.05])  # in b, by yaw alone
SIGNS = "npsauv.m has Z by 2 m (u q - v p + ...) and M by 2 (I_z - I_x) p r against Newton's law"
STRIPS = "npsauv.m sums 11 stations for 10 strips, and has w + x q in the pitching moment"
EQUAL = partial(compared, "mss", ADDRESS)


def npsauv() -> Iterator[Checked]:
    """Yield every comparison with npsauv.m: first as it is, then with what is known set right."""
    mss = reference_values("mss_values.yaml")
    case = mss["npsauv_xdot_test_state"]
    nu, published = np.array(mss["nu_test"], dtype=float), mss["npsauv_xdot_at_test_state"][0][:6]
    model = declare(ADDRESS, surface=False)
    M = total_mass(model)
    nu_r = nu - np.array([*V_C, 0, 0, 0])
    act = [float(a) for a in case["u_actual"]]

    what = "what is compared with is what npsauv.m computes"
    yield EQUAL(what, _mss_acceleration(mss, nu, nu_r, act), published, 1e-9)
    yield EQUAL("M", M, mss["npsauv_M_total"], 1e-9, relative=True)
    for text, v in (("", nu), (" in a current", nu_r)):
        ours = force_of_hull(model, M, v)
        theirs = mss_force(v) - _strips(v)
        what = f"force of the hull without strips{text}"
        yield EQUAL(f"{what}, as it is", ours, theirs, 1e-8, relative=True, known=SIGNS)
        right = theirs + sign_errors(v)
        yield EQUAL(f"{what}, two signs set right", ours, right, 1e-8, relative=True)
    yield EQUAL("force of the strips", _strips(nu), -mss_strips(nu), 0.01, relative=True,
                known=STRIPS)  # fmt: skip
    for rpm in (800.0, 1500.0):
        steered = [0.1, -0.05, 0.02, 0.03, rpm]
        what = f"planes and propeller with every printed term at {rpm:g} rpm"
        theirs = mss_control(nu, steered, nu[0])
        yield EQUAL(what, control(nu, steered), theirs, 1e-8, relative=True)
    yield EQUAL("B_delta: moments of the planes", _B_delta(), mss["npsauv_B_delta"], 1e-8,
                relative=True)  # fmt: skip

    phi, theta, psi = case["euler"]
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
    yield EQUAL(f"{what}, as it is", run["nu_dot"][0], published, 1e-8, known=four)
    yield EQUAL(f"{what}, these differences set right", run["nu_dot"][0], right, 1e-8)


def force_of_hull(model: Any, M: Array, nu_r: Array) -> Array:
    """Return M nu_dot of the water and the centripetal terms at nu_r, weightless, without tau."""
    f = Evaluation(model)
    p = f.values_of("parameter", {"W": 0.0, "B": 0.0})
    d = np.array(f.derived(p)).ravel()
    x = np.array(f.initial(p, d)).ravel()
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


def _B_delta() -> Array:
    """Return its B_delta: without a slipstream, n = 0, at 1 m/s."""
    planes = declare("fins", vehicle="npsauv", form="derivatives")
    inputs = {"n": 0.0, "nu_r": [1.0, 0, 0, 0, 0, 0]}
    slopes = []
    for i in range(4):
        there, back = (
            _settled(planes, inputs | {"u": [delta * (j == i) for j in range(4)]}, 3.0)
            for delta in (1e-4, -1e-4)
        )
        slopes.append((there - back)[[4, 5]] / 2e-4)
    return np.array(slopes).T


def _strips(nu: Array) -> Array:
    k_y, k_z = 0.5 * RHO * 0.5 * 0.53, 0.5 * RHO * 0.6 * 0.53
    return np.asarray(number(cross_flow(nu, -L / 2, L / 2, k_y, k_z)).ravel())


def _mss_acceleration(mss: Any, nu: Array, nu_r: Array, act: Sequence[float]) -> Array:
    """Put its terms together as npsauv.m does, to see that they are typed as they stand there."""
    phi, theta, _ = mss["npsauv_xdot_test_state"]["euler"]
    down = [-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)]
    force = mss_force(nu_r) + mss_control(nu_r, act, nu[0]) + mss_strips(nu_r)
    force[3:] += W * np.cross([0, 0, 0.061], down)
    nu_dot = np.linalg.solve(np.array(mss["npsauv_M_total"], dtype=float), force)
    return np.asarray(nu_dot + np.array([nu[5] * V_C[1], -nu[5] * V_C[0], 0, 0, 0, 0]))
