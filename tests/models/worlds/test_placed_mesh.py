"""Meshes of a scene: where they stand, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.worlds import placed_mesh as module
from uuvsim_cosim.models.worlds.ground import ground_named, ground_of
from uuvsim_cosim.models.worlds.placed_mesh import placed_mesh, unique_rows
from uuvsim_cosim.models.worlds.scene import Scene, load_scene, save_scene

TETRAHEDRON = "v 0 0 0\nv 2 0 0\nv 0 3 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
HEAD = 'id: w\ndescription: a wreck\nsource: made up\nunits: "m, rad"\nmeshes:\n'


def obj(folder: Path, text: str = TETRAHEDRON, name: str = "w.obj") -> Path:
    pytest.importorskip("trimesh", reason="the extra `scene` is not installed")
    (folder / name).write_text(text)
    return folder / name


def sorted_rows(rows: Any) -> Any:
    return np.round(rows, 9)[np.lexsort(np.round(rows, 9).T)]


@pytest.mark.parametrize(
    ("axes", "wanted"),
    [
        ("NED", [[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]]),
        ("ENU", [[0, 0, 0], [0, 2, 0], [3, 0, 0], [0, 0, -4]]),
        ("NWU", [[0, 0, 0], [2, 0, 0], [0, -3, 0], [0, 0, -4]]),
        ("EUS", [[0, 0, 0], [0, 2, 0], [0, 0, -3], [-4, 0, 0]]),
    ],
)
def test_axes_say_what_x_y_and_z_of_the_file_are(axes: str, wanted: Any, tmp_path: Path) -> None:
    mesh = placed_mesh(obj(tmp_path), (10, 20, 30), unit="m", axes=axes)
    np.testing.assert_allclose(
        sorted_rows(mesh.vertices), sorted_rows(np.add(wanted, [10.0, 20, 30]))
    )
    a, b, c = (mesh.vertices[mesh.corners[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", a - [10, 20, 30], np.cross(b - a, c - a)) / 6
    assert volume == pytest.approx(4.0)  # outside stays outside


def test_a_mesh_is_scaled_then_turned_then_moved(tmp_path: Path) -> None:
    """The nose (2, 0, 0) cm, doubled, yawed to east, stands 4 cm east of the position."""
    mesh = placed_mesh(
        obj(tmp_path), (1, 1, 1), (0.0, 0.0, np.pi / 2), unit="cm", scale=2, axes="NED"
    )
    assert np.abs(mesh.vertices - [1.0, 1.04, 1.0]).sum(axis=1).min() < 1e-12
    pitched = placed_mesh(obj(tmp_path), (0, 0, 0), (0.0, np.pi / 2, 0.0), "m", 1.0, "NED")
    assert np.abs(pitched.vertices - [0, 0, -2.0]).sum(axis=1).min() < 1e-12


def test_gltf_has_metres_and_y_up_of_its_own(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="the extra `scene` is not installed")
    box = trimesh.creation.box((2, 4, 6))  # 2 m east, 4 m up, 6 m south
    (tmp_path / "a.glb").write_bytes(box.export(file_type="glb"))
    mesh = placed_mesh(tmp_path / "a.glb", (0, 0, 0))
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [6, 2, 4])
    assert (mesh.unit, mesh.axes, mesh.open_edges) == ("m", "EUS", 0)


def test_an_open_surface_and_triangles_without_area_are_counted(tmp_path: Path) -> None:
    text = TETRAHEDRON.rsplit("f", 1)[0] + "f 1 1 2\n"
    mesh = placed_mesh(obj(tmp_path, text), (0, 0, 0), unit="m", axes="NED")
    assert (len(mesh.corners), mesh.open_edges, mesh.flat) == (3, 3, 1)
    assert "open at 3 edges; 1 triangles without area were left out" in mesh.facts


def test_a_scene_with_meshes_is_read_as_it_was_written(tmp_path: Path) -> None:
    mesh = placed_mesh(
        obj(tmp_path), (1.5, 2, 3), (0.1, 0.2, 0.3), "mm", 250.0, "ENU", "steel", "a wreck", False
    )
    folder = tmp_path / "s"
    save_scene(Scene("s", None, description="one", source="drawn", meshes=(mesh,)), folder)
    (read,) = load_scene(folder).meshes
    for field in ("position", "orientation", "unit", "scale", "axes", "material", "name",
                  "contact"):  # fmt: skip
        assert getattr(read, field) == getattr(mesh, field), field
    np.testing.assert_array_equal(read.vertices, mesh.vertices)
    np.testing.assert_array_equal(read.corners, mesh.corners)
    assert read.file == folder / "w.obj"


def test_the_buffers_of_a_gltf_go_with_it(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="the extra `scene` is not installed")
    parts = trimesh.creation.box((1, 1, 1)).export(file_type="gltf")
    for name, data in parts.items():
        (tmp_path / name).write_bytes(data)
    (main,) = [n for n in parts if n.endswith(".gltf")]
    mesh = placed_mesh(tmp_path / main, (0, 0, 0))
    folder = tmp_path / "s"
    save_scene(Scene("s", None, description="one", source="drawn", meshes=(mesh,)), folder)
    assert len(load_scene(folder).meshes[0].corners) == 12
    uris = {b["uri"] for b in json.loads((folder / main).read_text())["buffers"]}
    assert uris <= {f.name for f in folder.iterdir()}


WRONG = [
    ("{file: none.stl, position: [0, 0, 0], unit: m, axes: NED}",
     r"scene.yaml:6: meshes.0: none.stl: there is no such file in .*expected empty.stl, n"),
    ("{file: w.ply, position: [0, 0, 0]}", r"w.ply.*expected the name of an .stl, .obj, .glb"),
    ("{file: ../w.obj, position: [0, 0, 0]}", "beside this file"),
    ("{file: w.obj, position: [0, 0, 0], axes: NED}", "states no unit; expected unit: m, cm, mm"),
    ("{file: w.obj, position: [0, 0, 0], unit: kg, axes: NED}", "kg is no length; expected m, cm"),
    ("{file: w.obj, position: [0, 0, 0], unit: parsec, axes: NED}", "unknown unit 'parsec'"),
    ("{file: w.obj, position: [0, 0, 0], unit: m}", "states no axes; expected axes: NED, ENU"),
    ("{file: w.obj, position: [0, 0, 0], unit: m, axes: XYZ}", "axes: XYZ; expected axes: NED"),
    ("{file: w.obj, position: [0, 0], unit: m, axes: NED}", "expected N, E, D: three numbers"),
    ("{file: w.obj, position: [0, 0, .nan], unit: m, axes: NED}", "expected finite numbers"),
    ("{file: w.obj, position: [0, 0, 0], unit: m, axes: NED, scale: -1}", "-1 is less than"),
    ("{file: w.obj, position: [0, 0, 0], unit: m, axes: NED, scale: .inf}", "finite numbers"),
    ("{file: w.obj, position: [0, 0, 0], unit: mm, axes: NED, scale: 0.1}",
     "0.0004 m long with unit: mm and scale: 0.1; expected 0.01 to 20000 m"),
    ("{file: w.obj, position: [0, 0, 0], unit: m, axes: NED, orientation: [0, 0, 90]}",
     "expected rad, from -2 pi to 2 pi: are these degrees"),
    ("{file: nan.obj, position: [0, 0, 0], unit: m, axes: NED}", "has the vertex .*nan"),
    ("{file: empty.stl, position: [0, 0, 0], unit: m, axes: NED}", "no triangles; expected"),
    ("{file: points.obj, position: [0, 0, 0], unit: m, axes: NED}", "points.obj: no tri"),
    ("{file: text.stl, position: [0, 0, 0], unit: m, axes: NED}", "expected an STL"),
    ("{file: text.glb, position: [0, 0, 0]}", "is no mesh that trimesh reads"),
    ("{file: w.obj, position: [0, 0, 0], unit: m, axes: NED, colour: red}", "colour: unknown"),
]  # fmt: skip


@pytest.mark.parametrize(("entry", "said"), WRONG)
def test_what_is_no_mesh_is_refused_with_what_would_be_right(
    entry: str, said: str, tmp_path: Path
) -> None:
    obj(tmp_path)
    obj(tmp_path, TETRAHEDRON.replace("2 0 0", "nan 0 0"), "nan.obj")
    obj(tmp_path, "v 0 0 0\nv 1 1 1\n", "points.obj")
    (tmp_path / "empty.stl").write_bytes(bytes(84))
    for name in ("text.stl", "text.glb"):
        (tmp_path / name).write_text("nothing of the kind")
    (tmp_path / "scene.yaml").write_text(f"{HEAD}  - {entry}\n")
    with pytest.raises(InputInvalid, match=said):
        load_scene(tmp_path)


def test_too_many_triangles_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_TRIANGLES", 3)
    with pytest.raises(InputInvalid, match="4 triangles; expected at most 3: simplify the mesh"):
        placed_mesh(obj(tmp_path), (0, 0, 0), unit="m", axes="NED")


def test_too_many_triangles_together_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uuvsim_cosim.models.worlds.scene.MOST_TRIANGLES", 7)
    obj(tmp_path)
    entry = "  - {file: w.obj, position: [0, 0, 0], unit: m, axes: NED}\n"
    (tmp_path / "scene.yaml").write_text(HEAD + 2 * entry)
    with pytest.raises(InputInvalid, match="8 triangles together; expected at most 7"):
        load_scene(tmp_path)


def test_files_of_one_name_cannot_stand_in_one_folder(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    meshes = tuple(
        placed_mesh(obj(f), (0, 0, 0), unit="m", axes="NED") for f in (tmp_path, tmp_path / "b")
    )
    with pytest.raises(InputInvalid, match="expected files of different names"):
        save_scene(Scene("s", None, meshes=meshes), tmp_path / "s")


def test_a_hull_that_would_pass_through_a_mesh_is_refused(tmp_path: Path) -> None:
    obj(tmp_path)
    entry = "  - {file: w.obj, position: [0, 0, 5], unit: m, axes: NED, name: quay"
    (tmp_path / "scene.yaml").write_text(f"{HEAD}{entry}}}\n")
    with pytest.raises(
        ParameterInvalid,
        match=r"contact does not act between a hull and meshes \(quay\); expected obstacles",
    ):
        declare("contact", scene=str(tmp_path))
    (tmp_path / "scene.yaml").write_text(f"{HEAD}{entry}, contact: false}}\n# passes through\n")
    assert declare("contact", scene=str(tmp_path)).name == "contact"


def test_a_mesh_that_has_changed_is_read_again(tmp_path: Path) -> None:
    obj(tmp_path)
    (tmp_path / "scene.yaml").write_text(
        f"{HEAD}  - {{file: w.obj, position: [0, 0, 0], unit: m, axes: NED}}\n"
    )
    first = ground_named(str(tmp_path))
    obj(tmp_path, TETRAHEDRON.replace("0 0 4", "0 0 40"))
    assert ground_named(str(tmp_path)).name != first.name


def test_shared_corners_stay_shared_far_from_the_origin(tmp_path: Path) -> None:
    """In float32 relative to their middle: 11 km away, within 0.01 mm, and each once."""
    mesh = placed_mesh(obj(tmp_path), (8000.123456, -8000.1, 30), (0.3, 0.2, 0.1), "m", 1.0, "ENU")
    surfaces = ground_of(Scene("s", None, meshes=(mesh,))).surfaces
    assert len(surfaces.vertices) == 4
    wanted = mesh.vertices[mesh.corners]
    np.testing.assert_allclose(surfaces.triangles, wanted, rtol=0, atol=1e-5)


def test_rows_are_unique_and_minus_zero_is_zero() -> None:
    rows = np.array([[1.0, 0.0], [1.0, -0.0], [0.5, 2.0], [1.0, 0.0]])
    unique, same = unique_rows(rows)
    assert len(unique) == 2
    np.testing.assert_array_equal(unique[same], rows)
