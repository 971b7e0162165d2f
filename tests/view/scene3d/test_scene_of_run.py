import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.view.scene_parts import survey_folder, survey_signals
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.orchestrator.recording.mcap import write_mcap
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.view.scene3d.foxglove import export_scene_mcap
from uuvsim_cosim.view.scene3d.motion import turned
from uuvsim_cosim.view.scene3d.rerun_file import export_rrd
from uuvsim_cosim.view.scene3d.scene_of_run import newest_run, placed


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return survey_folder(tmp_path_factory.mktemp("run"), survey_signals())


@pytest.fixture(scope="module")
def drawn(recording: Path) -> dict[str, list[dict]]:
    """The messages of a scene's MCAP by topic."""
    from mcap.reader import make_reader

    out = export_scene_mcap(recording, recording.with_name("scene.mcap"))
    found: dict[str, list[dict]] = {}
    with out.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            if schema.name.startswith("foxglove."):
                found.setdefault(channel.topic, []).append(json.loads(message.data))
    return found


def test_a_recording_beside_its_system_has_its_hull_and_thrusters(recording: Path) -> None:
    scene3d, motion, _ = placed(recording)
    assert scene3d.notes == ()
    assert motion.thrusts["hull"].shape == (121, 8)
    assert motion.ranges["dvl"].shape == (121, 4)
    assert np.isnan(motion.ranges["dvl"][:, 3]).all()
    assert motion.estimates["hull"][:, 0] == pytest.approx(motion.positions["hull"][:, 0] + 0.1)
    assert len(scene3d.lines[0].points) > 2


def test_a_scene_names_each_signal_that_moves_it_once(recording: Path) -> None:
    scene3d, _, _ = placed(recording)
    names = scene3d.signals
    assert len(names) == len(set(names))
    assert {"hull.eta", *(f"thruster_{k}.thrust" for k in range(1, 9))} <= set(names)
    assert {n.partition(".")[0] for n in names} >= {"hull", "dvl"}


def test_a_recording_alone_is_seen_by_its_names(tmp_path: Path) -> None:
    write_mcap(survey_signals(), tmp_path / "alone.mcap")
    scene3d, motion, _ = placed(tmp_path / "alone.mcap")
    assert list(motion.positions) == ["hull"]
    assert list(motion.estimates) == ["hull"]
    assert scene3d.bodies[0].arrows == ()


def test_a_system_beside_another_recording_is_not_taken_for_its_own(tmp_path: Path) -> None:
    file = survey_folder(tmp_path, survey_signals())
    other = Signals(np.arange(3.0), np.arange(3), {"boat.eta": np.zeros((3, 6))}, {})
    write_mcap(other, file)
    assert list(placed(file)[1].positions) == ["boat"]


def test_a_recording_without_positions_is_refused_with_what_there_is(tmp_path: Path) -> None:
    signals = Signals(np.arange(3.0), np.arange(3), {"tank.level": np.zeros(3)}, {})
    write_mcap(signals, tmp_path / "tank.mcap")
    with pytest.raises(InputInvalid, match=r"no position.*hull\.eta.*tank\.level"):
        placed(tmp_path / "tank.mcap")


def test_a_recording_of_nothing_is_refused(tmp_path: Path) -> None:
    write_mcap(Signals(np.zeros(0), np.zeros(0, int), {}, {}), tmp_path / "none.mcap")
    with pytest.raises((InputInvalid, RecordingError), match=r"none\.mcap"):
        placed(tmp_path / "none.mcap")


def test_a_recording_that_is_cut_off_is_refused_in_a_sentence(recording: Path) -> None:
    cut = recording.with_name("cut.mcap")
    cut.write_bytes(recording.read_bytes()[:3000])
    with pytest.raises(RecordingError, match=r"cut\.mcap"):
        placed(cut)


def test_the_command_says_in_one_sentence_what_it_cannot_show(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["view", str(tmp_path / "nowhere")]) != 0
    assert status_of(["view", str(tmp_path)]) != 0
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2
    assert all(line.startswith("uuvsim: ") and "no recording here" in line for line in said)


def test_the_newest_run_is_found(tmp_path: Path) -> None:
    import os

    with pytest.raises(InputInvalid, match="uuvsim run"):
        newest_run(tmp_path)
    for i, name in enumerate(("b", "a")):
        (tmp_path / name).mkdir()
        file = tmp_path / name / "signals.parquet"
        file.write_bytes(b"x")
        os.utime(file, (1000.0 + i, 1000.0 + i))
    assert newest_run(tmp_path).name == "a"


def test_a_scene_leaves_the_signals_of_an_mcap_as_they_are(recording: Path, drawn: dict) -> None:
    plain, both = read_signals(recording), read_signals(recording.with_name("scene.mcap"))
    assert set(plain) == set(both)
    assert all(np.array_equal(plain[name], both[name]) for name in plain)


def test_foxglove_sees_the_hull_where_it_is(recording: Path, drawn: dict) -> None:
    _, motion, _ = placed(recording)
    first = {t["child_frame_id"]: t for t in drawn["/tf"][0]["transforms"]}
    assert first["ned"]["parent_frame_id"] == "world"
    at, q = first["hull"]["translation"], first["hull"]["rotation"]
    assert [at[k] for k in "xyz"] == pytest.approx(motion.positions["hull"][0], abs=1e-5)
    assert [q[k] for k in "wxyz"] == pytest.approx(motion.attitudes["hull"][0])
    root = np.array([[first["ned"]["rotation"][k] for k in "wxyz"]] * 3)
    assert turned(root, np.eye(3)) == pytest.approx(  # N, E, D become ENU's y, x, -z
        np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), abs=1e-12
    )


def test_foxglove_gets_every_entity_whole(drawn: dict) -> None:
    (scene,) = drawn["/scene"]
    names = {e["id"] for e in scene["entities"]}
    assert {"hull hull", "hull track", "hull estimate", "waypoints"} <= names
    for entity in scene["entities"]:
        for triangles in entity["triangles"]:
            assert max(triangles["indices"]) < len(triangles["points"])
    assert len(drawn["/thrust"][5]["entities"][0]["lines"][0]["points"]) == 16
    assert drawn["/echoes"][0]["fields"][2]["offset"] == 8


def test_a_rerun_file_is_written_whole_or_not_at_all(recording: Path, tmp_path: Path) -> None:
    out = export_rrd(recording, tmp_path / "run.rrd")
    assert out.read_bytes()[:3] == b"RRF"
    assert list(tmp_path.iterdir()) == [out]
    with pytest.raises(InputInvalid, match="its folder does not exist"):
        export_rrd(recording, tmp_path / "no" / "run.rrd")


def test_a_rerun_file_has_what_moves_over_time(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import rerun

    sent: dict[str, int] = {}
    send = rerun.RecordingStream.send_columns

    def noted(self: Any, place: str, when: Any, columns: Any) -> None:
        sent[place] = len(when[0].times)
        send(self, place, when, columns)

    monkeypatch.setattr(rerun.RecordingStream, "send_columns", noted)
    export_rrd(recording, tmp_path / "run.rrd")
    rows = 121
    assert sent["world/hull"] == sent["world/hull/thrust"] == rows
    assert {n for place, n in sent.items() if place.startswith("signals/")} == {rows}


def test_without_rerun_the_extra_is_named(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(InputInvalid, match=r"uuvsim-cosim\[rerun\]"):
        export_rrd(recording, tmp_path / "run.rrd")
