"""Vehicles against Fossen's equation typed again: other algebra (Kirchhoff, Euler angles), SciPy.

The numbers are those of parameters.yaml, read as plain YAML; nothing of the package is used for
the trajectories. Forces are sums of sines in all six degrees of freedom, in a current.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.integrate import solve_ivp

from uuvsim_cosim.content import content
from uuvsim_cosim.models.checks.compiled_run import rows_of
from uuvsim_cosim.models.declaration.library import declare

Array = np.ndarray[Any, np.dtype[np.float64]]
COLUMNS = (
    "t_s,N_m,E_m,D_m,phi_rad,theta_rad,psi_rad,u_mps,v_mps,w_mps,p_rps,q_rps,r_rps,"
    "X_N,Y_N,Z_N,K_Nm,M_Nm,N_Nm,vc_N_mps,vc_E_mps,vc_D_mps"
)
X, W = np.polynomial.legendre.leggauss(60)  # stations of the strips


def rotation(phi: float, theta: float, psi: float) -> Array:
    c, s = np.cos, np.sin
    z = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    y = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    x = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    product: Array = z @ y @ x
    return product


def strips(p: dict[str, float], nu: Array) -> Array:
    """Healey and Lienard's cross-flow integrals."""
    f = np.zeros(6)
    if "C_D_y" in p:
        half = 0.5 * (p["x_bow"] - p["x_stern"])
        x, dx = p["x_stern"] + half * (1 + X), half * W
        v, w = nu[1] + x * nu[5], nu[2] - x * nu[4]
        size = np.maximum(np.hypot(v, w), 1e-12)
        k = p["C_D_y"] * p["h_y"] * v * v + p["C_D_z"] * p["b_z"] * w * w
        y, z = (-0.5 * p["rho"] * k * a / size * dx for a in (v, w))
        f[[1, 2, 4, 5]] = y.sum(), z.sum(), -(x * z).sum(), (x * y).sum()
    return f


def right_hand_side(p: dict[str, float], v_c: Array) -> Callable[[Array, Array], Array]:
    """Return d(eta, nu)/dt of (eta, nu) and tau."""

    def matrix(kind: str, n: int, even: bool = False) -> Array:
        of = range(1, n + 1)
        rows = [
            [p.get(f"{kind}_{i}{j}", p.get(f"{kind}_{j}{i}", 0.0) if even else 0.0) for j in of]
            for i in of
        ]
        return np.array(rows)

    def skew(a: Array) -> Array:
        return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])

    m = p["m"]
    r_g, r_b = (np.array([p.get(f"{a}_{of}", 0.0) for a in "xyz"]) for of in "gb")
    inertia = matrix("I_b", 3, even=True)
    if "I_g_11" in p:  # about CG: Huygens and Steiner
        inertia = matrix("I_g", 3, even=True) - m * skew(r_g) @ skew(r_g)
    M_A = matrix("M_A", 6, even=True)
    M = M_A + np.block([[m * np.eye(3), -m * skew(r_g)], [m * skew(r_g), inertia]])
    linear, quadratic, lift = matrix("D_l", 6), matrix("D_q", 6), matrix("D_u", 6)
    fading = matrix("D_f", 6)
    weight = p["W"] if "W" in p else m * p["g"]
    buoyancy = p["B"] if "B" in p else p["rho"] * p["nabla"] * p["g"]
    products = [
        ("XYZKMN".index(k[0]), "uvwpqr".index(k[2]), "uvwpqr".index(k[3]), value)
        for k, value in p.items()
        if len(k) == 4 and k[1] == "_" and k[0] in "XYZKMN" and set(k[2:]) <= set("uvwpqr")
    ]

    def rates(x: Array, tau: Array) -> Array:
        phi, theta, _ = x[3:6]
        R, nu = rotation(*x[3:6]), x[6:]
        v, w = nu[:3], nu[3:]
        flow = R.T @ v_c
        nu_r = nu - np.r_[flow, 0, 0, 0]
        down = R.T @ [0, 0, 1]
        momentum = M_A @ nu_r  # Kirchhoff
        force = tau + strips(p, nu_r)
        force -= linear @ nu_r + quadratic @ (np.abs(nu_r) * nu_r) + abs(nu_r[0]) * (lift @ nu_r)
        force -= np.exp(-np.linalg.norm(nu_r[:3]) / p.get("U_f", 1.0)) * (fading @ nu_r)
        for i, a, b, value in products:
            force[i] += value * nu_r[a] * nu_r[b]
        force[:3] -= m * (np.cross(w, v) + np.cross(w, np.cross(w, r_g)))
        force[3:] -= np.cross(w, inertia @ w) + m * np.cross(r_g, np.cross(w, v))
        force[:3] -= np.cross(w, momentum[:3])
        force[3:] -= np.cross(w, momentum[3:]) + np.cross(nu_r[:3], momentum[:3])
        force[:3] += (weight - buoyancy) * down
        force[3:] += np.cross(weight * r_g - buoyancy * r_b, down)
        force -= M_A @ np.r_[np.cross(w, flow), 0, 0, 0]  # the current turns in b
        s, c, t = np.sin(phi), np.cos(phi), np.tan(theta)
        turning = [w[0] + t * (s * w[1] + c * w[2]), c * w[1] - s * w[2]]
        turning.append((s * w[1] + c * w[2]) / np.cos(theta))
        return np.r_[R @ v, turning, np.linalg.solve(M, force)]

    return rates


