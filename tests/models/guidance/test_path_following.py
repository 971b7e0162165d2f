from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.guidance.trajectory import trajectory

H = 0.02
LINE = [(0.0, 0.0, 5.0), (60.0, 0.0, 5.0)]


def drifting(lanes: Any, method: str, drift: float, until: float = 90.0) -> np.ndarray:
    """Cross-track error of a vehicle that goes where its bow looks, and is carried sideways."""
    run = lanes(declare("path_following", method=method, waypoints=LINE))
    eta = np.array([0.0, 1.0, 5.0, 0.0, 0.0, 0.0])
    rows = []
    for k in range(round(until / H)):
        run.step(k * H, H, eta=eta)
        psi, u = run["eta_d"][5], run["nu_d"][0]
        eta = eta + H * np.array([u * np.cos(psi), u * np.sin(psi) + drift, 0, 0, 0, 0])
        eta[5] = psi
        rows.append(eta[1])
    return np.array(rows)


def test_los_keeps_the_offset_of_its_law_in_a_current(lanes: Any) -> None:
    """U sin(atan(y / Delta)) = drift."""
    y = drifting(lanes, "los", 0.15)
    assert y[-1] == pytest.approx(1.5 * np.tan(np.arcsin(0.15 / 0.5)), rel=1e-3)


@pytest.mark.parametrize("method", ["ilos", "alos"])
def test_ilos_and_alos_take_the_offset_away(lanes: Any, method: str) -> None:
    y = drifting(lanes, method, 0.15)
    assert abs(y[-1]) < 5e-3
    assert np.max(np.abs(y)) < 1.3


def test_a_method_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="method 'lost'; expected los, ilos, alos"):
        declare("path_following", method="lost")


SLOPE = [(0.0, 0.0, 5.0), (60.0, 0.0, 11.0)]  # sinks 1 m in 10


def sinking(lanes: Any, method: str, drift: float, until: float = 90.0) -> np.ndarray:
    """Error z of a vehicle below a leg that sinks; it flies where it is told, and drifts down."""
    run = lanes(declare("path_following", method=method, waypoints=SLOPE, vertical="los"))
    eta = np.array([0.0, 0.0, 6.0, 0.0, 0.0, 0.0])
    run.step(0.0, H, eta=[0.0, 0.0, 5.0, 0.0, 0.0, 0.0])  # the leg begins where the vehicle is
    rows = []
    for k in range(1, round(until / H)):
        run.step(k * H, H, eta=eta)
        u, sink = run["nu_d"][0], run["nu_d"][2]
        assert run["eta_d"][2] == pytest.approx(eta[2], abs=1e-12)
        assert abs(sink) <= u
        ahead = np.sqrt(u**2 - sink**2)  # u is the speed along the path of flight
        eta = eta + H * np.array([ahead, 0.0, sink + drift, 0.0, 0.0, 0.0])
        rows.append((eta[2] - 5.0 - eta[0] / 10.0) * np.cos(np.arctan(0.1)))
    return np.array(rows)


def test_los_in_the_vertical_keeps_the_offset_of_its_law(lanes: Any) -> None:
    """Along the leg's normal, U sin(atan(z / Delta)) = drift cos(pi_v)."""
    z = sinking(lanes, "los", 0.1)
    assert z[-1] == pytest.approx(
        1.5 * np.tan(np.arcsin(0.1 * np.cos(np.arctan(0.1)) / 0.5)), rel=1e-3
    )
    assert abs(sinking(lanes, "los", 0.0)[-1]) < 1e-3


@pytest.mark.parametrize("method", ["ilos", "alos"])
def test_ilos_and_alos_take_the_offset_in_the_vertical_away(lanes: Any, method: str) -> None:
    z = sinking(lanes, method, 0.1)
    assert abs(z[-1]) < 5e-3
    assert np.max(np.abs(z)) < 1.3


def test_a_vertical_law_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="vertical 'up'; expected leg, los"):
        declare("path_following", vertical="up")
    with pytest.raises(ParameterInvalid, match="vertical=los with altitude=true; expected one of"):
        declare("path_following", vertical="los", altitude=True)


