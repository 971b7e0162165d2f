"""The canvas: areas of shapes in closed form, clipping, alpha, text."""

from __future__ import annotations

import string
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.envs.pictures.canvas import Canvas, rgb
from uuvsim_cosim.envs.pictures.canvas_coverage import Floats, polygon_coverage
from uuvsim_cosim.envs.pictures.canvas_font import GLYPHS, cap_height, text_mask, text_width
from uuvsim_cosim.errors import InputInvalid

BLACK, WHITE = "#000000", "#ffffff"
BOX = (0, 0, 40, 30)


def ink(canvas: Canvas) -> Floats:
    """Return how much black there is on a white canvas, a share for each pixel."""
    return 1.0 - canvas.pixels()[:, :, 0] / 255.0


def shoelace(points: Floats) -> float:
    x, y = points.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


@pytest.mark.parametrize("seed", range(5))
def test_a_polygon_covers_exactly_its_area(seed: int) -> None:
    draw = np.random.default_rng(seed)
    angle = np.sort(draw.uniform(0.0, 2.0 * np.pi, 9))  # a star around its middle: any, not convex
    radius = draw.uniform(3.0, 13.0, 9)[:, None]
    points = np.array([20.0, 15.0]) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    assert polygon_coverage(points, BOX)[1].sum() == pytest.approx(shoelace(points), abs=0.05)


def test_a_triangle_covers_its_area_to_rounding() -> None:
    points = np.array([(3.2, 4.7), (31.9, 8.3), (12.1, 27.4)])
    assert polygon_coverage(points, BOX)[1].sum() == pytest.approx(shoelace(points), abs=1e-9)


def test_a_polygons_direction_does_not_matter() -> None:
    points = np.array([(3.2, 4.7), (31.9, 8.3), (12.1, 27.4)])
    one, other = polygon_coverage(points, BOX)[1], polygon_coverage(points[::-1], BOX)[1]
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_a_polygon_cut_by_the_border_is_the_part_of_the_whole_one() -> None:
    points = np.array([(-8.0, -5.0), (50.0, 12.0), (10.0, 45.0)])
    box, cut = polygon_coverage(points, BOX)
    wide, whole = polygon_coverage(points, (-60, -60, 100, 100))
    left, top = box[0] - wide[0], box[1] - wide[1]
    same = whole[top : top + cut.shape[0], left : left + cut.shape[1]]
    np.testing.assert_allclose(cut, same, atol=1e-12)


@pytest.mark.parametrize("radius", [2.0, 5.5, 9.3])
def test_a_disc_covers_its_area(radius: float) -> None:
    canvas = Canvas(40, 30, WHITE)
    canvas.disc((19.7, 15.2), radius, BLACK)
    assert ink(canvas).sum() == pytest.approx(np.pi * radius**2, rel=0.02)


def test_a_line_covers_its_capsule() -> None:
    canvas = Canvas(200, 150, WHITE)
    canvas.line([(20.0, 20.0), (170.0, 110.0)], BLACK, 4.0)
    area = 4.0 * np.hypot(150.0, 90.0) + np.pi * 2.0**2
    assert ink(canvas).sum() == pytest.approx(area, rel=0.01)


def test_a_line_does_not_depend_on_where_its_points_stand() -> None:
    one, many = Canvas(200, 150, WHITE), Canvas(200, 150, WHITE)
    ends = np.array([(20.0, 20.0), (170.0, 110.0)])
    share = np.linspace(0.0, 1.0, 57)[:, None]
    one.line(ends, BLACK, 3.0)
    many.line(ends[0] + share * (ends[1] - ends[0]), BLACK, 3.0)
    assert np.abs(ink(one) - ink(many)).max() <= 1.0 / 255.0


def test_a_seen_through_line_is_not_darker_where_its_parts_meet() -> None:
    canvas = Canvas(60, 60, WHITE)
    canvas.line([(10, 10), (50, 50), (10, 50), (50, 10)], BLACK, 6.0, 0.5)
    assert ink(canvas).max() == pytest.approx(0.5, abs=1.0 / 255.0)


def test_a_line_from_far_away_is_what_its_near_part_is() -> None:
    far, near = Canvas(60, 60, WHITE), Canvas(60, 60, WHITE)
    far.line([(-1e7, 30.0), (1e7, 30.0)], BLACK, 2.0)
    near.line([(-10.0, 30.0), (70.0, 30.0)], BLACK, 2.0)
    assert np.abs(ink(far) - ink(near)).max() <= 1.0 / 255.0


def test_a_line_is_broken_where_a_point_is_not_finite() -> None:
    canvas = Canvas(60, 20, WHITE)
    canvas.line([(5, 10), (20, 10), (np.nan, 10), (40, 10), (55, 10)], BLACK, 2.0)
    darkness = ink(canvas)[10]
    assert darkness[10] > 0.9
    assert darkness[50] > 0.9
    assert darkness[25:36].max() == 0.0


