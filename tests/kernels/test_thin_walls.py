"""Hulls that hit thin walls: whatever size, mass, speed and step, they end where they came from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.kernels.throws import forces, places, throw
from uuvsim_cosim.models.declaration.kinematics import R, q_of_euler
from uuvsim_cosim.models.hull.contact import KAPPA
from uuvsim_cosim.models.hull.contact_reference import HEAD, HOLD, PLACE, Hull, free_place, pressed
from uuvsim_cosim.models.worlds.ground import ground_of
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.scene import Scene

DEPTH = 20.0


@dataclass(frozen=True)
class Body:
    """A hull and its diagonal mass."""

    hull: Hull
    M: np.ndarray

    @property
    def gyration(self) -> float:
        """The least radius of gyration [m]."""
        return float(np.sqrt(self.M[3:].min() / self.M[:3].max()))


@st.composite
def bodies(draw: Any, *, sided: bool = False) -> Body:
    """Boxes, capsules and balls of 5 cm to 3 m; `sided`: with other added masses for each axis."""
    length = 0.05 * 60 ** draw(st.floats(0, 1))
    breadth, height = (length * draw(st.floats(0.2, 1)) for _ in range(2))
    shape = draw(st.sampled_from(["box", "capsule", "ball"]))
    if shape == "box":
        hull = Hull((0, 0, 0), (length / 2, breadth / 2, height / 2), 3, 0.0)
    elif shape == "capsule":
        hull = Hull((0, 0, 0), (length / 2, 0, 0), 1, breadth / 4)
    else:
        hull = Hull((0, 0, 0), (0, 0, 0), 0, length / 2)
    m = draw(st.floats(300, 3000)) * length * breadth * height
    added = [draw(st.floats(1, 2.2)) for _ in range(3)] if sided else [draw(st.floats(1, 2.2))] * 3
    squares = np.array([length, breadth, height]) ** 2
    turned = m / 12 * (squares.sum() - squares) * draw(st.floats(1, 2))
    return Body(hull, np.array([*(m * np.array(added)), *turned]))


@dataclass(frozen=True)
class Flight:
    """A throw from before a wall whose near side is N = 0."""

    wall: float  # m, its thickness
    h: float
    speed: float
    way: tuple[float, float]  # rad: from N towards E, and downwards
    attitude: tuple[float, float, float]
    gap: float  # steps at that speed before the wall
    late: int
    mu: float


flights = st.builds(
    Flight,
    wall=st.floats(0.05, 0.5),
    h=st.floats(0, 1).map(lambda x: 1e-3 * 100**x),
    speed=st.floats(0.5, 5),
    way=st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2)),
    attitude=st.tuples(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3)),
    gap=st.floats(0, 15),
    late=st.integers(0, 2),
    mu=st.sampled_from([0.0, 0.3]),
)


def wall_of(thickness: float) -> Scene:
    return Scene("a wall", None, (Box((thickness / 2, 0, DEPTH), (thickness / 2, 200, 200)),))


def thrown(body: Body, f: Flight, **push: Any) -> Any:
    q = np.array(ca.DM(q_of_euler(*f.attitude))).ravel()
    Rnb = np.array(ca.DM(R(ca.DM(q))))
    half = np.array(body.hull.half) * (np.arange(3) < body.hull.n)
    reach = float(np.abs(Rnb[0]) @ half) + body.hull.radius
    psi, down = f.way
    v = f.speed * np.array([np.cos(psi) * np.cos(down), np.sin(psi) * np.cos(down), np.sin(down)])
    place = [-reach - 1e-3 - f.gap * f.speed * f.h, 0, DEPTH]
    steps = int(min(3000, 60 + 2 * (f.gap * f.speed * f.h + 0.5) / v[0] / f.h))
    return throw(
        wall_of(f.wall), body.hull, body.M, f.h, place, q, [*(Rnb.T @ v), 0, 0, 0],
        steps=steps + push.get("pushed", 0), mu=f.mu, late=f.late, **push,
    )  # fmt: skip


@settings(max_examples=400, deadline=None, derandomize=True)
@given(body=bodies(), f=flights)
def test_a_hull_ends_on_its_side_of_a_wall_with_no_more_energy(body: Body, f: Flight) -> None:
    """Up to two radii of gyration a step; without a Munk moment, whose turns no force foresees."""
    assume(f.speed * f.h < 2.0 * body.gyration)
    end = thrown(body, f)
    assert end.place[0] < 0.0
    assert end.energy <= end.first * (1 + 1e-5)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(body=bodies(sided=True), f=flights)
def test_so_does_one_whose_mass_has_sides_and_that_turns_slowly(body: Body, f: Flight) -> None:
    """It turns while the wall presses it: rare throws gain energy, and none with half the step."""
    munk = f.speed * np.sqrt(np.ptp(body.M[:3]) / body.M[3:].min())  # rad/s
    assume(munk * f.h < 0.2 and f.speed * f.h < 2.0 * body.gyration)
    end = thrown(body, f)
    assert end.place[0] < 0.0
    assert end.energy <= end.first * 1.05
    if end.energy > end.first * (1 + 1e-5):
        end = thrown(body, replace(f, h=f.h / 2))
        assert end.energy <= end.first * (1 + 1e-5)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(body=bodies(), f=flights, push=st.floats(0, 10))
def test_a_hull_that_a_thrust_pressed_into_a_wall_comes_back(
    body: Body, f: Flight, push: float
) -> None:
    """It sinks in by a h² / kappa, through a thin wall where that is more, and is not lost."""
    f = replace(f, way=(0.0, 0.0), speed=0.5, gap=1.0)
    assume(f.speed * f.h < body.gyration)
    end = thrown(body, f, push=(push, 0, 0), pushed=300)
    assert end.deep < 1.5 * push * f.h**2 / KAPPA + 4 * f.speed * f.h + 0.01
    assert end.deep < HOLD * f.h
    assert end.place[0] < 0.0


def test_a_wall_that_a_hull_has_left_on_its_way_around_does_not_pull_it_back() -> None:
    """Along a short wall without friction, past its end, and away: nothing touches any more."""
    scene = Scene("a short wall", None, (Box((0.05, 0, DEPTH), (0.05, 1, 5)),))
    hull, h = Hull((0, 0, 0), (0.2, 0.1, 0.1), 3, 0.0), 0.02
    M = [8.0, 8, 8, 0.1, 0.2, 0.2]
    end = throw(scene, hull, M, h, [-0.25, 0, DEPTH], [1, 0, 0, 0], [0.3, 1, 0, 0, 0, 0],
                steps=400, mu=0.0)  # fmt: skip
    assert end.place[1] > 5.0
    again = throw(scene, hull, M, h, [-0.25, 1.11, DEPTH], [1, 0, 0, 0], [1, 0, 0, 0, 0, 0],
                  steps=200, mu=0.0)  # fmt: skip
    np.testing.assert_allclose(again.nu, [1, 0, 0, 0, 0, 0], atol=1e-12)
    assert again.place[0] == pytest.approx(-0.25 + 4.0)


def crowd(n: int, seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    made: list[Obstacle] = []
    for i in range(n):
        c = (*rng.uniform(-6, 6, 2).tolist(), float(DEPTH + rng.uniform(-1, 1)))
        north, east, down = c
        size = rng.uniform(0.02, 0.6, 3).tolist()
        made.append(
            [
                Box(c, (size[0], size[1], size[2]), float(rng.uniform(-3, 3))),
                Sphere(c, size[0]),
                Cylinder(c, size[0], size[1]),
                Capsule(c, (north + size[0], east, down + size[1]), 0.1 * size[2]),
            ][i % 4]
        )
    return Scene("a crowd", None, tuple(made))


def poses(n: int, seed: int, h: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Arguments of the force (n, HEAD) and of the place (n, PLACE), most with a memory."""
    rng = np.random.default_rng(seed)
    x, seen = np.zeros((n, HEAD)), np.zeros((n, PLACE))
    for k in range(n):
        x[k, :3] = [*rng.uniform(-6, 6, 2), DEPTH + rng.uniform(-1, 1)]
        x[k, 3:12] = np.array(ca.DM(R(q_of_euler(*rng.uniform(-1.5, 1.5, 3))))).ravel()
        x[k, 12:18] = rng.normal(size=6)
        x[k, 18:27] = [20, 25, 30, 1, 1.5, 2, h, KAPPA, 0.3]
        x[k, 27:31] = [*(x[k, :3] + rng.normal(size=3) * 0.3), rng.random() < 0.8]
    seen[:, :12], seen[:, 12], seen[:, 13:] = x[:, :12], h, x[:, 27:31]
    return x, seen


