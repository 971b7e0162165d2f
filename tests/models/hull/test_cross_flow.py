"""Cross-flow drag, lift and products: closed forms, symmetry, and that drag only brakes."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.models.declaration.hull_parameters import product_of
from uuvsim_cosim.models.hull.damping import cross_flow, fading, lift, products

six = st.lists(st.floats(-3, 3), min_size=6, max_size=6).map(np.array)
a, b, K = -0.7, 0.9, 60.0  # stern, bow [m]; 1/2 rho C_D h [N.s2/m3]


def number(expression: Any) -> np.ndarray:
    return np.array(ca.evalf(ca.SX(expression))).ravel()


def drag(nu: Any, k_y: float = K, k_z: float = K, strips: int = 10) -> np.ndarray:
    return number(cross_flow(ca.SX(np.asarray(nu, dtype=float)), a, b, k_y, k_z, strips))


def closed_form(v: float, r: float) -> tuple[float, float]:
    """Y and N of a slab in sway and yaw alone: the integral split where the flow turns."""
    turn = np.clip(-v / r, a, b) if r else a
    Y = N = 0.0
    for low, high in ((a, turn), (turn, b)):
        sign = np.sign(v + 0.5 * (low + high) * r)
        powers = [(high**n - low**n) / n for n in range(1, 5)]
        Y += sign * (v * v * powers[0] + 2 * v * r * powers[1] + r * r * powers[2])
        N += sign * (v * v * powers[1] + 2 * v * r * powers[2] + r * r * powers[3])
    return K * Y, K * N


@pytest.mark.parametrize(("v", "r"), [(0.7, 0.0), (0.7, 0.4), (-1.2, 0.9), (1.0, -1.0)])
def test_strips_are_exact_where_the_flow_comes_from_one_side(v: float, r: float) -> None:
    force = drag([0.8, v, 0, 0, 0, r])
    np.testing.assert_allclose(force[[1, 5]], closed_form(v, r), rtol=1e-12, atol=1e-12)
    assert np.all(force[[0, 2, 3, 4]] == 0)


@pytest.mark.parametrize(("v", "r"), [(0.1, 1.0), (-0.3, 0.8), (0.0, 1.3)])
def test_strips_are_close_where_the_flow_turns_along_the_hull(v: float, r: float) -> None:
    np.testing.assert_allclose(drag([0, v, 0, 0, 0, r])[[1, 5]], closed_form(v, r), rtol=2e-3)


def test_twenty_one_stations_are_five_percent_too_much_and_ours_are_not() -> None:
    stations = np.linspace(a, b, 21)
    too_much = K * np.sum(np.ones_like(stations)) * (b - a) / 20
    assert too_much / drag([0, 1, 0, 0, 0, 0])[1] == pytest.approx(1.05, rel=1e-12)
    assert drag([0, 1, 0, 0, 0, 0])[1] == pytest.approx(K * (b - a), rel=1e-12)


def test_heave_and_pitch_are_sway_and_yaw_of_a_hull_that_is_rolled() -> None:
    """A round hull is the same at any roll: y to z, so v to w and r to -q, N to -M."""
    sway, heave = drag([0, 0.4, 0, 0, 0, 0.7]), drag([0, 0, 0.4, 0, -0.7, 0])
    assert heave[2] == pytest.approx(sway[1], rel=1e-14)
    assert heave[4] == pytest.approx(-sway[5], rel=1e-14)


@given(six, st.floats(0, 6.3))
@settings(max_examples=50, deadline=None)
def test_a_round_hull_brakes_alike_at_any_roll(nu: np.ndarray, phi: float) -> None:
    R = np.array([[1, 0, 0], [0, np.cos(phi), -np.sin(phi)], [0, np.sin(phi), np.cos(phi)]])
    H = np.kron(np.eye(2), R)
    np.testing.assert_allclose(drag(H @ nu), H @ drag(nu), atol=1e-9)


@given(six, st.floats(0, 100), st.floats(0, 100))
@settings(max_examples=100, deadline=None)
def test_cross_flow_drag_only_takes_energy(nu: np.ndarray, k_y: float, k_z: float) -> None:
    assert nu @ drag(nu, k_y, k_z) >= -1e-12


def test_drag_has_a_finite_gradient_at_rest() -> None:
    nu = ca.SX.sym("nu", 6)
    jacobian = ca.Function("J", [nu], [ca.jacobian(cross_flow(nu, a, b, K, K), nu)])
    assert np.all(np.isfinite(np.array(jacobian(np.zeros(6)))))


# ---- lift --------------------------------------------------------------------------------------


def fin_matrix(c: float, x: float) -> ca.SX:
    """A vertical fin at x that brakes v + x r with c |u|."""
    D_u = ca.SX(6, 6)
    D_u[1, 1], D_u[1, 5], D_u[5, 1], D_u[5, 5] = c, c * x, c * x, c * x * x
    return D_u


@given(six, st.floats(0, 50), st.floats(-2, 2))
@settings(max_examples=100, deadline=None)
def test_a_fixed_fin_only_takes_energy_ahead_and_astern(nu: np.ndarray, c: float, x: float) -> None:
    assert nu @ number(lift(fin_matrix(c, x), ca.SX(nu))) >= -1e-9


def test_lift_across_the_flow_is_alike_ahead_and_astern_and_none_broadside() -> None:
    D_u = fin_matrix(10.0, -0.5)
    force = {u: number(lift(D_u, ca.SX([u, 0.2, 0, 0, 0, 0])))[1] for u in (1.5, -1.5, 0.0)}
    assert force[1.5] == pytest.approx(force[-1.5], rel=1e-15) == pytest.approx(3.0)
    assert force[0.0] == 0.0


def test_damping_that_fades_is_linear_at_rest_and_gone_at_speed() -> None:
    D_f = ca.diag(ca.SX([4.0, 0, 0, 0, 0, 0]))
    slow, fast = (number(fading(D_f, 0.3, ca.SX([u, 0, 0, 0, 0, 0])))[0] for u in (1e-6, 6.0))
    assert slow == pytest.approx(4e-6, rel=1e-5)
    assert fast < 1e-6


# ---- products ----------------------------------------------------------------------------------


def test_a_product_is_its_coefficient_times_two_velocities() -> None:
    nu = np.array([1.5, -0.4, 0.3, 0.2, -0.6, 0.7])
    p = {"X_wq": 2.0, "Y_pq": 3.0, "N_vv": -4.0}
    force = number(products(p, ca.SX(nu)))
    expected = [2 * 0.3 * -0.6, 3 * 0.2 * -0.6, 0, 0, 0, -4 * 0.16]
    np.testing.assert_allclose(force, expected, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("Y_uv", "N.s2/m2"), ("N_ur", "N.m.s2/(m.rad)"), ("K_qr", "N.m.s2/rad2"), ("Z_up", None)],
)
def test_a_products_unit_follows_from_its_letters(name: str, unit: str | None) -> None:
    product = product_of(name)
    assert product is not None
    assert product.unit == (unit or "N.s2/(m.rad)")


@pytest.mark.parametrize("name", ["Y_vu", "Q_uv", "Y_uuv", "Y_ux"])
def test_other_letters_are_no_product(name: str) -> None:
    assert product_of(name) is None
