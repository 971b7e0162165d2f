"""NPS AUV against MSS: its mass to the last digit, its right-hand side where that is sound."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from ruamel.yaml import YAML

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.cross_flow import cross_flow
from uuvsim_cosim.models.evaluation import Evaluation
from uuvsim_cosim.models.kinematics import R_zyx
from uuvsim_cosim.models.library import declare
from uuvsim_cosim.models.model import Model
from uuvsim_cosim.models.simulate import simulate

MSS = YAML(typ="safe").load(Path(__file__).parent / "reference" / "npsauv_values.yaml")
L, RHO = 5.3, 1025.0
NU = np.array(MSS["nu_test"])
V_C = np.array([0.3 * np.cos(0.7 - 0.5), 0.3 * np.sin(0.7 - 0.5), 0.05])


@pytest.fixture(scope="module")
def model() -> Model:
    return declare("npsauv", surface=False)


def mass(model: Model) -> np.ndarray:
    f = Evaluation(model)
    p = ca.vertcat(*(v.symbol for v in model.of_kind("parameter")))
    M = ca.Function("M", [p], [ca.densify(model.variables["M"].start)])
    return np.array(M(f.values_of("parameter", {})))


def test_total_mass_agrees_with_mss(model: Model) -> None:
    np.testing.assert_allclose(mass(model), MSS["npsauv_M_total"], rtol=1e-9, atol=1e-7)


def acceleration(model: Model, nu_r: np.ndarray) -> np.ndarray:
    """Our M nu_dot of the water and the centripetal terms at nu_r, weightless, without tau."""
    f = Evaluation(model)
    p = f.values_of("parameter", {"W": 0.0, "B": 0.0})
    d = np.array(f.derived(p)).ravel()
    x = np.array(f.initial(p, d)).ravel()
    x[7:13] = nu_r
    nu_dot = np.array(f.rhs(0.0, f.values_of("input", {}), p, d, x, [])).ravel()[7:13]
    return np.asarray(mass(model) @ nu_dot)


def mss_force(nu: np.ndarray) -> np.ndarray:
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


def sign_errors(nu: np.ndarray) -> np.ndarray:
    """What npsauv.m has with the other sign than Newton's law: our force less that of MSS.

    Z: m (v p - u q - z_G (p² + q²)) for its negative; M: -(I_z - I_x) p r for (I_z - I_x) p r.
    """
    u, v, _, p, q, r = nu
    m, z = 53400 / 9.81, 0.061
    off = np.zeros(6)
    off[2] = -2 * m * (v * p - u * q - z * (p * p + q * q))
    off[4] = 2 * (13587 - 2038) * p * r
    return off


def mss_control(nu: np.ndarray, act: list[float]) -> np.ndarray:
    """Give the planes' and the propeller's part of npsauv.m (nu is relative to the water)."""
    u, v, w, _, q, r = nu
    dr, ds, dbp, dbs, rpm = act
    n, db = rpm / 60 * 2 * np.pi, dbp + dbs
    r2, r3, r4 = (0.5 * RHO * L**k for k in (2, 3, 4))
    eta = 0.012 * n / NU[0]
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


def mss_strips(nu: np.ndarray) -> np.ndarray:
    """Give its cross-flow drag: eleven stations for ten strips, and (w + x q) in pitch."""
    _, v, w, _, q, r = nu
    x = np.linspace(-L / 2, L / 2, 11)
    U = np.hypot(v + x * r, w - x * q) + 1e-6
    k = 0.5 * RHO * 0.53 * (0.5 * (v + x * r) ** 2 + 0.6 * (w - x * q) ** 2) / U * L / 10
    Y, Z, M = k * (v + x * r), k * (w - x * q), k * (w + x * q)
    return -np.array([0, Y.sum(), Z.sum(), 0, (x * M).sum(), (x * Y).sum()])


def test_what_is_compared_with_is_what_mss_computes() -> None:
    """The right-hand side typed here is that of npsauv.m, to the digits of its published value."""
    case = MSS["npsauv_xdot_test_state"]
    phi, theta, _ = case["euler"]
    nu_r = NU - np.array([*V_C, 0, 0, 0])
    down = [-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)]
    restoring = np.array([0, 0, 0, *(53400 * np.cross([0, 0, 0.061], down))])
    force = mss_force(nu_r) + mss_control(nu_r, case["u_actual"]) + mss_strips(nu_r) + restoring
    nu_dot = np.linalg.solve(np.array(MSS["npsauv_M_total"], dtype=float), force)
    nu_dot += np.array([NU[5] * V_C[1], -NU[5] * V_C[0], 0, 0, 0, 0])
    np.testing.assert_allclose(nu_dot, MSS["npsauv_xdot_at_test_state"][:6], atol=1e-9)


@pytest.mark.parametrize("nu", [NU, NU - np.array([0.3, 0.06, 0.05, 0, 0, 0])])
def test_the_hulls_force_is_that_of_mss_but_for_two_wrong_signs(model: Model, nu: Any) -> None:
    k_y, k_z = 0.5 * RHO * 0.5 * 0.53, 0.5 * RHO * 0.6 * 0.53
    strips = np.array(ca.evalf(cross_flow(ca.SX(nu), -L / 2, L / 2, k_y, k_z))).ravel()
    expected = mss_force(nu) - strips + sign_errors(nu)
    np.testing.assert_allclose(acceleration(model, nu), expected, rtol=1e-8, atol=1e-5)


def test_astern_it_is_damped_where_the_printed_products_drive_it(model: Model) -> None:
    astern = np.array([-1.0, 0.2, 0, 0, 0, 0])
    assert acceleration(model, astern)[1] < 0 < mss_force(astern)[1]


# ---- control surfaces ---------------------------------------------------------------------------


def control(nu: np.ndarray, act: list[float]) -> np.ndarray:
    """Our planes as printed and our propeller, settled at their commands."""
    n = act[4] * np.pi / 30
    planes = declare("fins", vehicle="npsauv", form="derivatives")
    inputs = {"u": act[:4], "nu_r": nu, "n": n}
    tau = simulate(planes, at=[0.0, 4.0], h=0.01, inputs=inputs)["tau"][-1]
    inputs = {"u": n / (50 * np.pi), "nu_r": nu}
    pushed = simulate(declare("propeller", vehicle="npsauv"), at=[0.0, 4.0], h=0.01, inputs=inputs)
    return np.asarray(tau + pushed["tau"][-1])


@pytest.mark.parametrize("rpm", [800.0, 1500.0])
def test_planes_and_propeller_are_those_of_mss_with_every_term(rpm: float) -> None:
    """Products of deflections with q, r, v, w and the propeller's slipstream on the planes, too."""
    act = [0.1, -0.05, 0.02, 0.03, rpm]
    np.testing.assert_allclose(control(NU, act), mss_control(NU, act), rtol=1e-8, atol=1e-6)


