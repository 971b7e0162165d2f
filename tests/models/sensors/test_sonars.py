"""Sonars as components: the same image by C, by numpy, natively and as FMU; what each shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_here
from uuvsim_cosim.models.acoustics.absorption import francois_garrison
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.sensors.sonar_component import sonar_of
from uuvsim_cosim.models.worlds.obstacles import Sphere
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.sonar_geometry import array_pattern
from uuvsim_cosim.models.worlds.terrain import Terrain

SONARS: dict[str, dict[str, Any]] = {
    "imaging_sonar": {"beams": 7, "bins": 30, "columns": 24, "rays": 10, "range_max": 25},
    "multibeam_sonar": {"beams": 7, "bins": 30, "columns": 24, "rays": 3, "range_max": 25},
    "scanning_sonar": {"bins": 30, "columns": 5, "rays": 20, "range_max": 25, "sector": 60},
    "side_scan_sonar": {"bins": 30, "columns": 5, "rays": 20, "range_max": 25},
}
SIZE = SONARS["imaging_sonar"]
ETA, Q = [0.0, 1.0, 8.0, 0.0, 0.0, 0.3], [np.cos(0.15), 0.0, 0.0, np.sin(0.15)]
GIVEN: dict[str, Any] = {"eta": ETA, "q": Q, "seed": [3, 5]}


@pytest.fixture(scope="module")
def hills(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Hills with a ball on them, in front of the sonar."""
    x = np.arange(40) - 20.0
    z = 14 + np.sin(x[:, None] / 4) * np.cos(x[None, :] / 5)
    folder: Path = tmp_path_factory.mktemp("hills")
    terrain = Terrain(z.astype(np.float32), 1.5, (-30.0, -30.0))
    save_scene(Scene("hills", terrain, (Sphere((9, 4, 12), 1.5),), None, "hills", "made"), folder)
    return str(folder)


def step(component: Any, n: int = 40, **values: Any) -> dict[str, Any]:
    """Set values, step n times 10 ms, return the outputs."""
    variables = component.description.variables
    for name, value in values.items():
        component.set(variables[name], np.asarray(value) if np.ndim(value) else value)
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    for k in range(n):
        component.do_step(k * 0.01, 0.01)
    return {k: component.get(v) for k, v in variables.items() if v.causality == "output"}


def image(scene: str, options: dict[str, Any] | None = None, **values: Any) -> dict[str, Any]:
    return step(
        Native(declare("imaging_sonar", scene=scene, **SIZE | (options or {})), "s"),
        **GIVEN | values,
    )


@pytest.mark.parametrize("which", SONARS)
def test_c_agrees_with_the_model_in_numpy(hills: str, which: str) -> None:
    options = {"complex": True, "labels": True, "others": 1, "shading": "none", "absorption": 0.3}
    model = declare(which, scene=hills, **SONARS[which] | options)
    given = {"eta": ETA, "q": Q, "other_eta_1": [6.0, -1.0, 11.0, 0.1, 0.2, 0.3]}
    parameters = {"other_size": [[0.4, 0.8]]}
    found = step(Native(model, "s"), **given, **parameters)
    wanted = simulate(model, until=0.4, h=0.01, inputs=given, parameters=parameters)
    for v in model.of_kind("output"):
        a, b = np.ravel(found[v.name]).astype(float), np.ravel(wanted[v.name][-1])
        np.testing.assert_allclose(a, b, atol=1e-5 * max(1.0, np.abs(b).max()), err_msg=v.name)
    assert found["valid"]
    if which == "imaging_sonar":
        assert set(np.ravel(found["label"])) == {0, 1, 2, 3}  # nothing, bed, ball, the other


PATHS = {
    "profile": "2:1510,6:1508,9:1490,13:1493", "segments": 3, "surface_bounce": 2e-4,
    "bottom_bounce": 1e-4,
}  # fmt: skip
UP = {  # of a sonar that looks at the surface and at the bed, near both
    "eta": [0.0, 1.0, 4.0, 0.1, 0.45, 0.3],
    "q": [0.96431, 0.0148734, 0.22760596, 0.1344639],
}


