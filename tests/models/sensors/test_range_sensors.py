"""Altimeter, DVL, multibeam and depth camera over a scene: geometry, noise, and what is no echo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_here
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.sensors.multibeam_and_camera import beams_of
from uuvsim_cosim.models.worlds.ground import ground_named
from uuvsim_cosim.models.worlds.obstacles import Sphere
from uuvsim_cosim.models.worlds.placed_mesh import placed_mesh
from uuvsim_cosim.models.worlds.scene import Scene, load_scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain

ETA, Q = [3.0, -2.0, 4.0, 0.0, 0.0, 0.0], [0.98, 0.1, -0.15, 0.05]
STILL = ["sigma_range", "sigma_range_relative", "dropout"]
WANDER = ["range_bias_sigma", "image_bias_sigma"]


@pytest.fixture(scope="module")
def hills(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Hills with a hole, and a ball on them."""
    x = np.arange(40) - 20.0
    z = 15 + 2 * np.sin(x[:, None] / 4) * np.cos(x[None, :] / 5)
    z[2:5, 2:5] = np.nan
    folder: Path = tmp_path_factory.mktemp("hills")
    terrain = Terrain(z.astype(np.float32), 1.5, (-30.0, -30.0))
    save_scene(Scene("hills", terrain, (Sphere((3, 0, 11), 1.0),), None, "hills", "made"), folder)
    return str(folder)


