"""The shipped scene of a charted wreck, and the missions that see wrecks by sonar."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.scene.wreck_scene import CENTRE, wreck_scene
from uuvsim_cosim.content import content
from uuvsim_cosim.models.shapes.mesh import raw_triangles
from uuvsim_cosim.models.worlds.scene import load_scene

SCENES = sorted(content("models", "scenes").glob("*/scene.yaml"))


def test_the_scene_is_what_its_script_writes(tmp_path: Path) -> None:
    wreck_scene(tmp_path)
    shipped = content("models", "scenes", "tacoma_wreck")
    assert (tmp_path / "wreck.stl").read_bytes() == (shipped / "wreck.stl").read_bytes()
    written, kept = ((f / "scene.yaml").read_text().splitlines()[1:] for f in (tmp_path, shipped))
    assert written == kept
    for layer in ("z", "sigma", "material"):
        both = [np.load(f / "terrain.npz")[layer] for f in (tmp_path, shipped)]
        assert np.array_equal(*both)


def test_the_wreck_lies_where_the_chart_has_it() -> None:
    chart, scene = load_scene("tacoma"), load_scene("tacoma_wreck")
    charted = [o for o in chart.obstacles if o.name == "WRECKS" and o.centre[:2] == CENTRE]
    assert len(charted) == 1
    bed = charted[0].centre[2] + charted[0].half_height
    (mesh,) = scene.meshes
    assert mesh.position == (*CENTRE, pytest.approx(bed))
    assert "made up" in scene.source


@pytest.mark.parametrize("name", [f.parent.name for f in SCENES])
def test_meshes_of_shipped_scenes_are_read_without_another_package(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    for mesh in load_scene(name).meshes:
        assert len(raw_triangles(mesh.file)) > 0


@pytest.mark.slow
def test_the_waterfall_shows_the_three_charted_wrecks(tmp_path: Path) -> None:
    run = uuv.run("sidescan_survey", until=150.0, out=tmp_path / "run", backend="native")
    signals = run.signals()
    labels = signals["side_scan.label"]
    north = signals["hull.eta"][:, 0]
    wrecks = [o for o in load_scene("tacoma").obstacles if o.name == "WRECKS"]
    for wreck in wrecks:
        beside = np.abs(north - wreck.centre[0]) < 3.0
        assert labels[beside].max() > 1, f"no echo of the wreck at {wreck.centre}"
    assert labels[np.abs(north + 1260.0) < 5.0].max() <= 1


@pytest.mark.slow
def test_the_sonar_sees_the_wreck_before_it_and_its_shadow(tmp_path: Path) -> None:
    run = uuv.run("wreck_inspection", until=30.0, out=tmp_path / "run", backend="native")
    signals = run.signals()
    labels = signals["sonar.label"][-1].reshape(64, 128)
    magnitude = signals["sonar.magnitude"][-1].reshape(64, 128)
    wreck, bed = labels == labels.max(), labels == 1
    assert labels.max() > 1
    assert wreck.sum() > 100
    assert magnitude[wreck].mean() > 5 * magnitude[bed].mean()
    shadow = magnitude[np.nonzero(wreck.any(axis=1))[0], -8:]
    assert np.median(shadow) < np.median(magnitude[bed]) / 5
