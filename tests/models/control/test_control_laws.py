from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.operating_point import Coordinates
from uuvsim_cosim.models.control.control_law import nominal_matrices
from uuvsim_cosim.models.control.lqr import design_lqr
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.vehicles.closed_forms import total_mass

H = 0.02
LAWS = ("lqr", "feedback_linearisation", "backstepping", "sliding_mode")
AT = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
FREE = {"tau_max": np.full(6, 1e9)}


@pytest.fixture(scope="module")
def hull() -> Coordinates:
    return Coordinates(declare("bluerov2_heavy", surface=False))


def tau(lanes: Any, law: str, **inputs: Any) -> np.ndarray:
    run = lanes(declare(law), parameters=FREE)
    return np.array(run.step(0.0, H, **{"eta_d": AT, "eta": AT} | inputs)["tau_d"])


def accelerated(hull: Coordinates, eta: Any, nu: Any, force: Any) -> np.ndarray:
    x, u = hull.point({"tau": force, "nu": nu, "eta": eta})
    return np.array(hull.functions[0](x, u)[0]).ravel()[6:12]


@pytest.mark.parametrize("law", LAWS)
def test_every_law_has_the_connectors_of_the_pid(law: str) -> None:
    def connectors(name: str) -> dict[str, Any]:
        model = declare(name)
        return {v.name: (v.kind, v.shape, v.units) for v in model.of_kind("input", "output")}

    assert connectors(law) == connectors("controller")


