"""Lift and drag of wings: the published flight model, energy, stall, and stratified water."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import parameter_set
from uuvsim_cosim.models.hull.vehicle import hull
from uuvsim_cosim.models.hull.wings import wings

RHO = 1025.0
P: dict[str, float] = {k: q.value for k, q in parameter_set("slocum").quantities.items()}


def force(nu_r: list[float], **changed: float) -> np.ndarray:
    values = {name: ca.SX(value) for name, value in (P | changed).items()}
    return np.array(ca.evalf(wings(values, RHO, ca.SX(nu_r)))).ravel()


@pytest.mark.parametrize("degrees", [1.0, 3.0, -3.0, 6.0])
def test_at_small_angles_it_is_the_published_flight_model(degrees: float) -> None:
    """Lift and drag across and along the flow, by alpha and alpha² of Merckelbach et al."""
    a, V = np.radians(degrees), 0.35
    X, _, Z, *_ = force([V * np.cos(a), 0, V * np.sin(a), 0, 0, 0])
    q_S = 0.5 * RHO * P["S"] * V**2
    drag = -(X * np.cos(a) + Z * np.sin(a))
    lift = X * np.sin(a) - Z * np.cos(a)
    assert drag == pytest.approx(q_S * (P["C_D_0"] + P["C_D_alpha"] * a * a), rel=0.01)
    assert lift == pytest.approx(q_S * P["C_L_alpha"] * a, rel=0.01)


@pytest.mark.parametrize("seed", range(8))
def test_water_at_rest_only_takes_energy(seed: int) -> None:
    nu = np.random.default_rng(seed).normal(size=6) * [0.4, 0.4, 0.4, 0.5, 0.5, 0.5]
    assert force(nu.tolist()) @ nu <= 0.0


def test_lift_does_no_work() -> None:
    nu = np.array([0.3, 0.0, 0.05, 0.0, 0.1, 0.0])
    lift = force(nu.tolist(), C_D_0=0.0, C_D_alpha=0.0, C_N=0.0)
    assert abs(lift @ nu) < 1e-15
    assert abs(lift[2]) > 1.0


def test_broadside_there_is_no_force_along_the_hull() -> None:
    for w in (0.2, -0.2):
        F = force([0.0, 0.0, w, 0.0, 0.0, 0.0])
        s = np.sin(P["alpha_stall"]) ** 2
        C = P["C_D_0"] + P["C_D_alpha"] * s + P["C_N"] * (1.0 - s)
        assert F[0] == 0.0
        assert F[2] == pytest.approx(-np.sign(w) * 0.5 * RHO * P["S"] * C * w * w)


def test_force_is_continuous_through_the_stall_and_through_rest() -> None:
    for degrees in (15.0, -15.0, 0.0, 90.0, 180.0):
        near = [np.radians(degrees) + step for step in (-1e-7, 1e-7)]
        before, after = (force([0.3 * np.cos(a), 0, 0.3 * np.sin(a), 0, 0, 0]) for a in near)
        assert before == pytest.approx(after, abs=1e-5)
    assert force([0.0] * 6) == pytest.approx(np.zeros(6))


def test_a_glider_that_starts_from_rest_does_not_stay_stalled() -> None:
    """With a broadside drag along the flow, it would sink at 52 deg of angle of attack."""
    own = {"eta_0": (0, 0, 20, 0, -0.38, 0), "m": 70.235, "z_g": 0.2}
    hold = -P["m"] * P["g"] * 0.2 * np.sin(0.38)  # N.m, a moment that holds the pitch
    end = simulate(
        declare("slocum", surface="false"),
        until=120.0,
        h=0.1,
        parameters=own,
        inputs={"tau": [0, 0, 0, 0, hold, 0]},
    )
    u, _, w = end["nu_r"][-1, :3]
    assert 0.2 < u < 0.5
    assert abs(np.arctan2(w, u)) < np.radians(5.0)


def test_density_of_the_water_changes_the_buoyancy() -> None:
    model = declare("slocum", surface="false", stratified="true")
    for density, sign in ((1020.0, 1.0), (1030.0, -1.0)):
        run = simulate(model, until=0.1, h=0.1, inputs={"density": density})
        depth = 5.0 * P["beta_nabla"]
        net = P["g"] * (P["m"] - density * P["nabla"] * (1.0 - depth))
        assert np.sign(net) == sign
        assert run["nu_dot"][0, 2] == pytest.approx(net / (P["m"] + P["M_A_33"]), rel=1e-3)


@pytest.mark.parametrize("lacking", ["S", "x_w", "alpha_stall"])
def test_a_set_with_a_part_of_the_wings_is_refused(lacking: str) -> None:
    numbers: Mapping[str, float] = {k: v for k, v in P.items() if k != lacking}
    with pytest.raises(InputInvalid, match=f"{lacking} missing"):
        hull("glider", numbers)


def test_stratified_water_needs_a_volume() -> None:
    with pytest.raises(InputInvalid, match="rho, nabla and g"):
        uuv.declare("remus100", stratified="true")
