"""A training's configuration: every mistake with its line, and what would have been right."""

from __future__ import annotations

from pathlib import Path

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.shared.task_ids import TASKS, make_task
from uuvsim_cosim.learn.training.config import TrainingConfig, read_config

WRONG = """\
task: transition_3
algorithm: sacc
seed: -1
envs: many
stepz: 5
profile: table2
algorithm_: x
settings: [1]
"""
SETTINGS = """\
task: source
algorithm: sac
settings:
  lr: 3e-4
  gama: 0.9
  tau: 2
  hidden: 1.5
  tune_alpha: perhaps
"""


def test_all_mistakes_of_a_file_are_told_with_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(WRONG)
    with pytest.raises(InputInvalid) as told:
        read_config(path)
    said = str(told.value)
    for line, words in (
        (1, "expected one such as transition_2, transition_1"),
        (2, "expected one such as sac, isac, masac"),
        (3, "expected a whole number, 0"),
        (4, "'many'; expected a whole number"),
        (5, "unknown; expected one such as steps"),
        (6, "table1"),
        (8, "expected values by name"),
    ):
        assert any(t.strip().startswith(f"{path}:{line}:") and words in t
                   for t in said.splitlines()), (line, said)  # fmt: skip


def test_mistakes_of_an_algorithms_settings_are_told_with_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text(SETTINGS)
    with pytest.raises(InputInvalid) as told:
        read_config(path)
    said = [line.strip() for line in str(told.value).splitlines()]
    assert [line.split(":")[1] for line in said] == ["5", "6", "7", "8"]
    assert "'gama'; expected one such as gamma" in said[0]
    assert "expected a number, 0 … 1" in said[1]
    assert "expected a whole number from 1" in said[2]
    assert "expected true or false" in said[3]


def test_what_is_said_beside_a_file_comes_after_it(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("task: target\nseed: 1\ntask_options: {rules: {credit: own, w_p: 0.02}}\n"
                    "algorithm: masac\nsettings: {lr: 1.0e-3, hidden: 8}\n")  # fmt: skip
    config = read_config(path, seed=4, settings={"lr": 2e-3},
                         task_options={"rules": {"w_p": 0.03}, "n_trackers": 3})  # fmt: skip
    assert (config.task, config.seed) == ("target", 4)
    assert config.settings == {"lr": 2e-3, "hidden": 8}
    assert config.task_options == {"rules": {"credit": "own", "w_p": 0.03}, "n_trackers": 3}


def test_a_broken_yaml_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text("task: source\nsettings: {lr: 1\n")
    with pytest.raises(InputInvalid, match=r"broken.yaml:\d+: .*expected YAML"):
        read_config(path)


@pytest.mark.parametrize("name", list(TASKS))
def test_every_name_makes_its_task(name: str) -> None:
    assert make_task(name).horizon > 0


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("transition_9", {}, "no such task; expected one such as transition_2, transition_1"),
        ("source", {"n_tracker": 3}, "n_tracker"),
        ("uuvsim/StationKeeping-v0", {"regoin": 3}, "regoin"),
        ("no.such.module:Task", {}, "No module named .no.; expected FILE.py:Name"),
        ("fractions:Fraction", {}, "expected a Task or TeamTask"),
    ],
)
def test_a_task_that_cannot_be_is_refused(name: str, options: dict[str, int], said: str) -> None:
    with pytest.raises(InputInvalid, match=said):
        make_task(name, options)


def test_a_profile_is_only_target_trackings() -> None:
    task = make_task("source", profile="table1")
    assert getattr(task, "profile") == "table1"  # noqa: B009
    with pytest.raises(InputInvalid, match="has none; expected default"):
        make_task("uuvsim/StationKeeping-v0", profile="table1")


def test_seeds_of_training_are_not_those_of_evaluation() -> None:
    with pytest.raises(InputInvalid, match="seed 1000000; expected a whole number, 0 … 999999"):
        TrainingConfig("source", seed=1_000_000)


def test_the_documentation_names_every_field_and_setting_and_its_example_is_one(
    tmp_path: Path,
) -> None:
    from dataclasses import fields

    from uuvsim_cosim.learn.algorithms.dqn import DqnSettings
    from uuvsim_cosim.learn.algorithms.ppo import PpoSettings

    folder = Path(__file__).parents[3] / "docs" / "learning"
    page = (folder / "learning.md").read_text(encoding="utf-8")
    both = page + (folder / "training_settings.md").read_text(encoding="utf-8")
    for kind in (TrainingConfig, DqnSettings, PpoSettings):
        for f in fields(kind):
            assert f"`{f.name}`" in both, f.name
    (tmp_path / "c.yaml").write_text(page.split("```yaml\n")[1].split("```")[0])
    assert read_config(tmp_path / "c.yaml").settings == {"lr": 3e-4, "hidden": 256, "updates": 4}
