"""Panels of a surface: on the surface, similar to each other, and complete."""

from __future__ import annotations

from itertools import pairwise
from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.shapes.mesh import Mesh, repaired
from uuvsim_cosim.models.shapes.panels import cut_to, mirror_planes, panel_meshes

Array = NDArray[np.float64]


def box(size: tuple[float, float, float]) -> Array:
    """Twelve triangles, outside anticlockwise."""
    c = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [f for a, b, d, e in quads for f in ((a, b, d), (a, d, e))]
    return c[np.array(faces)] * np.array(size) / 2


def cylinder(length: float, diameter: float, n: int = 48) -> Array:
    """Sides of two slivers each and fans of slivers at the ends, as a CAD program writes them."""
    angle = np.linspace(0, 2 * pi, n + 1)
    out = []
    for a, b in pairwise(angle):
        low, high = (
            [np.array([x, np.cos(v) * diameter / 2, np.sin(v) * diameter / 2]) for v in (a, b)]
            for x in (-length / 2, length / 2)
        )
        start, end = np.array([-length / 2, 0, 0]), np.array([length / 2, 0, 0])
        out += [(low[0], high[0], high[1]), (low[0], high[1], low[1])]
        out += [(end, high[0], high[1]), (start, low[1], low[0])]
    return np.array(out)


def turned(triangles: Array) -> Array:
    c, s = np.cos(0.4), np.sin(0.4)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.asarray(triangles @ R.T)


def area(triangles: Array) -> float:
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return float(0.5 * np.linalg.norm(cross, axis=1).sum())


@pytest.mark.parametrize("place", [np.asarray, turned])
def test_panels_of_a_box_have_its_area_and_volume_exactly(place: object) -> None:
    mesh = repaired(place(box((1.0, 0.6, 0.05))), "box")  # type: ignore[operator]
    panels = panel_meshes(mesh)
    assert panels.mirrored == ((0, 1, 2) if place is np.asarray else ())
    for part in panels.meshes:
        assert panels.volume(part) == pytest.approx(0.03, rel=1e-9)
        whole = 2 ** len(panels.mirrored) * area(part)
        assert whole == pytest.approx(2 * (0.6 + 0.05 + 0.03), rel=1e-9)


def test_meshes_are_similar_and_within_their_limit() -> None:
    panels = panel_meshes(repaired(box((1.0, 0.6, 0.4)), "box"))
    first = len(panels.meshes[0]) / panels.cuts[0] ** 2
    for k, part in zip(panels.cuts, panels.meshes, strict=True):
        assert len(part) == first * k**2
        assert panels.count(part) == 8 * len(part)
    assert len(panels.meshes[-1]) <= 4000 / 8**0.5


def test_panels_of_a_cylinder_approach_its_volume_with_the_square_of_their_side() -> None:
    n = 48
    triangles = cylinder(2.0, 1.0, n)
    panels = panel_meshes(repaired(triangles, "cylinder", turn=True))
    exact = 2.0 * 0.25 * n / 2 * np.sin(2 * pi / n)  # of the polygon with n sides
    lost = [1 - panels.volume(part) / exact for part in panels.meshes]
    assert 0.0 < lost[2] < lost[1] < lost[0] < 0.02
    assert lost[0] / lost[2] == pytest.approx((panels.cuts[2] / panels.cuts[0]) ** 2, rel=0.3)
    # No sliver of the file is left: its triangles are 30 times as long as broad.
    sides = np.linalg.norm(np.roll(panels.meshes[0], 1, axis=1) - panels.meshes[0], axis=2)
    assert (sides.max(axis=1) / sides.min(axis=1)).max() < 5.0


def test_mirror_planes_are_those_of_the_solid_and_not_of_its_triangles() -> None:
    assert mirror_planes(Mesh(box((1.0, 0.6, 0.4)))) == (0, 1, 2)  # diagonals are not mirrored
    moved = box((1.0, 0.6, 0.4))
    moved[moved[..., 0] > 0, 1] *= 0.5  # a bow that is half as broad
    assert mirror_planes(Mesh(moved)) == (1, 2)
    moved[moved[..., 2] > 0, 1] += 0.1
    assert mirror_planes(Mesh(moved)) == ()


def test_triangles_are_cut_without_a_loss_of_area() -> None:
    fine = cut_to(box((1.0, 0.6, 0.4)), 0.1)
    assert area(fine) == pytest.approx(2 * (0.6 + 0.4 + 0.24))
    assert np.linalg.norm(np.roll(fine, 1, axis=1) - fine, axis=2).max() <= 0.1


def test_a_surface_with_too_many_edges_is_refused_with_what_to_leave_out() -> None:
    pin = box((0.01, 0.01, 0.05))
    places = [np.array([0.02 * i, 0.02 * j, 0.003 * (i * j % 7)]) for i, j in np.ndindex(14, 14)]
    pins = [pin + place for place in places]
    with pytest.raises(InputInvalid, match=r"comb.stl: its sharp edges need \d+ panels .* bolts"):
        panel_meshes(Mesh(np.concatenate(pins)), "comb.stl")


def test_panels_at_the_tips_of_a_slender_spheroid_are_neither_slivers_nor_folded() -> None:
    half = np.array([2.0, 0.25, 0.25])
    polar, around = np.linspace(0.0, pi, 97), np.linspace(0.0, 2.0 * pi, 193)
    p = np.stack([np.outer(np.cos(polar), np.ones(193)), np.outer(np.sin(polar), np.cos(around)),
                  np.outer(np.sin(polar), np.sin(around))], axis=2) * half  # fmt: skip
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
    upper, lower = np.stack([a, b, d], axis=2)[1:], np.stack([b, c, d], axis=2)[:-1]
    surface = np.concatenate([upper.reshape(-1, 3, 3), lower.reshape(-1, 3, 3)])
    for t in panel_meshes(repaired(surface, "spheroid")).meshes:
        twice = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
        size = np.linalg.norm(twice, axis=1)
        outward = t.mean(axis=1) / half**2
        facing = (twice * outward).sum(axis=1) / (size * np.linalg.norm(outward, axis=1))
        sides = ((t - np.roll(t, 1, axis=1)) ** 2).sum(axis=(1, 2))
        assert facing.min() > 0.9
        assert (2.0 * np.sqrt(3.0) * size / sides).min() > 0.25  # 1: equilateral
