import struct
import zlib
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.scene.s57_cell import slope
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Sphere
from uuvsim_cosim.models.worlds.placed_mesh import placed_mesh
from uuvsim_cosim.models.worlds.scene import Scene, load_scene
from uuvsim_cosim.models.worlds.terrain import Terrain, load_terrain
from uuvsim_cosim.scene.terrain.write import check_whole, surface, write_terrain


@pytest.fixture
def scene() -> Scene:
    z = np.array([[1, 2, 3, 4], [2, 3, 4, 5], [3, 4, 5, np.nan]], np.float32)
    terrain = Terrain(
        z, 10.0, (-10.0, -20.0), np.full(z.shape, 0.5, np.float32), "EPSG:32632", 5_300_000.0,
        500_000.0, "LAT", source="a test & more",
    )  # fmt: skip
    bodies = (Box((0, 0, 1), (2, 1, 1), 0.3, "a"), Sphere((0, 5, 1), 1.0),
              Capsule((0, 0, 1), (3, 4, 1), 0.5, "pipe"), Cylinder((5, 5, 1), 1, 2))  # fmt: skip
    return Scene("reef", terrain, bodies, source="a test")


def test_a_geotiff_comes_back_as_the_terrain(scene: Scene, tmp_path: Path) -> None:
    import rasterio

    from uuvsim_cosim.scene.terrain.raster import raster_terrain

    write_terrain(scene, tmp_path / "a.tif")
    with rasterio.open(tmp_path / "a.tif") as file:
        assert file.crs.to_epsg() == 32632
        assert np.isnan(file.nodata)
        assert file.tags()["VERTICAL_DATUM"] == "LAT"
        assert file.descriptions == ("elevation", "sigma")
        assert file.units == ("m", "m")
        assert scene.terrain is not None
        assert file.xy(2, 0) == (500_000 - 20, 5_300_000 - 10)  # the south-western node
        np.testing.assert_array_equal(file.read(1)[::-1], -scene.terrain.z)
    again = raster_terrain(tmp_path / "a.tif", 10.0).terrain
    np.testing.assert_allclose(again.z, scene.terrain.z, atol=1e-5)
    assert again.vertical_datum == "LAT"


def test_a_height_map_has_sixteen_bits_and_says_its_scale(scene: Scene, tmp_path: Path) -> None:
    write_terrain(scene, tmp_path / "a.png")
    data = (tmp_path / "a.png").read_bytes()
    assert struct.unpack(">IIBB", data[16:26]) == (4, 3, 16, 0)
    at = data.index(b"IDAT")
    (length,) = struct.unpack(">I", data[at - 4 : at])
    lines = np.frombuffer(zlib.decompress(data[at + 4 : at + 4 + length]), np.uint8).reshape(3, 9)
    levels = np.ascontiguousarray(lines[:, 1:]).view(">u2")
    assert levels[0, 3] == 0  # unknown
    assert levels[2, 0] == 65535  # 1 m deep, the highest
    assert levels[0, 2] == 1  # 5 m, the deepest
    assert b"elevation in m = -5.000000 + (level - 1) * " in data


def test_the_surface_is_cut_along_the_diagonal_and_faces_up(scene: Scene) -> None:
    assert scene.terrain is not None
    vertices, triangles = surface(scene.terrain)
    assert len(triangles) == 2 * 5  # of six cells one lacks a corner
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] < 0).all()  # up is -D
    step = vertices[triangles][:, [1, 2, 0]] - vertices[triangles]
    diagonal = np.abs(step[..., :2]).min(axis=2).max(axis=1) > 0
    assert diagonal.all()
    assert (np.sign(step[..., 0] * step[..., 1]) >= 0).all()  # (i, j) to (i+1, j+1)


def test_a_mesh_is_a_gltf_that_reads_back(scene: Scene, tmp_path: Path) -> None:
    import trimesh

    write_terrain(scene, tmp_path / "a.glb")
    read = trimesh.load(tmp_path / "a.glb")
    assert set(read.geometry) == {"seabed", "obstacles"}
    low, high = read.geometry["seabed"].bounds  # x east, y up, z south
    np.testing.assert_allclose([low, high], [[-20, -5, -10], [10, -1, 10]])


def test_a_world_is_xml_with_its_mesh_and_bodies(scene: Scene, tmp_path: Path) -> None:
    write_terrain(scene, tmp_path / "a.sdf")
    world = ElementTree.parse(tmp_path / "a.sdf").getroot().find("world")
    assert world is not None
    assert len(world.findall("model")) == 5
    assert world.findtext(".//uri") == "a.stl"
    assert (tmp_path / "a.stl").stat().st_size == 84 + 50 * 10
    box = world.findall("model")[1]
    pose = [float(v) for v in str(box.findtext("pose")).split()]
    np.testing.assert_allclose(pose, [0, 0, -1, 0, 0, np.pi / 2 - 0.3], atol=1e-5)


