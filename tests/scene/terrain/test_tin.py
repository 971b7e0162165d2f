import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from uuvsim_cosim.scene.terrain.points import KnownPoints
from uuvsim_cosim.scene.terrain.tin import Triangulation, scan


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_scan_lines_give_what_scipy_interpolates(seed: int) -> None:
    from scipy.interpolate import LinearNDInterpolator

    rng = np.random.default_rng(seed)
    corners = [[-5, -5], [30, -5], [-5, 30], [30, 30]]  # every node within their hull
    on_nodes = rng.integers(0, 20, (20, 2))
    xy = np.concatenate([rng.uniform(-3, 25, (40, 2)), on_nodes, corners]).astype(float)
    z = rng.normal(size=len(xy))
    triangles = Delaunay(xy)
    depth, _ = scan(xy[:, 0], xy[:, 1], z, triangles.simplices, (18, 22))
    y, x = np.mgrid[:18, :22]
    expected = LinearNDInterpolator(triangles, z)(np.stack([x, y], -1))
    np.testing.assert_allclose(depth, expected, atol=1e-9)


def test_a_plane_is_interpolated_exactly_with_its_slope() -> None:
    x, y = np.meshgrid([-1.0, 4.2, 11.0], [-1.0, 3.3, 9.0])
    xy = np.column_stack([x.ravel(), y.ravel()])
    z = 3 + 0.3 * xy[:, 0] - 0.4 * xy[:, 1]
    depth, slope = scan(xy[:, 0], xy[:, 1], z, Delaunay(xy).simplices, (8, 10))
    row, column = np.mgrid[:8, :10]
    np.testing.assert_allclose(depth, 3 + 0.3 * column - 0.4 * row, atol=1e-12)
    np.testing.assert_allclose(slope, 0.5, rtol=1e-6)


def test_leaving_one_out_is_a_new_triangulation_without_it() -> None:
    from scipy.interpolate import LinearNDInterpolator

    rng = np.random.default_rng(3)
    xy, z = rng.uniform(0, 100, (40, 2)), rng.uniform(0, 40, 40)
    rows, value, _, distance = Triangulation(KnownPoints(xy, z, 20)).left_out()
    assert list(rows) == list(range(20))
    for row in rows:
        others = np.arange(40) != row
        again = LinearNDInterpolator(xy[others], z[others])(xy[row : row + 1])[0]
        np.testing.assert_allclose(value[row], again, atol=1e-9)
        nearest = np.hypot(*(xy[others] - xy[row]).T).min()
        assert np.isnan(value[row]) or np.isclose(distance[row], nearest)
