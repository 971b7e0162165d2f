"""`uuvsim train --curriculum`: its options, what it says, and what it leaves."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from uuvsim_cosim.cli import status_of

Uuvsim = Callable[..., tuple[int, str, str]]
PLAN = """
envs: 8
evaluate_every: 80
evaluation_episodes: 2
settings: {hidden: 8, batch: 16, shared: true, updates: 1.0}
options: {horizon: 4}
stages:
  - {task: source, steps: 80, settings: {warm_up: 16}}
  - {task: transition_2, steps: 80, evaluate_every: 40, settings: {critic_only: 4}}
"""
ASKED = ("--no-report", "--evaluate-every", "16", "--set", "warm_up=32")


@pytest.fixture
def uuvsim(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Uuvsim:
    """Run `uuvsim train --curriculum` in a folder with a plan: give status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    Path("plan.yaml").write_text(PLAN)

    def call(*arguments: str) -> tuple[int, str, str]:
        capsys.readouterr()
        status = status_of(["train", "--curriculum", "plan.yaml", "-o", "c", *arguments])
        said = capsys.readouterr()
        return status, said.out, said.err

    return call


def test_it_leaves_a_report_of_all_stages_and_curves_for_tensorboard(
    uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    monkeypatch.setattr("typer.launch", shown.append)
    status, out, _ = uuvsim("--open")
    assert status == 0
    assert "c/report.html" in out
    assert shown == ["c/report.html"]
    page = Path("c/report.html").read_text(encoding="utf-8")
    assert "http" not in page
    for words in (
        "plan, masac", "2 of 2 stages", "Stage 1, source", "Stage 2, transition_2",
        "The best policy of the last stage", "seed 2000003", "critic_only = 4",
    ):  # fmt: skip
        assert words in page
    for place in ("1-source", "2-transition_2"):
        assert list(Path("c", place).glob("events.out.tfevents.*"))


def test_without_a_report_it_leaves_none_and_opens_nothing(
    uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("typer.launch", lambda _: pytest.fail("opened"))
    assert uuvsim("--no-report", "--open")[0] == 0
    assert not Path("c/report.html").exists()
    assert not Path("c/pictures").exists()


def test_options_come_after_the_stages_and_a_stage_that_taught_nothing_says_so(
    uuvsim: Uuvsim,
) -> None:
    status, out, _ = uuvsim(*ASKED, "--set", "critic_only=3")
    assert status == 0
    assert "no actor" not in out
    for place in ("1-source", "2-transition_2"):
        rows = Path("c", place, "evaluations.csv").read_text().splitlines()[1:]
        assert [float(row.split(",")[0]) for row in rows] == [0, 16, 32, 48, 64, 80]
    about = json.loads(Path("c/curriculum.json").read_text())
    assert [s["settings"]["critic_only"] for s in about["curriculum"]["stages"]] == [3, 3]
    status, out, _ = uuvsim(*ASKED, "--restart", "--set", "critic_only=30")
    assert status == 0
    assert "stage 2, transition_2: no actor was updated: critic_only is 30, updates made 7" in out


def test_begun_anew_is_what_is_a_curriculum_and_nothing_else(uuvsim: Uuvsim) -> None:
    assert uuvsim("--no-report")[0] == 0
    status, _, err = uuvsim("--no-report", "--envs", "4")
    assert status == 2
    assert (
        "c: holds a curriculum with envs 8; expected 4, another folder (-o), or a new start" in err
    )
    status, _, _ = uuvsim("--no-report", "--envs", "4", "--restart")
    assert status == 0
    assert json.loads(Path("c/curriculum.json").read_text())["curriculum"]["envs"] == 4
    Path("c/curriculum.json").unlink()
    status, _, err = uuvsim("--no-report", "--restart")
    assert status == 2
    assert "c: contains other files; expected an empty or a new folder" in err
    assert Path("c/1-source/best.npz").is_file()


@pytest.mark.parametrize("option", ["--config", "--seeds", "--ray"])
def test_options_of_one_training_are_refused(option: str, uuvsim: Uuvsim) -> None:
    status, _, err = uuvsim(option, "3")
    assert status == 2
    assert f"{option}: applies to one training; expected --curriculum without it" in err
