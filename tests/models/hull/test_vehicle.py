"""The hull in motion: invariants, convergence order, files (`models check` has the rest)."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.checks.reference_trajectory import check
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.hull.coriolis import C_RB
from uuvsim_cosim.models.hull.vehicle import hull

REFERENCE = content("models", "vehicles", "bluerov2_heavy", "reference")
INERT = {"W": 0.0, "B": 0.0, "I_b_11": 1.0, "I_b_22": 1.0, "I_b_33": 1.0}
FULL_M_A = {
    **{f"M_A_{i}{i}": v for i, v in enumerate((8.0, 14.0, 17.0, 0.3, 0.4, 0.35), 1)},
    "M_A_12": 0.5,
    "M_A_13": -0.8,
    "M_A_15": 0.3,
    "M_A_24": -0.25,
    "M_A_26": 0.4,
    "M_A_35": -0.2,
    "M_A_46": 0.02,
    "M_A_45": -0.03,
}
BODY = {
    "m": 12.0,
    "W": 120.0,
    "B": 120.0,
    "x_g": 0.01,
    "y_g": -0.02,
    "z_g": 0.03,
    "z_b": -0.01,
    "I_g_11": 0.2,
    "I_g_22": 0.3,
    "I_g_33": 0.25,
    "I_g_12": 0.01,
    "I_g_23": -0.02,
}
OFF_DIAGONAL = {**BODY, **FULL_M_A}
DAMPED = {
    **OFF_DIAGONAL,
    **{f"D_l_{i}{i}": 2.0 for i in range(1, 7)},
    "D_q_11": 20.0,
    "D_q_22": 30.0,
    "D_q_33": 40.0,
    "D_q_26": 3.0,
    "D_l_35": 0.7,
}
MOVING = (0.6, -0.3, 0.2, 0.4, -0.5, 0.3)


def test_a_set_does_not_reproduce_the_other_ones_trajectory() -> None:
    deviations = check(
        "bluerov2_heavy@wu_2018", REFERENCE / "von_benzon_2022_const_surge.csv", 0.02
    )
    assert max(d.max for d in deviations) > 0.1


# ---- invariants ---------------------------------------------------------------------------------


def energy(model: Model, numbers: dict[str, float], nu: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Kinetic energy of hull and water, and that of CG below CB (W = B), at each row."""
    f = Evaluation(model)
    M = ca.SX(model.variables["M"].start)
    p = ca.vertcat(*(v.symbol for v in model.of_kind("parameter")))
    matrix = np.array(ca.Function("M", [p], [ca.densify(M)])(f.values_of("parameter", {})))
    lever = np.array([numbers.get(f"{a}_g", 0) - numbers.get(f"{a}_b", 0) for a in "xyz"])
    w, x, y, z = q.T
    down = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]).T
    kinetic = 0.5 * np.einsum("ni,ij,nj->n", nu, matrix, nu)
    return kinetic - numbers["W"] * (down @ lever)


def loss(h: float) -> float:
    model = hull("free", OFF_DIAGONAL, surface=False)
    r = simulate(model, until=8, h=h, parameters={"nu_0": MOVING})
    E = energy(model, OFF_DIAGONAL, r["nu"], r["q"])
    return float(np.abs(E - E[0]).max() / abs(E[0]))


def test_a_free_hull_keeps_its_energy_to_the_integrators_order() -> None:
    """Unforced, undamped, neutrally buoyant, with full M_A and CG off centre."""
    coarse, fine = loss(0.02), loss(0.01)
    assert fine < 1e-6
    assert coarse / fine > 14


def test_momentum_of_a_drifting_frame_is_galilean() -> None:
    """In a steady uniform current, drifting with it, the motion is that in still water."""
    v_c = np.array([0.4, -0.7, 0.25])
    model = hull("galilei", DAMPED, surface=False)
    tau = [3.0, -1.0, 2.0, 0.3, -0.2, 0.4]
    still = simulate(model, until=10, h=5e-3, tau=tau)
    start = {"nu_0": [*v_c, 0, 0, 0]}
    moved = simulate(model, until=10, h=5e-3, tau=tau, inputs={"v_c": v_c}, parameters=start)
    np.testing.assert_allclose(moved["nu_r"], still["nu"], atol=1e-9)
    drift = np.outer(moved.t, v_c)
    np.testing.assert_allclose(moved["eta"][:, :3] - drift, still["eta"][:, :3], atol=1e-9)
    np.testing.assert_allclose(moved["q"], still["q"], atol=1e-9)