@pytest.fixture
def wreck(scene: Scene, tmp_path: Path) -> Scene:
    """The scene with a mesh of four triangles."""
    (tmp_path / "keel.obj").write_text(
        "v 0 0 0\nv 4 0 0\nv 0 5 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    keel = placed_mesh(tmp_path / "keel.obj", (1, 2, 3), unit="m", axes="NED", name="keel")
    return replace(scene, meshes=(keel,))


def test_a_mesh_of_a_scene_is_in_its_gltf(wreck: Scene, tmp_path: Path) -> None:
    import trimesh

    write_terrain(replace(wreck, obstacles=()), tmp_path / "a.glb")
    low, high = trimesh.load(tmp_path / "a.glb").geometry["obstacles"].bounds
    np.testing.assert_allclose([low, high], [[2, -6, -5], [7, -3, -1]])  # east, up, south


def test_a_mesh_of_a_scene_stands_in_its_world(wreck: Scene, tmp_path: Path) -> None:
    import trimesh

    files = write_terrain(wreck, tmp_path / "a.sdf")
    world = ElementTree.parse(tmp_path / "a.sdf").getroot().find("world")
    assert world is not None
    model = world.findall("model")[-1]
    assert str(model.get("name")).endswith("keel")
    file = files[-1]
    assert model.findtext(".//uri") == file.name
    low, high = trimesh.load(file).bounds
    np.testing.assert_allclose([low, high], [[2, 1, -6], [7, 5, -3]])  # east, north, up


def test_the_command_shows_and_copies_the_meshes_of_a_scene(
    wreck: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_terrain(wreck, tmp_path / "one")
    assert status_of(["terrain", str(tmp_path / "one"), "-o", str(tmp_path / "two")]) == 0
    (keel,) = load_scene(tmp_path / "two").meshes
    np.testing.assert_array_equal(keel.vertices, wreck.meshes[0].vertices)
    assert status_of(["terrain", str(tmp_path / "two"), "-o", str(tmp_path / "b.npz")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "4 triangles, N 1.00 to 5.00, E 2.00 to 7.00, D 3.00 to 6.00 m, closed" in said
    assert ".npz holds no obstacles or meshes" in said


def test_the_command_writes_a_scene_that_loads(tmp_path: Path) -> None:
    cell = slope()
    cell.point("WRECKS", (10.01, 54.01), VALSOU=5.5)
    chart = cell.write(tmp_path / "A.000")
    assert status_of(["terrain", str(chart), "-r", "50", "-o", str(tmp_path / "bay")]) == 0
    scene = load_scene(tmp_path / "bay")
    assert scene.name == "bay"
    assert [o.name for o in scene.obstacles] == ["WRECKS"]
    assert status_of(["terrain", str(tmp_path / "bay"), "-o", str(tmp_path / "b.npz")]) == 0
    assert scene.terrain is not None
    np.testing.assert_array_equal(load_terrain(tmp_path / "b.npz").z, scene.terrain.z)


def test_the_command_makes_the_same_bytes_twice(tmp_path: Path) -> None:
    chart = str(slope().write(tmp_path / "A.000"))
    for name in ("a", "b"):
        assert status_of(["terrain", chart, "-r", "50", "-o", str(tmp_path / name)]) == 0
    for file in ("terrain.npz",):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.000"], "no such file (did you mean A.000?); expected a chart (.000) or a grid"),
        (["A.00"], "no such file (did you mean A.000?); expected a chart (.000) or a grid"),
        (["A.000", "-o", "a.obj"], "expected .tif"),
        (["A.000", "-r", "0"], "resolution 0 m; expected more than 0"),
        (["A.000", "-r", "nan"], "resolution nan m"),
        (["A.000", "--around", "54.01"], "are wanted together"),
        (["A.000", "--around", "north", "--size", "1"], "expected LAT,LON"),
        (["A.000", "--around", "54.01,10.01", "--size", "0"], "expected km"),
        (["A.000", "--land", "-3"], "expected metres above the datum"),
        (["A.000", "--unit", "ft"], "not for a chart"),
        (["A.000", "--datum", "LAT"], "depths are from MLLW, not from LAT"),
        (["A.000", "--relief", "-1"], "expected a seed of 0 or more"),
        (["A.zip"], "unpack it first"),
        (["folder"], "expected a folder with one base cell"),
    ],
)
def test_a_wrong_wish_is_one_sentence(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    slope(count=4).write(tmp_path / "A.000")
    (tmp_path / "A.zip").write_bytes(b"PK")
    (tmp_path / "folder").mkdir()
    assert status_of(["terrain", *arguments]) == 2
    error = capfd.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_missing_library_is_asked_for_by_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    from uuvsim_cosim.scene.chart.read import read_chart

    chart = slope().write(tmp_path / "A.000")
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    with pytest.raises(InputInvalid, match=r"needs pyogrio, which .*uuvsim-cosim\[scene\]"):
        read_chart(chart)


def test_an_old_file_stays_when_the_new_one_cannot_be_written(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import rasterio

    target = tmp_path / "a.tif"
    target.write_text("old")

    def fails(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(rasterio, "open", fails)
    with pytest.raises(OSError, match="No space"):
        write_terrain(scene, target)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_geotiff_that_did_not_arrive_whole_is_no_success(scene: Scene, tmp_path: Path) -> None:
    file = write_terrain(scene, tmp_path / "a.tif")[0]
    check_whole(file)
    file.write_bytes(file.read_bytes()[:-200])  # as a full disk leaves it
    with pytest.raises(OSError, match="is the disk full"):
        check_whole(file)
