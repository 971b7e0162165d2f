"""A run says where its vehicle was without terrain."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain
from uuvsim_cosim.scene.outside_terrain import left_terrain


@pytest.fixture
def ssd(tmp_path: Path) -> Path:
    z = np.full((11, 11), 20.0, np.float32)
    z[4:6, 4:6] = np.nan
    save_terrain(Terrain(z, 10.0, (0.0, 0.0)), tmp_path / "t.npz")
    file = tmp_path / "system.ssd"
    file.write_text(
        f'<c source="model:dvl?id=a50&amp;scene={tmp_path}/t.npz"/><c s="?scene=flat"/>'
    )
    return file


def track(*places: tuple[float, float, float]) -> np.ndarray:
    return np.array([[*p, 0.0, 0.0, 0.0] for p in places])


@pytest.mark.parametrize(
    ("places", "words"),
    [
        (((5, 5, 3), (5, 9, 3), (5, 8, 3), (5, 7, 3)), ""),
        (((5, 5, 3), (5, 9, 3), (-1, 8, 3), (-2, 7, 3)),
         "left the terrain of .* 0 to 100 m.* 50 % of the time, first at t = 2 s"),
        (((5, 5, 3), (45, 45, 3), (45, 45, 3), (45, 45, 3)), "over a hole .* 75 %.* at t = 1 s"),
        (((5, 5, 3), (5, 9, 3), (5, 8, 3), (5, 7, 23)), "below the seabed .* 25 %.* t = 3 s"),
    ],
)  # fmt: skip
def test_a_hull_beside_its_terrain_over_a_hole_and_below_the_bed_is_said(
    ssd: Path, places: tuple[tuple[float, float, float], ...], words: str
) -> None:
    signals = {"vessel.hull.eta": track(*places), "navigation.eta": track((1e5, 0, 0))}
    said = left_terrain(ssd, np.arange(4.0), signals)
    if not words:
        assert said == []
        return
    (one,) = said
    assert one.startswith("vessel.hull ")
    assert re.search(words, one)


def test_systems_without_a_scene_and_runs_without_a_hull_say_nothing(ssd: Path) -> None:
    assert left_terrain(ssd, np.arange(1.0), {"target.position": track((1e5, 0, 0))}) == []
    ssd.write_text('<c source="model:dvl"/>')
    assert left_terrain(ssd, np.arange(1.0), {"hull.eta": track((1e5, 0, 0))}) == []