@pytest.fixture(scope="module")
def wreck(hills: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The hills with a mesh on them, below the sensor's path."""
    trimesh = pytest.importorskip("trimesh", reason="the extra `scene` is not installed")
    folder: Path = tmp_path_factory.mktemp("wreck")
    ship = trimesh.creation.icosphere(2, 1.0)
    ship.apply_scale([3000.0, 2000.0, 1500.0])
    (folder / "ship.stl").write_bytes(ship.export(file_type="stl"))
    placed = placed_mesh(folder / "ship.stl", (1.0, -4.0, 10.0), (0.2, 0.1, 0.7), "mm", 1.0, "ENU")
    save_scene(replace(load_scene(hills), meshes=(placed,)), folder)
    return str(folder)


def step(native: Any, n: int = 40, silent: bool = False, **values: Any) -> dict[str, Any]:
    """Set values, step n times 10 ms, give the outputs."""
    variables = native.description.variables
    if silent:
        for name in (*STILL, *WANDER):
            if name in variables:
                native.set(variables[name], 0.0)
    for name, value in values.items():
        native.set(variables[name], np.asarray(value, float) if np.ndim(value) else value)
    native.enter_initialization_mode(0.0, None)
    native.exit_initialization_mode()
    for k in range(n):
        native.do_step(k * 0.01, 0.01)
    return {k: native.get(v) for k, v in variables.items() if v.causality == "output"}


def run(name: str, options: Any, **values: Any) -> dict[str, Any]:
    return step(Native(declare(name, **options), name), **values)


SENSORS: dict[str, tuple[str, dict[str, Any]]] = {
    "altimeter": ("altimeter", {"others": 1}),
    "dvl": ("dvl", {"id": "a50", "track": "both", "others": 1}),
    "multibeam": ("multibeam", {"beams": 40, "others": 1}),
    "depth": ("depth_camera", {"id": "camera_class", "columns": 7, "rows": 5}),
}


@pytest.mark.parametrize("scene", ["hills", "wreck"])
@pytest.mark.parametrize("which", SENSORS)
def test_c_agrees_with_casadis_own_evaluation_by_brute_force(
    which: str, scene: str, request: pytest.FixtureRequest
) -> None:
    name, options = SENSORS[which]
    model = declare(name, scene=request.getfixturevalue(scene), **options)
    given = {"eta": ETA, "q": Q}
    parameters: dict[str, Any] = {}
    if "others" in options:
        given["other_eta_1"] = [2.0, -2.5, 9.0, 0.1, 0.2, 0.3]
        parameters["other_size"] = [[0.4, 0.8]]
    found = step(Native(model, name), **given, **parameters)
    wanted = simulate(model, until=0.4, h=0.01, inputs=given, parameters=parameters)
    for v in model.of_kind("output"):
        a, b = np.ravel(found[v.name]).astype(float), np.ravel(wanted[v.name][-1])
        np.testing.assert_allclose(a, b, atol=1e-9, err_msg=v.name)
    assert found["valid"]


@pytest.mark.parametrize("which", SENSORS)
def test_every_range_sensor_sees_a_mesh(which: str, hills: str, wreck: str) -> None:
    name, options = SENSORS[which]
    alone = {k: v for k, v in options.items() if k != "others"}
    bed, ship = (
        run(name, alone | {"scene": scene}, eta=ETA, q=Q, silent=True) for scene in (hills, wreck)
    )
    key = {"altimeter": "altitude", "depth": "image"}.get(which, "range")
    assert np.all(np.ravel(ship[key]) <= np.ravel(bed[key]) + 1e-9)
    assert np.min(np.ravel(ship[key]) - np.ravel(bed[key])) < -1.0


@pytest.mark.parametrize("scene", ["hills", "wreck"])
@pytest.mark.parametrize("which", ["multibeam", "altimeter"])
def test_an_fmu_has_the_bits_of_the_native_component(
    which: str, scene: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    name, options = SENSORS[which]
    model = declare(name, scene=request.getfixturevalue(scene), **options | {"others": 0})
    wanted = step(Native(model, name), eta=ETA, q=Q)
    for fmi in (2, 3):
        fmu = build_fmu(model, fmi=fmi, target=tmp_path / f"{name}_{fmi}.fmu")  # type: ignore[arg-type]
        found = step(instantiate_here(read_fmu(fmu), name), eta=ETA, q=Q)
        for key, value in wanted.items():
            np.testing.assert_array_equal(found[key], value, err_msg=f"FMI {fmi}: {key}")


def test_over_a_level_scene_altimeter_and_dvl_read_what_they_read_over_a_plane() -> None:
    for name, tolerance in (("altimeter", 2e-3), ("dvl", 1e-12)):
        nu = {"nu": [1, 0.2, 0.1, 0, 0, 0.1]} if name == "dvl" else {}
        for roll in (0.0, 0.15, 0.3):
            q = [np.cos(roll / 2), np.sin(roll / 2), 0, 0]
            a = run(name, {}, eta=ETA, q=q, silent=True, **nu)
            b = run(name, {"scene": "flat"}, eta=ETA, q=q, silent=True, **nu)
            assert a["valid"] == b["valid"]
            assert b["altitude"] == pytest.approx(a["altitude"], rel=tolerance)


def test_points_of_a_multibeam_and_of_a_camera_lie_on_the_seabed(hills: str) -> None:
    import casadi as ca

    from uuvsim_cosim.models.declaration.kinematics import R
    from uuvsim_cosim.scene.shared.ray_casting import Caster

    Rnb = np.array(ca.DM(R(Q)))
    for name, key, options in (
        ("multibeam", "range", {"id": "norbit_wbms", "beams": 60}),
        ("depth_camera", "image", {"id": "camera_class", "columns": 8, "rows": 6}),
    ):
        b = beams_of(name, **options)
        out = run(name, {"scene": hills, **options}, eta=ETA, q=Q, silent=True)
        r = out[key] / b.directions[:, 2] if name == "depth_camera" else out[key]
        p = np.array(ETA[:3]) + (b.r_s + (b.directions * r[:, None]) @ b.R_bs.T) @ Rnb.T
        there = out[key] > 0
        assert out["heard"] == there.sum() > 30
        off = p[:, 2] - Caster(hills).height(p[:, 0], p[:, 1])
        ball = np.abs(np.linalg.norm(p - (3, 0, 11), axis=1) - 1.0) < 1e-9
        assert np.all((np.abs(off) < 1e-9)[there & ~ball])


def test_a_level_camera_sees_one_depth_and_growing_ranges() -> None:
    options = {"scene": "flat", "id": "camera_class", "columns": 8, "rows": 6}
    depth = run("depth_camera", options, eta=[0, 0, 14.9, 0, 0, 0], silent=True)["image"]
    ranges = run("depth_camera", options | {"reading": "range"}, eta=[0, 0, 14.9, 0, 0, 0],
                 silent=True)["image"].reshape(6, 8)  # fmt: skip
    np.testing.assert_allclose(depth, 10.0, rtol=1e-12)
    np.testing.assert_allclose(ranges, ranges[::-1, ::-1], rtol=1e-12)
    assert ranges[0, 0] == ranges.max() > ranges[2, 3] > 10.0


def test_port_comes_first_and_the_image_begins_ahead() -> None:
    fan = beams_of("multibeam", "norbit_wbms")
    assert fan.directions.shape == (512, 3)
    assert (fan.R_bs @ fan.directions[0])[1] < 0 < (fan.R_bs @ fan.directions[-1])[1]
    image = beams_of("depth_camera", "camera_class", columns=8, rows=6)
    first = image.R_bs @ image.directions[0]
    assert first[0] > 0 > first[1]  # towards the bow, and port


def test_a_frame_is_read_in_place_and_cannot_be_changed() -> None:
    native = Native(declare("multibeam", scene="flat", beams=12), "m")
    step(native, eta=[0, 0, 15, 0, 0, 0], dropout=0.0)
    variable = native.description.variables["range"]
    seen = native.view(variable)
    before = seen.copy()
    native.set(native.description.variables["eta"], np.array([0, 0, 10.0, 0, 0, 0]))
    native.do_step(0.4, 0.2)
    native.view(variable)
    assert np.all(seen > before + 4.0)
    with pytest.raises(ValueError, match="read-only"):
        seen[0] = 1.0


def test_a_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "bed.npz"
    for z in (20.0, 30.5):
        save_terrain(Terrain(np.full((3, 3), z, np.float32), 50.0, (-50.0, -50.0)), file)
        assert ground_named(str(file)).low == z


@pytest.mark.parametrize(
    "eta", [(0, 0, 60, 0, 0, 0), (99, 0, 5, 0, 0, 0), (-25.5, -25.5, 12, 0, 0, 0)]
)
def test_below_the_bed_outside_of_the_terrain_and_over_a_hole_nothing_is_heard(
    hills: str, eta: Any
) -> None:
    out = run("altimeter", {"scene": hills}, eta=eta)
    assert not out["valid"]
    out = run("multibeam", {"scene": hills, "beams": 40}, eta=eta)
    if eta[2] != 12:  # beside the hole there is ground
        assert not out["valid"]
        assert not np.any(out["range"])
        assert out["heard"] == 0


def test_noise_and_losses_of_a_frame_are_as_stated() -> None:
    n = 4000
    options = {"scene": "flat", "beams": n}
    noise = {"sigma_range": 0.03, "sigma_range_relative": 0.002, "dropout": 0.2}
    eta = [0, 0, 15, 0, 0, 0]
    clean = run("multibeam", options, eta=eta, silent=True)["range"]
    noisy = run("multibeam", options, eta=eta, **noise, range_bias_sigma=0.0)["range"]
    heard = noisy > 0
    assert np.mean(heard) == pytest.approx(0.8, abs=4.5 * np.sqrt(0.16 / n))
    z = ((noisy - clean) / np.hypot(0.03, 0.002 * clean))[heard]
    assert np.std(z) == pytest.approx(1.0, abs=4.5 / np.sqrt(2 * heard.sum()))
    assert np.mean(z) == pytest.approx(0.0, abs=4.5 / np.sqrt(heard.sum()))


def test_all_beams_share_the_wandering_error() -> None:
    options = {"scene": "flat", "beams": 50}
    eta = [0, 0, 15, 0, 0, 0]
    clean = run("multibeam", options, eta=eta, silent=True)["range"]
    native = Native(declare("multibeam", **options), "m")
    quiet = {"sigma_range": 0.0, "sigma_range_relative": 0.0, "dropout": 0.0}
    off = step(native, eta=eta, **quiet, range_bias_sigma=0.5)["range"] - clean
    assert abs(off[0]) > 1e-3
    np.testing.assert_allclose(off, off[0], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("altimeter", {"scene": "tacona"}, "there is no scene 'tacona'"),
        ("multibeam", {"beams": 1}, "1 beams"),
        ("depth_camera", {"columns": 1000, "rows": 1000}, "expected 1 to 20000"),
        ("depth_camera", {"reading": "deep"}, "expected depth or range"),
        ("dvl", {"scene": "flat", "others": -1}, "others = -1"),
    ],
)
def test_wrong_options_are_said(name: str, options: Any, words: str) -> None:
    with pytest.raises((ParameterInvalid, InputInvalid), match=words):
        declare(name, **options)
