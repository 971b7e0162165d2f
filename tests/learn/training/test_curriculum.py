"""A curriculum goes from task to task, unchanged at each switch, and on to the same bits."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.commands.learn.policies import acting_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.checkpoint import load_checkpoint
from uuvsim_cosim.learn.algorithms.off_policy_learner import MasacLearner
from uuvsim_cosim.learn.deployment.export import export_policy
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.curriculum import (
    CURRICULA,
    Curriculum,
    Promotion,
    Stage,
    curriculum_of,
    read_curriculum,
)
from uuvsim_cosim.learn.training.folders import locked, write_done
from uuvsim_cosim.learn.training.loading import load_policies
from uuvsim_cosim.learn.training.train_curriculum import learner_for, settings_of, train_curriculum

SMALL = {"hidden": 16, "batch": 16, "buffer": 1000, "shared": True, "updates": 1.0}
EASY = Promotion(share=None, least=-1e6, evaluations=2)


def small(**changes: object) -> Curriculum:
    stages = (
        Stage("source", 160, settings={"warm_up": 32}),
        Stage("transition_2", 240, promotion=EASY, settings={"critic_only": 4}),
        Stage("target", 160, settings={"critic_only": 4}),
    )
    given = {"settings": SMALL, "options": {"horizon": 4}, "envs": 8, "evaluate_every": 80,
             "evaluation_episodes": 4}  # fmt: skip
    return Curriculum("small", stages, **{**given, **changes})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("curriculum")
    train_curriculum(small(), folder, seed=3)
    return folder


def policies(folder: Path) -> list[bytes]:
    return [p.read_bytes() for p in sorted(folder.glob("*/policy*.npz"))]


def after(calls: int) -> Callable[[], bool]:
    left = iter(range(calls))
    return lambda: next(left, None) is None


@pytest.mark.parametrize("steps", [7, 31])  # in the first stage, in the second
def test_an_interrupted_curriculum_goes_on_to_the_same_bits(
    whole: Path, tmp_path: Path, steps: int
) -> None:
    with pytest.raises(KeyboardInterrupt):
        train_curriculum(small(), tmp_path, seed=3, interrupted=after(steps))
    train_curriculum(small(), tmp_path, seed=3)
    assert len(policies(tmp_path)) == 5
    assert policies(tmp_path) == policies(whole)


def test_a_curriculum_that_is_done_is_not_done_again(whole: Path) -> None:
    before = policies(whole)
    done = train_curriculum(small(), whole, seed=3, interrupted=lambda: True)
    assert [s.task for s in done] == ["source", "transition_2", "target"]
    assert policies(whole) == before


def test_a_rule_of_promotion_ends_a_stage(whole: Path) -> None:
    done = train_curriculum(small(), whole, seed=3)
    assert [s.promoted for s in done] == [False, True, False]
    assert [s.evaluations[-1]["step"] for s in done] == [160, 80, 160]


def learner(whole: Path, stage: int, file: str) -> MasacLearner:
    names = ("1-source", "2-transition_2", "3-target")
    task = make_task(small().stages[stage].task, {"horizon": 4})
    given = learner_for(small(), stage, task, 3)
    given.set_state(load_checkpoint(whole / names[stage] / file)["learner"])
    return given


def test_at_a_switch_each_acts_exactly_as_one_did_that_cannot_see_what_wakes_up(
    whole: Path,
) -> None:
    last, began = learner(whole, 0, "checkpoint.pt"), learner(whole, 1, "switch.pt")
    awake = last._replay.awake()
    assert 6 < awake.sum() < 14  # itself, and a target at rest
    seen = np.random.default_rng(0).normal(size=(20, 2, 31)).astype(np.float32)
    asleep = np.where(awake, seen, 0).astype(np.float32)
    for i in range(2):
        expected = last.act(asleep[:, i : i + 1], explore=False)
        assert np.array_equal(began.act(seen[:, i : i + 1], explore=False), expected)


def test_a_folder_of_another_curriculum_or_seed_is_refused(whole: Path) -> None:
    with pytest.raises(InputInvalid, match="seed 3; expected 4"):
        train_curriculum(small(), whole, seed=4)
    with pytest.raises(InputInvalid, match=r"envs 8; expected 4, .*--restart"):
        train_curriculum(small(envs=4), whole, seed=3)
    other = replace(small().stages[2], steps=80)
    with pytest.raises(InputInvalid, match="stage 3, steps 160; expected 80"):
        train_curriculum(replace(small(), stages=(*small().stages[:2], other)), whole, seed=3)


def test_two_processes_do_not_go_through_a_curriculum_in_one_folder(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(InputInvalid, match="another process trains there now"):
        train_curriculum(small(), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == [".in_use"]
    with pytest.raises(KeyboardInterrupt):  # once it is free, it is taken, and let go of
        train_curriculum(small(), tmp_path, interrupted=lambda: True)
    with locked(tmp_path):
        pass


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    for restart in (False, True):
        with pytest.raises(InputInvalid, match="contains other files; expected an empty or a new"):
            train_curriculum(small(), tmp_path, restart=restart)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_begun_anew_a_curriculum_is_as_if_it_were_the_first(whole: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(whole, tmp_path / "copy")
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(KeyboardInterrupt):
        train_curriculum(small(envs=4), folder, restart=True, interrupted=lambda: True)
    assert sorted(p.name for p in folder.iterdir() if p.is_dir()) == ["1-source"]
    ended = []
    train_curriculum(
        small(), folder, seed=3, restart=True, stage_ends=lambda k, s: ended.append((k, s.task))
    )
    assert ended == [(0, "source"), (1, "transition_2"), (2, "target")]
    assert policies(folder) == policies(whole)
    assert (folder / "notes.txt").is_file()


def test_what_a_stage_has_lost_is_named(whole: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(whole, tmp_path / "copy")
    (folder / "1-source" / "evaluations.csv").unlink()
    with pytest.raises(InputInvalid, match=r"evaluations\.csv: cannot be read"):
        train_curriculum(small(), folder, seed=3)
    (folder / "curriculum.json").write_text("{")
    with pytest.raises(InputInvalid, match=r"curriculum\.json: cannot be read"):
        train_curriculum(small(), folder, seed=3)


def test_a_lost_switch_is_made_again_to_the_same_bits(whole: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(whole, tmp_path / "copy")
    shutil.rmtree(folder / "3-target")
    train_curriculum(small(), folder, seed=3)
    assert policies(folder) == policies(whole)


def test_the_file_of_a_curriculum_says_what_python_says(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(
        "name: small\nenvs: 8\nevaluate_every: 80\nevaluation_episodes: 4\n"
        "settings: {hidden: 16, batch: 16, buffer: 1000, shared: true, updates: 1.0}\n"
        "options: {horizon: 4}\nstages:\n"
        "  - {task: source, steps: 160, settings: {warm_up: 32}}\n"
        "  - task: transition_2\n    steps: 240\n    settings: {critic_only: 4}\n"
        "    promotion: {least: -1.0e6, evaluations: 2}\n"
        "  - {task: target, steps: 160, settings: {critic_only: 4}}\n"
    )
    assert read_curriculum(path) == small()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stages: 3", "expected a list of stages"),
        ("stages: [{task: source}]", "steps missing"),
        ("stages: [{task: source, steps: 8, promotion: {shar: 1}}]", "shar: unknown.*share"),
        ("stages: [{task: source, steps: 0}]", "steps 0; expected a whole number"),
        ("stages: [{task: source, steps: 8}]\nalgorithm: ppo", "transfers nothing; expected masac"),
        ("stages: [{task: source, steps: 8}]\nsettings: 3", "settings: 3; expected values by name"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with pytest.raises(InputInvalid, match=message):
        read_curriculum(path)


def test_stages_that_observe_other_numbers_are_refused(tmp_path: Path) -> None:
    three = Stage("target", 80, options={"n_trackers": 3})
    with pytest.raises(InputInvalid, match=r"stage 2: observes 38 .* slots"):
        train_curriculum(Curriculum("x", (Stage("source", 80), three)), tmp_path / "x")


def test_a_curriculum_without_stages_is_refused() -> None:
    with pytest.raises(InputInvalid, match="curriculum x: no stages; expected at least one"):
        Curriculum("x", ())


def test_unknown_names_are_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="expected one such as stt"):
        curriculum_of("sst")
    wrong = Curriculum("x", (Stage("source", 8), Stage("transition_3", 8)))
    with pytest.raises(InputInvalid, match="transition_2"):
        train_curriculum(wrong, tmp_path / "x")
    assert not (tmp_path / "x").exists()
    assert CURRICULA["stt"].stages[-1].task == "target"


def test_mirror_without_a_symmetry_is_refused_with_its_stage_before_anything_runs(
    tmp_path: Path,
) -> None:
    stages = (Stage("source", 80), Stage("transition_1", 80, {"motion": "path"}))
    one_way = Curriculum("c", stages, settings={"mirror": True}, envs=8)
    with pytest.raises(InputInvalid, match=r"stage 2: mirror: transition_1 has no symmetry"):
        train_curriculum(one_way, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_a_folder_stands_for_its_last_finished_stage(whole: Path, tmp_path: Path) -> None:
    found = acting_of([str(whole)], None, {})
    assert (found.name, found.options) == ("target", {"horizon": 4})
    best = load_policies(whole / "3-target")
    assert [p.trained for p in load_policies(whole)] == [p.trained for p in best]
    with pytest.raises(InputInvalid, match=r"3-target: policies of .*, as best-tracker_1\.npz"):
        export_policy(whole, tmp_path / "p.pth")
    folder = shutil.copytree(whole, tmp_path / "copy")
    about = json.loads((folder / "curriculum.json").read_text())
    write_done(folder, small(), 3, about["done"][:1])
    (alone,) = load_policies(folder, "policy")
    assert (alone.task, alone.trained["step"]) == ("source", 160)
    (written,) = export_policy(folder, tmp_path / "p.pth")
    assert written.is_file()
    write_done(folder, small(), 3, [])
    with pytest.raises(InputInvalid, match="no stage of this curriculum is done; expected one"):
        load_policies(folder)


def test_what_is_asked_for_beside_a_curriculum_comes_after_what_its_stages_say() -> None:
    first = Stage("source", 80, {"rules": {"w_p": 0.1}}, {"lr": 1e-3}, evaluate_every=20)
    plan = Curriculum("c", (first, Stage("target", 80)), options={"rules": {"credit": "own"}})
    asked = plan.changed(
        settings={"critic_only": 10, "lr": 1e-4}, options={"rules": {"w_p": 0.2}, "horizon": 4},
        evaluate_every=40, envs=8,
    )  # fmt: skip
    assert settings_of(asked, 0) == {"lr": 1e-4, "critic_only": 10}
    assert settings_of(asked, 1) == {"lr": 1e-4, "critic_only": 10, "warm_up": 0}
    assert settings_of(plan, 1) == {"critic_only": 500, "warm_up": 0}
    told = [{**asked.options, **s.options} for s in asked.stages]
    assert told[0] == {"rules": {"w_p": 0.2}, "horizon": 4}
    assert told[1] == {"rules": {"credit": "own", "w_p": 0.2}, "horizon": 4}
    assert [s.evaluate_every or asked.evaluate_every for s in asked.stages] == [40, 40]
    assert asked.envs == 8
    assert plan.changed() == plan