def test_the_equation_solved_is_fossens_with_both_coriolis_forces() -> None:
    """M_RB nu_dot + C_RB(nu) nu + M_A nu_r_dot + C_A(nu_r) nu_r + ... = tau, term by term."""
    model = hull("full", DAMPED | {"W": 0.0, "B": 0.0}, surface=False)
    v_c, tau = np.array([0.5, -0.2, 0.3]), np.array([5.0, 1.0, -2.0, 0.4, 0.1, -0.3])
    start = {"nu_0": MOVING, "eta_0": [0, 0, 5, 0.3, -0.4, 1.0]}
    r = simulate(model, at=[0.0], tau=tau, inputs={"v_c": v_c}, parameters=start)
    nu, nu_r, nu_dot = r["nu"][0], r["nu_r"][0], r["nu_dot"][0]
    omega, v_c_b = nu[3:], (nu - nu_r)[:3]
    nu_r_dot = nu_dot + np.array([*np.cross(omega, v_c_b), 0, 0, 0])
    m, r_g = DAMPED["m"], np.array([0.01, -0.02, 0.03])
    I_g = np.array([[0.2, 0.01, 0], [0.01, 0.3, -0.02], [0, -0.02, 0.25]])
    S = np.array([[0, -r_g[2], r_g[1]], [r_g[2], 0, -r_g[0]], [-r_g[1], r_g[0], 0]])
    I_b = I_g - m * S @ S
    M_RB = np.block([[m * np.eye(3), -m * S], [m * S, I_b]])
    M_A = np.zeros((6, 6))
    D_l, D_q = np.zeros((6, 6)), np.zeros((6, 6))
    for name, value in DAMPED.items():
        if name[:3] in ("M_A", "D_l", "D_q"):
            i, j = int(name[4]) - 1, int(name[5]) - 1
            {"M_A": M_A, "D_l": D_l, "D_q": D_q}[name[:3]][i, j] = value
    M_A = np.triu(M_A) + np.triu(M_A, 1).T
    C = np.array(ca.evalf(C_RB(m, ca.SX(I_b), ca.SX(r_g), ca.SX(omega))))
    a, b = (M_A @ nu_r)[:3], (M_A @ nu_r)[3:]
    munk = np.concatenate([np.cross(omega, a), np.cross(nu_r[:3], a) + np.cross(omega, b)])
    drag = D_l @ nu_r + D_q @ (np.abs(nu_r) * nu_r)
    np.testing.assert_allclose(
        M_RB @ nu_dot + C @ nu + M_A @ nu_r_dot + munk + drag, tau, rtol=0, atol=1e-9
    )


def test_a_spheroid_that_moves_obliquely_feels_munks_moment_alone() -> None:
    """N = (M_A_11 - M_A_22) u v, M = (M_A_33 - M_A_11) u w; no force across, without damping."""
    body = {"m": 30.0, "W": 300.0, "B": 300.0, "I_g_11": 0.2, "I_g_22": 4.0, "I_g_33": 4.0}
    added = dict(zip((11, 22, 33, 55, 66), (1.2, 28.0, 31.0, 3.0, 2.5), strict=True))
    model = hull("spheroid", body | {f"M_A_{i}": a for i, a in added.items()}, surface=False)
    u, v, w = 1.5, 0.4, -0.2
    f = Evaluation(model)
    p = f.values_of("parameter", {"nu_0": [u, v, w, 0.0, 0.0, 0.0]})
    d = np.array(f.derived(p)).ravel()
    start = np.array(f.initial(p, d)).ravel()
    nu_dot = np.array(f.rhs(0.0, f.values_of("input", {}), p, d, start, [])).ravel()[7:13]
    moments = [0.0, (31.0 - 1.2) * u * w, (1.2 - 28.0) * u * v]
    np.testing.assert_allclose(nu_dot[:3], 0.0, atol=1e-12)
    np.testing.assert_allclose(nu_dot[4:] * [4.0 + 3.0, 4.0 + 2.5], moments[1:], rtol=1e-12)
    assert nu_dot[3] * 0.2 == pytest.approx((28.0 - 31.0) * v * w)


