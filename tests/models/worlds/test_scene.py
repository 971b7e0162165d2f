from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Sphere
from uuvsim_cosim.models.worlds.scene import Scene, find_scene, load_scene, save_scene, scene_ids
from uuvsim_cosim.models.worlds.terrain import Terrain

OBSTACLES = (
    Box((1.0, 2.0, 3.0), (1e-7, 1e12, 1.0), 0.2, 'x: # {"é'),
    Sphere((1.0, 2.0, 3.25), 2.0),
    Capsule((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.2, "a pipe"),
    Cylinder((0.0, 0.0, -1.5), 1.0, 2.0),
)


def test_a_scene_is_read_as_it_was_written(tmp_path: Path) -> None:
    terrain = Terrain(np.array([[1, np.nan], [3, 4]], np.float32), 2.0, (-2.0, 0.0), source="s")
    save_scene(Scene("reef", terrain, OBSTACLES, None, "a reef", "drawn"), tmp_path / "reef")
    read = load_scene(tmp_path / "reef")
    assert (read.name, read.obstacles, read.description, read.source) == (
        "reef", OBSTACLES, "a reef", "drawn")  # fmt: skip
    assert read.terrain is not None
    np.testing.assert_array_equal(read.terrain.z, terrain.z)
    assert read.folder == tmp_path / "reef"


def test_a_scene_can_be_named_by_its_file(tmp_path: Path) -> None:
    save_scene(Scene("pool", None), tmp_path)
    assert find_scene(tmp_path / "scene.yaml") == tmp_path
    assert load_scene(str(tmp_path)).obstacles == ()


def test_all_mistakes_of_a_scene_are_said_at_once(tmp_path: Path) -> None:
    (tmp_path / "terrain.npz").write_text("nothing")
    (tmp_path / "scene.yaml").write_text(
        "id: a\nsource: xyz\nwind: 1\nobstacles:\n  - bax: {centre: [1, 2, 3]}\n"
        "  - sphere: {centre: [1, 2, .nan], radius: -1}\n  - {}\n"
    )
    with pytest.raises(InputInvalid) as refused:
        load_scene(tmp_path)
    said = str(refused.value)
    for part in ("'description' is a required", "'units' is a required", "wind: unknown",
                 "'bax'; expected one such as box", "scene.yaml:6: obstacles.1.sphere.centre",
                 "finite numbers", "-1 is less than", "obstacles.2",
                 "terrain.npz: not a terrain"):  # fmt: skip
        assert part in said
    assert "pickle" not in said


def test_a_scene_that_is_not_there_is_answered_with_near_names() -> None:
    with pytest.raises(
        InputInvalid,
        match=r"no scene 'tacomma'; expected one such as tacoma, tacoma_wreck, or the path",
    ):
        load_scene("tacomma")


@pytest.mark.parametrize("scene", scene_ids())
def test_a_shipped_scene_is_small_and_whole(scene: str) -> None:
    read = load_scene(scene)
    files = list(find_scene(scene).iterdir())
    assert {"scene.yaml", "README.md"} <= {f.name for f in files}
    assert sum(f.stat().st_size for f in files) < 300_000
    assert read.name == scene
    assert read.terrain is not None
    assert np.isfinite(read.terrain.z).any()


def test_the_canyon_is_its_closed_form() -> None:
    terrain = load_scene("canyon").terrain
    assert terrain is not None
    axis = -500 + 5.0 * np.arange(201)
    N, E = np.meshgrid(axis, axis, indexing="ij")
    mound = 10 * np.exp(-((N - 200) ** 2 + (E + 200) ** 2) / 7200)
    z = 30 + np.clip(40 - np.abs(E), 0, 30) - mound
    np.testing.assert_allclose(terrain.z, z, atol=1e-5)
    assert terrain.extent == (-500.0, 500.0, -500.0, 500.0)


def test_tacoma_names_noaa_and_says_not_for_navigation() -> None:
    source = load_scene("tacoma").source
    assert "NOAA ENC US5WA22M" in source
    assert "not for navigation" in source
