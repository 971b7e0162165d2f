"""`uuvsim train`, `evaluate` and `play`: from a task's name to a policy, figures and pictures."""

from __future__ import annotations

import csv
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.conftest import Uuvsim
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.commands.learn.training_progress import TrainingProgress, curve
from uuvsim_cosim.learn.training.training import Progress

TRAIN = (
    "train", "source", "--algo", "sac", "--envs", "8", "--set", "hidden=8", "--set", "batch=16",
    "--set", "warm_up=32", "--set", "tune_alpha=false", "--task-set", "horizon=4", "--task-set",
    "rules.credit=own", "--evaluate-every", "80", "--evaluation-episodes", "4",
)  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train once, with a report."""
    place = tmp_path_factory.mktemp("trained")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        assert status_of([*TRAIN, "--steps", "160"]) == 0
    return place / "runs" / "train" / "source-sac-0"


def test_it_leaves_curves_policies_a_checkpoint_and_a_report(trained: Path) -> None:
    names = {p.name for p in trained.iterdir()}
    assert {
        "training.json", "checkpoint.pt", "best.npz", "policy.npz", "episodes.csv",
        "evaluations.csv", "judged.json", "report.html", "pictures",
    } <= names  # fmt: skip
    assert any(name.startswith("events.out.tfevents") for name in names)
    with (trained / "evaluations.csv").open() as file:
        assert [row["step"] for row in csv.DictReader(file)] == ["0.0", "80.0", "160.0"]


def test_the_report_is_one_whole_page_without_a_network(trained: Path) -> None:
    page = (trained / "report.html").read_text(encoding="utf-8")
    assert "http://" not in page
    assert "https://" not in page
    for words in ("source, sac", "scripted", "environment steps", "seed 2000003", "rules = credit"):
        assert words in page
    open_tags: list[str] = []

    class Tags(HTMLParser):
        def handle_starttag(self, tag: str, attrs: object) -> None:
            if tag not in ("meta", "img", "br", "input"):
                open_tags.append(tag)

        def handle_startendtag(self, tag: str, attrs: object) -> None:
            pass

        def handle_endtag(self, tag: str) -> None:
            assert open_tags.pop() == tag

    Tags().feed(page)
    assert not open_tags


def test_the_same_command_goes_on_and_another_is_refused(trained: Path, uuvsim: Uuvsim) -> None:
    shutil.copytree(trained, "runs/train/source-sac-0")
    status, out, _ = uuvsim(*TRAIN, "--steps", "240", "--no-report")
    assert status == 0
    assert "240" in out
    status, _, err = uuvsim(*TRAIN, "--steps", "240", "--set", "lr=0.1")
    assert status == 2
    assert "holds a training with settings" in err
    assert "--restart" in err


def test_policies_are_evaluated_beside_the_scripted_one(trained: Path, uuvsim: Uuvsim) -> None:
    status, out, _ = uuvsim(
        "evaluate", str(trained), str(trained / "policy.npz"), "--episodes", "5", "-o", "e.csv"
    )
    assert status == 0
    head = next(line for line in out.splitlines() if line.startswith("figure"))
    assert "together" in head
    assert "scripted" in head
    with Path("e.csv").open() as file:
        rows = {(r["policy"], r["figure"]): r for r in csv.DictReader(file)}
    yardstick = rows["scripted", "return"]
    assert float(yardstick["low"]) <= float(yardstick["value"]) <= float(yardstick["high"])
    status, out, _ = uuvsim("evaluate", str(trained), "--task", "transition_1", "--episodes", "2",
                            "--task-set", "horizon=2")  # fmt: skip
    assert status == 0
    assert out.strip().startswith("transition_1: 2 episodes")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("best.npz", "expected a table's name, FILE.csv"),
        ("thesis.csv", "exists and is no table of `uuvsim evaluate`"),
        ("nowhere/e.csv", "expected a file in an existing folder"),
    ],
)
def test_a_table_replaces_nothing_but_a_table(name: str, said: str, uuvsim: Uuvsim) -> None:
    for other in (Path("best.npz"), Path("thesis.csv")):
        other.write_text("mine\n")
    asked = ["evaluate", "scripted", "--task", "source", "--task-set", "horizon=2"]
    status, out, err = uuvsim(*asked, "--episodes", "1", "-o", name)
    assert (status, out) == (2, "")  # before anything is computed
    assert said in err
    assert Path("best.npz").read_text() == Path("thesis.csv").read_text() == "mine\n"
    for episodes in ("1", "2"):
        assert uuvsim(*asked, "--episodes", episodes, "-o", "e.csv")[0] == 0


def test_an_episode_is_played_as_picture_page_and_pictures(trained: Path, uuvsim: Uuvsim) -> None:
    status, out, _ = uuvsim("play", "--policy", str(trained), "-o", "p.png", "--seed", "5")
    assert status == 0
    assert "return" in out
    with Image.open("p.png") as film:
        assert film.n_frames == 11  # the start, and ten actions
    status, _, _ = uuvsim("play", "source", "--task-set", "horizon=2", "-o", "frames")
    assert status == 0
    assert [p.name for p in sorted(Path("frames").iterdir())][-1] == "00005.png"
    status, _, _ = uuvsim("play", "source", "--policy", "random", "--task-set", "horizon=2")
    assert status == 0
    assert Path("source-random-2000000.html").read_text().count("<img") == 6


@pytest.mark.parametrize(("vehicle", "actions", "scripted"), [("my_rov", 5, 2), ("remus100", 5, 1)])
def test_a_policy_is_trained_evaluated_and_played_with_a_vehicle_by_name(
    vehicle: str,
    actions: int,
    scripted: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`my_rov` is a folder of the user, whose pitch is passive; fins have no scripted policy."""
    monkeypatch.chdir(tmp_path)
    assert status_of(["models", "new", "my_rov"]) == 0
    words = (
        "train", "uuvsim/StationKeeping-v0", "--envs", "4", "--set", "hidden=8", "--set",
        "batch=16", "--set", "warm_up=32", "--task-set", "horizon=2", "--task-set",
        f"vehicle={vehicle}", "--evaluate-every", "80", "--evaluation-episodes", "4",
    )  # fmt: skip
    assert status_of([*words, "--steps", "80"]) == 0
    assert status_of([*words, "--steps", "160"]) == 0  # continues
    (folder,) = (tmp_path / "runs" / "train").iterdir()
    with (folder / "evaluations.csv").open() as file:
        assert [row["step"] for row in csv.DictReader(file)] == ["0.0", "80.0", "160.0"]
    with np.load(folder / "policy.npz") as kept:
        assert kept["2.bias"].shape == (actions,)
    assert status_of(["evaluate", str(folder), "--episodes", "4", "-o", "figures.csv"]) == 0
    rows = (tmp_path / "figures.csv").read_text(encoding="utf-8").splitlines()
    assert len({row.split(",")[0] for row in rows[1:]}) == scripted
    assert status_of(["play", "--policy", str(folder), "-o", "episode.html"]) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "train transition_4",
            "task 'transition_4'; expected one such as transition_2, transition_1",
        ),
        ("train source --algo sax", "algorithm 'sax'; expected "),
        ("train source --algo dqm", "algorithm 'dqm'; expected "),
        ("train", "no task; expected a task, as in `uuvsim train transition_1`, or --config"),
        ("train source --config nowhere.yaml", "nowhere.yaml: no such file"),
        ("train source --set lr", "--set lr: expected NAME=VALUE"),
        ("train source --set lr=-1", "lr -1; expected a number, more than 0"),
        ("train source --set lr=nan", "lr nan; expected a number"),
        ("train source --task-set rules.w_q=3", "no rule 'w_q'"),
        ("train source --task-set n_obstacle=3", "n_obstacle"),
        ("train source --steps 0", "steps 0; expected a whole number"),
        ("train uuvsim/StationKeeping-v0 --profile table1", "has none; expected default"),
        ("evaluate nowhere.npz", "nowhere.npz: no such file or folder; expected a policy"),
        ("evaluate target_masc", "one that ships such as target_masac"),
        ("evaluate scripted", "no task; expected one task"),
        ("evaluate scripted --task source --episodes 0", "--episodes 0: expected 1"),
        ("play --policy junk.npz", "junk.npz: "),
        ("play --policy junk.pt", "as `uuvsim train` writes it (best.npz, beside its checkpoint)"),
        ("play source --window --out x.png", "expected one of them"),
        ("play source --out x.gif", "x.gif: ending '.gif' was read; expected .html"),
        ("play", "no task; expected one task"),
    ],
)
def test_a_mistake_is_one_sentence_and_status_2(words: str, said: str, uuvsim: Uuvsim) -> None:
    for junk in (Path("junk.npz"), Path("junk.pt")):
        junk.write_bytes(b"PK\x03\x04 no archive")
    status, _, err = uuvsim(*words.split())
    assert status == 2, err
    assert said in err
    assert "Traceback" not in err
    assert not Path("runs").exists()