# name of the file: amplitudes of the six forces, surge at the start, current
CASES = {
    ("bluerov2_heavy", "wu_2018", "sines_in_a_current"): (
        (30, 30, 30, 1, 1, 4), 0.0, (0.3, -0.25, 0.05)),
    ("bluerov2_heavy", "von_benzon_2022", "sines_in_a_current"): (
        (30, 30, 30, 1, 1, 4), 0.0, (0.2, 0.1, 0.3)),
    ("remus100", "prestero_2001_printed", "sines_in_a_current"): (
        (8, 4, 4, 0.1, 1, 1), 1.5, (0.3, -0.25, 0.05)),
    ("npsauv", "healey_lienard_1993", "sines"): (
        (800, 500, 500, 60, 500, 500), 2.0, (0.0, 0.0, 0.0)),
    ("npsauv", "healey_lienard_1993", "sines_in_a_current"): (
        (800, 500, 500, 60, 500, 500), 2.0, (0.2, -0.15, 0.05)),
}  # fmt: skip
OMEGA, PHASE = (np.random.default_rng(1).uniform(a, b, (6, 3)) for a, b in ((0.2, 2.0), (0.0, 6.0)))
HEADER = (
    "# model: Fossen's equation typed again (Kirchhoff, Euler angles) from the numbers of {set} "
    "alone; integrator scipy DOP853 rtol 1e-10 atol 1e-11; group: typed_again\n"
    "# frames NED/FRD, Euler zyx, no surface, current in the three last columns, tau is the "
    "generalised force in FRD about CO\n"
    "# inputs: three sines in each of the six, sampled\n"
)


def numbers(id: str, set_name: str) -> dict[str, float]:
    file = YAML(typ="safe").load(content("models", "vehicles", id, "parameters.yaml").read_text())
    return {k: float(v["value"]) for k, v in file["sets"][set_name]["parameters"].items()}


def trajectory(case: tuple[str, str, str]) -> Array:
    """Integrate 8 s of a case: t, eta, nu, tau, v_c in rows 0.1 s apart."""
    amplitudes, u_0, current = CASES[case]

    def tau(t: float) -> Array:
        return np.array(amplitudes) * 0.3 * np.sin(OMEGA * t + PHASE).sum(axis=1)

    rates = right_hand_side(numbers(*case[:2]), np.array(current))
    t = np.linspace(0.0, 8.0, 81)
    start = np.array([0, 0, 20, 0.1, -0.1, 0.5, u_0, 0, 0, 0, 0, 0])
    states = solve_ivp(
        lambda s, x: rates(x, tau(s)), (0, 8), start, "DOP853", t, rtol=1e-10, atol=1e-11
    ).y.T
    return np.column_stack([t, states, [tau(s) for s in t], np.tile(current, (len(t), 1))])


