from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.linearize import linear_model
from uuvsim_cosim.models.analysis.operating_point import Coordinates
from uuvsim_cosim.models.analysis.trim import trim_model
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.vehicles.closed_forms import total_mass


@pytest.fixture(scope="module")
def hull() -> Model:
    return declare("bluerov2_heavy", surface=False)


def test_a_linear_model_is_the_derivative_of_the_equations(hull: Model) -> None:
    """Against central differences, under way and tilted."""
    at = {"nu": [0.4, 0.1, -0.1, 0.1, 0.2, 0.3], "eta[4]": 0.1, "eta[5]": -0.2, "tau[1]": 5.0}
    linear = linear_model(hull, at)
    c = Coordinates(hull)
    x, u = c.point(at)
    f = c.functions[0]
    h = 1e-6

    def slope(of: np.ndarray, moved: Any) -> np.ndarray:
        columns = []
        for i in range(len(of)):
            push = h * np.eye(len(of))[i]
            up, down = (np.concatenate([np.array(v).ravel() for v in moved(s * push)])
                        for s in (1, -1))  # fmt: skip
            columns.append((up - down) / (2 * h))
        return np.array(columns).T

    by_x = slope(x, lambda push: f(x + push, u))
    by_u = slope(u, lambda push: f(x, u + push))
    assert np.vstack([linear.A, linear.C]) == pytest.approx(by_x, abs=1e-7)
    assert np.vstack([linear.B, linear.D]) == pytest.approx(by_u, abs=1e-7)


def test_roll_at_rest_is_a_pendulum_of_its_restoring_moment(hull: Model) -> None:
    """T = 2 pi sqrt(M_44 / (B |z_b|)), sway and roll not coupled here."""
    linear = linear_model(hull, outputs=["eta"])
    rates = np.abs(linear.poles().imag)
    w = np.sqrt(1000 * 9.82 * 0.0134 * 0.01 / total_mass(hull)[3, 3])
    assert np.min(np.abs(rates - w)) < 1e-9
    assert linear.state_labels[3] == "eta[4]"
    assert linear.output_labels == [f"eta[{i}]" for i in range(1, 7)]


def test_trim_finds_the_terminal_speed(hull: Model) -> None:
    """13.7 u + 141 u² = X, held level."""
    point = trim_model(hull, {"tau[1]": 20.0}, free=["tau[3]"])
    u = (-13.7 + np.sqrt(13.7**2 + 4 * 141 * 20)) / (2 * 141)
    assert point["nu[1]"] == pytest.approx(u, rel=1e-9)
    assert point.residual < 1e-9


def test_trim_of_a_hull_whose_weight_is_not_its_buoyancy_needs_heave(hull: Model) -> None:
    w = 13.5 * 9.82 - 1000 * 9.82 * 0.0134
    point = trim_model(hull, {"nu": np.zeros(6)}, free=["tau"])
    assert point["tau[3]"] == pytest.approx(-w)


def test_a_linear_model_around_a_trim_keeps_the_trim(hull: Model) -> None:
    auv = declare("remus100", surface=False)
    point = trim_model(auv, {"nu[1]": 1.5}, free=["tau[1]", "tau[5]"])
    assert point["eta[5]"] < -0.05  # it is light: it flies bow down
    assert abs(point["nu[3]"] * np.cos(point["eta[5]"]) - 1.5 * np.sin(point["eta[5]"])) < 1e-9
    A = linear_model(auv, point).A
    level = linear_model(auv, {"nu[1]": 1.5}).A
    assert not np.allclose(A, level)


def test_where_there_is_no_equilibrium_the_rates_that_stay_are_told(hull: Model) -> None:
    with pytest.raises(InputInvalid, match=r"no equilibrium near the guess: dnu\[3\]/dt = 0.03"):
        trim_model(hull, {"nu": np.zeros(6)}, free=["tau[1]"])


def test_names_that_do_not_exist_are_refused_with_near_ones(hull: Model) -> None:
    with pytest.raises(InputInvalid, match=r"no state or input 'nuu' \(did you mean nu"):
        linear_model(hull, {"nuu": 1.0})
    with pytest.raises(InputInvalid, match=r"no output 'etta' \(did you mean eta"):
        linear_model(hull, outputs=["etta"])
    with pytest.raises(InputInvalid, match=r"tau: \[1.0, 2.0\]; expected 6 finite numbers"):
        linear_model(hull, {"tau": [1.0, 2.0]})
    with pytest.raises(InputInvalid, match="is sampled; expected continuous states alone"):
        trim_model(declare("controller"))
    with pytest.raises(InputInvalid, match="the rates at the point are not finite"):
        linear_model(hull, {"eta[5]": np.pi / 2, "nu[6]": 1e308})


def test_a_sampled_law_has_its_gains_at_high_frequency_and_integrates_at_low() -> None:
    """PD by its closed form at the Nyquist frequency; the integral makes a pole at 1."""
    pid = linear_model(declare("controller"), inputs=["eta[1]"], outputs=["tau_d[1]"])
    assert pid.dt == 0.02
    assert pid.D[0, 0] == pytest.approx(-80.0)
    assert np.min(np.abs(pid.poles() - 1.0)) < 1e-9
    slow = abs(pid(np.exp(1j * 1e-3 * 0.02)))
    assert slow == pytest.approx(24.0 / 1e-3, rel=0.01)
