"""Warnings of a run about contact, and about hulls outside of the terrain."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.models.worlds.obstacles import Cylinder, Sphere
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.scene.run_warnings import contact_warnings, sonar_warnings, terrain_warnings


@pytest.fixture
def ssd(tmp_path: Path) -> Path:
    solids = (Sphere((9, 9, 9), 1.0), Cylinder((0, 0, 10), 0.5, 5, name="pile"))
    save_scene(Scene("piles", None, solids, None, "two piles", "made up"), tmp_path / "piles")
    file = tmp_path / "system.ssd"
    source = f"model:contact?vehicle=sphere&amp;scene={tmp_path / 'piles'}&amp;step=0.02"
    file.write_text(f'<c source="{source}"/>', encoding="utf-8")
    return file


def signals(depth: float, touched: int) -> dict[str, np.ndarray]:
    return {
        "contact.depth": np.array([depth, 0.0]),
        "contact.touched": np.array([touched, -1]),
        "sonar.depth": np.array([3.0, 3.0]),
    }


def test_a_start_inside_an_obstacle_is_named_with_its_depth(ssd: Path) -> None:
    (said,) = contact_warnings(ssd, 0.02, signals(0.31, 2))
    assert "the hull of contact starts 0.31 m deep in obstacle 2 of the scene (pile)" in said
    (said,) = contact_warnings(ssd, 0.02, signals(0.31, 1))
    assert "obstacle 1 of the scene:" in said
    (said,) = contact_warnings(ssd, 0.02, signals(0.31, 3))
    assert "another vehicle" in said
    (said,) = contact_warnings(ssd, 0.02, signals(0.31, 0))
    assert "in the seabed" in said


def test_a_start_in_the_water_is_not_reported(ssd: Path) -> None:
    assert contact_warnings(ssd, 0.02, signals(0.0, -1)) == []
    assert contact_warnings(ssd, 0.02, signals(0.001, 0)) == []


def test_a_hull_that_is_pressed_deep_into_a_pile_is_named_with_the_right_step(ssd: Path) -> None:
    came = {"contact.depth": np.array([0.0, 0.8]), "contact.touched": np.array([-1, 2])}
    (said,) = contact_warnings(ssd, 0.02, came)  # the radius of `sphere` is 0.2 m
    assert "comes 0.8 m deep into obstacle 2 of the scene (pile)" in said
    assert "a step of at most 0.01 s instead of 0.02 s" in said
    came["contact.depth"][1] = 0.15
    assert contact_warnings(ssd, 0.02, came) == []


def test_a_system_with_longer_steps_than_stated_is_reported(ssd: Path) -> None:
    (said,) = contact_warnings(ssd, 0.05, signals(0.0, -1))
    assert "steps of at most 0.02 s, and the system's is 0.05 s" in said
    assert "step=0.05" in said


def test_a_run_records_what_is_reported(ssd: Path, tmp_path: Path) -> None:
    from uuvsim_cosim.view.recorded.traces import traces_of

    scene = tmp_path / "piles"
    s = System("in", "0.02").add("hull", "model:sphere", {"eta_0": (0.2, 0, 10, 0, 0, 0)})
    s = s.add("contact", f"model:contact?vehicle=sphere&scene={scene}&step=0.01")
    for name in ("eta", "q", "nu"):
        s = s.connect(f"hull.{name}", f"contact.{name}")
    made = run(s.connect("contact.tau", "hull.tau"), until=0.1, out=tmp_path / "run")
    said = contact_warnings(made.folder / "system.ssd", made.tick, traces_of(made.folder).values)
    assert len(said) == 2
    assert "at most 0.01 s" in said[0]
    assert "0.5 m deep in obstacle 2 of the scene (pile)" in said[1]


@pytest.fixture
def ssd_of_terrain(tmp_path: Path) -> Path:
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
    ssd_of_terrain: Path, places: tuple[tuple[float, float, float], ...], words: str
) -> None:
    signals = {"vessel.hull.eta": track(*places), "navigation.eta": track((1e5, 0, 0))}
    said = terrain_warnings(ssd_of_terrain, np.arange(4.0), signals)
    if not words:
        assert said == []
        return
    (one,) = said
    assert one.startswith("vessel.hull ")
    assert re.search(words, one)


def test_systems_without_a_scene_and_runs_without_a_hull_say_nothing(ssd_of_terrain: Path) -> None:
    assert (
        terrain_warnings(ssd_of_terrain, np.arange(1.0), {"target.position": track((1e5, 0, 0))})
        == []
    )
    ssd_of_terrain.write_text('<c source="model:dvl"/>')
    assert terrain_warnings(ssd_of_terrain, np.arange(1.0), {"hull.eta": track((1e5, 0, 0))}) == []


def test_a_sonar_above_the_water_or_in_an_obstacle_is_said(ssd: Path, tmp_path: Path) -> None:
    piles = tmp_path / "piles"
    file = tmp_path / "sonar.ssd"
    file.write_text(f'<c source="model:imaging_sonar@p900?beams=9&amp;scene={piles}"/>')
    places = track((50, 50, 3), (50, 50, -1), (0, 0, 10), (0, 0, 10))
    first, second = sonar_warnings(file, np.arange(4.0), {"a.hull.eta": places})
    assert first == (
        "a.hull was above the water for 25 % of the time, first at t = 1 s: "
        "sonars show noise alone there"
    )
    assert "in an obstacle of scene" in second
    assert "50 % of the time, first at t = 2 s" in second
    file.write_text('<c source="model:dvl"/>')
    assert sonar_warnings(file, np.arange(4.0), {"a.hull.eta": places}) == []