def test_mss_acceleration_in_a_current_is_ours_but_for_what_is_known(model: Model) -> None:
    """The whole right-hand side: hull, planes, propeller, weight, current; four differences named.

    Two signs, the strips (11 stations for ten, w + x q), and eta by the speed over ground.
    """
    case = MSS["npsauv_xdot_test_state"]
    nu_r = NU - np.array([*V_C, 0, 0, 0])
    act = list(case["u_actual"])
    act[4] *= nu_r[0] / NU[0]
    phi, theta, psi = case["euler"]
    v_c = np.array(ca.evalf(ca.mtimes(R_zyx(phi, theta, psi), ca.DM(V_C)))).ravel()
    start = {"eta_0": [0, 0, 9, phi, theta, psi], "nu_0": NU}
    run = simulate(model, at=[0.0], inputs={"v_c": v_c}, tau=control(nu_r, act), parameters=start)
    k_y, k_z = 0.5 * RHO * 0.5 * 0.53, 0.5 * RHO * 0.6 * 0.53
    strips = -np.array(ca.evalf(cross_flow(ca.SX(nu_r), -L / 2, L / 2, k_y, k_z))).ravel()
    known = sign_errors(nu_r) + strips - mss_strips(nu_r)
    # It turns the current by yaw alone; what that leaves out of nu_c_dot:
    turned = -np.cross(NU[3:], V_C) - np.array([NU[5] * V_C[1], -NU[5] * V_C[0], 0])
    expected = np.array(MSS["npsauv_xdot_at_test_state"]).ravel()[:6]
    expected = expected + np.linalg.solve(mass(model), known) + [*turned, 0, 0, 0]
    np.testing.assert_allclose(run["nu_dot"][0], expected, atol=1e-8)


def test_at_its_steady_speed_the_propeller_adds_nothing_to_the_planes() -> None:
    steady = np.array([1.5, 0.1, 0.05, 0.02, 0.03, -0.01])
    fast = control(steady, [0.0, 0.0, 0.0, 0.0, 1.5 / 0.012 * 30 / np.pi])
    np.testing.assert_allclose(fast, [0.5 * RHO * L**2 * 0.00385 * 2.25, 0, 0, 0, 0, 0], atol=1e-6)


def test_without_flow_the_planes_as_printed_are_finite() -> None:
    act = [0.2, 0.2, 0.2, 0.2, 1500.0]
    assert np.all(np.isfinite(control(np.zeros(6), act)))
    assert np.all(np.isfinite(control(-NU, [*act[:4], -1500.0])))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('of: [u, u, "rudders"]', 'of: [u, "rudders"]', "two velocities"),
        ('of: [u, r, "rudders"]', 'of: [u, r, "ruders"]', "rudders, stern planes"),
        (
            'unit: "N.s2/m2", source: "Healey and Lienard (1993): Ydr',
            'unit: N, source: "Ydr',
            "Ydr",
        ),
    ],
)
def test_a_mistake_in_a_control_derivative_is_named_with_its_line(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    for name in ("parameters", "fins", "control"):
        text = content("models", "vehicles", "npsauv", f"{name}.yaml").read_text()
        (tmp_path / f"{name}.yaml").write_text(text.replace(old, new))
    with pytest.raises(InputInvalid, match=rf"control\.yaml:\d+: .*{message}"):
        declare("fins", vehicle=str(tmp_path), form="derivatives")


def test_a_vehicle_without_control_derivatives_is_refused_by_name() -> None:
    with pytest.raises(InputInvalid, match=r"remus100.*control\.yaml"):
        declare("fins", vehicle="remus100", form="derivatives")
