"""Speckle of the simulated side-scan sonar against that of a recorded one.

The recorded figures are those of the file test/data/wrecks/scotsman-iver2.xtf of OpenSidescan
(CIDCO, MIT licence): a Marine Sonic HDS of 600 kHz on an Iver2, 461 pings of 1,024 samples to
30 m a side, over a sandy bottom, with a wreck that is left out. The file is not part of the
project. `speckle(read_xtf(file).magnitude[rows, side, bins])` gives them again.
"""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.acoustics.absorption import francois_garrison
from uuvsim_cosim.models.acoustics.materials import strength_table
from uuvsim_cosim.models.worlds.sonar_geometry import sonar_geometry
from uuvsim_cosim.models.worlds.sonar_image import Surfaces
from uuvsim_cosim.scene.shared.sonar import Sonar
from uuvsim_cosim.view.sonar.speckle import Speckle, speckle

# (side, pings, bins): variation, contrast, exceedance. 1 is starboard.
RECORDED = {
    (1, (0, 150), (700, 1000)): Speckle(0.353, 0.759, 0.0222),
    (1, (0, 100), (850, 1020)): Speckle(0.352, 0.746, 0.0190),
    (0, (0, 150), (500, 900)): Speckle(0.353, 0.754, 0.0286),
    (0, (0, 120), (800, 1000)): Speckle(0.339, 0.727, 0.0260),
}


@pytest.fixture(scope="module")
def starboard() -> np.ndarray:
    """Return pings (200, 2048) over level sand, 6 m below, to 30 m, in cells of 1.5 cm."""
    geometry = sonar_geometry(
        beams=1, swath=0.0, beam_width=np.radians(0.5), shading="none", elevation=np.radians(50.0),
        bins=2048, range_min=0.3, range_max=30.0, resolution=0.0146, rays=512,
    )  # fmt: skip
    sigma = np.round(strength_table(["sand"], 600e3).sigma, 12)
    surfaces = Surfaces(sigma, np.zeros((0, 0), np.uint8), np.zeros(0, np.uint8))
    alpha = float(francois_garrison(600e3, 10.0, 33.0, 10.0))
    sonar = Sonar(
        "flat", geometry, surfaces, frequency=600e3, source_level=210.0, noise_level=60.0,
        absorption=alpha, tvg=30,
    )  # fmt: skip
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    looks = np.array([[0.0, -1.0, 0.0], [c, 0.0, -s], [s, 0.0, c]])  # of x, y, z: columns
    places = np.stack([0.11 * np.arange(200), np.zeros(200), np.full(200, 19.0)], axis=1)
    return sonar.images(places, looks).magnitude[:, 0]


def test_cells_have_the_speckle_of_rayleigh(starboard: np.ndarray) -> None:
    found = speckle(starboard[:, 1400:2000])
    assert found.variation == pytest.approx(np.sqrt(4.0 / np.pi - 1.0), abs=0.01)
    assert found.contrast == pytest.approx(1.0, abs=0.03)
    assert found.exceedance == pytest.approx(np.exp(-3.0), abs=0.003)


@pytest.mark.parametrize("patch", RECORDED)
def test_means_of_two_cells_have_the_speckle_of_the_recorded_sonar(
    starboard: np.ndarray, patch: tuple[int, tuple[int, int], tuple[int, int]]
) -> None:
    found = speckle(starboard.reshape(200, 1024, 2).mean(axis=2)[:, 700:1000])
    recorded = RECORDED[patch]
    assert found.variation == pytest.approx(recorded.variation, rel=0.10)
    assert found.contrast == pytest.approx(recorded.contrast, rel=0.05)
    assert found.exceedance == pytest.approx(recorded.exceedance, abs=0.01)


def test_a_level_that_falls_with_range_does_not_count_as_speckle() -> None:
    rng = np.random.default_rng(3)
    a = np.sqrt(rng.exponential(size=(300, 300))) * np.geomspace(1.0, 0.01, 300)
    assert speckle(a).variation == pytest.approx(0.523, abs=0.01)


def test_a_patch_that_has_no_statistics_is_refused() -> None:
    with pytest.raises(InputInvalid, match=r"a patch \(20, 300\); expected at least \(61, 61\)"):
        speckle(np.ones((20, 300)))
    with pytest.raises(InputInvalid, match="without echo"):
        speckle(np.zeros((100, 100)))
