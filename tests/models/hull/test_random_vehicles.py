"""Invariants of the equations over random vehicles: every parameter and the state are drawn."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.hull.coriolis import m2c
from uuvsim_cosim.models.hull.vehicle import hull

PAIRS = [(i, j) for i in range(1, 7) for j in range(i, 7)]
NAMES = {
    **dict.fromkeys(("m", "W", "B"), 1.0),
    **{f"{a}_{b}": 0.0 for b in "gb" for a in "xyz"},
    **{f"I_g_{i}{j}": float(i == j) for i, j in PAIRS if j <= 3},
    **{f"M_A_{i}{j}": 0.0 for i, j in PAIRS},
    **{f"{d}_{i}{j}": 0.0 for d in ("D_l", "D_q") for i in range(1, 7) for j in range(1, 7)},
    **{f"D_u_{i}{i}": 0.0 for i in range(1, 7)},
    "x_bow": 1.0,
    "x_stern": -1.0,
    "rho": 1000.0,
    "C_D_y": 1.0,
    "C_D_z": 1.0,
    "h_y": 0.2,
    "b_z": 0.2,
}
seeds = st.integers(0, 2**32 - 1)
check = settings(max_examples=40, deadline=None, derandomize=True)


@lru_cache
def equations() -> tuple[Any, Any]:
    """Return the general hull, and its M of the parameters."""
    model = hull("general", NAMES, surface=False)
    p = ca.vertcat(*(v.symbol for v in model.of_kind("parameter")))
    M = ca.Function("M", [p], [ca.densify(model.variables["M"].start)])
    return Evaluation(model), M


def definite(rng: np.random.Generator, n: int, least: float = 0.1) -> np.ndarray:
    A = rng.normal(size=(n, n))
    return np.asarray(A @ A.T + least * np.eye(n))


class Vehicle:
    """A random vehicle: masses positive definite, damping passive, CG and CB off centre."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        a, b, c = rng.uniform(0.05, 0.4, 3)
        self.m = float(rng.uniform(5, 50))
        turn = rotation(rng)
        self.I_g = turn @ np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) @ turn.T * self.m
        self.r_g, self.r_b = rng.normal(0, 0.1, 3), rng.normal(0, 0.1, 3)
        self.M_A, self.D_l = definite(rng, 6), definite(rng, 6, 0.0)
        self.D_q = np.diag(rng.uniform(0, 30, 6))
        self.D_u = np.diag(rng.uniform(0, 30, 6))
        self.weights = rng.uniform(50, 500, 2)
        self.drag = rng.uniform(0, 2, 2)

    def numbers(self) -> dict[str, float]:
        n = {"m": self.m, "W": self.weights[0], "B": self.weights[1]}
        n |= {f"{a}_g": v for a, v in zip("xyz", self.r_g, strict=True)}
        n |= {f"{a}_b": v for a, v in zip("xyz", self.r_b, strict=True)}
        n |= {f"I_g_{i}{j}": self.I_g[i - 1, j - 1] for i, j in PAIRS if j <= 3}
        n |= {f"M_A_{i}{j}": self.M_A[i - 1, j - 1] for i, j in PAIRS}
        for name, D in (("D_l", self.D_l), ("D_q", self.D_q)):
            n |= {f"{name}_{i + 1}{j + 1}": D[i, j] for i in range(6) for j in range(6)}
        n |= {f"D_u_{i}{i}": self.D_u[i - 1, i - 1] for i in range(1, 7)}
        n |= {"C_D_y": self.drag[0], "C_D_z": self.drag[1]}
        return n

    def values(self) -> np.ndarray:
        return equations()[0].values_of("parameter", self.numbers())

    def M(self) -> np.ndarray:
        return np.array(equations()[1](self.values()))

    def rates(
        self, nu: np.ndarray, q: np.ndarray, tau: np.ndarray, v_c: np.ndarray | None = None
    ) -> np.ndarray:
        """Return nu_dot (6) at an attitude q, in a current v_c in n."""
        f, _ = equations()
        p = self.values()
        d = np.array(f.derived(p)).ravel()
        u = f.values_of("input", {"tau": tau, "v_c": np.zeros(3) if v_c is None else v_c})
        x = np.concatenate([[0, 0, 9], q, nu])
        return np.array(f.rhs(0.0, u, p, d, x, [])).ravel()[7:13]


def quaternion(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=4)
    return np.asarray(q / np.linalg.norm(q))


def matrix(q: np.ndarray) -> np.ndarray:
    w, v = q[0], q[1:]
    return np.asarray(np.eye(3) + 2 * w * S(v) + 2 * S(v) @ S(v))


def rotation(rng: np.random.Generator) -> np.ndarray:
    return matrix(quaternion(rng))


