from collections.abc import Callable

import numpy as np
import pytest

from uuvsim_cosim.models.shapes.hull_parts import (
    Shell,
    box,
    ellipsoid,
    enclosed_volume,
    fin,
    joined,
    myring,
    myring_profile,
    plate,
    propeller,
    thruster,
    tube,
    turned,
)

PI = np.pi
ONE_OF_EACH: dict[str, Callable[[], Shell]] = {
    "box": lambda: box((1, 2, 3), (1, 2, 3), 0.2, (10, 20, 30)),
    "ellipsoid": lambda: ellipsoid((0, 0, 0), (3, 2, 1)),
    "fin": lambda: fin((0, 1, 0), (0, 0.5, 0), (0.3, 0.2), 0.1),
    "myring": lambda: myring((0.6, 0, 0), 0.2, 0.6, 0.5, 0.2, c_offset=0.04),
    "plate": lambda: plate(
        (0, 0, 0), "y", 0.1, [(0, 0), (3, 0), (3, 2), (1.5, 1.5), (0, 2)],
        [[(0.5, 0.5), (1, 0.5), (1, 1)], [(2, 0.5), (2.5, 0.5), (2.5, 1.2)]],
    ),
    "propeller": lambda: propeller((0, 0, 0), (1, 0, 0), 0.1, 0.02),
    "thruster": lambda: thruster((0, 0, 0), (1, -1, 0), 0.05, 0.08, 0.02),
    "tube": lambda: tube((0, 0, 0), (2, 1, 0), 0.3, (0.3, 0)),
    "turned": lambda: turned([(0, 1), (1, 1), (1, 0.8), (0, 0.8)], ring=True),
}  # fmt: skip


def signed(shell: Shell) -> float:
    t = shell[0][shell[1]]
    return float(np.einsum("ni,ni->", t[:, 0], np.cross(t[:, 1], t[:, 2]))) / 6.0


@pytest.mark.parametrize("kind", ONE_OF_EACH)
def test_a_part_is_closed_and_faces_outwards(kind: str) -> None:
    vertices, faces = ONE_OF_EACH[kind]()
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there, back = ({(int(a), int(b)) for a, b in e} for e in (edges, edges[:, ::-1]))
    assert len(there) == len(edges)  # each directed edge once
    assert there == back  # and once in the other direction
    assert len(np.unique(np.round(vertices, 9), axis=0)) == len(vertices)
    assert signed((vertices, faces)) > 0


@pytest.mark.parametrize(
    ("shell", "volume", "tolerance"),
    [
        (box((5, 0, 0), (1, 2, 3)), 6.0, 1e-12),
        (tube((0, 0, 0), (2, 0, 0), 0.5, around=96), PI * 0.5, 1e-3),
        (tube((0, 0, 0), (2, 0, 0), 0.5, (0.5, 0.5), 96), PI * 0.25 + 4 / 3 * PI * 0.125, 3e-3),
        (ellipsoid((0, 0, 1), (3, 2, 1), 96), 8 * PI, 3e-3),
        (plate((0, 0, 0), "z", 0.1, [(0, 0), (4, 0), (4, 3), (0, 3)],
               [[(1, 1), (2, 1), (2, 2), (1, 2)]]), 1.1, 1e-12),
    ],
)  # fmt: skip
def test_a_part_has_the_volume_of_its_closed_form(
    shell: Shell, volume: float, tolerance: float
) -> None:
    assert signed(shell) == pytest.approx(volume, rel=tolerance)
    assert enclosed_volume(*shell) == pytest.approx(signed(shell), rel=2e-3)


def test_the_hull_of_the_remus_has_the_published_volume() -> None:
    # Prestero (2001), table of REMUS hull parameters: 3.15e-2 m3, length 1.33 m.
    profile = np.array(myring_profile(0.191, 0.654, 0.541, 0.191, 2, 25, 0.0165, 0.0368, 200))
    x, r = profile.T
    assert x[-1] == pytest.approx(1.33, rel=0.003)
    assert np.sum(PI * 0.5 * (r[1:] ** 2 + r[:-1] ** 2) * np.diff(x)) == pytest.approx(
        3.15e-2, rel=0.006
    )


def test_what_overlaps_counts_once() -> None:
    two = joined([box((0, 0, 0), (1, 1, 1)), box((0.5, 0, 0), (1, 1, 1))])
    assert signed(two) == pytest.approx(2.0)
    assert enclosed_volume(*two) == pytest.approx(1.5, rel=0.005)


def test_a_box_is_as_large_as_stated_and_its_edges_are_not_wider_than_it() -> None:
    vertices, _ = box((0, 0, 0), (1, 2, 3), 0.2)
    assert np.ptp(vertices, axis=0) == pytest.approx([1, 2, 3])
    with pytest.raises(ValueError, match=r"edge 0\.6"):
        box((0, 0, 0), (1, 2, 3), 0.6)