HULLS = (
    Hull((0.05, 0, 0.02), (0.25, 0.15, 0.1), 3, 0.0),
    Hull((0, 0, 0), (0.4, 0, 0), 1, 0.08),
    Hull((0, 0, 0), (0, 0, 0), 0, 0.2),
)


@pytest.mark.parametrize("n", [3, 60, 500])
def test_the_tree_finds_what_every_solid_by_itself_finds_to_the_bit(n: int) -> None:
    scene, (x, seen) = crowd(n, n), poses(400, n)
    for hull in HULLS:
        given = forces(scene, hull, x)
        np.testing.assert_array_equal(given, forces(scene, hull, x, every=True))
        np.testing.assert_array_equal(
            places(scene, hull, seen), places(scene, hull, seen, every=True)
        )
        assert (given[:, 6] > 0).any()


def test_force_and_place_agree_with_the_reference_in_numpy() -> None:
    scene, (x, seen) = crowd(30, 1), poses(60, 2)
    ground = ground_of(scene)
    rub = np.ones(len(ground.solids))
    for hull in HULLS:
        y, at = forces(scene, hull, x), places(scene, hull, seen)
        for k in range(len(x)):
            wanted = pressed(ground, hull, lambda n, e: 1.0, rub, x[k])
            np.testing.assert_allclose(y[k], wanted, rtol=1e-6, atol=1e-5)
            np.testing.assert_allclose(at[k], free_place(ground, hull, seen[k]), atol=1e-7)
