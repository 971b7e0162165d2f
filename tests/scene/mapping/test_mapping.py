"""Maps of the seabed: what ranges, poses and gridding leave of the truth, and the files of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain
from uuvsim_cosim.scene.mapping.map_files import write_geotiff, write_las, write_ply
from uuvsim_cosim.scene.mapping.mapping import (
    HeightGrid,
    SeabedMap,
    Track,
    Window,
    map_seabed,
    read_map,
    run_points,
    write_map,
)
from uuvsim_cosim.scene.mapping.scans import RangeSensor, frames, points, range_sensor, rotation
from uuvsim_cosim.scene.mapping.settings_file import settings_of_system
from uuvsim_cosim.scene.mapping.survey import read_settings
from uuvsim_cosim.scene.shared.ray_casting import Caster

Array = NDArray[np.float64]
SLOPE = (0.08, -0.05)


def plane() -> Terrain:
    x = np.arange(-30.0, 31.0, 5.0)
    n, e = np.meshgrid(x, x, indexing="ij")
    z = 20.0 + SLOPE[0] * n + SLOPE[1] * e
    return Terrain(z.astype(np.float32), 5.0, (-30.0, -30.0), crs="EPSG:32610", northing=5.2e6,
                   easting=5.4e5, vertical_datum="MLLW")  # fmt: skip


@pytest.fixture(scope="module")
def caster() -> Caster:
    return Caster(plane())


@pytest.fixture(scope="module")
def camera() -> RangeSensor:
    quiet = range_sensor("depth_camera", "camera_class", 1.0, columns=32, rows=24)
    return replace(quiet, sigma=0.0, bias_sigma=0.0)


def track(seconds: float = 20.0, **poses: Array) -> Track:
    """Return a straight way northwards, rolling and pitching, 5 m above the plane."""
    t = np.arange(0.0, seconds + 1e-9, 0.1)
    eta = np.zeros((len(t), 6))
    eta[:, 0] = -10.0 + t
    eta[:, 2] = 15.0 + SLOPE[0] * eta[:, 0]
    eta[:, 3], eta[:, 4], eta[:, 5] = 0.1 * np.sin(t), 0.1 * np.cos(t), 0.2
    return Track(t, {"true": eta, **{k: eta + v for k, v in poses.items()}}, seed=4)


@pytest.fixture(scope="module")
def made(caster: Caster, camera: RangeSensor) -> SeabedMap:
    aside = np.array([0.0, 0.0, 0.1, 0, 0, 0])
    found = map_seabed(track(navigation=aside), caster, [camera], 0.25, "plane")
    return replace(found, crs="EPSG:32610", northing=5.2e6, easting=5.4e5, vertical_datum="MLLW")


def test_points_of_a_true_pose_lie_on_the_seabed(caster: Caster, camera: RangeSensor) -> None:
    """Z = 20 + a N + b E, of every point, whatever the attitude and the lever arm."""
    way = track()
    eta = way.poses["true"]
    for frame in frames(camera, way.time, eta, caster):
        heard = np.isfinite(frame.range)
        p = points(camera, camera.in_body[heard], frame.range[heard], eta[frame.row])
        expected = 20.0 + SLOPE[0] * p[:, 0] + SLOPE[1] * p[:, 1]
        np.testing.assert_allclose(p[:, 2], expected, atol=2e-6)  # float32 nodes


def test_a_map_of_perfect_ranges_leaves_the_cells_alone_and_an_error_of_depth_passes(
    made: SeabedMap,
) -> None:
    true, navigation = made.figures
    assert true.rmse < 0.005
    assert abs(true.bias) < 2e-4
    assert navigation.bias == pytest.approx(0.1, abs=1e-3)
    assert made.points == 21 * 32 * 24


def test_an_error_aside_costs_the_slope_times_it(caster: Caster, camera: RangeSensor) -> None:
    aside = np.array([0.5, 0.0, 0.0, 0, 0, 0])
    found = map_seabed(track(navigation=aside), caster, [camera], 0.25)
    assert found.figures[1].bias == pytest.approx(-0.5 * SLOPE[0], abs=1e-3)


def test_noise_averages_out_over_the_points_of_a_cell(caster: Caster, camera: RangeSensor) -> None:
    noisy = replace(camera, sigma=0.1)
    found = map_seabed(track(5.0), caster, [noisy], 2.0)
    clean = map_seabed(track(5.0), caster, [camera], 2.0)
    assert 0.1 > found.figures[0].rmse > clean.figures[0].rmse
    assert abs(found.figures[0].bias) < 0.02


def test_a_bias_is_gauss_markov_and_of_the_seed_alone(camera: RangeSensor) -> None:
    drifting = replace(camera, bias_sigma=0.2, bias_tau=5.0)
    b = drifting.biases(20000, seed=1)
    assert b.std() == pytest.approx(0.2, rel=0.1)
    assert np.corrcoef(b[:-1], b[1:])[0, 1] == pytest.approx(np.exp(-0.2), abs=0.02)
    assert np.array_equal(b[:50], drifting.biases(50, seed=1))
    assert not np.array_equal(b[:50], drifting.biases(50, seed=2))


def test_a_frame_alone_has_the_bits_that_it_has_among_others(
    caster: Caster, camera: RangeSensor
) -> None:
    noisy = replace(camera, sigma=0.02, bias_sigma=0.01, dropout=0.1)
    way = track()
    whole = list(frames(noisy, way.time, way.poses["true"], caster, 7))
    some = list(frames(noisy, way.time, way.poses["true"], caster, 7, every=5))
    assert [f.row for f in some] == [f.row for f in whole[::5]]
    for a, b in zip(some, whole[::5], strict=True):
        np.testing.assert_array_equal(a.range, b.range)
    lost = np.mean([np.isnan(f.range).mean() for f in whole])
    assert lost == pytest.approx(0.1, abs=0.02)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 300), st.floats(0.05, 3.0), st.integers(0, 99))
def test_a_grid_is_the_mean_of_the_points_of_each_cell(n: int, cell: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = rng.uniform(-2, 2, (n, 3))
    window = Window.around(np.array([-1.0, -1.5]), np.array([1.0, 1.5]), 0.2, cell)
    grid = HeightGrid(window)
    for part in np.array_split(p, 3):
        grid.add(*part.T)
    i = np.floor((p[:, 0] - window.north) * (1 / cell)).astype(int)
    j = np.floor((p[:, 1] - window.east) * (1 / cell)).astype(int)
    z = grid.mean()
    for row, column in np.ndindex(*z.shape):
        own = p[(i == row) & (j == column), 2]
        assert (
            np.isnan(z[row, column])
            if len(own) == 0
            else z[row, column] == pytest.approx(own.mean(), abs=1e-12)
        )


def test_rotations_are_those_of_the_hull() -> None:
    from uuvsim_cosim.envs.tasks.coordinates import R_zyx

    angles = np.random.default_rng(1).uniform(-3, 3, (20, 3))
    for a, R in zip(angles, R_zyx(angles), strict=True):
        np.testing.assert_allclose(rotation(*a), R, atol=1e-15)


# ---- files -------------------------------------------------------------------------------------


def test_a_map_is_read_as_it_was_written(made: SeabedMap, tmp_path: Path) -> None:
    write_map(made, tmp_path)
    again = read_map(tmp_path)
    assert again is not None
    assert again.figures == made.figures
    assert again.window == made.window
    np.testing.assert_allclose(again.depth["true"], made.depth["true"], rtol=1e-6)
    (tmp_path / "map.npz").write_bytes(b"no map")
    with pytest.raises(InputInvalid, match=r"map\.npz: no map"):
        read_map(tmp_path)


def test_a_geotiff_lies_where_the_scene_does_with_elevations_up(
    made: SeabedMap, tmp_path: Path
) -> None:
    import rasterio

    file = write_geotiff(made, tmp_path / "map.tif")
    with rasterio.open(file) as tif:
        assert tif.crs.to_epsg() == 32610
        assert tif.nodata == -9999.0
        assert tif.tags()["VERTICAL_DATUM"] == "MLLW"
        (at,) = tif.sample([(5.4e5 + 0.1, 5.2e6 + 3.1)])
    assert at[0] == pytest.approx(-(20.0 + SLOPE[0] * 3.125 + SLOPE[1] * 0.125), abs=0.02)


@pytest.mark.parametrize("ending", ["laz", "las"])
def test_points_lie_where_the_scene_does(
    ending: str, caster: Caster, camera: RangeSensor, tmp_path: Path
) -> None:
    import laspy

    file = tmp_path / f"p.{ending}"
    given_ = np.concatenate(list(run_points(track(3.0), caster, [camera])))
    n = write_las([given_[:1000], given_[1000:]], file, "EPSG:32610", (5.2e6, 5.4e5))
    read = laspy.read(file)
    assert n == len(read.points) == len(given_)
    np.testing.assert_allclose(np.asarray(read.x) - 5.4e5, given_[:, 1], atol=6e-4)
    np.testing.assert_allclose(np.asarray(read.y) - 5.2e6, given_[:, 0], atol=6e-4)
    np.testing.assert_allclose(np.asarray(read.z), -given_[:, 2], atol=6e-4)
    assert read.header.parse_crs().to_epsg() == 32610


def test_a_ply_says_how_many_points_follow(tmp_path: Path) -> None:
    p = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    assert write_ply([p[:1], p[1:]], tmp_path / "p.ply") == 2
    head, _, body = (tmp_path / "p.ply").read_bytes().partition(b"end_header\n")
    assert int(head.split(b"element vertex")[1].split()[0]) == 2
    np.testing.assert_array_equal(
        np.frombuffer(body, "<f4").reshape(-1, 3), [[2, 1, -3], [5, 4, -6]]
    )


# ---- what is refused ---------------------------------------------------------------------------


def test_a_vehicle_beside_or_far_above_its_terrain_is_refused(
    caster: Caster, camera: RangeSensor
) -> None:
    way = track()
    beside = Track(way.time, {"true": way.poses["true"] + [500, 0, 0, 0, 0, 0]})
    with pytest.raises(InputInvalid, match="is nowhere above the terrain"):
        map_seabed(beside, caster, [camera])
    high = Track(way.time, {"true": way.poses["true"] - [0, 0, 14, 0, 0, 0]})
    with pytest.raises(InputInvalid, match=r"no part of the seabed was seen \(.* 0.3 to 4 m"):
        map_seabed(high, caster, [replace(camera, far=4.0)])


SETTINGS: dict[str, tuple[str, str]] = {
    "no sensor": ("scene: hills\nsensors: []\n", "mapping.yaml.*sensors"),
    "unknown kind": ("scene: hills\nsensors:\n- {kind: lidar, preset: x, period: 1}\n", "lidar"),
    "unknown preset": (
        "scene: hills\nsensors:\n- {kind: multibeam, preset: x9, period: 1}\n", "x9.*expected",
    ),
    "beams of a camera": (
        "scene: hills\nsensors:\n- {kind: depth_camera, preset: camera_class, period: 1, beams: 9}",
        "a depth_camera has no beams; expected columns and rows",
    ),
    "component and more": ("scene: hills\nsensors:\n- {component: a, period: 1}\n", "component"),
    "period 0": ("scene: hills\nsensors:\n- {kind: multibeam, preset: p900, period: 0}\n", "0"),
}  # fmt: skip


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_that_cannot_be_meant_are_refused(name: str, tmp_path: Path) -> None:
    text, words = SETTINGS[name]
    (tmp_path / "mapping.yaml").write_text(text)
    with pytest.raises(UuvsimError, match=words):
        read_settings(tmp_path / "mapping.yaml")


def test_the_survey_that_ships_maps_and_other_systems_do_not() -> None:
    file = settings_of_system("seabed_mapping")
    assert file is not None
    found = read_settings(file)
    assert [len(s.directions) for s in found.sensors] == [160 * 120]
    assert found.components == ("multibeam",)
    assert settings_of_system("bluerov2_survey") is None


# ---- a run, from the command line --------------------------------------------------------------


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 6 s, written by hand: no vehicle needs to be simulated to be mapped."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder = tmp_path_factory.mktemp("run")
    save_terrain(plane(), folder / "plane.npz")
    way = track(6.0)
    columns = {"time": way.time, "tick": np.arange(len(way.time))}
    fields = [pa.field("time", pa.float64()), pa.field("tick", pa.int64())]
    for component, offset in (("hull", 0.0), ("navigation", 0.05)):
        for i in range(6):
            name = f"{component}.eta[{i + 1}]"
            columns[name] = way.poses["true"][:, i] + (offset if i == 2 else 0.0)
            about = {"path": component, "variable": "eta", "index": str(i + 1), "unit": "m"}
            fields.append(pa.field(name, pa.float64(), metadata=about))
    schema = pa.schema(fields, metadata={"uuvsim": json.dumps({"seed": 4})})
    pq.write_table(pa.table(list(columns.values()), schema=schema), folder / "signals.parquet")
    (folder / "mapping.yaml").write_text(
        "scene: plane.npz\ncell: 0.5\nsensors:\n"
        "- {kind: depth_camera, preset: camera_class, period: 1, columns: 20, rows: 15}\n"
    )
    return folder


@pytest.mark.parametrize("ending", ["tif", "laz", "ply"])
def test_the_command_makes_a_map_and_its_files(
    ending: str, run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from uuvsim_cosim.cli import status_of

    out = tmp_path / f"map.{ending}"
    assert status_of(["map", str(run_folder), "-o", str(out), "--every", "2"]) == 0
    said = capsys.readouterr().out
    assert "map RMSE, true pose" in said
    assert "map RMSE, navigation's pose" in said
    assert out.stat().st_size > 500


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--every", "0"], "--every 0: expected 1 or more"),
        (["-o", "map.xyz"], "expected a name that ends with .tif"),
        (["--pose", "odometry"], "--pose odometry: expected true or navigation"),
        (["--scene", "atlantis"], "no scene 'atlantis'"),
        (["--cell", "-1"], "cell -1.0 m; expected more than 0"),
        (["-o", "/no/such/folder/map.tif"], "its folder does not exist"),
    ],
)
def test_options_that_cannot_be_meant_are_one_sentence(
    options: list[str], words: str, run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from uuvsim_cosim.cli import status_of

    assert status_of(["map", str(run_folder), *options]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("ending", "library"),
    [("tif", "rasterio"), ("las", "laspy"), ("laz", "laspy"), ("laz", "lazrs")],
)
def test_a_missing_library_is_named_before_anything_is_computed(
    ending: str, library: str, run_folder: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    import sys

    from uuvsim_cosim.cli import status_of
    from uuvsim_cosim.scene.mapping import survey

    def compute(*given: object) -> None:
        raise AssertionError("the track was read")

    monkeypatch.setitem(sys.modules, library, None)  # as if it were not installed
    monkeypatch.setattr(survey, "track_of_run", compute)
    assert status_of(["map", str(run_folder), "-o", f"{run_folder}/map.{ending}"]) == 2
    said = capsys.readouterr().err
    assert f"needs {library}" in said
    assert "pip install 'uuvsim-cosim[scene]'" in said


def test_readings_of_a_component_in_the_loop_make_the_map(tmp_path: Path) -> None:
    """A camera that moves with its hull: its recorded frames, not others, and its own mounting."""
    from uuvsim_cosim.orchestrator.running.run import run
    from uuvsim_cosim.orchestrator.system.system import System
    from uuvsim_cosim.scene.mapping.survey import SurveySettings, survey_of

    save_terrain(plane(), tmp_path / "plane.npz")
    camera = f"model:depth_camera?scene={tmp_path}/plane.npz&period=0.25&columns=24&rows=18"
    system = System("s", "0.05").add("hull", "model:sphere").add("camera", camera)
    for name in ("eta", "q"):
        system = system.connect(f"hull.{name}", f"camera.{name}")
    system = system.set("hull.eta_0", [0, 0, 15.0, 0.2, 0, 1.0]).set("camera.r_s", [0.3, 0, 0.1])
    for name in ("sigma_range", "sigma_range_relative", "image_bias_sigma", "dropout"):
        system = system.set(f"camera.{name}", 0.0)
    system = system.set("hull.nu_0", [0.5, 0, 0, 0, 0, 0])
    folder = run(system, until=2.0, out=tmp_path / "run", backend="native").folder
    survey = survey_of(folder, SurveySettings(f"{tmp_path}/plane.npz", 0.5, (), ("camera",)))
    made = survey.map()
    assert made.points == 8 * 24 * 18  # t = 0 to 1.75 s
    assert made.figures[0].rmse < 0.02  # of cells half a metre wide on a slope of 9 %
    for xyz in run_points(survey.track, survey.caster, survey.settings.sensors):
        expected = 20.0 + SLOPE[0] * xyz[:, 0] + SLOPE[1] * xyz[:, 1]
        np.testing.assert_allclose(xyz[:, 2], expected, atol=3e-6)
    for component, words in (("hull", "hull is model:sphere; expected"), ("x", "component 'x'")):
        with pytest.raises(InputInvalid, match=words):
            survey_of(folder, SurveySettings("hills", 0.5, (), (component,)))


@pytest.mark.parametrize("ending", ["tif", "laz", "las", "ply"])
def test_a_disk_that_is_full_is_said_and_what_was_there_stays(
    ending: str, run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from resource import RLIMIT_FSIZE, getrlimit, setrlimit

    from uuvsim_cosim.cli import status_of

    out = tmp_path / f"map.{ending}"
    out.write_text("before")
    assert status_of(["map", str(run_folder)]) == 0
    before = getrlimit(RLIMIT_FSIZE)
    setrlimit(RLIMIT_FSIZE, (200, before[1]))  # no file may grow beyond it
    try:
        status = status_of(["map", str(run_folder), "-o", str(out), "--every", "1"])
    finally:
        setrlimit(RLIMIT_FSIZE, before)
    assert status == 2
    assert f"{out}: cannot be written" in capsys.readouterr().err
    assert out.read_text() == "before"
    assert list(tmp_path.iterdir()) == [out]


def test_a_report_shows_the_map(made: SeabedMap) -> None:
    from uuvsim_cosim.view.reports.survey_map import map_figures, map_pictures, map_section

    assert [f.key for f in map_figures(made)] == ["map_true", "map_navigation", "map_points"]
    pictures = map_pictures(made)
    assert list(pictures) == ["depth", "error, true pose", "error, navigation's pose"]
    depth, _ = pictures["depth"]
    assert depth.shape[:2] == made.truth.shape  # small enough to be shown whole
    # North is up and the seabed falls northwards: the top is darker.
    seen = depth.reshape(len(depth), -1).mean(axis=1)
    assert seen[len(seen) // 4] < seen[3 * len(seen) // 4]
    html = map_section(made, {"truth": track().poses["true"][:, :2]})
    assert html.count("data:image/png;base64,") == 3
    assert len(html) < 400_000
    w, eta = made.window, track().poses["true"]
    first = f"M{eta[0, 1] - w.east:.2f} {w.north + w.rows * w.cell - eta[0, 0]:.2f}L"
    assert html.count('class="line truth"') == html.count(f'd="{first}') == 1


def test_a_frame_is_what_the_component_measures_at_the_same_pose() -> None:
    """A multibeam without errors, in C, over the hills; incidence is no limit here."""
    from uuvsim_cosim.fmus.codegen.native import Native
    from uuvsim_cosim.models.declaration.library import declare

    c = Native(declare("multibeam", id="p900", scene="hills", beams=24), "multibeam")
    v = c.description.variables
    eta = np.array([12.0, -30.0, 20.0, 0.1, -0.2, 2.0])
    roll, pitch, yaw = 0.5 * eta[3:]
    cos, sin = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    q = [
        cos[0] * cos[1] * cos[2] + sin[0] * sin[1] * sin[2],
        sin[0] * cos[1] * cos[2] - cos[0] * sin[1] * sin[2],
        cos[0] * sin[1] * cos[2] + sin[0] * cos[1] * sin[2],
        cos[0] * cos[1] * sin[2] - sin[0] * sin[1] * cos[2],
    ]
    quiet = dict.fromkeys(
        ("sigma_range", "sigma_range_relative", "range_bias_sigma", "dropout"), 0.0
    )
    for name, value in {**quiet, "eta": eta, "q": np.array(q), "incidence_max": 1.57}.items():
        c.set(v[name], value)
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    c.do_step(0.0, 0.1)
    measured = np.asarray(c.get(v["range"]))
    own = range_sensor("multibeam", "p900", 0.1, beams=24)
    own = replace(own, sigma=0.0, bias_sigma=0.0, dropout=0.0)
    time, way = np.array([0.0, 0.1]), np.array([eta, eta])
    frame = next(frames(own, time, way, Caster("hills")))
    heard = np.isfinite(frame.range)
    assert heard.sum() > 20
    np.testing.assert_allclose(measured[heard], frame.range[heard], atol=1e-9)
    assert np.all(measured[~heard] == 0.0)