@pytest.mark.parametrize("pose", [{"eta": ETA, "q": Q}, UP])
def test_c_agrees_with_numpy_on_rays_that_bend_and_bounce(hills: str, pose: dict[str, Any]) -> None:
    options = {"complex": True, "labels": True, "shading": "none", "water": "inputs"}
    model = declare("imaging_sonar", scene=hills, **SIZE | options | PATHS)
    parameters = {"sound_speed": 1480.0, "pH": 7.9}
    given = pose | {"temperature": 15.0, "salinity": 33.0}
    found = step(Native(model, "s"), **given, **parameters)
    wanted = simulate(model, until=0.4, h=0.01, inputs=given, parameters=parameters)
    for v in model.of_kind("output"):
        a, b = np.ravel(found[v.name]).astype(float), np.ravel(wanted[v.name][-1])
        np.testing.assert_allclose(a, b, atol=2e-5 * max(1.0, np.abs(b).max()), err_msg=v.name)
    plain = step(Native(declare("imaging_sonar", scene=hills, **SIZE | options), "s"), **given)
    assert np.any(np.asarray(found["magnitude"]) != np.asarray(plain["magnitude"]))


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_has_the_native_bits_of_rays_that_bend_and_bounce(
    hills: str, tmp_path: Path, fmi: Any
) -> None:
    model = declare("imaging_sonar", scene=hills, labels=True, **SIZE | PATHS)
    wanted = step(Native(model, "s"), **GIVEN | UP)
    component = instantiate_here(
        read_fmu(build_fmu(model, fmi=fmi, target=tmp_path / "sonar.fmu")), "s"
    )
    found = step(component, **GIVEN | UP)
    component.free()
    for name, value in found.items():
        np.testing.assert_array_equal(value, wanted[name], err_msg=name)


@pytest.mark.parametrize("source", [-100.0, 220.0])
def test_the_absorption_follows_the_water(hills: str, source: float) -> None:
    """Noise is raised by the gain of 2 alpha r; echoes, which have lost as much, stay."""
    noise = 70.0 if source < 0 else -200.0
    images, alphas = [], []
    for T, S in ((4.0, 35.0), (20.0, 31.0)):
        water = {"temperature": T, "salinity": S, "absorption_depth": 8.0}
        images.append(image(hills, source_level=source, noise_level=noise, **water)["magnitude"])
        alphas.append(float(francois_garrison(900e3, T, S, 8.0)))
    ranges = 1.0 + (np.arange(30) + 0.5) * 24 / 30
    gained = 2 * (alphas[1] - alphas[0]) * ranges * (source < 0)
    levels = 20 * np.log10([np.reshape(i, (7, 30)) + 1e-30 for i in images])
    seen = levels[0] > levels[0].max() - (np.inf if source < 0 else 60.0)
    assert seen.sum() > 30
    wanted = np.tile(gained, (7, 1))
    # An image adds echoes of several ranges, each with its own loss, before the gain.
    close = 0.05 if source < 0 else 0.6
    np.testing.assert_allclose((levels[1] - levels[0])[seen], wanted[seen], atol=close)
    assert abs(alphas[1] - alphas[0]) > 0.05


def test_water_beyond_the_formulas_range_is_reported(hills: str) -> None:
    given = {"water": "inputs", "frequency": 450e3}
    for salinity, known in ((34.0, True), (7.7, False)):
        found = image(hills, given, temperature=10.0, salinity=salinity)
        assert found["water_known"] == known
    assert found["absorption"] == pytest.approx(
        float(francois_garrison(450e3, 10.0, 30.0, 8.0)), rel=1e-3
    )


def test_another_frequency_changes_beams_absorption_and_backscatter() -> None:
    """With half the frequency, an array of the same length has a beam twice as wide."""
    p = preset("sensors", "p900", "imaging_sonar")
    own, half = (sonar_of(p, frequency=f, bins=10) for f in (0, 450e3))
    u = half.u[np.abs(half.weight[:, 256]).argmax()]
    for g, width in ((own, np.radians(1.0)), (half, 2 * np.arcsin(2 * np.sin(np.radians(0.5))))):
        wanted = array_pattern(g.u - np.sin(g.bearings[256]), width, "hann")
        kept = np.abs(g.weight[:, 256]) > 0.0
        np.testing.assert_allclose(g.weight[kept, 256], wanted[kept], atol=2e-6)
    assert abs(u) < 0.01
    assert half.theta[-1] / own.theta[-1] == pytest.approx(
        np.arcsin(2 * np.sin(np.radians(10))) / np.radians(10), rel=1e-6
    )
    found = {f: declare("imaging_sonar", **SIZE, frequency=f) for f in (900e3, 450e3)}
    assert "at 900 kHz: Lambert" in found[900e3].description
    assert "at 450 kHz: Lambert" in found[450e3].description
    assert [m.starts()["frequency"].item() for m in found.values()] == [900e3, 450e3]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("which", SONARS)
def test_an_fmu_has_the_bits_of_the_native_component(
    hills: str, tmp_path: Path, fmi: Any, which: str
) -> None:
    model = declare(which, scene=hills, labels=True, **SONARS[which])
    wanted = step(Native(model, "s"), **GIVEN)
    path = build_fmu(model, fmi=fmi, target=tmp_path / "sonar.fmu")
    component = instantiate_here(read_fmu(path), "s")
    found = step(component, **GIVEN)
    component.free()
    for name, value in found.items():
        np.testing.assert_array_equal(value, wanted[name], err_msg=name)
    left_out = {"magnitude", "label"} if fmi == 2 else set()
    assert set(wanted) - set(found) == left_out


