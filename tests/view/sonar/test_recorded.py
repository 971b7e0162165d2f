"""Images of the real component: a run with a sonar, its pictures, arrays and messages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Sphere
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.view.sonar.recorded import scans_of_run

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
