"""Materials of sonar: the shipped file, tables of strength, and the materials of a scene."""

from math import pi

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.acoustics.backscatter import apl_uw, grain_size
from uuvsim_cosim.models.acoustics.materials import (
    GRAZING,
    material,
    materials,
    scene_materials,
    strength_table,
)
from uuvsim_cosim.models.worlds.obstacles import Box, Sphere
from uuvsim_cosim.models.worlds.scene import Scene, load_scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.chart.codes import NATURES


def test_every_nature_that_a_chart_may_state_is_a_material() -> None:
    assert set(NATURES.values()) <= set(materials())


def test_an_unknown_material_is_refused_with_near_ones() -> None:
    with pytest.raises(InputInvalid, match=r"'snad'.*expected one such as sand"):
        material("snad")
    with pytest.raises(InputInvalid, match="expected one of mud, clay, silt"):
        strength_table(["mud", "xyzzy"], 40e3)


def test_a_row_of_a_sediment_is_the_published_law() -> None:
    table = strength_table(["sand"], 40e3, c=1480.0)
    assert np.array_equal(table.sigma[0], apl_uw(GRAZING, 40e3, grain_size(1.5), 1480.0))
    assert table.assumptions == ()


def test_a_rigid_solid_has_the_greatest_lambert_coefficient() -> None:
    sigma = strength_table(["rigid"], 900e3).sigma[0]
    assert sigma == pytest.approx(np.sin(GRAZING) ** 2 / pi)


def test_steel_reflects_what_its_impedance_says() -> None:
    z, water = 7700.0 * 6100.0, 1000.0 * 1500.0
    sigma = strength_table(["steel"], 900e3).sigma[0]
    assert sigma[90] == pytest.approx(((z - water) / (z + water)) ** 2 / pi)


def test_above_the_range_a_sediment_follows_lambert_and_says_so() -> None:
    table = strength_table(["sand", "steel", "sand"], 900e3)
    ratio = table.sigma[0, 1:] / np.sin(GRAZING[1:]) ** 2
    assert ratio == pytest.approx(ratio[0])
    assert len(table.assumptions) == 1
    assert "sand at 900 kHz: Lambert's law with 10 log10 mu = -16.8 dB" in table.assumptions[0]
    angles = slice(10, 61)
    published = strength_table(["sand"], 100e3).sigma[0, angles]
    level = 10.0 * np.log10(table.sigma[0, angles] / published)
    assert np.mean(level) == pytest.approx(0.0, abs=1e-9)


def test_no_surface_scatters_more_than_it_receives() -> None:
    table = strength_table(materials(), 900e3)
    assert (table.sigma <= np.sin(GRAZING) ** 2 / pi + 1e-12).all()


def test_the_published_law_alone_is_refused_beyond_its_range() -> None:
    with pytest.raises(InputInvalid, match="900000 Hz; expected 10000 to 100000 Hz"):
        strength_table(["sand"], 900e3, law="apl_uw")


def test_wrong_law_and_frequency_are_refused() -> None:
    with pytest.raises(InputInvalid, match=r"law 'urick'.*auto, apl_uw, lambert"):
        strength_table(["sand"], 40e3, law="urick")
    for f in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputInvalid, match="expected above 0"):
            strength_table(["steel"], f)


def test_tacoma_has_the_materials_of_its_chart() -> None:
    scene = load_scene("tacoma")
    assert scene.terrain is not None
    assert scene.terrain.material is not None
    found = scene_materials(scene, seabed="silt", solid="steel")
    assert set(found.names) == {"mud", "sand", "rock", "silt", "steel"}
    for charted in ("mud", "sand", "rock"):
        k = scene.terrain.materials.index(charted)
        where = scene.terrain.material == k
        assert (found.terrain[where] == found.names.index(charted)).all()
    assert (found.solids == found.names.index("steel")).all()
    assert any("11% of the seabed: silt" in a for a in found.assumptions)


def test_a_seabed_of_unknown_nature_needs_a_material() -> None:
    with pytest.raises(InputInvalid) as error:
        scene_materials(load_scene("tacoma"))
    assert [p.read for p in error.value.problems] == [
        "no material is stated for 11% of the seabed",
        "no material is stated for 24 solids and meshes",
    ]
    assert "seabed=NAME, one of mud" in error.value.problems[0].expected


def test_a_solid_keeps_its_own_material() -> None:
    solids = (Box((0, 0, 0), (1, 1, 1), material="concrete"), Sphere((9, 0, 0), 1.0))
    found = scene_materials(Scene("s", None, solids), solid="rock")
    assert [found.names[k] for k in found.solids] == ["concrete", "rock"]
    assert found.terrain.shape == (0, 0)


def test_a_material_that_a_scene_misspells_is_refused_with_its_place() -> None:
    scene = Scene("s", None, (Sphere((0, 0, 0), 1.0, name="mine", material="stel"),))
    with pytest.raises(InputInvalid, match=r"scene s: mine: material 'stel'.*steel"):
        scene_materials(scene)


def test_a_terrain_without_natures_is_one_material() -> None:
    terrain = Terrain(np.full((3, 3), 20.0, np.float32), 10.0, (0.0, 0.0))
    found = scene_materials(Scene("s", terrain), seabed="sand")
    assert found.names == ("sand",)
    assert found.assumptions == ("100% of the seabed: sand (option seabed)",)
