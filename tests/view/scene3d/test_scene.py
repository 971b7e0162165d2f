from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.models.declaration.parameter_files import vehicle_ids, vehicle_size
from uuvsim_cosim.models.sensors.multibeam_and_camera import beams_of
from uuvsim_cosim.models.shapes.mesh import Mesh as Closed
from uuvsim_cosim.models.shapes.mesh import solid_of
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Sphere
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.shipped.tracking import target_tracking
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.scene3d.colours import depth_colours
from uuvsim_cosim.view.scene3d.motion import echoes, extent, motion_of, quaternions, turned
from uuvsim_cosim.view.scene3d.rays import rays_of, rotation
from uuvsim_cosim.view.scene3d.scene import Body, Mesh, Rays, Scene3D, Solid
from uuvsim_cosim.view.scene3d.scene_of_plan import ANYTHING, scene3d_of_plan
from uuvsim_cosim.view.scene3d.shapes import (
    basin,
    cropped,
    hull_of,
    obstacle_mesh,
    placed_surface,
    terrain_mesh,
)

PI = np.pi


def volume(mesh: Mesh) -> float:
    """Positive where the triangles are anticlockwise seen from outside."""
    return solid_of(Closed(mesh.vertices[mesh.faces].astype(float))).volume


@pytest.mark.parametrize(
    ("obstacle", "expected", "tolerance"),
    [
        (Box((5, 2, 9), (1, 2, 0.5), 0.7), 8.0, 1e-5),
        (Sphere((5, 2, 9), 1.5), 4 / 3 * PI * 1.5**3, 0.06),
        (Cylinder((5, 2, 9), 0.5, 2.0), PI * 0.25 * 4.0, 0.03),
        (Capsule((1, 2, 3), (4, 1, 5), 0.4), PI * 0.16 * 14**0.5 + 4 / 3 * PI * 0.064, 0.05),
    ],
)
def test_an_obstacle_is_closed_and_has_its_volume(obstacle, expected, tolerance) -> None:
    mesh = obstacle_mesh(obstacle)
    assert volume(mesh) == pytest.approx(expected, rel=tolerance)
    if not isinstance(obstacle, Capsule):
        middle = 0.5 * (mesh.vertices.max(axis=0) + mesh.vertices.min(axis=0))
        assert middle == pytest.approx(obstacle.centre, abs=1e-5)


def test_every_hull_fills_the_size_of_its_file() -> None:
    for id in vehicle_ids():
        size = vehicle_size(id)
        if size is None:
            continue
        mesh = hull_of(size)
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        assert high - low == pytest.approx([size.length, size.breadth, size.height], rel=0.03), id
        assert 0.5 * (low + high) == pytest.approx(size.at, abs=0.03 * size.length), id
        assert 0.4 < volume(mesh) / (size.length * size.breadth * size.height) < 1.001, id


def test_a_basin_is_seen_from_within_and_open_above() -> None:
    mesh = basin(np.array([1.0, 2.0, 0.0]), np.array([2.0, 4.0, 1.5]))
    corners = mesh.vertices[mesh.faces].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.array([1.0, 2.0, 0.75]) - corners.mean(axis=1)
    assert np.all(np.einsum("ij,ij->i", normals, inwards) > 0)
    assert not np.any(normals[:, 2] > 0)


def test_terrain_faces_up_and_is_open_where_it_is_unknown() -> None:
    z = np.full((7, 5), 10.0, np.float32)
    z[3, 2] = np.nan
    mesh = terrain_mesh(Terrain(z, 2.0, (-3.0, 4.0)))
    corners = mesh.vertices[mesh.faces].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(normals[:, 2] < 0)  # up is -D
    assert len(mesh.faces) == 2 * 6 * 4 - 6  # a node has six triangles about it
    assert mesh.vertices[:, :2].min(axis=0).tolist() == [-3.0, 4.0]


def test_a_large_terrain_is_thinned_to_its_edges() -> None:
    mesh = terrain_mesh(Terrain(np.zeros((901, 700), np.float32), 1.0, (0.0, 0.0)), nodes=100)
    assert len(mesh.vertices) < 110**2
    assert mesh.vertices[:, :2].max(axis=0).tolist() == [900.0, 699.0]


