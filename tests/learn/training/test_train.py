"""A training from its configuration: it goes on after Ctrl-C, and refuses what is not its own."""

from __future__ import annotations

import re
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.checkpoint import load_checkpoint
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.learn.shared.errors import LearningDiverged
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.folders import locked
from uuvsim_cosim.learn.training.interruption import TrainingInterrupted
from uuvsim_cosim.learn.training.loading import acting_in, load_policies
from uuvsim_cosim.learn.training.train import Trained, train
from uuvsim_cosim.learn.training.training import Progress

FILES = ("policy.npz", "best.npz", "evaluations.csv", "episodes.csv")
SMALL: dict[str, Any] = {
    "envs": 8, "steps": 320, "evaluate_every": 160, "evaluation_episodes": 4,
    "task_options": {"horizon": 4},
}  # fmt: skip
SETTINGS = {
    "sac": {"hidden": 16, "batch": 16, "warm_up": 32, "buffer": 200},
    "dqn": {"hidden": 16, "batch": 16, "warm_up": 32, "buffer": 200},
    "ppo": {"hidden": 16, "batch": 16, "samples": 96, "epochs": 2},
}


def small(folder: Path, algorithm: str = "sac", **more: Any) -> Trained:
    given = {**SMALL, "settings": SETTINGS[algorithm], "tensorboard": False, **more}
    return train("source", algorithm=algorithm, folder=folder, **given)


class Interrupt:
    """Presses Ctrl-C, or ends the process, after so many environment steps."""

    def __init__(self, step: int, number: int = signal.SIGINT) -> None:
        self.step, self.number = step, number

    def __call__(self, progress: Progress) -> None:
        if progress.what == "step" and progress.step == self.step:
            signal.raise_signal(signal.Signals(self.number))


@pytest.mark.parametrize(
    ("algorithm", "number", "status"),
    [("sac", signal.SIGINT, 130), ("ppo", signal.SIGTERM, 143), ("dqn", signal.SIGINT, 130)],
)
def test_an_interrupted_training_goes_on_to_the_same_bits(
    algorithm: str, number: int, status: int, tmp_path: Path
) -> None:
    small(tmp_path / "whole", algorithm)
    with pytest.raises(
        TrainingInterrupted, match=r"after step 168 of 320; the same .* continues"
    ) as e:
        small(tmp_path / "parts", algorithm, observers=(Interrupt(168, number),))
    assert e.value.status == status
    done = small(tmp_path / "parts", algorithm)
    assert len(done.evaluations) == 3
    for name in FILES:
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "parts" / name).read_bytes()


def test_a_gradient_that_is_no_number_stops_it_and_keeps_what_was_before(tmp_path: Path) -> None:
    from uuvsim_cosim.learn.algorithms.masac import Masac

    update = Masac.update

    def broken(self: Masac, *given: Any, **more: Any) -> Any:
        broken.calls += 1  # type: ignore[attr-defined]
        if broken.calls == 30:  # type: ignore[attr-defined]
            self.critic.weights[0].register_hook(lambda g: g * float("nan"))
        return update(self, *given, **more)

    broken.calls = 0  # type: ignore[attr-defined]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Masac, "update", broken)
        with pytest.raises(LearningDiverged, match="gradient of critic is nan") as told:
            small(tmp_path)
    assert "stopped after step 256; " in str(told.value)
    assert "sac: the gradient" in str(told.value)
    assert "checkpoint.pt is of step 160" in str(told.value)
    assert "diverged.pt and policy.npz are of then" in str(told.value)
    counted = load_checkpoint(tmp_path / "diverged.pt")["counters"]
    assert counted["step"] == Policy.load(tmp_path / "policy.npz").trained["step"] == 256
    assert (tmp_path / "episodes.csv").is_file()
    assert len(small(tmp_path).evaluations) == 3  # without the fault it goes on from there


def test_a_folder_of_another_training_is_refused_and_can_be_begun_anew(tmp_path: Path) -> None:
    small(tmp_path, steps=8, evaluate_every=8)
    with pytest.raises(
        InputInvalid, match=r"holds a training with seed 0; expected 3, .*--restart"
    ):
        small(tmp_path, seed=3, steps=8, evaluate_every=8)
    again = small(tmp_path, seed=3, steps=8, evaluate_every=8, restart=True)
    assert again.policies()["agent"].trained["seed"] == 3