def test_nu_dot_is_the_derivative_of_nu() -> None:
    model = declare("bluerov2_heavy@wu_2018")
    inputs = {"v_c": [0.3, 0.1, 0]}
    r = simulate(model, until=2, h=1e-3, tau=[8, 2, 1, 0.1, 0.2, 0.3], inputs=inputs)
    central = (r["nu"][2:] - r["nu"][:-2]) / 2e-3
    np.testing.assert_allclose(central, r["nu_dot"][1:-1], atol=1e-5)


# ---- order of the integrator, other equations ---------------------------------------------------


def smooth(t: float) -> list[float]:
    return [10 * np.sin(1.3 * t), 4 * np.cos(t), 3 * np.sin(2 * t), 0.3, 0.2 * np.sin(t), 0.5]


def test_the_integrator_is_of_fourth_order() -> None:
    """Where the equation is smooth: |v| v loses one order each time that v changes sign."""
    linear = {name: value for name, value in DAMPED.items() if not name.startswith("D_q")}
    model = hull("linear", linear, surface=False)
    end = [simulate(model, at=[0, 4], h=h, tau=smooth)["nu"][-1] for h in (0.04, 0.02, 0.0025)]
    coarse, fine = (np.abs(e - end[2]).max() for e in end[:2])
    assert 13 < coarse / fine < 21


def euler_rhs(t: float, y: np.ndarray, tau: Callable[[float], Any]) -> np.ndarray:
    """Wu (2018), written out anew: Euler angles, matrices by numpy, Newton-Euler for the body."""
    phi, theta, psi = y[3:6]
    v, w = y[6:9], y[9:12]
    c, s = np.cos, np.sin
    Rz = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    Ry = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    Rx = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    Rnb = Rz @ Ry @ Rx
    T = np.array(
        [
            [1, s(phi) * np.tan(theta), c(phi) * np.tan(theta)],
            [0, c(phi), -s(phi)],
            [0, s(phi) / c(theta), c(phi) / c(theta)],
        ]
    )
    m, inertia, r_g = 11.5, 0.16 * np.eye(3), np.array([0, 0, 0.02])
    M_A = np.array([5.5, 12.7, 14.57, 0.12, 0.12, 0.12])
    D_l = np.array([4.03, 6.22, 5.18, 0.07, 0.07, 0.07])
    D_q = np.array([18.18, 21.66, 36.99, 1.55, 1.55, 1.55])
    nu = y[6:]
    momentum = M_A * nu
    force = m * (np.cross(w, v) + np.cross(w, np.cross(w, r_g))) + np.cross(w, momentum[:3])
    moment = np.cross(w, inertia @ w) + m * np.cross(r_g, np.cross(w, v))
    moment += np.cross(v, momentum[:3]) + np.cross(w, momentum[3:])
    down = Rnb.T @ np.array([0, 0, 1.0])
    force -= (112.8 - 114.8) * down
    moment -= np.cross(r_g, 112.8 * down)
    load = np.asarray(tau(t)) - np.concatenate([force, moment]) - (D_l + D_q * np.abs(nu)) * nu
    S = np.array([[0, -r_g[2], r_g[1]], [r_g[2], 0, -r_g[0]], [-r_g[1], r_g[0], 0]])
    M = np.block([[m * np.eye(3), -m * S], [m * S, inertia]]) + np.diag(M_A)
    return np.concatenate([Rnb @ v, T @ w, np.linalg.solve(M, load)])


def stepped(t: float) -> list[float]:
    return [12.0 if t >= 3 else 0.0, -5.0 if 2 <= t < 6 else 5 * np.sin(t), 0, 0, 0, 0.4 * (t >= 1)]