def test_dashes_cover_their_share() -> None:
    dashed, whole = Canvas(600, 20, WHITE), Canvas(600, 20, WHITE)
    dashed.line([(0, 10), (600, 10)], BLACK, 1.0, dash=(9, 11))
    whole.line([(0, 10), (600, 10)], BLACK, 1.0)
    assert ink(dashed).sum() / ink(whole).sum() == pytest.approx(10.0 / 20.0, abs=0.02)  # + ends


def test_a_trail_fades() -> None:
    canvas = Canvas(110, 20, WHITE)
    canvas.line([(5, 10), (35, 10), (65, 10), (95, 10)], BLACK, 4.0, np.array([0.2, 0.5, 1.0]))
    darkness = ink(canvas)[10]
    np.testing.assert_allclose(darkness[[20, 50, 80]], [0.2, 0.5, 1.0], atol=0.01)


def test_alpha_mixes_colours_in_proportion() -> None:
    canvas = Canvas(4, 4, "#ff0000")
    canvas.rectangle(0, 0, 4, 4, "#0000ff", 0.25)
    assert canvas.pixels()[1, 1].tolist() == [191, 0, 64]


def test_nothing_is_drawn_outside_of_what_is_clipped() -> None:
    canvas = Canvas(60, 40, WHITE)
    with canvas.clipped(10, 10, 30, 25):
        canvas.disc((30, 20), 25, BLACK)
        canvas.line([(0, 0), (60, 40)], BLACK, 5)
        canvas.text((5, 12), "across the border", BLACK, 14)
        canvas.rectangle(-5, -5, 100, 100, BLACK, 0.5)
        canvas.arrow((12, 12), (59, 20), BLACK, 3)
    darkness = ink(canvas)
    assert darkness[10:25, 10:30].min() > 0.0
    darkness[10:25, 10:30] = 0.0
    assert darkness.max() == 0.0


def test_an_arrow_ends_at_its_tip() -> None:
    canvas = Canvas(60, 40, WHITE)
    canvas.arrow((5, 20), (50, 20), BLACK, 2)
    dark = np.nonzero(ink(canvas) > 0.02)
    assert dark[1].max() in (48, 49)
    assert np.ptp(dark[0]) >= 3


@pytest.mark.parametrize("shape", ["disc", "polygon", "line", "arrow", "circle"])
def test_what_is_not_finite_leaves_no_mark(shape: str) -> None:
    canvas = Canvas(20, 20, WHITE)
    nan = (np.nan, 3.0)
    arguments: dict[str, tuple[Any, ...]] = {
        "disc": (nan, 3.0), "polygon": ([nan, (1, 2), (9, 9)],), "line": ([nan, (9, 9)],),
        "arrow": (nan, (9, 9)), "circle": (nan, 4.0),
    }  # fmt: skip
    getattr(canvas, shape)(*arguments[shape], BLACK)
    assert ink(canvas).max() == 0.0


def test_every_printable_ascii_character_has_a_glyph() -> None:
    printable = set(string.printable) - set(string.whitespace)
    assert printable <= set(GLYPHS)


@pytest.mark.parametrize("size", [10.0, 12.0, 20.0])
def test_no_two_characters_look_alike(size: float) -> None:
    wide = [np.pad(text_mask(c, size), ((0, 0), (0, 40)))[:, :40] for c in GLYPHS]
    pairs = [
        (a, b)
        for i, a in enumerate(GLYPHS)
        for j, b in enumerate(GLYPHS)
        if i < j and np.abs(wide[i] - wide[j]).sum() < 0.5
    ]
    assert pairs == [("O", "0")]  # the letter and the figure are one shape


def test_text_at_ten_pixels_is_crisp() -> None:
    upright = text_mask("EFHILT", 10.0)
    assert set(np.unique(upright)) == {0.0, 1.0}


def test_text_stands_where_it_is_anchored() -> None:
    canvas = Canvas(100, 40, WHITE)
    canvas.text((90, 30), "HEH", BLACK, 10.0, anchor=(1.0, 1.0))
    rows, columns = np.nonzero(ink(canvas))
    assert (columns.max() + 1, rows.max() + 1) == (90, 30)
    assert columns.min() == 90 - text_width("HEH", 10.0)
    assert rows.min() == 30 - cap_height(10.0)


def test_figures_are_all_equally_wide() -> None:
    assert len({text_width(d, 11.0) for d in string.digits}) == 1


def test_a_character_without_a_glyph_is_a_crossed_box() -> None:
    np.testing.assert_array_equal(text_mask("\u4e2d", 10.0), text_mask("\u6587", 10.0))


def test_an_empty_text_is_nothing() -> None:
    canvas = Canvas(20, 20, WHITE)
    canvas.text((5, 5), "", BLACK)
    assert ink(canvas).max() == 0.0


@pytest.mark.parametrize("colour", ["red", "#12345", "#12345g", 3, None])
def test_a_colour_of_another_form_is_refused(colour: Any) -> None:
    with pytest.raises(InputInvalid, match="#rrggbb"):
        rgb(colour)


def test_a_canvas_without_pixels_is_refused() -> None:
    with pytest.raises(InputInvalid, match="at least 1 x 1"):
        Canvas(0, 10)
