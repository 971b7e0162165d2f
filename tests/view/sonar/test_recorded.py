"""Images of the real component: a run with a sonar, its pictures, arrays and messages."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Sphere
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.view.reports.run_report import write_report
from uuvsim_cosim.view.sonar.pictures import waterfall
from uuvsim_cosim.view.sonar.recorded import scans_of_run
from uuvsim_cosim.view.sonar.xtf import read_xtf

BALL = (12.0, 3.0, 6.5)  # m; on a level bottom at 8 m
SONAR = "model:imaging_sonar?beams=24&bins=60&range_max=25&labels=true&complex=true&scene="


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run a vehicle that holds its place, 4 m above a level bottom, with a ball ahead."""
    folder = tmp_path_factory.mktemp("scene")
    terrain = Terrain(np.full((9, 9), 8.0, np.float32), 10.0, (-40.0, -40.0))
    ball = Sphere(BALL, 0.8, name="ball")
    save_scene(Scene("made", terrain, (ball,), None, "a ball", "made"), folder)
    system = (
        uuv.load("bluerov2_hold")
        .add("sonar", SONAR + str(folder))
        .connect("hull.eta", "sonar.eta")
        .connect("hull.q", "sonar.q")
        .set("hull.eta_0", [0.0, 0.0, 4.0, 0.0, 0.0, 0.0])
    )
    out = tmp_path_factory.mktemp("run") / "r"
    uuv.run(system, until=1.0, out=out)
    return out


def test_a_run_has_the_pings_of_its_sonar_with_axes_and_poses(run: Path) -> None:
    scans = scans_of_run(run)
    assert scans.name == "sonar"
    assert scans.magnitude.shape == (len(scans), 24, 60)
    assert scans.time == pytest.approx(0.2 * np.arange(len(scans)))
    assert scans.ranges[[0, -1]] == pytest.approx([1.2, 24.8])
    assert np.degrees(scans.bearings[[0, -1]]) == pytest.approx([-45.0, 45.0], abs=0.01)
    assert (scans.frequency, scans.sound_speed) == (900e3, 1500.0)
    assert scans.eta is not None
    assert scans.eta[0, 2] == pytest.approx(4.0, abs=0.2)
    assert scans.shown == ("no echo", "seabed", "ball")
    assert scans.pressure is not None
    assert np.abs(scans.pressure) == pytest.approx(scans.magnitude, rel=1e-4, abs=1e-9)


def test_the_ball_has_its_label_at_its_range_and_bearing(run: Path) -> None:
    scans = scans_of_run(run)
    assert scans.labels is not None
    assert scans.eta is not None
    beam, at = np.argwhere(scans.labels[0] == 2).mean(axis=0).round().astype(int)
    ahead = np.array(BALL) - scans.eta[0, :3]
    assert scans.ranges[at] == pytest.approx(np.linalg.norm(ahead) - 0.8, abs=0.8)
    assert scans.bearings[beam] == pytest.approx(np.arctan2(ahead[1], ahead[0]), abs=0.1)


@pytest.mark.parametrize("ending", ["png", "webp", "npz"])
def test_export_writes_the_images(uuvsim: Uuvsim, run: Path, tmp_path: Path, ending: str) -> None:
    out = tmp_path / f"image.{ending}"
    status, text, err = uuvsim("export", str(run), "-o", str(out))
    assert (status, err) == (0, "")
    assert "sonar: " in text
    assert "pings of 24 beams and 60 bins" in text
    assert out.stat().st_size > 1000