@pytest.mark.parametrize(("tau", "breaks"), [(smooth, []), (stepped, [1, 2, 3, 6])])
def test_forces_sampled_in_a_file_are_continued_between_the_rows(
    tau: Callable[[float], Any], breaks: list[float], tmp_path: Path
) -> None:
    """An independent right-hand side by DOP853, whose file holds the force at 0.1 s only."""
    from scipy.integrate import solve_ivp

    y = np.array([0, 0, 10, 0.1, -0.2, 0.3, 0.2, -0.1, 0.05, 0.1, 0.0, -0.2])
    edges = [0.0, *breaks, 10.0]
    rows = [np.concatenate([[0.0], y, tau(0.0)])]
    for start, end in pairwise(edges):
        times = np.round(np.arange(start + 0.1, end + 0.05, 0.1), 9)
        last = np.nextafter(end, start)
        f = lambda t, y, last=last: euler_rhs(t, y, lambda r: tau(min(r, last)))  # noqa: E731
        s = solve_ivp(f, (start, end), y, "DOP853", times, rtol=1e-11, atol=1e-12)
        y = s.y[:, -1]
        rows += [np.concatenate([[t], x, tau(t)]) for t, x in zip(times, s.y.T, strict=True)]
    header = (REFERENCE / "wu_2018_const_surge.csv").read_text().splitlines()[4]
    body = "\n".join(",".join(f"{v:.12g}" for v in row) for row in rows)
    path = tmp_path / "r.csv"
    path.write_text(f"# no surface\n{header}\n{body}\n")
    deviations = check("bluerov2_heavy@wu_2018", path, h=5e-3)
    assert max(d.max for d in deviations) < 1e-6


def test_a_file_may_hold_a_current_in_which_the_hull_drifts(tmp_path: Path) -> None:
    """The published trajectory as one who drifts the other way would have written it down."""
    lines = (REFERENCE / "wu_2018_release_tilt.csv").read_text().splitlines()
    table = np.array([[float(x) for x in row.split(",")] for row in lines[5:80]])
    v_c = np.array([0.3, -0.2, 0.1])
    for row in table:
        phi, theta, psi = row[4:7]
        Rnb = np.array(ca.evalf(R_zyx(phi, theta, psi)))
        row[1:4] += v_c * row[0]
        row[7:10] += Rnb.T @ v_c
    rows = "\n".join(",".join(f"{x:.12g}" for x in [*row, *v_c]) for row in table)
    path = tmp_path / "drift.csv"
    path.write_text(f"# no surface\n{lines[4]},vc_N_mps,vc_E_mps,vc_D_mps\n{rows}\n")
    deviations = check("bluerov2_heavy@wu_2018", path, h=5e-3)
    assert max(d.max for d in deviations) < 1e-6


# ---- surface, structure, refusals ---------------------------------------------------------------


def test_a_hull_that_floats_comes_to_rest_where_it_displaces_its_weight() -> None:
    r = simulate(declare("bluerov2_heavy@wu_2018"), until=120, h=0.02)
    D = r["eta"][-1, 2]
    x = D / 0.254 + 0.5
    assert abs(r["nu"][-1]).max() < 1e-3
    assert 114.8 * (3 * x**2 - 2 * x**3) == pytest.approx(112.8, abs=0.05)


@pytest.mark.parametrize(("set", "limit"), [("von_benzon_2022", 300), ("wu_2018", 330)])
def test_zeros_cost_no_instructions(set: str, limit: int) -> None:
    assert Evaluation(declare(f"bluerov2_heavy@{set}")).rhs.n_instructions() < limit


def test_a_published_mass_that_is_not_symmetric_is_kept() -> None:
    numbers = OFF_DIAGONAL | {"M_A_21": 0.6}
    model = hull("skewed", numbers, surface=False)
    assert {"M_A_12", "M_A_21"} <= set(model.variables)


def test_a_value_adds_an_element_that_the_set_leaves_out() -> None:
    model = declare("bluerov2_heavy", values={"x_g": 0.02})
    assert model.variables["x_g"].start == 0.02


def test_weight_and_volume_together_are_refused() -> None:
    with pytest.raises(ParameterInvalid, match="either W and B, or rho, nabla and g, never both"):
        hull("both", OFF_DIAGONAL | {"rho": 1000.0}, surface=False)


def test_an_unknown_set_is_refused_with_those_that_exist() -> None:
    with pytest.raises(ParameterInvalid, match="'fossen'; expected von_benzon_2022, wu_2018"):
        declare("bluerov2_heavy@fossen")