def test_a_trajectory_ends_at_its_waypoints_at_rest_and_its_velocity_is_its_derivative(
    lanes: Any,
) -> None:
    square = [(4.0, 0.0, 5.0), (4.0, 3.0, 6.0)]
    run = lanes(trajectory(waypoints=square))
    rows, speeds, turns = [], [], []
    for k in range(2600):
        run.step(k * H, H, eta=[0, 0, 5, 0, 0, 0])
        rows.append(run["eta_d"].copy())
        speeds.append(run["nu_d"].copy())
        turns.append(run["done"])
    eta, nu = np.squeeze(rows), np.squeeze(speeds)
    assert eta[-1] == pytest.approx([4, 3, 6, 0, 0, np.pi / 2], abs=1e-9)
    assert nu[-1] == pytest.approx(np.zeros(6), abs=1e-12)
    assert turns[-1] == 1
    for point in square:
        assert np.min(np.linalg.norm(eta[:, :3] - point, axis=1)) < 1e-9
    slope = (eta[2:, :3] - eta[:-2, :3]) / (2 * H)
    c, s = np.cos(eta[1:-1, 5]), np.sin(eta[1:-1, 5])
    v = nu[1:-1]
    wanted = np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]], axis=1)
    assert np.max(np.abs(slope - wanted)) < 2e-3
    longest = np.sqrt(5.774 * 4.0 / 0.1)  # s: this short leg is bound by its acceleration
    peak = np.max(np.linalg.norm(nu[:, :3], axis=1))
    assert peak == pytest.approx(1.875 * 4.0 / longest, rel=1e-3)


def flown(lanes: Any, until: float, seabed: Any = None, **options: Any) -> np.ndarray:
    """N, E, D and done of a vehicle that goes as it is told, at once, from (-10, 2)."""
    run = lanes(declare("path_following", method="los", **options))
    at = np.array([-10.0, 2.0, 5.0, 0.0, 0.0, 0.0])
    rows = []
    for k in range(round(until / H)):
        more = {} if seabed is None else {"altitude": seabed(at[0]) - at[2], "altitude_valid": 1.0}
        run.step(k * H, H, eta=at, nu=[0.5, 0, 0, 0, 0, 0], **more)
        eta_d, u = np.ravel(run["eta_d"]), float(np.ravel(run["nu_d"])[0])
        at = at + H * u * np.array([np.cos(eta_d[5]), np.sin(eta_d[5]), 0, 0, 0, 0])
        at[2], at[5] = eta_d[2], eta_d[5]
        rows.append([*at[:3], float(np.ravel(run["done"])[0])])
    return np.array(rows)


def test_a_loiter_circles_around_the_last_waypoint(lanes: Any) -> None:
    """The default radius is 20 m; the vehicle goes on at its speed of 0.5 m/s."""
    at = flown(lanes, 400.0, end="loiter", waypoints=[(20.0, 0.0, 5.0)])
    last = at[-5000:]
    assert np.hypot(last[:, 0] - 20.0, last[:, 1]) == pytest.approx(20.0, abs=0.3)
    bearing = np.unwrap(np.arctan2(last[:, 1], last[:, 0] - 20.0))
    assert bearing[-1] - bearing[0] == pytest.approx(0.5 * 100.0 / 20.0, rel=0.03)  # clockwise
    assert last[-1, 3] == 1.0


def test_a_repeated_path_is_flown_again(lanes: Any) -> None:
    corners = [(20.0, 0.0, 5.0), (20.0, 10.0, 5.0), (0.0, 10.0, 5.0), (0.0, 0.0, 5.0)]
    at = flown(lanes, 400.0, end="repeat", waypoints=corners)
    for corner in corners:
        near = np.hypot(at[:, 0] - corner[0], at[:, 1] - corner[1]) < 1.0
        assert np.count_nonzero(np.diff(near.astype(int)) == 1) >= 2
    assert not at[:, 3].any()


def test_the_path_follows_the_seabed_but_not_below_its_leg(lanes: Any) -> None:
    """The seabed rises by 1 in 20 from 25 m; wanted is 10 m above it, the leg is at 14 m."""
    path = [(-5.0, 2.0, 14.0), (80.0, 2.0, 14.0)]
    at = flown(lanes, 150.0, lambda north: 25.0 - 0.05 * north, altitude=True, waypoints=path)
    deep = at[:, 0] < 10.0
    assert at[deep, 2].max() <= 14.0
    high = at[:, 0] > 40.0
    assert 25.0 - 0.05 * at[high, 0] - at[high, 2] == pytest.approx(10.0, abs=0.1)


def test_an_end_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="end 'land'; expected station, loiter, repeat"):
        declare("path_following", end="land")
