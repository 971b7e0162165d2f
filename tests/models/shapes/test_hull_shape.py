import io
from pathlib import Path

import numpy as np
import pytest
import trimesh

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.parameter_files import vehicle_ids, vehicle_size
from uuvsim_cosim.models.shapes.hull_shape import hull_shape, read_hull_shape
from uuvsim_cosim.models.vehicles.mesh_figures import displaced_volume
from uuvsim_cosim.models.worlds.placed_mesh import placed_mesh

# Their sizes and their buoyancies do not belong together: docs/vehicles/shapes.md says why.
CONTRADICTORY = {"npsauv", "slocum"}
HEAD = 'vehicle: v\nunits: "m, deg"\nsource: made up\nparts:\n'


@pytest.mark.parametrize("id", vehicle_ids())
def test_the_mesh_of_a_vehicle_is_a_solid_of_its_extent_and_volume(id: str) -> None:
    shape, size = hull_shape(id), vehicle_size(id)
    assert shape is not None
    assert size is not None
    low, high = shape.extent
    np.testing.assert_allclose(high - low, [size.length, size.breadth, size.height], rtol=0.01)
    np.testing.assert_allclose(0.5 * (low + high), size.at, atol=0.005 * size.length)
    vertices, faces = shape.surface
    assert len(faces) < 4100
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    for part in mesh.split(only_watertight=True):
        assert part.volume > 0
    if id not in CONTRADICTORY:
        assert shape.volume == pytest.approx(displaced_volume(id)[0], rel=0.05)


def test_a_glb_reads_back_with_its_parts_where_a_scene_places_it(tmp_path: Path) -> None:
    shape = hull_shape("bluerov2")
    assert shape is not None
    data = shape.glb()
    assert data == shape.glb()
    read = trimesh.load(io.BytesIO(data), file_type="glb")
    assert set(read.geometry) == {p.name for p in shape.parts}
    assert len(data) < 80_000
    file = tmp_path / "rov.glb"
    file.write_bytes(data)
    placed = placed_mesh(file, (10.0, 20.0, 5.0))
    low, high = placed.vertices.min(axis=0), placed.vertices.max(axis=0)
    np.testing.assert_allclose([low, high] - np.array([10.0, 20.0, 5.0]), shape.extent, atol=1e-5)
    assert placed.open_edges == 0


def test_a_part_is_copied_by_mirrors_and_turns(tmp_path: Path) -> None:
    file = tmp_path / "shape.yaml"
    file.write_text(
        HEAD + "  - {name: a, box: {at: [1, 2, 3], size: [1, 1, 1]}, mirror: [x, y]}\n"
        "  - {name: b, fin: {at: [0, 1, 0], span: [0, 1, 0], chord: [1, 1]}, around: [0, 90]}\n"
    )
    a, b = read_hull_shape(file).parts
    centres = a.vertices.reshape(4, 8, 3).mean(axis=1)
    assert {tuple(c) for c in centres.tolist()} == {(x, y, 3) for x in (-1, 1) for y in (-2, 2)}
    assert b.vertices.max(axis=0)[1:] == pytest.approx([2, 2])  # the second fin is below


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ("  - {name: a}\n", "parts.0: none; expected one of box"),
        ("  - {name: a, box: {at: [0, 0, 0], size: [1, 1, 0]}}\n", "encloses no volume"),
        ("  - {name: a, box: {at: [0, 0, 0], size: [1, 1, 1], edge: 2}}\n", "edge 2"),
        ("  - {name: a, box: {at: [0, 0, .inf], size: [1, 1, 1]}}\n", "expected finite numbers"),
        ("  - {name: a, ball: {}}\n", "ball"),
        ("  - {name: a, plate: {at: [0, 0, 0], normal: y, thickness: 1, "
         "outline: [[0, 0], [1, 1], [1, 0], [0, 1]]}}\n", "plate"),
        ("  - {name: a, colour: red, box: {at: [0, 0, 0], size: [1, 1, 1]}}\n", "#rrggbb"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_shape_is_reported_with_its_line(
    tmp_path: Path, parts: str, words: str
) -> None:
    file = tmp_path / "shape.yaml"
    file.write_text(HEAD + parts)
    with pytest.raises(ParameterInvalid, match=r"shape\.yaml:[45]: ") as error:
        read_hull_shape(file)
    assert words in str(error.value)


def test_a_folder_without_a_shape_has_none(tmp_path: Path) -> None:
    (tmp_path / "parameters.yaml").write_text("id: x\n")
    assert hull_shape(str(tmp_path)) is None