@pytest.mark.parametrize(
    ("algorithm", "changes", "said"),
    [
        ("sac", {"warm_up": 1000}, "no update was made: warm_up is 1000, steps 80; .* 1000 steps"),
        ("sac", {"updates": 0.01}, "no update was made: updates is 0.01 for each step"),
        ("sac", {"critic_only": 500}, "no actor was updated: critic_only is 500, updates made 7"),
        ("dqn", {"batch": 100}, "no update was made: batch is 100, steps 80"),
        ("ppo", {"samples": 2048}, "no update was made: samples is 2048, steps 80"),
        ("ppo", {"samples": 80}, None),
        ("sac", {}, None),
    ],
)
def test_a_training_too_short_for_an_update_says_so(
    algorithm: str, changes: dict[str, Any], said: str | None, tmp_path: Path
) -> None:
    given: dict[str, Any] = {"steps": 80, "evaluate_every": 80}
    settings = {**SETTINGS[algorithm], **changes}
    for _ in range(2):  # what was learned before is known where nothing is left to do
        note = small(tmp_path, algorithm, settings=settings, **given).note
        assert (note is None) if said is None else re.match(said, note or "")


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(
        InputInvalid, match="contains other files; expected an empty or a new folder"
    ):
        small(tmp_path)


def test_two_processes_do_not_train_in_one_folder(tmp_path: Path) -> None:
    small(tmp_path, steps=8, evaluate_every=8)
    with locked(tmp_path), pytest.raises(InputInvalid, match="another process trains there now"):
        small(tmp_path, steps=16, evaluate_every=8)
    assert small(tmp_path, steps=16, evaluate_every=8).evaluations[-1]["step"] == 16


def test_a_task_that_cannot_be_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="whole multiple"):
        small(tmp_path / "new", task_options={"horizon": 5})
    assert not (tmp_path / "new").exists()


def test_more_steps_go_on_and_the_curves_are_written_for_tensorboard(tmp_path: Path) -> None:
    small(tmp_path, steps=80, tensorboard=True)
    done = small(tmp_path, steps=160, tensorboard=True)
    assert [r["step"] for r in done.evaluations] == [0, 80, 160]
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    read = EventAccumulator(str(tmp_path)).Reload()
    assert {"evaluation/return", "episodes/track", "loss/critic_loss"} <= set(
        read.Tags()["scalars"]
    )
    assert [e.step for e in read.Scalars("evaluation/return")] == [0, 80, 160]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"algorithm": "saac"}, "algorithm 'saac'; expected one such as sac"),
        ({"task": "target", "algorithm": "sac"}, "for one agent, the task has 2; expected masac"),
        ({"settings": {"leaning_rate": 1}}, "expected one of lr, gamma"),
        ({"settings": {"buffer": 4}}, "buffer 4; expected at least 8, one a step"),
        ({"settings": {"central": False}}, "setting 'central'; expected"),
    ],
)
def test_what_cannot_be_learned_is_refused(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    from uuvsim_cosim.learn.training.config import TrainingConfig

    with pytest.raises(InputInvalid, match=said):
        train(TrainingConfig("source", algorithm="sac", envs=8).changed(**changes), folder=tmp_path)
    assert not list(tmp_path.iterdir())


def test_without_torch_one_sentence_says_which_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputInvalid, match=r"learning expects torch: pip install .*\[rl\]"):
        train("source", folder=tmp_path)


def test_policies_of_two_act_for_three_and_never_where_they_see_other_things(
    tmp_path: Path,
) -> None:
    done = train(
        "transition_2", folder=tmp_path, envs=2, steps=4, evaluate_every=4, evaluation_episodes=1,
        task_options={"horizon": 2, "slots": [2, 2]}, settings={"hidden": 4}, tensorboard=False,
    )  # fmt: skip
    policies = load_policies(done.folder / "best-tracker_2.npz")
    assert [p.agent for p in policies] == ["tracker_1", "tracker_2"]
    options = {"n_trackers": 3, "slots": [2, 2]}
    acts = acting_in(make_task("target", options), policies, "target")
    assert acts["tracker_3"] is policies[0]
    with pytest.raises(InputInvalid, match=r"observes .* numbers .*; expected"):
        acting_in(make_task("uuvsim/StationKeeping-v0"), policies, "station keeping")