def test_an_fmi_2_description_names_what_is_left_out(tmp_path: Path) -> None:
    path = build_fmu(declare("imaging_sonar", complex=True), fmi=2, target=tmp_path / "sonar.fmu")
    text = read_fmu(path).description.description
    assert text.endswith("not in FMI 2.0: imaginary, magnitude, real")


def test_an_equal_pose_gives_equal_bits_and_another_one_another_speckle(hills: str) -> None:
    one, same = (image(hills, noise_level=-200.0)["magnitude"] for _ in range(2))
    np.testing.assert_array_equal(one, same)
    moved = image(hills, noise_level=-200.0, eta=[0.5, *ETA[1:]])["magnitude"]
    assert np.corrcoef(one, moved)[0, 1] < 0.9


def test_the_mean_and_the_peak_are_those_of_the_magnitudes(hills: str) -> None:
    found = image(hills)
    assert found["mean"] == pytest.approx(np.mean(found["magnitude"]), rel=1e-6)
    assert found["peak"] == np.max(found["magnitude"])


def test_only_noise_is_no_range(hills: str) -> None:
    found = image(hills, source_level=-100.0)
    assert not found["valid"]
    assert not np.any(found["range"])
    assert np.all(found["magnitude"] > 0.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"bins": 200_000}, "at most"),
        ({"beams": -1}, "1 or more of each"),
        ({"tvg": 35}, "0, 10, 20, 30, 40"),
        ({"shading": "round"}, "none, hamming, hann"),
        ({"range_max": 0.5}, "rising"),
        ({"columns": 2}, "one within a beam"),
        ({"seabed": "porridge"}, "material 'porridge': there is none"),
        ({"solid": "cheese", "others": 1}, "material 'cheese': there is none"),
        ({"scene": "flat", "solid": "cheese"}, "material 'cheese': there is none"),
        ({"range_max": float("inf")}, "finite"),
        ({"beams": 1}, "1 beams of width"),
        ({"beams": 100_000, "bins": 1}, "at most 8192"),
        ({"columns": 40_000, "rays": 1}, "at most 8192 columns"),
        ({"rays": 100_000_000}, "2000000 rays of a ping"),
        ({"law": "apl_uw"}, "900000 Hz"),
        ({"law": "newton"}, "auto, apl_uw, lambert"),
        ({"absorption": "none"}, "francois_garrison, ainslie_mccolm"),
        ({"absorption": -1}, "0 or more"),
        ({"complex": "perhaps"}, "true, false"),
        ({"frequency": "high"}, "frequency = high; expected a number"),
        ({"frequency": -1}, "0 for the preset's own"),
        ({"frequency": 2e6}, r"frequency 2e\+06 Hz; expected 500000 to 1e\+06 Hz"),
        ({"frequency": 1e3}, "still forms a beam"),
        ({"water": "sea"}, "parameters or inputs"),
        ({"water": "inputs", "absorption": 0.1}, "a formula: francois_garrison or ainslie"),
        ({"profile": "0:1500,0:1490"}, "depths that rise"),
        ({"profile": "0:-1500"}, "1300 to 1800 m/s"),
        ({"profile": "deep"}, "0:1500,20:1490"),
        ({"profile": "0:1500,20:1490", "segments": 0}, "segments = 0; expected 1 to 1000"),
        ({"surface_bounce": "rough"}, "off, or the rms height"),
        ({"bottom_bounce": -0.1}, "bottom_bounce = -0.1; expected off"),
    ],
)
def test_a_wrong_option_is_refused_by_one_message(options: dict[str, Any], words: str) -> None:
    with pytest.raises((ParameterInvalid, InputInvalid), match=words):
        declare("imaging_sonar", **SIZE | options)


def test_a_frequency_beyond_the_range_of_the_formula_is_refused(tmp_path: Path) -> None:
    shipped = content("models", "sensors", "p900", "imaging_sonar.yaml").read_text()
    (tmp_path / "high.yaml").write_text(shipped.replace("value: 900000", "value: 1200000"))
    with pytest.raises(InputInvalid, match=r"frequency 1\.2e\+06 Hz"):
        declare("imaging_sonar", id=str(tmp_path / "high.yaml"))
    declare("imaging_sonar", id=str(tmp_path / "high.yaml"), absorption=0.5)


