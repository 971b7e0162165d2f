"""REMUS 100 against Fossen's remus100.py: his trajectories, with the choices that are his taken.

He zeroes eight entries of C_A, sums 21 strips for 20, has no strips in heave and pitch, takes the
speed of advance over ground, and turns a current into b by yaw alone. All of it is done to our
hull here, from outside, by forces; what agrees then is M, C, D, g, the kinematics and RK4.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.models.checks.comparison import Checked, compared
from uuvsim_cosim.models.checks.compiled_run import end_of, prepared
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import parameter_set
from uuvsim_cosim.models.hull.vehicle import hull
from uuvsim_cosim.models.vehicles.closed_forms import total_mass

__all__ = ["trajectories"]

Array = NDArray[np.float64]
ADDRESS = "remus100@fossen_2021"
SUBSTEPS = 25  # of 0.02 s between the rows of his files
STILL, CURRENT = (0.0, 0.0), (0.5, float(np.deg2rad(30.0)))  # speed [m/s], direction [rad]
EQUAL = partial(compared, "fossen", ADDRESS)


def trajectories() -> Iterator[Checked]:
    """Yield his three trajectories, and the speed of the shipped propeller and drag."""
    for name, what, current in (
        ("straight_1525", "100 s straight ahead at 1525 rpm", STILL),
        ("step_nocurrent", "150 s steered", STILL),
        ("step_current", "40 s steered in a current of 0.5 m/s", CURRENT),
    ):
        ours, his = _run(f"pvs_remus100_{name}_converged.csv", current)
        off = ours - his
        off[:, 3:6] = np.remainder(off[:, 3:6] + np.pi, 2 * np.pi) - np.pi
        yield EQUAL(f"{what}, with his choices", off, np.zeros_like(off), 1e-6)
    inputs: dict[str, ArrayLike] = {"u": 1.0, "nu_r": [2.5536, 0, 0, 0, 0, 0]}
    pushed = end_of(declare("propeller", vehicle="remus100"), 20.0, 0.02, inputs)
    drag = parameter_set("remus100", "fossen_2021").quantities["D_q_11"].value * 2.5536**2
    what = "thrust of the shipped propeller and drag at his speed at 1525 rpm, 2.5536 m/s"
    yield EQUAL(what, pushed["thrust"], drag, 2e-4, relative=True)


def _force(nu: Any, fins: Any, rpm: Any, U_a: Any) -> Any:
    """Return propeller, fins, lift and 21 strips; nu is relative to the water, U_a over ground."""
    rho, S, C_D = 1026.0, 0.7 * 1.6 * 0.19, 1.2108 - 0.0067 / 0.0652 * 0.1272
    u, v, w, r = nu[0], nu[1], nu[2], nu[5]
    U, alpha, n = ca.norm_2(nu[:3]), ca.atan2(w, u), rpm / 60
    D, J, size = 0.14, 0.6632, ca.fabs(n)

    def of_propeller(at_0: float, at_J: float, power: int) -> Any:
        slope = (at_J - at_0) / J * 0.944 * U_a / D
        return rho * D**power * (at_0 * n * size + slope * size)

    thrust, torque = of_propeller(0.4566, 0.1798, 4), of_propeller(0.0700, 0.0312, 5)
    q_h, q_v, area = 0.5 * rho * (u * u + v * v), 0.5 * rho * (u * u + w * w), 2 * 0.00665
    Y, Z = -q_h * area * 0.5 * fins[0], -q_v * area * 0.7 * fins[1]
    X = -q_h * area * 0.5 * fins[0] ** 2 - q_v * area * 0.7 * fins[1] ** 2
    AR = 0.19**2 / S
    C_L = np.pi * AR / (1 + np.sqrt(1 + (AR / 2) ** 2)) * alpha
    C_D_0 = 0.42 * np.pi * 0.095**2 / S
    drag = 0.5 * rho * U * U * S * (C_D_0 + C_L**2 / (np.pi * 0.7 * AR))
    lift = 0.5 * rho * U * U * S * C_L
    across, turning = ca.SX(0), ca.SX(0)
    for x in np.linspace(-0.8, 0.8, 21):
        strip = -0.5 * rho * 0.19 * C_D * ca.fabs(v + x * r) * (v + x * r) * 0.08
        across, turning = across + strip, turning + x * strip
    return ca.vertcat(
        0.9 * thrust + X - ca.cos(alpha) * drag + ca.sin(alpha) * lift,
        Y + across,
        Z - ca.sin(alpha) * drag - ca.cos(alpha) * lift,
        torque / 10,  # his scaling of the propeller's moment
        0.8 * Z,
        -0.8 * Y + turning,
    )


def _run(name: str, current: tuple[float, float]) -> tuple[Array, Array]:
    """Integrate our hull under his forces and commands along his file; ours and his, (n, 12)."""
    lines = content("models", "reference", name).read_text(encoding="utf-8").splitlines()
    rows = [row for row in lines if not row.startswith("#")][1:]
    table = np.array([[float(x) for x in row.split(",")] for row in rows])
    # The shipped set without strips and lift, and without the entries of C_A that he zeroes.
    numbers = {k: q.value for k, q in parameter_set("remus100", "fossen_2021").quantities.items()}
    left_out = ("x_bow", "x_stern", "C_D_y", "C_D_z", "h_y", "b_z", "rho", "D_q_11")
    numbers = {k: v for k, v in numbers.items() if k not in left_out and not k.startswith("D_u")}
    A11, A22 = numbers["M_A_11"], numbers["M_A_22"]
    zeroed = {"M_uw": A11 - A22, "N_uv": A22 - A11, "X_wq": A22, "X_vr": -A22}
    model = hull("remus", numbers | zeroed | {"Z_uq": -A11, "Y_ur": A11}, surface=False)
    M = total_mass(model)
    f, p, d, at_rest = prepared(model, {"eta_0": np.zeros(6)})

    s, c, h = ca.SX.sym("s", 16), ca.SX.sym("c", 3), 0.5 / SUBSTEPS

    def rate(s: Any) -> Any:
        x, act = s[:13], s[13:]
        flow = ca.SX.zeros(3)
        if current[0]:
            still = f.outputs.call([0.0, np.zeros(9), p, d, x, []], True, False)[0]
            angle = current[1] - still[5]
            flow = ca.vertcat(current[0] * ca.cos(angle), current[0] * ca.sin(angle), 0)
        nu_r = ca.vertcat(x[7:10] - flow, x[10:13])
        tau = _force(nu_r, act[:2], act[2], ca.norm_2(x[7:10]))
        tau -= ca.mtimes(M[:, 2:3], x[11] * flow[0] - x[10] * flow[1])  # heave, which he leaves out
        u = ca.vertcat(tau, ca.mtimes(R(x[3:7]), flow))
        dx = f.rhs.call([0.0, u, p, d, x, []], True, False)[0]
        return ca.vertcat(dx, (c - act) / ca.DM([0.1, 0.1, 1.0]))

    k1 = rate(s)
    k2 = rate(s + h / 2 * k1)
    k3 = rate(s + h / 2 * k2)
    k4 = rate(s + h * k3)
    step = ca.Function("step", [s, c], [s + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    commands = np.repeat(table[:-1, 13:16], SUBSTEPS, axis=0).T
    start = np.r_[at_rest, np.zeros(3)]
    run = np.array(step.mapaccum(commands.shape[1])(start, commands))[:, SUBSTEPS - 1 :: SUBSTEPS]
    states = np.column_stack([start, run])
    ours = np.array(f.outputs.map(states.shape[1])(0.0, np.zeros(9), p, d, states[:13], [])).T
    return np.hstack([ours[:, :6], ours[:, 10:16]]), table[:, 1:13]
