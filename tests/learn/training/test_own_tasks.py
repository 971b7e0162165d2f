"""Tasks of the user's own, in a file beside; and what becomes of the mistakes in them."""

from __future__ import annotations

from pathlib import Path

import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.learn.shared.task_ids import make_task, short_name

OWN = """
import numpy as np
from uuvsim_cosim.envs.tasks.tracking_scenarios import source

count = 0
base = type(source())  # with its defaults a team of two

class Own(base):
    def reward(self, m):
        return super().reward(m)

class Breaks(base):
    def reward(self, m):
        global count
        count += 1
        if count == 25:
            raise ValueError("boom")
        return super().reward(m)

class Empties(base):
    def reward(self, m):
        global count
        count += 1
        return {k: r * (np.nan if count == 25 else 1) for k, r in super().reward(m).items()}

number = 3
"""
SMALL = (
    "--envs", "8", "--set", "hidden=8", "--set", "batch=16", "--set", "warm_up=32", "--steps",
    "240", "--evaluate-every", "80", "--evaluation-episodes", "2", "--no-report", "-o", "run",
    "--task-set", "horizon=4",
)  # fmt: skip


@pytest.fixture(autouse=True)
def _beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(OWN)


def test_a_task_in_a_file_beside_is_learned_and_judged(capsys: pytest.CaptureFixture[str]) -> None:
    assert short_name("./own.py:Own") == "Own"
    assert status_of(["train", "./own.py:Own", *SMALL]) == 0, capsys.readouterr().err
    assert Policy.load("run/best-tracker_1.npz").task == "./own.py:Own"
    assert status_of(["evaluate", "run", "--episodes", "2"]) == 0


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("owm:Own", "No module named 'owm'; expected FILE.py:Name, or one that Python finds"),
        ("none.py:Own", "none.py: no such file"),
        ("own.py:Owm", "no class 'Owm' in own.py"),
        ("own.py:number", "no class 'number' in own.py"),
        ("own.py:", "expected package.module:Name, or FILE.py:Name"),
        ("own", "or one of yours: FILE.py:Name, package.module:Name"),
    ],
)
def test_a_task_that_is_not_there_is_one_sentence(name: str, said: str) -> None:
    with pytest.raises(InputInvalid) as told:
        make_task(name)
    assert said in str(told.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Breaks", "own.py:17: ValueError: boom; stopped after step "),
        ("Empties", "in environment 0 is nan; expected a finite number; stopped after step "),
    ],
)
def test_a_mistake_in_it_is_told_with_its_place_and_what_is_kept(
    name: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["train", f"own.py:{name}", *SMALL]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert "run/checkpoint.pt is of step " in err
    assert err.count("\n") == 1
    assert Path("run/evaluations.csv").is_file()
