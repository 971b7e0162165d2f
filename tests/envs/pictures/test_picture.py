"""The picture: N up and E right, D down, a scale that does not jump, bad views refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.envs.pictures.canvas import rgb
from uuvsim_cosim.envs.pictures.canvas_coverage import Floats
from uuvsim_cosim.envs.pictures.hull_outline import from_above, from_the_side
from uuvsim_cosim.envs.pictures.picture import Arena, Cylinder, Goal, Picture, Target, Vehicle, View
from uuvsim_cosim.envs.pictures.scale import Extent, label, nice_step, ticks
from uuvsim_cosim.errors import InputInvalid

POOL = Arena(north=(0.0, 2.6), east=(0.0, 4.8), floor=1.1)
BLUE = "#1268b3"


def vehicle(*eta: float, name: str = "auv") -> Vehicle:
    return Vehicle(name, (*eta, *(0.0,) * (6 - len(eta))), 0.22, 0.18, BLUE)


def whole_scene() -> View:
    return View(
        vehicles=[vehicle(1.0, 2.0, 0.5), vehicle(2.0, 1.0, 0.7, name="other")],
        targets=[Target((1.3, 2.4, 0.6), psi=0.5, reach=1.2)],
        obstacles=[Cylinder(0.7, 1.2, 0.15)],
        goals=[Goal((2.0, 4.0, 0.4), psi=1.0), Goal((1.0, 1.0))],
        path=[(0.2, 0.2), (1.0, 2.0), (2.0, 4.0)],
        trails=[[(0.1, 0.1, 0.0), (0.5, 0.4, 0.1)]],
        arena=POOL, current=(0.1, 0.2, 0.0), time=1.5, title="a task", lines=["reward  1.0"],
    )  # fmt: skip


def middle_of(picture: Any, colour: str) -> Floats:
    """Return the mean (x, y) of the pixels of one colour in the plan."""
    rows, columns = np.nonzero((picture == np.array(rgb(colour))).all(axis=2))
    plan = columns < 460
    assert plan.any()
    return np.array([columns[plan].mean(), rows[plan].mean()])


def draw_one(*eta: float) -> Any:
    return Picture().draw(View([vehicle(*eta)], arena=POOL))


def test_a_picture_is_what_render_has_to_give() -> None:
    frame = Picture(640, 480).draw(whole_scene())
    assert frame.shape == (480, 640, 3)
    assert frame.dtype == np.uint8
    assert frame.flags.c_contiguous


def test_the_same_views_give_the_same_bits() -> None:
    one, other = Picture(), Picture()
    for _ in range(3):
        np.testing.assert_array_equal(one.draw(whole_scene()), other.draw(whole_scene()))


def test_a_frame_handed_out_is_not_drawn_on_again() -> None:
    picture = Picture()
    first = picture.draw(whole_scene())
    kept = first.copy()
    picture.draw(View([vehicle(0.2, 0.3, 0.1)], arena=POOL))
    np.testing.assert_array_equal(first, kept)


def test_north_is_up_and_east_is_right() -> None:
    here = middle_of(draw_one(1.0, 2.0, 0.5), BLUE)
    north = middle_of(draw_one(2.0, 2.0, 0.5), BLUE)
    east = middle_of(draw_one(1.0, 3.0, 0.5), BLUE)
    assert north[1] < here[1] - 50
    assert abs(north[0] - here[0]) < 1.5
    assert east[0] > here[0] + 50
    assert abs(east[1] - here[1]) < 1.5


def test_a_metre_north_is_as_long_as_a_metre_east() -> None:
    here = middle_of(draw_one(1.0, 2.0, 0.5), BLUE)
    north = middle_of(draw_one(2.0, 2.0, 0.5), BLUE)
    east = middle_of(draw_one(1.0, 3.0, 0.5), BLUE)
    assert here[1] - north[1] == pytest.approx(east[0] - here[0], abs=2.0)


def test_down_is_down_in_the_depth_strip() -> None:
    def row(depth: float) -> float:
        frame = draw_one(1.0, 2.0, depth)[:, 480:]
        return float(np.nonzero((frame == np.array(rgb(BLUE))).all(axis=2))[0].mean())

    assert row(0.2) < row(0.5) < row(0.9)


def test_the_bow_points_where_the_vehicle_heads() -> None:
    for psi in np.linspace(-np.pi, np.pi, 9):
        bow = from_above(10.0, 4.0, psi)[0]
        np.testing.assert_allclose(bow, [5.0 * np.sin(psi), -5.0 * np.cos(psi)], atol=1e-12)


def test_the_outline_from_above_is_symmetric() -> None:
    outline = from_above(10.0, 4.0, 0.0)
    mirrored = outline * np.array([-1.0, 1.0])
    as_set = {tuple(np.round(p, 9) + 0.0) for p in outline}
    assert as_set == {tuple(np.round(p, 9) + 0.0) for p in mirrored}


def test_a_bow_up_pitch_lifts_the_bow_in_the_strip() -> None:
    assert from_the_side(10.0, 4.0, 0.3)[0, 1] < 0.0


def test_what_stands_still_does_not_move_while_another_vehicle_sails() -> None:
    picture = Picture()
    goal = Goal((0.0, 0.0))
    places = []
    for k in range(60):
        picture.draw(View([vehicle(0.05 * k, 0.04 * k, 1.0)], goals=[goal], time=0.1 * k))
        places.append(picture._plan.at(goal.position))
    jumps = np.hypot(*np.diff(places, axis=0).T)
    assert jumps.max() < 0.06 * 640


def test_an_arena_fixes_the_scale() -> None:
    picture = Picture()
    picture.draw(View([vehicle(0.1, 0.1, 0.1)], arena=POOL))
    scale = picture._plan.scale
    picture.draw(View([vehicle(90.0, 0.1, 0.1)], arena=POOL))
    assert picture._plan.scale == scale


def test_a_vehicle_that_leaves_is_still_seen_without_an_arena() -> None:
    picture = Picture()
    for north in (0.0, 1.0, 500.0, -4000.0):
        picture.draw(View([vehicle(north, 0.0, 5.0)]))
        x, y = picture._plan.at((north, 0.0))
        left, top, right, bottom = picture._plan.box
        assert left <= x <= right
        assert top <= y <= bottom


def test_an_extent_holds_still_for_points_well_inside() -> None:
    extent = Extent(least_span=1.0)
    corners = np.array([(0.0, 0.0), (10.0, 10.0)])
    low, high = (edge.copy() for edge in extent.follow(corners))
    for wobble in (0.2, -0.3, 0.1):
        now = extent.follow(corners + wobble)
        np.testing.assert_array_equal(now[0], low)
        np.testing.assert_array_equal(now[1], high)


def test_an_extent_shrinks_slowly_once_little_of_it_is_used() -> None:
    extent = Extent(least_span=1.0)
    extent.follow(np.array([[0.0], [100.0]]))
    spans = [np.ptp(extent.follow(np.array([[49.0], [51.0]]))) for _ in range(80)]
    assert np.all(np.diff(spans) <= 0.0)
    assert spans[0] > 100.0
    assert spans[-1] < 15.0


def test_time_that_goes_back_is_a_new_episode() -> None:
    picture = Picture()
    for k in range(5):
        picture.draw(View([vehicle(float(k), 0.0, 1.0)], time=float(k)))
    again = picture.draw(View([vehicle(0.0, 0.0, 1.0)], time=0.0))
    np.testing.assert_array_equal(again, Picture().draw(View([vehicle(0.0, 0.0, 1.0)], time=0.0)))


def test_trails_keep_to_their_length() -> None:
    picture = Picture(trail=7)
    for k in range(20):
        picture.draw(View([vehicle(0.1 * k, 1.0, 0.5)], arena=POOL, time=float(k)))
    assert len(picture._trails["auv"]) == 7


def test_a_moved_obstacle_is_drawn_anew() -> None:
    picture = Picture()
    before = picture.draw(View(obstacles=[Cylinder(1.0, 1.0, 0.2)], arena=POOL))
    after = picture.draw(View(obstacles=[Cylinder(1.0, 3.0, 0.2)], arena=POOL))
    fresh = Picture().draw(View(obstacles=[Cylinder(1.0, 3.0, 0.2)], arena=POOL))
    assert not np.array_equal(before, after)
    np.testing.assert_array_equal(after, fresh)


@pytest.mark.parametrize("index", range(6))
def test_a_vehicle_without_a_place_is_said_and_the_others_drawn(index: int) -> None:
    eta = [1.0, 2.0, 0.5, 0.0, 0.0, 0.0]
    eta[index] = np.nan
    lost = replace(vehicle(), name="lost", eta=eta, colour="#e2622a")
    frame = Picture().draw(View([lost, vehicle(1.0, 2.0, 0.5)], arena=POOL))
    middle_of(frame, BLUE)
    assert not (frame[:, :460] == np.array(rgb("#e2622a"))).all(axis=2).any()


def test_an_empty_view_is_an_empty_chart() -> None:
    assert Picture().draw(View()).std() > 0.0


@pytest.mark.parametrize("size", [(240, 160), (320, 240), (1280, 720), (1001, 333)])
def test_every_size_works(size: tuple[int, int]) -> None:
    assert Picture(*size).draw(whole_scene()).shape == (size[1], size[0], 3)


def test_many_lines_of_text_leave_room_for_the_depths() -> None:
    view = replace(whole_scene(), lines=[f"line {i} " + "x" * 80 for i in range(60)])
    frame = Picture().draw(view)[300:, 480:]
    assert (frame == np.array(rgb(BLUE))).all(axis=2).any()


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Picture(100, 480), "at least 240 x 160"),
        (lambda: Picture(trail=-1), "0 or more"),
        (lambda: Vehicle("a", (1.0, 2.0), 1.0, 1.0), "vehicle 'a', eta.*expected 6 numbers"),
        (lambda: Vehicle("a", (0.0,) * 6, 0.0, 1.0), "length: 0.0; expected a length above 0 m"),
        (lambda: Vehicle("a", (0.0,) * 6, 1.0, np.nan), "breadth: nan"),
        (lambda: Vehicle("a", (0.0,) * 6, 1.0, 1.0, "blue"), "#rrggbb"),
        (lambda: Target((1.0, 2.0)), "target 'target', position.*expected 3 numbers"),
        (lambda: Target((1.0, 2.0, 3.0), reach=-1.0), "reach: -1.0"),
        (lambda: Cylinder(0.0, 0.0, -0.1), "cylinder, r"),
        (lambda: Goal((1.0,)), "goal, position.*expected 2 or 3 numbers"),
        (lambda: Arena((2.0, 1.0), (0.0, 1.0)), "north: 2.0 to 1.0; expected lower, then greater"),
        (lambda: Arena((0.0, 1.0), (0.0, 1.0), -3.0), "floor"),
        (lambda: View(path=[1.0, 2.0]), "path: shape"),
        (lambda: View(trails=[np.zeros((2, 4))]), "trail 0: shape"),
        (lambda: View(current=(1.0,)), "current"),
    ],
)
def test_a_view_that_cannot_be_drawn_is_refused(make: Any, sentence: str) -> None:
    with pytest.raises(InputInvalid, match=sentence):
        make()


def test_a_nice_step_is_one_two_or_five() -> None:
    assert [nice_step(s) for s in (0.03, 0.11, 1.0, 1.1, 3.0, 7.0)] == [0.05, 0.2, 1.0, 2, 5, 10]


def test_ticks_are_multiples_between_the_edges() -> None:
    np.testing.assert_allclose(ticks(-0.25, 0.6, 0.2), [-0.2, 0.0, 0.2, 0.4, 0.6])


def test_a_label_has_the_decimals_of_its_step() -> None:
    assert [label(0.30000001, 0.1), label(20.0, 5.0), label(-0.0, 0.5)] == ["0.3", "20", "0.0"]