def file_of(case: tuple[str, str, str]) -> Path:
    return content("models", "vehicles", case[0], "reference") / f"{case[1]}_{case[2]}.csv"


@pytest.mark.parametrize("case", CASES, ids="-".join)
def test_the_shipped_trajectories_are_those_of_the_equation_typed_again(
    case: tuple[str, str, str],
) -> None:
    """`models check` compares the hull with the file; this is where the file comes from."""
    shipped = np.loadtxt(file_of(case), delimiter=",", skiprows=4)
    np.testing.assert_allclose(shipped, trajectory(case), rtol=0, atol=1e-7)
    assert np.max(np.abs(shipped[-1, 1:3])) > 0.5  # it went somewhere


def test_in_a_current_that_rotates_a_hull_moves_as_the_equation_typed_again_says() -> None:
    """A current that changes with time pushes by its acceleration, too: the inputs v_c and a_c."""
    p = numbers("bluerov2_heavy", "von_benzon_2022")
    M_A = np.diag([p.get(f"M_A_{i}{i}", 0.0) for i in range(1, 7)])
    r_b = np.array([0.0, 0.0, p["z_b"]])
    turning = 0.7
    tau = np.array([20.0, -8.0, 5.0, 0.3, -0.2, 1.5])

    def flow(t: Array | float) -> tuple[Array, Array]:
        a, still = turning * np.asarray(t), 0.0 * np.asarray(t)
        v_c = np.array([0.4 * np.cos(a), 0.4 * np.sin(a), 0.1 + still])
        return v_c, turning * np.array([-v_c[1], v_c[0], still])

    def rates(t: float, x: Array) -> Array:
        v_c, a_c = flow(t)
        a = rotation(*x[3:6]).T @ a_c
        push = p["rho"] * p["nabla"] * a
        further = M_A @ np.r_[a, 0, 0, 0] + np.r_[push, np.cross(r_b, push)]
        return right_hand_side(p, v_c)(x, tau + further)

    t = np.linspace(0.0, 5.0, 26)
    start = np.array([0, 0, 20, 0.1, -0.1, 0.5, 0.2, 0, 0, 0, 0, 0])
    theirs = solve_ivp(rates, (0, 5), start, "DOP853", t, rtol=1e-9, atol=1e-10).y.T
    model = declare("bluerov2_heavy@von_benzon_2022", surface=False, waves=True)
    assert [v.name for v in model.of_kind("input")] == ["tau", "v_c", "a_c"]
    inputs = lambda s: np.column_stack([np.tile(tau, (len(s), 1)), *(f.T for f in flow(s))])  # noqa: E731
    ours = rows_of(model, t, 5e-3, inputs, {"eta_0": start[:6], "nu_0": start[6:]})
    off = ours["eta"] - theirs[:, :6]
    off[:, 3:] = np.remainder(off[:, 3:] + np.pi, 2 * np.pi) - np.pi
    np.testing.assert_allclose(off, 0.0, rtol=0, atol=1e-6)
    np.testing.assert_allclose(ours["nu"], theirs[:, 6:], rtol=0, atol=1e-6)


def write() -> None:
    """Write the files anew: python tests/models/checks/test_independent.py."""
    for case in CASES:
        body = "\n".join(",".join(f"{x:.12g}" for x in row) for row in trajectory(case))
        file_of(case).parent.mkdir(exist_ok=True)
        file_of(case).write_text(HEADER.format(set=case[1]) + COLUMNS + "\n" + body + "\n")


if __name__ == "__main__":
    write()