def test_a_corrupt_checkpoint_and_one_of_another_version_are_refused(
    trained: Path, uuvsim: Uuvsim
) -> None:
    import torch

    folder = Path("runs/train/source-sac-0")
    shutil.copytree(trained, folder)
    torch.save({"uuvsim_checkpoint": 99, "content": {}}, folder / "checkpoint.pt")
    status, _, err = uuvsim(*TRAIN, "--steps", "240", "--no-report")
    assert status == 2
    assert "checkpoint.pt: format 99, written by another version" in err
    whole = (trained / "checkpoint.pt").read_bytes()
    (folder / "checkpoint.pt").write_bytes(whole[: len(whole) // 2])
    status, _, err = uuvsim(*TRAIN, "--steps", "240", "--no-report")
    assert status == 2
    assert "expected a whole checkpoint" in err
    (folder / "best.npz").write_bytes((trained / "best.npz").read_bytes()[:300])
    status, _, err = uuvsim("evaluate", str(folder))
    assert status == 2
    assert "expected a whole policy" in err


def test_without_torch_training_says_which_extra_and_acting_works(
    trained: Path, uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    status, _, err = uuvsim("train", "source")
    assert status == 2
    assert "learning expects torch: pip install 'uuvsim-cosim[rl]'" in err
    status, _, err = uuvsim("reproduce", "fig7", "-o", "results", "--work", "work")
    assert status == 2
    assert "learning expects torch: pip install 'uuvsim-cosim[rl]'" in err
    status, out, _ = uuvsim("evaluate", str(trained), "--episodes", "2")
    assert status == 0
    assert "return" in out


def test_without_threadpoolctl_training_names_the_extra(
    uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "threadpoolctl", None)
    status, _, err = uuvsim("train", "source")
    assert status == 2
    assert "threadpoolctl is not installed; expected pip install 'uuvsim-cosim[rl]'" in err


def test_a_curve_rises_as_its_values_do() -> None:
    drawn = curve([float(k) for k in range(200)])
    assert len(drawn) <= 60
    assert list(drawn) == sorted(drawn)
    assert drawn[0] == "▁"
    assert drawn[-1] == "█"
    assert curve([float("nan")]) == ""
    assert len(set(curve([2.0] * 5))) == 1


def test_progress_takes_what_training_tells_where_nothing_is_drawn() -> None:
    with TrainingProgress() as progress:
        for what in ("step", "episodes", "evaluation", "checkpoint"):
            progress(Progress(8, 80, 1, {"return": float(np.pi)}, what))


MIXED = """\
from uuvsim_cosim.envs import Channel, FunctionTask
from uuvsim_cosim.orchestrator.running.library import load


def Mixed() -> FunctionTask:
    return FunctionTask(
        load("bluerov2_hold").replace("hull", "model:rexrov"),
        actions=[Channel("hull.v_c[1]", -0.1, 0.1, "m/s")], observations=["hull.eta[3]"],
        reward=lambda m: -abs(m["hull.eta"][:, 2]), action_step="0.1", horizon="0.4",
    )
"""


def test_force_trains_in_a_system_of_mixed_vehicles_and_warns_of_each(
    uuvsim: Uuvsim, tmp_path: Path
) -> None:
    (tmp_path / "mixed.py").write_text(MIXED)
    train = (
        "train", "mixed.py:Mixed", "--envs", "2", "--steps", "8", "--evaluate-every", "8",
        "--evaluation-episodes", "2", "--set", "hidden=8", "--set", "warm_up=4", "--no-report",
    )  # fmt: skip
    status, _, err = uuvsim(*train)
    assert (status, "made for bluerov2_heavy" in err, "--force" in err) == (2, True, True)
    status, out, err = uuvsim(*train, "--force")
    assert status == 0, err
    assert "made for bluerov2_heavy, but hull is rexrov" in " ".join(out.split())
    status, out, err = uuvsim("evaluate", "runs/train/Mixed-sac-0", "--episodes", "2")
    assert status == 0, err