def test_the_part_of_a_terrain_near_a_track_lies_where_it_lay() -> None:
    z = np.arange(100.0 * 80).reshape(100, 80).astype(np.float32)
    whole = Terrain(z, 2.0, (-50.0, 10.0))
    part = cropped(whole, np.array([0.0, 40.0, 0]), np.array([20.0, 60.0, 5]), 10.0)
    assert part.extent == (-10.0, 32.0, 30.0, 72.0)
    assert part.z[0, 0] == z[20, 10]
    assert cropped(whole, np.array([900.0, 0, 0]), np.array([910.0, 0, 0]), 5.0) is whole


def test_a_terrain_of_holes_alone_gives_no_triangles() -> None:
    mesh = terrain_mesh(Terrain(np.full((4, 4), np.nan, np.float32), 1.0, (0.0, 0.0)))
    assert mesh.faces.shape == (0, 3)
    assert depth_colours(mesh.vertices[:, 2]).shape == (0, 3)


def test_thrusters_are_found_by_their_wires() -> None:
    (body,) = scene3d_of_plan(flatten(load("bluerov2_survey"))).bodies
    assert [a.signal for a in body.arrows] == [f"thruster_{i}.thrust" for i in range(1, 9)]
    assert all(np.linalg.norm(a.e) == pytest.approx(1.0) for a in body.arrows)
    assert body.estimate == "navigation.eta"
    (dvl,) = body.rays
    assert np.linalg.norm(dvl.directions, axis=1) == pytest.approx(np.ones(4))
    assert dvl.directions[:, 2] == pytest.approx(np.full(4, dvl.directions[0, 2]))


def test_the_beams_of_a_multibeam_are_those_of_its_model() -> None:
    (body,) = scene3d_of_plan(flatten(load("seabed_mapping"))).bodies
    (rays,) = (r for r in body.rays if r.name == "multibeam")
    beams = beams_of("multibeam", "p900", scene="tacoma")
    assert rays.signal == "multibeam.range"
    assert rays.directions == pytest.approx(beams.directions @ beams.R_bs.T)


def test_the_scene_has_what_a_system_has_and_no_more() -> None:
    scene3d = scene3d_of_plan(flatten(target_tracking(3, obstacles=2)))
    assert [b.name for b in scene3d.bodies] == ["tracker_1", "tracker_2", "tracker_3"]
    assert [m.signal for m in scene3d.markers] == ["target.position"]
    assert [s.kind for s in scene3d.solids] == ["basin"]  # obstacles of radius 0 are not there
    assert all(len(b.arrows) == 8 for b in scene3d.bodies)


def test_names_do_not_matter() -> None:
    system = (
        System("other", "0.01")
        .add("boat", "model:vehicle?id=remus100")
        .add("mixer", "model:wrench?vehicle=remus100")
        .add("screw", "model:propeller")
        .connect("mixer.tau", "boat.tau")
        .connect("screw.thrust", "mixer.thrust[1]")
    )
    (body,) = scene3d_of_plan(flatten(system)).bodies
    assert (body.name, body.eta) == ("boat", "boat.eta")
    assert [a.signal for a in body.arrows] == ["screw.thrust"]
    length = vehicle_size("remus100").length  # type: ignore[union-attr]
    assert length < body.size < 1.06 * length  # the propeller is behind the hull


def test_a_hull_of_unknown_size_is_a_box_and_said_so(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "class Hull:\n    inputs = {'tau': (6, 'N')}\n    outputs = {'eta': (6, 'm')}\n"
        "    def step(self, t, dt, u):\n        return {'eta': [0.0] * 6}\n",
        encoding="utf-8",
    )
    system = System("own", "0.1").add("hull", f"{tmp_path / 'own.py'}:Hull")
    scene3d = scene3d_of_plan(flatten(system))
    (body,) = scene3d.bodies
    assert body.hull is ANYTHING
    assert "unknown" in scene3d.notes[0]


def test_a_scene_that_is_not_there_is_said_and_nothing_else_is_lost(tmp_path: Path) -> None:
    plan = flatten(System("x", "0.01").add("hull", "model:remus100"))
    (hull,) = plan.components
    elsewhere = replace(hull, source="model:remus100?scene=atlantis")
    scene3d = scene3d_of_plan(replace(plan, components=(elsewhere,)))
    assert "atlantis" in " ".join(scene3d.notes)
    assert len(scene3d.bodies) == 1
    assert scene3d.terrain is None