def test_export_shows_labels_and_a_smaller_span(uuvsim: Uuvsim, run: Path, tmp_path: Path) -> None:
    for words in (("--picture", "labels"), ("--picture", "polar", "--span", "30")):
        out = str(tmp_path / "a.png")
        assert uuvsim("export", str(run), "-o", out, "--sonar", "sonar", *words)[0] == 0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("-o a.xtf", "expected a side-scan sonar"),
        ("-o a.png --picture waterfall", "expected a side-scan sonar"),
        ("-o a.png --sonar dvl", "no sonar 'dvl'; expected one of sonar"),
        ("-o a.png --span 0", "span 0 dB; expected numbers above 0"),
        ("-o a.csv --picture fan", "expected a file .png, .webp"),
        ("-o a.npz --span 30", "expected a file .png, .webp"),
        ("-o a.mcap --sonar sonar", "expected a file .png, .webp, .npz, .xtf"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    uuvsim: Uuvsim, run: Path, words: str, expected: str
) -> None:
    status, _, err = uuvsim("export", str(run), *words.split())
    assert status == 2
    assert expected in " ".join(err.split())


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run a vehicle with a side-scan, a scanning and a multibeam sonar over a level bottom."""
    folder = tmp_path_factory.mktemp("scene")
    terrain = Terrain(np.full((9, 9), 8.0, np.float32), 10.0, (-40.0, -40.0))
    ball = Sphere((1.0, 6.0, 7.0), 0.8, name="ball")
    save_scene(Scene("made", terrain, (ball,), None, "a ball", "made"), folder)
    sources = {
        "side": "side_scan_sonar?bins=80&rays=48",
        "scanning": "scanning_sonar?bins=40&rays=16&sector=120&step=30",
        "multibeam": "multibeam_sonar?beams=9&bins=40",
    }
    system = uuv.load("bluerov2_hold").set("hull.eta_0", [0.0, 0.0, 4.0, 0.0, 0.0, 0.0])
    for name, source in sources.items():
        system = system.add(name, f"model:{source}&range_max=20&scene={folder}")
        system = system.connect("hull.eta", f"{name}.eta")
        system = system.connect("hull.q", f"{name}.q")
    out = tmp_path_factory.mktemp("run") / "r"
    uuv.run(system, until=1.2, out=out)
    return out


def test_the_waterfall_of_a_side_scan_shows_the_bottom_from_its_altitude_on(survey: Path) -> None:
    scans = scans_of_run(survey, "side")
    assert scans.is_side_scan
    assert len(scans) == 12
    level = scans.magnitude.mean(axis=0)
    water = scans.ranges < 3.2  # the sonar is 4 m above the bottom
    for side in (0, 1):
        assert level[side, ~water].max() > 30 * level[side, water].max()
    rows, slant = waterfall(scans, scans.magnitude)
    assert rows.shape == (12, 160)
    assert slant[[0, -1]] == pytest.approx([-scans.ranges[-1], scans.ranges[-1]])


def test_a_side_scan_is_exported_as_xtf(uuvsim: Uuvsim, survey: Path, tmp_path: Path) -> None:
    out = tmp_path / "side.xtf"
    status, text, _ = uuvsim("export", str(survey), "-o", str(out), "--sonar", "side")
    assert status == 0
    assert "12 pings of 2 beams and 80 bins" in text
    found, scans = read_xtf(out), scans_of_run(survey, "side")
    assert found.magnitude / found.magnitude.max() == pytest.approx(
        scans.magnitude / scans.magnitude.max(), abs=2e-5
    )


def test_the_pings_of_a_scanning_sonar_are_one_image_a_scan(survey: Path) -> None:
    scans = scans_of_run(survey, "scanning")
    assert np.degrees(scans.bearings) == pytest.approx([-45.0, -15.0, 15.0, 45.0])
    assert scans.magnitude.shape == (len(scans), 4, 40)
    assert scans.time[0] == pytest.approx(0.3)
    assert (scans.magnitude[0].max(axis=1) > 0).all()
    recorded = uuv.read_signals(survey)
    sample, image = recorded["scanning.t_sample"], recorded["scanning.magnitude"]
    for beam in range(4):
        ping = image[np.flatnonzero(np.isclose(sample, 0.1 * beam))[0]]
        assert np.array_equal(scans.magnitude[0, beam], ping.astype(np.float32))


def test_a_multibeam_looks_down_and_finds_the_bottom(survey: Path) -> None:
    scans = scans_of_run(survey, "multibeam")
    assert scans.downward
    assert scans.detections is not None
    assert scans.detections[0, 4] == pytest.approx(3.9, abs=0.6)


def test_the_report_shows_each_sonar_beside_the_scene(survey: Path, run: Path) -> None:
    text = write_report(survey).read_text(encoding="utf-8")
    assert "<h2>Sonar</h2>" in text
    cards = re.findall(r'<div class="card sonar"><h3>(\w+)<', text)
    assert cards == ["side", "scanning", "multibeam"]
    own = write_report(run).read_text(encoding="utf-8")
    [card] = re.findall(r'<div class="card sonar">.*?</div>', own, re.S)
    scans = scans_of_run(run)
    pictures_ = re.findall(r"base64,([^\"]+)", card)
    assert len(pictures_) == len(scans)
    assert len(set(pictures_)) == len(scans)
    assert f'max="{len(scans) - 1}"' in card


def test_a_report_without_a_sonar_has_no_such_section(tmp_path: Path) -> None:
    uuv.run("bluerov2_hold", until=0.1, out=tmp_path / "r")
    assert "<h2>Sonar</h2>" not in write_report(tmp_path / "r").read_text(encoding="utf-8")


def test_several_sonars_need_a_name(survey: Path) -> None:
    with pytest.raises(InputInvalid, match="3 sonars; expected --sonar side or scanning or multib"):
        scans_of_run(survey)


def test_a_run_without_a_sonar_is_refused(tmp_path: Path) -> None:
    uuv.run("bluerov2_hold", until=0.1, out=tmp_path / "r")
    with pytest.raises(InputInvalid, match="its system has no sonar with images"):
        scans_of_run(tmp_path / "r")
    with pytest.raises(InputInvalid, match=r"no system\.ssd"):
        scans_of_run(tmp_path)


def test_a_bag_has_the_images_of_the_run(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader

    from uuvsim_cosim.bridge.ros2.bag import write_bag
    from uuvsim_cosim.bridge.ros2.topic_writer import typestore

    write_bag(run, tmp_path / "bag.mcap")
    scans = scans_of_run(run)
    package = "marine_acoustic_msgs/msg/"
    with AnyReader([tmp_path / "bag.mcap"], default_typestore=typestore("jazzy")) as bag:
        types = {c.topic: c.msgtype for c in bag.connections}
        assert types["/sonar/projected_image"] == f"{package}ProjectedSonarImage"
        assert types["/sonar/raw_image"] == f"{package}RawSonarImage"
        assert types["/sonar/detections"] == f"{package}SonarDetections"
        images = [
            bag.deserialize(raw, connection.msgtype)
            for connection, _, raw in bag.messages(
                [c for c in bag.connections if c.topic == "/sonar/projected_image"]
            )
        ]
    assert len(images) == len(scans)
    for k, found in enumerate(images):
        pixels = np.asarray(found.image.data).view("<f4").reshape(60, 24)
        assert np.array_equal(pixels.T, scans.magnitude[k])
