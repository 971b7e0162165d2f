"""Films: the same bytes, paths of the camera, files that are whole, refusals."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.view.scene_parts import survey_folder, survey_signals
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.orchestrator.recording.mcap import write_mcap
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.view.film import files
from uuvsim_cosim.view.film.files import film_file
from uuvsim_cosim.view.film.film import Film, FilmSettings, write_film
from uuvsim_cosim.view.film.paths import LEAST_DEPTH, Subject, camera_path, keyframes
from uuvsim_cosim.view.film.renderer import SEABED, Look
from uuvsim_cosim.view.scene3d.scene import Scene3D
from uuvsim_cosim.view.scene3d.scene_of_run import placed

SMALL = (96, 64)
KEYS = """keyframes:
- {at: 0, eye: [0, 0, 2]}
- {at: 4, eye: [4, -2, 3]}
- {at: 8, eye: [5, -2, 6]}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return survey_folder(tmp_path_factory.mktemp("run"), survey_signals())


@pytest.fixture(scope="module")
def film(run: Path) -> Film:
    return Film(run, settings(fps=4.0, end=3.0, panels=("depth", "speed", "hull.eta[1]")))


def settings(**given: Any) -> FilmSettings:
    return FilmSettings(**({"size": SMALL} | given))


def refusal(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return the one message of a film that is refused."""
    assert status_of(["film", *words]) == 2
    text = capsys.readouterr().err.strip()
    assert "Traceback" not in text
    return " ".join(text.split())


def silent(phase: str, done: float, total: float) -> None:
    pass


# ---- frames -------------------------------------------------------------------------------------


def test_a_film_has_the_same_bytes_each_time(run: Path, tmp_path: Path) -> None:
    made = []
    for name in ("a.webp", "b.webp"):
        film = Film(run, settings(fps=2.0, end=3.0, caustics=0.5, panels=("depth", "dvl.range[1]")))
        write_film(film, tmp_path / name, silent)
        made.append((tmp_path / name).read_bytes())
    assert made[0] == made[1]


def test_a_slower_film_has_every_other_frame_of_a_faster_one(run: Path) -> None:
    slow, fast = (Film(run, settings(fps=f, end=4.0, start=1.0)) for f in (2.0, 4.0))
    assert (len(slow), len(fast)) == (6, 12)
    assert (slow.frame(3) == fast.frame(6)).all()


def test_captions_panels_and_tracks_are_drawn_only_where_they_are_asked_for(run: Path) -> None:
    plain = settings(captions=False, track=False)
    free = Film(run, plain).frame(0)
    panels = Film(run, settings(captions=False, track=False, panels=("depth",))).frame(0)
    changed = (free != panels).any(axis=2)
    assert changed.any()
    assert not changed[:, : int(0.6 * SMALL[0])].any()
    assert (Film(run, settings(track=False)).frame(0) != free).any()


def test_contours_are_where_the_seabed_crosses_a_level() -> None:
    north = np.arange(-20.0, 21.0)
    slope = np.repeat((10.0 + 0.2 * north)[:, None], 41, axis=1).astype(np.float32)
    bed = Terrain(slope, 1.0, (-20.0, -20.0))
    run = Scene3D("made", terrain=bed)
    film = object.__new__(Film)  # without a recording
    from uuvsim_cosim.envs.pictures.canvas import Canvas
    from uuvsim_cosim.view.film.renderer import Renderer

    renderer = Renderer(run, 120, 160, "none")
    film._step, film.renderer = 0.5, renderer
    look = Look.at(np.array([-0.3, 0.0, 2.0]), np.array([-0.3, 0.0, 9.0]))
    seen = renderer.seen(look, {}, 0.0)
    assert (seen.kind == SEABED).all()
    canvas = Canvas(160, 120, "#ffffff")
    film._contours(canvas, seen, 9.0)
    dark = (canvas.pixels()[:, 20] < 200).any(axis=1)  # beside the column of the labels
    rows = np.flatnonzero(dark)
    levels = seen.deep[rows, 20]
    assert len(rows) >= 3
    assert np.abs(levels / 0.5 - np.round(levels / 0.5)).max() < 0.1


def test_panels_show_the_last_ping_and_the_last_image_at_their_time() -> None:
    from uuvsim_cosim.envs.pictures.canvas import Canvas
    from uuvsim_cosim.view.film.panels import _Camera, _Sonar
    from uuvsim_cosim.view.sonar.pictures import Levels
    from uuvsim_cosim.view.sonar.scans import SonarScans

    echo = np.zeros((2, 3, 4), np.float32)
    echo[1] = 1.0
    scans = SonarScans(
        "sonar", np.array([1.0, 2.0]), np.array([-0.3, 0.0, 0.3]), np.arange(1.0, 5.0), echo
    )
    images = np.zeros((2, 3, 4, 3), np.uint8)
    images[1] = 255
    for panel in (
        _Sonar(scans, Levels(1.0)),
        _Camera("camera", np.array([1.0, 2.0]), images, 0.75),
    ):
        brightness = []
        for t in (1.0, 1.9, 2.0, 1.0):
            canvas = Canvas(120, 100, "#000000")
            panel.draw(canvas, (0, 0, 120, 90), 8.0, t)
            brightness.append(float(canvas.pixels()[30:70].mean()))
        assert brightness[0] == brightness[3]
        assert brightness[2] > brightness[1] + 10.0


# ---- paths --------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera", ["chase", "orbit", "top", "side", "chase:40", "top:30"])
def test_a_camera_beside_the_vehicle_stays_in_the_water_and_sees_it(run: Path, camera: str) -> None:
    film = Film(run, settings(camera=camera, fps=1.0))
    caster = film.renderer.caster
    for t in film.times.tolist():
        look, _ = film._path.look(t, caster, film.subject)
        at = film.subject.pose(t)[0]
        assert look.eye[2] >= LEAST_DEPTH - 1e-9
        assert look.eye[2] < float(caster.height(look.eye[0], look.eye[1]))
        pixels, _ = film.renderer.projected(look, at[None])
        assert (pixels[0] > 0).all()
        assert (pixels[0] < SMALL).all()


def test_a_film_counts_the_frames_whose_camera_came_nearer(run: Path) -> None:
    film = Film(run, settings(camera="top:30", fps=1.0, end=3.0))
    list(film.frames())
    assert film.nearer == 3


def test_keyframes_are_reached_at_their_times(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "my_camera_path.yaml"
    file.write_text(KEYS)
    film = Film(run, settings())
    path = keyframes(file, film.subject, 0.0, 8.0)
    for t, eye in ((0.0, [0, 0, 2]), (4.0, [4, -2, 3]), (8.0, [5, -2, 6]), (9.0, [5, -2, 6])):
        np.testing.assert_allclose(path.places(t)[0], eye, atol=1e-12)
    np.testing.assert_allclose(path.places(4.0)[1], film.subject.smooth(4.0)[0])


def test_keyframes_beside_the_vehicle_turn_with_its_heading(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "my_camera_path.yaml"
    file.write_text("frame: vehicle\nkeyframes: [{at: 0, eye: [-2, 1, -0.5], target: [1, 0, 0]}]\n")
    subject: Subject = Film(run, settings()).subject
    eye, target = keyframes(file, subject, 0.0, 8.0).places(6.0)
    at, yaw = subject.smooth(6.0)
    ahead, starboard = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    np.testing.assert_allclose(eye[:2] - at[:2], -2 * ahead + starboard, atol=1e-9)
    np.testing.assert_allclose(target - at, [*ahead, 0.0], atol=1e-9)


def test_the_pose_between_two_samples_is_between_them(run: Path) -> None:
    _, motion, _ = placed(run)
    subject = Subject(motion, "hull", 0.5)
    (a, _), (b, _), (c, R) = (subject.pose(t) for t in (1.0, 1.1, 1.05))
    np.testing.assert_allclose(c, 0.5 * (a + b))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


# ---- files --------------------------------------------------------------------------------------


def test_a_webp_is_read_by_others_with_its_frames_and_its_length(
    film: Film, tmp_path: Path
) -> None:
    write_film(film, tmp_path / "a.webp", silent)
    with Image.open(tmp_path / "a.webp") as image:
        assert (image.size, image.n_frames) == (SMALL, 12)
        long = 0
        for k in range(12):
            image.seek(k)
            image.load()
            long += image.info["duration"]
            apart = np.asarray(image.convert("RGB"), float) - film.frame(k)
            assert np.abs(apart).mean() < 8.0
    assert long == 3000


@pytest.mark.parametrize("stop", [0, 3])
def test_an_interrupted_film_is_a_whole_shorter_one_or_none(
    film: Film, tmp_path: Path, stop: int
) -> None:
    def progress(phase: str, done: float, total: float) -> None:
        if done == stop:
            raise KeyboardInterrupt

    out = tmp_path / "a.webp"
    with pytest.raises(KeyboardInterrupt):
        write_film(film, out, progress)
    assert [p.name for p in tmp_path.iterdir()] == (["a.webp"] if stop else [])
    if stop:
        with Image.open(out) as image:
            assert image.n_frames == stop
            assert int.from_bytes(out.read_bytes()[4:8], "little") == out.stat().st_size - 8


def test_a_folder_has_a_picture_of_each_frame_and_a_png_the_first(
    film: Film, tmp_path: Path
) -> None:
    write_film(film, tmp_path / "all", silent)
    write_film(film, tmp_path / "one.png", silent)
    names = sorted(p.name for p in (tmp_path / "all").iterdir())
    assert names == [f"{k:05d}.png" for k in range(1, 13)]
    first = (tmp_path / "one.png").read_bytes()
    assert first == (tmp_path / "all" / "00001.png").read_bytes()
    assert (np.asarray(Image.open(io.BytesIO(first))) == film.frame(0)).all()


def program(folder: Path, text: str) -> None:
    file = folder / "ffmpeg"
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(file.stat().st_mode | stat.S_IXUSR)


def test_an_mp4_gets_the_raw_frames_through_ffmpeg(
    film: Film, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(tmp_path, 'for last; do :; done; cat > "$last"')
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    write_film(film, tmp_path / "a.mp4", silent)
    raw = np.frombuffer((tmp_path / "a.mp4").read_bytes(), np.uint8)
    assert (raw.reshape(12, SMALL[1], SMALL[0], 3)[7] == film.frame(7)).all()


def test_the_message_of_an_ffmpeg_that_fails_is_shown_and_no_file_is_left(
    film: Film, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(tmp_path, "cat > /dev/null; echo 'no encoder libx264' >&2; exit 1")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    with pytest.raises(InputInvalid, match=r"a\.mp4: cannot be written \(ffmpeg: no encoder"):
        write_film(film, tmp_path / "a.mp4", silent)
    assert [p.name for p in tmp_path.iterdir()] == ["ffmpeg"]


def test_a_full_disk_is_one_message_and_the_old_film_stays(
    film: Film, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "a.png"
    out.write_bytes(b"old")

    def full(pixels: object) -> bytes:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files, "png", full)
    with pytest.raises(InputInvalid, match=r"a\.png: cannot be written \(No space left"):
        write_film(film, out, silent)
    assert out.read_bytes() == b"old"


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path: Path) -> None:
    import tracemalloc

    pixels = np.zeros((64, 96, 3), np.uint8)
    peaks = []
    for count in (5, 60):
        tracemalloc.start()
        with film_file(tmp_path / "a.webp", 64, 96, 20.0) as file:
            for k in range(count):
                pixels[:] = np.random.default_rng(k).integers(0, 255, pixels.shape)
                file.add(pixels)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0] + 20_000


# ---- the command and its refusals ---------------------------------------------------------------


def test_the_command_writes_a_film_and_names_its_length(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(run), "-o", str(tmp_path / "a.webp"), "--to", "2", "--fps", "3", "--size", "96x64"]
    assert status_of(["film", *words, "--camera", "orbit", "--panel", "depth,altitude"]) == 0
    assert "6 frames of 96 x 64, 2 s" in capsys.readouterr().out
    with Image.open(tmp_path / "a.webp") as image:
        assert image.n_frames == 6


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--camera", "chace"], "--camera: 'chace'; expected.*chase"),
        (["--camera", "chase:-1"], "a distance above 0"),
        (["--camera", "fixed:1,2"], "three numbers in metres"),
        (["--camera", "fixed:0,0,-1"], "above the water; expected a place in the water"),
        (["--camera", "fixed:0,0,26"], "below the seabed at 25 m"),
        (["--from", "5", "--to", "5.0", "--camera", "orbit", "--speed", "0"], "--speed: 0"),
        (["--from", "6", "--to", "5"], "a film from 6 to 5 s; expected times from 0 to 12 s"),
        (["--to", "99"], "expected times from 0 to 12 s"),
        (["--size", "90000x90000"], "MiB; expected.*at most 16,000,000 pixels"),
        (["--size", "1x1"], "at least 64 a side"),
        (["--size", "wide"], "two whole numbers"),
        (["--fps", "nan"], "--fps: nan"),
        (["--speed", "1e-7"], "frames; expected at most 1,000,000"),
        (["--water", "clear"], "water: 'clear'"),
        (["--caustics", "2"], "0 to 1"),
        (["--follow", "hul"], "--follow: 'hul'; expected.*hull"),
        (["--panel", "dept"], "'dept' is not in .*; expected.*depth"),
        (["--panel", "a,b,c,d,e,f,g"], "7 panels; expected at most 6"),
        (["--path", "none.yaml"], "none.yaml"),
        (["--path", "x.yaml", "--camera", "top"], "one of the two"),
    ],
)
def test_a_film_that_cannot_be_made_is_refused_in_one_message(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    import re

    out = tmp_path / "a.webp"
    text = refusal(capsys, str(run), "-o", str(out), *words)
    assert re.search(message, text), text
    assert not out.exists()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.gif", r"ending '\.gif' was read; expected \.webp"),
        ("none/a.webp", "its folder does not exist"),
        ("full", "is not an empty folder"),
        ("a.mp4", "there is no ffmpeg on the PATH"),
    ],
)
def test_a_file_that_cannot_be_written_is_refused_before_the_first_frame(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    import re

    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").write_text("")
    monkeypatch.setenv("PATH", str(tmp_path))
    text = refusal(capsys, str(run), "-o", str(tmp_path / name))
    assert re.search(message, text), text


def test_keyframes_out_of_the_water_or_out_of_order_are_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "my_camera_path.yaml", str(tmp_path / "a.webp")
    for text, message in (
        (KEYS.replace("[5, -2, 6]", "[5, -2, 60]"), "below the seabed at 25 m"),
        (KEYS.replace("at: 8", "at: 4"), "times that rise"),
        (KEYS.replace("at: ", "at: 10"), "times of the film"),
        (KEYS.replace("eye: [0, 0, 2]", "eye: [0, 0]"), "my_camera_path.yaml:2"),
        (KEYS.replace("eye: [0, 0, 2]", "eye: [0, 0, 2], target: [1, 1, 1]"), "in each, or in"),
    ):
        file.write_text(text)
        assert message in refusal(capsys, str(run), "-o", out, "--path", str(file))


def test_a_run_without_a_pose_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    signals = Signals(np.arange(3.0), np.arange(3), {"tank.level": np.zeros(3)}, {})
    write_mcap(signals, tmp_path / "tank.mcap")
    text = refusal(capsys, str(tmp_path / "tank.mcap"), "-o", str(tmp_path / "a.webp"))
    assert "no position was recorded" in text


def test_a_camera_in_an_obstacle_is_refused() -> None:
    from uuvsim_cosim.scene.shared.ray_casting import Caster
    from uuvsim_cosim.view.scene3d.motion import Motion

    motion = Motion(np.arange(2.0), {"hull": np.full((2, 3), 30.0)}, {})
    subject = Subject(motion, "hull", 0.5)
    with pytest.raises(InputInvalid, match="in the obstacle"):
        camera_path("fixed:-100,0,45", subject, 0.0, Caster("canyon"))