def test_the_meshes_of_a_scene_are_drawn_where_they_stand(tmp_path: Path) -> None:
    (tmp_path / "keel.obj").write_text("v 0 0 0\nv 4 0 0\nv 0 5 0\nv 0 0 3\nf 1 2 3\nf 1 3 4\n")
    (tmp_path / "scene.yaml").write_text(
        'id: s\ndescription: a keel\nsource: made up\nunits: "m, rad"\n'
        "obstacles:\n  - sphere: {centre: [0, 0, 5], radius: 1}\n"
        "meshes:\n  - {file: keel.obj, position: [1, 2, 3], unit: m, axes: NED, name: keel}\n"
    )
    system = System("x", "0.01").add("sonar", f"model:multibeam?scene={tmp_path}&beams=3")
    sphere, keel = scene3d_of_plan(flatten(system)).solids
    assert (keel.name, keel.kind) == ("keel 2", "obstacle")
    corners = keel.mesh.vertices[keel.mesh.faces]
    np.testing.assert_allclose(corners.min(axis=(0, 1)), [1, 2, 3])
    np.testing.assert_allclose(corners.max(axis=(0, 1)), [5, 7, 6])
    assert sphere.name == "sphere 1"


def test_a_mesh_of_many_triangles_is_drawn_coarser_and_stays_in_place() -> None:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(100.0), np.arange(100.0)))
    i, j = (a.ravel() for a in np.meshgrid(np.arange(99), np.arange(99)))
    a = 100 * i + j
    corners = np.concatenate([np.stack([a, a + 1, a + 101], 1), np.stack([a, a + 101, a + 100], 1)])
    mesh = PlacedMesh(Path("plate.stl"), np.column_stack([x, y, np.sin(x / 9)]),
                      corners.astype(np.int32), (0.0, 0.0, 0.0))  # fmt: skip
    drawn = placed_surface(mesh, 2000)
    assert 500 < len(drawn.faces) <= 2000
    assert np.abs(drawn.vertices[:, 2] - np.sin(drawn.vertices[:, 0] / 9)).max() < 0.05
    np.testing.assert_allclose(np.ptp(drawn.vertices, axis=0)[:2], 99, atol=5)
    assert len(placed_surface(mesh).faces) == 2 * 99 * 99


angles = st.floats(-1.5, 1.5)


@given(phi=angles, theta=angles, psi=st.floats(-3.1, 3.1))
def test_quaternions_turn_as_euler_angles_do(phi: float, theta: float, psi: float) -> None:
    q = quaternions(np.array([[phi, theta, psi]]))
    assert np.linalg.norm(q) == pytest.approx(1.0)
    vectors = np.eye(3)
    assert turned(np.repeat(q, 3, axis=0), vectors) == pytest.approx(
        (rotation(phi, theta, psi) @ vectors.T).T, abs=1e-12
    )


def _one_body(rays: tuple[Rays, ...] = ()) -> Scene3D:
    return Scene3D("x", (Body("hull", ANYTHING, "hull.eta", rays=rays),))


def test_a_sensor_whose_rays_point_nowhere_known_is_noted_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("uuvsim_cosim.view.scene3d.rays._instrument", lambda *_: None)
    output = SimpleNamespace(causality="output", shape=(3,), size=3)
    outputs = {"range": output, "altitude": output}
    sensor = SimpleNamespace(path="sonar", description=SimpleNamespace(variables=outputs))
    eta = SimpleNamespace(source=0, target=1, source_variable=SimpleNamespace(name="eta"))
    plan: Any = SimpleNamespace(transfers=[eta], components=[None, sensor])
    notes: list[str] = []
    place: Any = lambda _, name: np.zeros(3) if name == "r_s" else None  # noqa: E731
    assert list(rays_of(plan, 0, place, notes)) == []
    assert notes == ["sonar.range: the directions of its 3 rays are not known"]