@pytest.fixture(scope="module")
def post(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A level bed at 20 m, and a ball 10 m to starboard of the origin."""
    folder: Path = tmp_path_factory.mktemp("post")
    level = Terrain(np.full((2, 2), 20.0, np.float32), 2000.0, (-1000.0, -1000.0))
    save_scene(Scene("post", level, (Sphere((0, 10, 18), 1.0),), None, "post", "made"), folder)
    return str(folder)


def still(
    which: str, scene: str, depth: float = 15.0, n: int = 1, **options: Any
) -> dict[str, Any]:
    model = declare(which, scene=scene, labels=True, range_max=25, **options)
    return step(Native(model, "s"), n, eta=[0, 0, depth, 0, 0, 0], r_s=[0, 0, 0])


def test_a_side_scan_shows_a_ball_to_starboard_in_its_second_beam(post: str) -> None:
    port, starboard = still("side_scan_sonar", post, bins=200)["label"].reshape(2, 200)
    assert not np.any(port == 2)
    ranges = 0.5 + (np.flatnonzero(starboard == 2) + 0.5) * 24.5 / 200
    assert ranges.min() == pytest.approx(np.hypot(10, 3) - 1.0, abs=0.1)
    first = 0.5 + (np.flatnonzero(port == 1)[0] + 0.5) * 24.5 / 200
    assert first == pytest.approx(5.0, abs=0.5)  # the bed below


def test_a_scanning_sonar_shows_the_ball_at_its_bearing_and_begins_anew(post: str) -> None:
    options = {"period": "0.01", "sector": 240, "step": 10, "bins": 50}
    c = Native(declare("scanning_sonar", scene=post, labels=True, range_max=25, **options), "s")
    v = c.description.variables
    c.set(v["eta"], np.array([0.0, 0, 18, 0, 0, 0]))
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    bearings, seen = [], []
    for k in range(48):
        c.do_step(k * 0.01, 0.01)
        bearings.append(float(c.get(v["bearing"])))
        seen.append(bool(np.any(np.asarray(c.get(v["label"])) == 2)))
    np.testing.assert_allclose(np.degrees(bearings[:24]), np.arange(-115, 120, 10), atol=1e-9)
    assert bearings[24:] == bearings[:24]
    assert {round(np.degrees(b)) for b, s in zip(bearings, seen, strict=True) if s} == {85, 95}


def test_a_vehicle_that_turns_during_a_scan_sees_a_ball_in_every_ping(post: str) -> None:
    options = {"period": "0.01", "sector": 240, "step": 10, "bins": 50}
    c = Native(declare("scanning_sonar", scene=post, labels=True, range_max=25, **options), "s")
    v = c.description.variables
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    for k in range(5):
        c.do_step(k * 0.01, 0.01)
        yaw = np.radians(90 + 115 - 10 * (k + 1))  # the head's bearing: -115 deg + 10 deg a ping
        c.set(v["eta"], np.array([0.0, 0, 18, 0, 0, yaw]))
        c.set(v["q"], np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]))
        if k:
            assert np.any(np.asarray(c.get(v["label"])) == 2)


def test_the_pings_of_a_side_scan_follow_a_vehicle_that_dives(post: str) -> None:
    options = {"period": "0.01", "bins": 200, "labels": True, "range_max": 25}
    c = Native(declare("side_scan_sonar", scene=post, **options), "s")
    v = c.description.variables
    c.set(v["r_s"], np.zeros(3))
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    for k, depth in enumerate((8.0, 11.0, 14.0, 17.0)):
        c.set(v["eta"], np.array([0.0, 0, depth, 0, 0, 0]))
        c.do_step(k * 0.01, 0.01)
        port = np.asarray(c.get(v["label"])).reshape(2, 200)[0]
        first = 0.5 + (np.flatnonzero(port == 1)[0] + 0.5) * 24.5 / 200
        assert first == pytest.approx(20.0 - depth, abs=0.5)


def test_a_multibeam_sonar_measures_the_depth_of_a_level_bed(post: str) -> None:
    found = still("multibeam_sonar", post, depth=10.0, beams=33, bins=500, rays=16)
    angles = np.radians(130) * (np.arange(33) / 32 - 0.5)
    inner = np.abs(angles) < np.radians(40)
    depth = found["range"] * np.cos(angles)
    assert np.median(depth[inner]) == pytest.approx(10.0, abs=0.15)
    assert np.all(np.abs(depth[inner] - 10.0) < 1.0)


def test_a_sonar_above_the_water_or_in_a_solid_has_noise_alone(post: str) -> None:
    for eta in ([0, 0, -2.0, 0, 0, 0], [0, 10.0, 18.0, 0, 0, 0]):
        model = declare("imaging_sonar", scene=post, **SIZE)
        found = step(Native(model, "s"), 1, eta=eta, r_s=[0, 0, 0])
        assert not found["valid"]
