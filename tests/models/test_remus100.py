"""REMUS 100: Fossen's own right-hand side term by term, and what Prestero printed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.closed_forms import total_mass
from uuvsim_cosim.models.evaluation import Evaluation
from uuvsim_cosim.models.library import declare
from uuvsim_cosim.models.parameters import parameter_set
from uuvsim_cosim.models.simulate import simulate
from uuvsim_cosim.models.vehicle import hull

HERE = Path(__file__).parent / "reference"
RPM = 2 * np.pi / 60
PROPELLER = {"D": 0.14, "t": 0.1, "KT": (0.4566, 0.1798), "KQ": (0.0700, 0.0312), "J": 0.6632}


def fossen_numbers() -> dict[str, float]:
    """The shipped set, with what Fossen leaves out or writes otherwise switched, on purpose.

    No strips and no lift (they are in `fossen_force`, as he sums them), and without the eight
    entries of C_A that he zeroes: products take them back out.
    """
    numbers = {k: q.value for k, q in parameter_set("remus100", "fossen_2021").quantities.items()}
    left_out = ("x_bow", "x_stern", "C_D_y", "C_D_z", "h_y", "b_z", "rho", "D_q_11")
    numbers = {k: v for k, v in numbers.items() if k not in left_out and not k.startswith("D_u")}
    A11, A22 = numbers["M_A_11"], numbers["M_A_22"]
    return numbers | {
        "M_uw": A11 - A22,
        "N_uv": A22 - A11,
        "X_wq": A22,
        "X_vr": -A22,
        "Z_uq": -A11,
        "Y_ur": A11,
    }


def fossen_force(
    nu: np.ndarray, fins: np.ndarray, rpm: float, over_ground: float | None = None
) -> np.ndarray:
    """Propeller, fins, body lift and cross-flow drag with 21 strips, as Fossen writes them.

    `nu` is relative to the water; his speed of advance is the one over ground.
    """
    rho, S, C_D = 1026.0, 0.7 * 1.6 * 0.19, 1.2108 - 0.0067 / 0.0652 * 0.1272
    u, v, w, _, _, r = nu
    U, alpha, n = float(np.linalg.norm(nu[:3])), np.arctan2(w, u), rpm / 60
    U_a = U if over_ground is None else over_ground
    D, J = PROPELLER["D"], PROPELLER["J"]
    tau = np.zeros(6)
    for row, key, power in ((0, "KT", 4), (3, "KQ", 5)):
        at_0, at_J = PROPELLER[key]
        tau[row] = (
            rho * D**power * (at_0 * n * abs(n) + (at_J - at_0) / J * 0.944 * U_a / D * abs(n))
        )
    tau[0] *= 1 - PROPELLER["t"]
    tau[3] /= 10  # his scaling of the propeller's moment
    q_h, q_v = 0.5 * rho * (u * u + v * v), 0.5 * rho * (u * u + w * w)
    area = 2 * 0.00665
    Y, Z = -q_h * area * 0.5 * fins[0], -q_v * area * 0.7 * fins[1]
    X = -q_h * area * 0.5 * fins[0] ** 2 - q_v * area * 0.7 * fins[1] ** 2
    tau += [X, Y, Z, 0, 0.8 * Z, -0.8 * Y]
    AR = 0.19**2 / S
    C_L = np.pi * AR / (1 + np.sqrt(1 + (AR / 2) ** 2)) * alpha
    C_D_0 = 0.42 * np.pi * 0.095**2 / S
    drag = 0.5 * rho * U * U * S * (C_D_0 + C_L**2 / (np.pi * 0.7 * AR))
    lift = 0.5 * rho * U * U * S * C_L
    tau[0] += -np.cos(alpha) * drag + np.sin(alpha) * lift
    tau[2] += -np.sin(alpha) * drag - np.cos(alpha) * lift
    x = np.linspace(-0.8, 0.8, 21)
    strips = -0.5 * rho * 0.19 * C_D * np.abs(v + x * r) * (v + x * r) * 0.08
    tau[1] += strips.sum()
    tau[5] += (x * strips).sum()
    return tau


def rotation(q: np.ndarray) -> np.ndarray:
    """Give R of b to n of a unit quaternion, scalar first."""
    w, v = q[0], q[1:]
    S = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray(np.eye(3) + 2 * w * S + 2 * S @ S)


def run(
    name: str, numbers: dict[str, float], current: tuple[float, float] = (0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate our hull under Fossen's forces along his file; give ours and his, (n, 12).

    He turns the current (speed, direction) into b by yaw alone, and leaves out what pitching makes
    of it in heave: both are done to ours here.
    """
    rows = [r for r in (HERE / name).read_text().splitlines() if not r.startswith("#")]
    table = np.array([[float(x) for x in r.split(",")] for r in rows[1:]])
    model = hull("remus", numbers, surface=False)
    f, M = Evaluation(model), total_mass(model)
    p = f.values_of("parameter", {"eta_0": np.zeros(6)})
    d = np.array(f.derived(p)).ravel()
    x = np.array(f.initial(p, d)).ravel()
    u = f.values_of("input", {})
    act, h, steps = np.zeros(3), 0.02, 25

    def rate(x: np.ndarray, act: np.ndarray, command: np.ndarray) -> tuple[Any, np.ndarray]:
        nu = x[7:13].copy()
        if current[0]:
            eta, speed = np.array(f.outputs(0.0, u, p, d, x, [])).ravel()[:6], current[0]
            angle = current[1] - eta[5]
            v_b = np.array([speed * np.cos(angle), speed * np.sin(angle), 0.0])
            u[6:9] = rotation(x[3:7]) @ v_b
            nu[:3] -= v_b
        u[:6] = fossen_force(nu, act[:2], act[2], float(np.linalg.norm(x[7:10])))
        if current[0]:
            u[:6] -= M[:, 2] * (x[11] * v_b[0] - x[10] * v_b[1])
        dx = np.array(f.rhs(0.0, u, p, d, x, [])).ravel()
        return dx, (command - act) / np.array([0.1, 0.1, 1.0])

    found = [np.array(f.outputs(0.0, u, p, d, x, [])).ravel()]
    for k in range(len(table) - 1):
        command = table[k, 13:16]
        for _ in range(steps):
            k1, a1 = rate(x, act, command)
            k2, a2 = rate(x + h / 2 * k1, act + h / 2 * a1, command)
            k3, a3 = rate(x + h / 2 * k2, act + h / 2 * a2, command)
            k4, a4 = rate(x + h * k3, act + h * a3, command)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            act = act + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        found.append(np.array(f.outputs(0.0, u, p, d, x, [])).ravel())
    ours = np.array(found)
    return np.hstack([ours[:, :6], ours[:, 10:16]]), table[:, 1:13]