@pytest.mark.parametrize("law", LAWS)
def test_at_rest_where_it_is_wanted_a_law_bears_the_weight_and_no_more(
    lanes: Any, law: str
) -> None:
    known = nominal_matrices("bluerov2_heavy")
    heavy = float((known["W"] - known["B"]).item())
    assert tau(lanes, law) == pytest.approx([0, 0, -heavy, 0, 0, 0], abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_a_law_pushes_ahead_to_where_the_bow_looks(lanes: Any, law: str) -> None:
    east = [0, 0, 5, 0, 0, np.pi / 2]
    push = tau(lanes, law, eta_d=[0, 0.1, 5, 0, 0, np.pi / 2], eta=east) - tau(
        lanes, law, eta_d=east, eta=east
    )
    assert push[0] > 1.0
    assert np.abs(push[1:3]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_a_law_holds_the_hull_in_a_current_that_it_does_not_know(law: str) -> None:
    eta = held(law, [-0.25, 0.2, 0.0], 16.0)
    assert np.max(np.abs(eta[-1, :3] - AT[:3])) < 0.05
    assert np.max(np.abs(eta[:, 3:])) < 0.2


def test_feedback_linearisation_leaves_the_error_of_an_oscillator(
    lanes: Any, hull: Coordinates
) -> None:
    """d²e/dt² = -2 zeta omega de/dt - omega² e on the nominal hull, whatever its velocity."""
    eta, nu = np.array([0, 0, 5, 0.1, -0.05, 0.4]), np.array([0.3, -0.2, 0.1, 0.1, 0.2, -0.3])
    p = preset("controllers", "bluerov2_feedback_linearisation", "controller")
    omega, zeta = np.array(p.vector("omega", "rad/s", 6)), 1.0
    made = accelerated(
        hull, eta, nu, tau(lanes, "feedback_linearisation", eta_d=eta, eta=eta, nu=nu)
    )
    assert made == pytest.approx(-2 * zeta * omega * nu, abs=1e-9)


def test_backstepping_lowers_its_lyapunov_function_as_its_proof_says(
    lanes: Any, hull: Coordinates
) -> None:
    """dV/dt = -s'(D + K_d)s - e'K_p Lambda e, at random states on the nominal hull."""
    p = preset("controllers", "bluerov2_backstepping", "controller")
    per = {"Lambda": ("1/s", "1/s"), "K_p": ("N/m", "N.m/rad"), "K_d": ("N.s/m", "N.m.s/rad")}
    Lambda, K_p, K_d = (np.array(p.vector(n, (f,) * 3 + (m,) * 3, 6)) for n, (f, m) in per.items())
    v = nominal_matrices("bluerov2_heavy")
    rng = np.random.default_rng(3)
    for _ in range(5):
        nu, e_p = rng.normal(0, 0.3, 6), rng.normal(0, 0.3, 3)
        force = tau(lanes, "backstepping", eta_d=[*(AT[:3] + e_p), 0, 0, 0], eta=AT, nu=nu)
        e = np.concatenate([e_p, np.zeros(3)])
        e_dot = -nu - np.concatenate([np.cross(nu[3:], e_p), np.zeros(3)])
        s = Lambda * e - nu
        s_dot = Lambda * e_dot - accelerated(hull, AT, nu, force)
        D = v["D_l"] + v["D_q"] @ np.diag(np.abs(nu))
        slope = s @ v["M"] @ s_dot + e @ (K_p * e_dot)
        assert slope == pytest.approx(-s @ (D @ s + K_d * s) - e @ (K_p * Lambda * e), rel=1e-9)
        assert slope < 0


def test_the_switching_term_of_sliding_mode_is_bounded(lanes: Any) -> None:
    for speed in (-1.0, 1.0):
        push = {"eta_d": AT, "eta": AT, "nu": [speed, 0, 0, 0, 0, 0]}
        without = lanes(declare("sliding_mode"), parameters=FREE | {"K_s": np.zeros(6)})
        more = tau(lanes, "sliding_mode", **push) - without.step(0.0, H, **push)["tau_d"]
        assert more[0] == pytest.approx(-12.0 * np.sign(speed), rel=0.01)


def test_the_shipped_gains_of_the_lqr_are_those_of_its_design() -> None:
    p = preset("controllers", "bluerov2_lqr", "controller")
    design = design_lqr("bluerov2_heavy", p.vector("Q", "1", 18), p.vector("R", "1", 6))
    shipped = np.reshape(declare("lqr").variables["K"].start, (6, 18))
    assert shipped == pytest.approx(design.K, rel=1e-5, abs=1e-6)


def test_a_design_solves_the_riccati_equation_and_is_stable() -> None:
    Q, R = np.full(18, 0.5), np.full(6, 10.0)
    design = design_lqr("bluerov2", Q, R)
    assert np.max(design.poles.real) < 0
    model = declare("bluerov2", surface=False)
    B = np.vstack([np.zeros((12, 6)), np.linalg.inv(total_mass(model))])
    # K = R^-1 B' S:  the design's own, for R = 1 / largest².
    gains = design.K
    assert gains == pytest.approx(np.diag(R**2) @ B.T @ design.S, rel=1e-6, abs=1e-6)
    assert np.min(np.linalg.eigvalsh(design.S)) > 0


@pytest.mark.parametrize(
    ("Q", "R", "told"),
    [
        (np.ones(17), np.ones(6), "Q = .* expected 18 positive numbers"),
        (np.ones(18), [1, 1, 1, 1, 1, 0], "R = .* expected 6 positive numbers"),
        (np.full(18, np.nan), np.ones(6), "expected 18 positive numbers"),
    ],
)
def test_weights_that_make_no_sense_are_refused(Q: Any, R: Any, told: str) -> None:
    with pytest.raises(InputInvalid, match=told):
        design_lqr("bluerov2_heavy", Q, R)


def test_gains_are_designed_for_a_vehicle_that_the_preset_does_not_hold() -> None:
    other = declare("lqr", vehicle="rexrov").variables["K"].start
    assert not np.allclose(other, declare("lqr").variables["K"].start)


def held(law: str, v_c: Any, until: float) -> np.ndarray:
    """Rows of the hull's eta, of its true state and an ideal allocation."""
    hull, control = Evaluation(declare("bluerov2_heavy")), Evaluation(declare(law))
    p, p_c = hull.values_of("parameter", {}), control.values_of("parameter", {})
    d, d_c = hull.derived(p), control.derived(p_c)
    x, z = np.array(hull.initial(p, d)), np.array(control.initial(p_c, d_c))
    tau_d, none, rows = np.zeros(6), np.zeros(0), []
    u = hull.values_of("input", {"v_c": v_c})
    u_c = control.values_of("input", {"eta_d": AT})
    for k in range(round(until / H)):
        u[:6] = tau_d
        y = np.array(hull.outputs(k * H, u, p, d, x, none)).ravel()
        u_c[12:18], u_c[18:24] = y[:6], y[10:16]
        z = np.array(control.updates[0](k * H, u_c, p_c, d_c, none, z, none))
        x = np.array(hull.rk4(k * H, H, u, u, u, p, d, x, none))
        tau_d = np.array(control.outputs(k * H, u_c, p_c, d_c, none, z)).ravel()
        rows.append(y[:6])
    return np.array(rows)