def test_echoes_over_a_flat_bottom_lie_on_it() -> None:
    random = np.random.default_rng(2)
    eta = np.column_stack([random.normal(size=(50, 3)), 0.3 * random.normal(size=(50, 3))])
    directions = np.array([[0.3, 0.1, 0.95], [-0.2, 0.4, 0.9]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    r = np.array([0.2, -0.1, 0.1])
    ranges = np.array([
        [(20.0 - (e[:3] + rotation(*e[3:]) @ r)[2]) / (rotation(*e[3:]) @ d)[2] for d in directions]
        for e in eta
    ])  # fmt: skip
    scene3d = _one_body((Rays("sonar", "sonar.range", r, directions),))
    traces = Traces(np.arange(50.0), {"hull.eta": eta, "sonar.range": ranges})
    points = echoes(scene3d.bodies[0], motion_of(scene3d, traces))
    assert points.shape == (100, 3)
    assert points[:, 2] == pytest.approx(np.full(100, 20.0))


def test_echoes_are_thinned_evenly_to_the_most_that_are_asked_for() -> None:
    rays = Rays("sonar", "s.range", np.zeros(3), np.array([[0.0, 0, 1], [0, 1, 0], [1, 0, 0]]))
    scene3d = _one_body((rays,))
    ranges = 1.0 + np.arange(1200.0).reshape(400, 3)
    traces = Traces(np.arange(400.0), {"hull.eta": np.zeros((400, 6)), "s.range": ranges})
    motion = motion_of(scene3d, traces)
    assert len(echoes(scene3d.bodies[0], motion)) == 1200
    few = echoes(scene3d.bodies[0], motion, most=100)
    assert 90 <= len(few) <= 100
    depths = few[few[:, 2] > 0.0, 2]  # of the first ray: 1, 1 + 3 k, ...
    assert len(set(np.diff(depths))) == 1


def test_a_body_that_does_not_move_has_no_echoes() -> None:
    scene3d = _one_body()
    motion = motion_of(scene3d, Traces(np.arange(2.0), {"hull.eta": np.zeros((2, 6))}))
    other = replace(scene3d.bodies[0], name="other")
    assert echoes(other, motion).shape == echoes(scene3d.bodies[0], motion).shape == (0, 3)


def test_a_reading_that_is_held_counts_once_and_a_lost_one_not_at_all() -> None:
    rays = Rays("sonar", "s.range", np.zeros(3), np.array([[0.0, 0, 1], [0, 0, 1]]), "s.valid")
    scene3d = _one_body((rays,))
    ranges = np.array([[5.0, 0.0], [5.0, 0.0], [6.0, np.nan], [7.0, 8.0]])
    valid = np.array([[1.0, 1], [1, 1], [1, 1], [0, 1]])
    eta = np.zeros((4, 6))
    traces = Traces(np.arange(4.0), {"hull.eta": eta, "s.range": ranges, "s.valid": valid})
    found = echoes(scene3d.bodies[0], motion_of(scene3d, traces))[:, 2]
    assert sorted(found.tolist()) == [5.0, 6.0, 8.0]


def test_the_longest_arrow_is_the_greatest_thrust(survey: Traces) -> None:
    scene3d = scene3d_of_plan(flatten(load("bluerov2_survey")))
    motion = motion_of(scene3d, survey, most=500)
    assert len(motion.time) <= 500
    whole = motion_of(scene3d, survey)
    longest = np.abs(whole.thrusts["hull"]).max() * whole.scales["hull"]
    assert longest == pytest.approx(1.5 * scene3d.bodies[0].size)
    assert motion.scales == whole.scales


def test_an_obstacle_kilometres_away_does_not_shrink_what_moves() -> None:
    eta = np.zeros((3, 6))
    eta[:, 0] = [0.0, 10.0, 20.0]
    near, far = Cylinder((12, 3, 5), 1, 5), Cylinder((5000, 0, 5), 1, 5)
    solids = tuple(Solid(str(k), obstacle_mesh(o), "obstacle") for k, o in enumerate((near, far)))
    scene3d = replace(_one_body(), solids=solids)
    high = extent(scene3d, motion_of(scene3d, Traces(np.arange(3.0), {"hull.eta": eta})))[1]
    assert high[0] < 30
    assert high[1] >= 4 - 1e-6  # the near one is within


def test_what_is_not_finite_moves_nothing_else() -> None:
    scene3d = _one_body()
    eta = np.zeros((3, 6))
    eta[1] = np.nan
    motion = motion_of(scene3d, Traces(np.arange(3.0), {"hull.eta": eta}))
    low, high = extent(scene3d, motion)
    assert np.isfinite([low, high]).all()
    assert motion.moment(1.4) == 1
    assert motion.moment(-5.0) == 0
    assert motion.moment(99.0) == 2