@pytest.mark.parametrize("case", ["straight_1525", "step_nocurrent"])
def test_fossens_trajectory_is_reproduced_where_his_choices_are_taken(case: str) -> None:
    """Both files to 1e-6 (positions after 150 s as well): M, C, D, g and kinematics are his."""
    ours, his = run(f"pvs_remus100_{case}_converged.csv", fossen_numbers())
    off = ours - his
    off[:, 3:6] = np.remainder(off[:, 3:6] + np.pi, 2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-6


def test_the_shipped_propeller_and_drag_balance_at_fossens_speed() -> None:
    m = declare("propeller", vehicle="remus100")
    nu_r = [2.5536, 0, 0, 0, 0, 0]
    r = simulate(m, until=20, h=0.01, inputs={"u": 1.0, "nu_r": nu_r})
    drag = parameter_set("remus100", "fossen_2021").quantities["D_q_11"].value * 2.5536**2
    assert r["thrust"][-1] == pytest.approx(drag, rel=2e-4)
    assert r["tau"][-1, 3] > 0  # a left-handed propeller rolls the hull to starboard


def test_fossens_trajectory_in_a_current_is_reproduced_where_his_choices_are_taken() -> None:
    """Turning in 0.5 m/s: Coriolis of the relative velocity, a current that turns in b."""
    current = (0.5, np.deg2rad(30.0))
    ours, his = run("pvs_remus100_step_current_converged.csv", fossen_numbers(), current)
    off = ours - his
    off[:, 3:6] = np.remainder(off[:, 3:6] + np.pi, 2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-6


# ---- Prestero ----------------------------------------------------------------------------------

PRINTED = {
    "Xuu": -1.62, "Xwq": -35.5, "Xqq": -1.93, "Xvr": 35.5, "Xrr": -1.93,
    "Yrr": 0.632, "Yuv": -28.6, "Ywp": 35.5, "Ypq": 1.93, "Yur": 5.22,
    "Zww": -131.0, "Zqq": -0.632, "Zuw": -28.6, "Zvp": -35.5, "Zrp": 1.93, "Zuq": -5.22,
    "Kpp": -0.130, "Mww": 3.18, "Muq": -2.0, "Muw": 24.0, "Mvp": -1.93, "Mrp": 4.86,
    "Nvv": -3.18, "Nur": -2.0, "Nuv": -24.0, "Nwp": -1.93, "Npq": -4.86,
}  # fmt: skip
DISPUTED = {
    "prestero_2001": {"Yvv": -131.0, "Mqq": -9.40, "Nrr": -9.40},
    "prestero_2001_printed": {"Yvv": -1310.0, "Mqq": -188.0, "Nrr": -94.0},
    "scrimmage": {"Yvv": -131.0, "Mqq": -9.40, "Nrr": -9.40, "Kpp": -0.0013},
    "sgarioto_2011": {"Yvv": -1310.0, "Zww": -1310.0, "Xuu": -2.93550},
}


def hydrodynamic_force(set: str) -> Any:
    """Give nu -> the force of the water alone: M nu_dot + C_RB(nu) nu, weightless."""
    model = declare(f"remus100@{set}", surface=False)
    f = Evaluation(model)
    p = f.values_of("parameter", {"W": 0.0, "B": 0.0})
    d = np.array(f.derived(p)).ravel()
    x = np.array(f.initial(p, d)).ravel()
    u = f.values_of("input", {})
    q = {k: v.value for k, v in parameter_set("remus100", set).quantities.items()}
    m, r_g = q["m"], np.array([0, 0, q["z_g"]])
    inertia = np.diag([q[f"I_b_{i}{i}"] for i in (1, 2, 3)])
    S = np.array([[0, -r_g[2], 0], [r_g[2], 0, 0], [0, 0, 0]])
    M = np.block([[m * np.eye(3), -m * S], [m * S, inertia]])
    M += np.diag([q[f"M_A_{i}{i}"] for i in range(1, 7)])
    for i, j in ((1, 5), (2, 4)):
        M[i, j] += q[f"M_A_{i + 1}{j + 1}"]
        M[j, i] += q[f"M_A_{i + 1}{j + 1}"]

    def force(nu: np.ndarray) -> np.ndarray:
        x[7:13] = nu
        nu_dot = np.array(f.rhs(0.0, u, p, d, x, [])).ravel()[7:13]
        v, w = nu[:3], nu[3:]
        push = m * (np.cross(w, v) + np.cross(w, np.cross(w, r_g)))
        turn = np.cross(w, inertia @ w) + m * np.cross(r_g, np.cross(w, v))
        return np.asarray(M @ nu_dot + np.concatenate([push, turn]))

    return force


@pytest.mark.parametrize("set", sorted(DISPUTED))
def test_every_coefficient_that_prestero_printed_comes_out(set: str) -> None:
    """Combined ones too: Munk moment, body lift and fins add up to what the thesis lists."""
    force, unit = hydrodynamic_force(set), np.eye(6)
    for name, value in (PRINTED | DISPUTED[set]).items():
        row, a, b = "XYZKMN".index(name[0]), "uvwpqr".index(name[1]), "uvwpqr".index(name[2])
        if a == b:
            found = force(unit[a])[row]
        else:
            found = (force(unit[a] + unit[b]) - force(unit[a]) - force(unit[b]))[row]
        assert found == pytest.approx(value, abs=1e-8), name


def test_the_speed_of_the_thesis_comes_out() -> None:
    """X_prop = 3.86 N against |X_uu| = 1.62: 1.54 m/s, held level (open loop it is unstable)."""
    r = simulate(
        declare("remus100", surface=False),
        until=400,
        h=0.05,
        tau=[3.86, 0, 0, 0, 0, 0],
        parameters={"W": 0.0, "B": 0.0, "z_g": 0.0},
    )
    assert r["nu"][-1, 0] == pytest.approx(np.sqrt(3.86 / 1.62), abs=1e-9)
    assert r["nu"][-1, 0] == pytest.approx(1.543596, abs=1e-5)  # as published_checks.yaml has it


@pytest.mark.parametrize("address", ["remus100@fossen_2021", "npsauv", "eca_a9"])
def test_in_a_uniform_current_a_torpedo_moves_as_in_still_water_that_drifts(address: str) -> None:
    """Galilean: strips, lift and products feel nu_r alone, the Munk moment too."""
    v_c = np.array([0.4, -0.3, 0.1])
    model = declare(address, surface=False)
    tau = [10.0, 0.5, -1.0, 0.02, 0.1, -0.2]
    still = simulate(model, until=5, h=0.01, tau=tau)
    moved = simulate(model, until=5, h=0.01, tau=tau, inputs={"v_c": v_c},
                     parameters={"nu_0": [*v_c, 0, 0, 0]})  # fmt: skip
    np.testing.assert_allclose(moved["nu_r"], still["nu"], atol=1e-9)
    np.testing.assert_allclose(moved["q"], still["q"], atol=1e-9)