def S(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


@check
@given(seeds)
def test_M_is_symmetric_and_positive_definite(seed: int) -> None:
    M = Vehicle(seed).M()
    np.testing.assert_allclose(M, M.T, atol=1e-12 * np.abs(M).max())
    assert np.linalg.eigvalsh(M)[0] > 0


@check
@given(seeds)
def test_C_is_skew_and_does_no_work(seed: int) -> None:
    vehicle = Vehicle(seed)
    nu = vehicle.rng.normal(size=6)
    C = np.array(ca.evalf(ca.densify(m2c(ca.SX(ca.DM(vehicle.M())), ca.SX(ca.DM(nu))))))
    np.testing.assert_allclose(C, -C.T, atol=1e-12 * np.abs(C).max())
    assert abs(nu @ C @ nu) <= 1e-12 * np.abs(C).max() * (nu @ nu)


@check
@given(seeds)
def test_still_water_only_takes_energy(seed: int) -> None:
    """Weightless and without tau:  nu' M nu_dot = -nu' D(nu) nu <= 0."""
    vehicle = Vehicle(seed)
    vehicle.weights = np.zeros(2)
    nu = vehicle.rng.normal(size=6)
    M = vehicle.M()
    assert nu @ M @ vehicle.rates(nu, quaternion(vehicle.rng), np.zeros(6)) <= 1e-9


@check
@given(seeds)
def test_in_a_uniform_current_a_drifting_observer_sees_still_water(seed: int) -> None:
    vehicle = Vehicle(seed)
    rng, tau = vehicle.rng, vehicle.rng.normal(0, 10, 6)
    nu, q, v_c = rng.normal(size=6), quaternion(rng), rng.normal(size=3)
    v_c_b = matrix(q).T @ v_c
    still = vehicle.rates(nu, q, tau)
    moved = vehicle.rates(nu + np.array([*v_c_b, 0, 0, 0]), q, tau, v_c)
    expected = still - np.array([*np.cross(nu[3:], v_c_b), 0, 0, 0])
    np.testing.assert_allclose(moved, expected, atol=1e-9 * (1 + np.abs(expected).max()))


@check
@given(seeds)
def test_north_is_where_one_draws_it(seed: int) -> None:
    """Turning attitude and current about the vertical changes nothing in b."""
    vehicle = Vehicle(seed)
    rng, tau = vehicle.rng, vehicle.rng.normal(0, 10, 6)
    nu, q, v_c, psi = rng.normal(size=6), quaternion(rng), rng.normal(size=3), rng.uniform(-3, 3)
    c, s = np.cos(psi / 2), np.sin(psi / 2)
    w, x, y, z = q
    turned = np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])
    current = matrix(np.array([c, 0, 0, s])) @ v_c
    here, there = vehicle.rates(nu, q, tau, v_c), vehicle.rates(nu, turned, tau, current)
    np.testing.assert_allclose(there, here, atol=1e-9 * (1 + np.abs(here).max()))


@check
@given(seeds)
def test_the_motion_does_not_depend_on_where_CO_is_nor_on_the_axes_of_b(seed: int) -> None:
    """The same body written about another point in turned axes: M' = H^T M H, nu = H nu'.

    (Linear damping alone: |nu| nu, strips and |u| belong to the axes that they were measured in.)
    """
    vehicle = Vehicle(seed)
    rng = vehicle.rng
    vehicle.D_q = vehicle.D_u = np.zeros((6, 6))
    vehicle.drag = np.zeros(2)
    turn, at = rotation(rng), rng.normal(0, 0.3, 3)
    H = np.block([[np.eye(3), -S(at)], [np.zeros((3, 3)), np.eye(3)]])
    # nu at the new point: v' = v + omega x at; axes turned by `turn` (new to old).
    T = np.kron(np.eye(2), turn)
    inverse_H = np.linalg.inv(H)
    to_old = inverse_H @ T
    other = Vehicle(seed)
    other.D_q = other.D_u = np.zeros((6, 6))
    other.drag = np.zeros(2)
    other.M_A = to_old.T @ vehicle.M_A @ to_old
    other.D_l = to_old.T @ vehicle.D_l @ to_old
    other.I_g = turn.T @ vehicle.I_g @ turn
    other.r_g, other.r_b = turn.T @ (vehicle.r_g - at), turn.T @ (vehicle.r_b - at)
    nu, q, tau = rng.normal(size=6), quaternion(rng), rng.normal(0, 10, 6)
    R_new = matrix(q) @ turn
    q_new = quaternion_of(R_new)
    nu_new = np.linalg.solve(to_old, nu)
    new = other.rates(nu_new, q_new, to_old.T @ tau)
    old = vehicle.rates(nu, q, tau)
    np.testing.assert_allclose(to_old @ new, old, atol=1e-8 * (1 + np.abs(old).max()))


def quaternion_of(R: np.ndarray) -> np.ndarray:
    """Return the unit quaternion of R by the eigenvector of the largest component (Bar-Itzhack)."""
    K = np.zeros((4, 4))
    K[0, 0] = np.trace(R)
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    K[0, 1:], K[1:, 0] = v, v
    K[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
    return np.asarray(np.linalg.eigh(K / 3)[1][:, -1])
