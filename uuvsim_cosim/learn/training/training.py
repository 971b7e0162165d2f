"""Training: a learner acts in a task, is evaluated on other seeds, and is saved."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, final

import numpy as np

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.envs.tasks.evaluation import Evaluation, evaluate
from uuvsim_cosim.envs.tasks.scripted import Policies
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.learn.algorithms.checkpoint import load_checkpoint, save_checkpoint
from uuvsim_cosim.learn.algorithms.learner import Learner
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.learn.shared.errors import LearningDiverged
from uuvsim_cosim.learn.training.rollout import Rollout
from uuvsim_cosim.learn.training.training_seeds import EVALUATION_SEED, first_of_training

__all__ = [
    "EVALUATION_SEED",
    "Progress",
    "Training",
    "TrainingObserver",
    "acting",
    "taught_nothing",
]


@dataclass(frozen=True)
class Progress:
    """Progress of a training; `row` has the numbers of the last step, episodes or evaluation."""

    step: int  # environment steps, summed over all environments
    steps: int  # those of the whole training
    episodes: int
    row: Mapping[str, float] = field(default_factory=dict)
    what: str = "step"  # "step", "episodes", "evaluation", "checkpoint"


class TrainingObserver(Protocol):
    """Observer of a training: a function that receives the progress."""

    def __call__(self, progress: Progress) -> None:
        """Receive the progress."""


@final
class Training:
    """Training of a `learner` in `n` environments of a `task`, for `steps` environment steps.

    Its `folder` holds episodes.csv (one row for each episode), evaluations.csv, policy.npz (the
    last policy), best.npz (the policy of the best evaluation) and checkpoint.pt. `run` resumes from
    the checkpoint and gives the same bits as without an interruption. `name` and `options` are
    those from which the task can be made again. Environment i has the seed `first` + i, by default
    one that no training with another `seed` uses. The training ends early if `stop` returns True
    for an evaluation.
    """

    def __init__(
        self,
        task: Task | TeamTask,
        learner: Learner,
        *,
        name: str,
        options: Mapping[str, object],
        n: int,
        seed: int,
        steps: int,
        folder: Path,
        evaluate_every: int,
        evaluation_episodes: int = 100,
        checkpoint_every: int | None = None,
        observers: tuple[TrainingObserver, ...] = (),
        stop: Callable[[Evaluation], bool] | None = None,
        interrupted: Callable[[], bool] | None = None,
        first: int | None = None,
    ) -> None:
        self.task, self.learner, self.folder = task, learner, folder
        self.name, self.options = name, dict(options)
        self.n, self.seed, self.steps = n, seed, steps
        self._evaluate_every, self._evaluation_episodes = evaluate_every, evaluation_episodes
        self._checkpoint_every = checkpoint_every or evaluate_every
        self._observers, self._stop, self._interrupted = observers, stop, interrupted
        self.rollout = Rollout(task, n, first_of_training(seed) if first is None else first)
        self.step, self.episodes, self.cpu = 0, 0, 0.0
        self.updates: int | None = 0  # None: unknown, from an older checkpoint
        self.best = -np.inf
        self.evaluations: list[dict[str, float]] = []
        self._rows: list[dict[str, float]] = []
        self._resumed = False

    @property
    def checkpoint(self) -> Path:
        """The file from which the training resumes."""
        return self.folder / "checkpoint.pt"

    @property
    def note(self) -> str | None:
        """The reason if nothing has been learned so far, else None."""
        return taught_nothing(self.learner.settings, self.step, self.updates)

    def run(self) -> list[dict[str, float]]:
        """Train to the end; return one row for each evaluation, the first before any update.

        The last evaluation is always made at the end. If `interrupted` returns True after a step,
        that step is saved and KeyboardInterrupt is raised. If a loss or a gradient is not finite,
        LearningDiverged is raised; the state is then in diverged.pt and policy.npz, and the last
        checkpoint stays valid.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        self.resume()
        if not self._resumed and not self.evaluations:
            self._evaluate()
            self.save()
        kept = self.step
        began = time.process_time()
        try:
            while self.step < self.steps:
                if self.evaluations and self.evaluations[-1].get("stopped"):
                    break  # `stop` found the last evaluation good enough
                self._one_step()
                if self._passed(self._evaluate_every):
                    self._evaluate()
                if self._passed(self._checkpoint_every):
                    self.save()
                    kept = self.step
                if self._interrupted is not None and self._interrupted():
                    self.save()
                    raise KeyboardInterrupt
        except Exception as error:
            last = f"stopped after step {self.step}; {self.checkpoint} is of step {kept}"
            with suppress(OSError):  # the disk may be full: the first error is reported
                self._write_curves()
            if isinstance(error, LearningDiverged):
                beside = self.folder / "diverged.pt"
                with suppress(OSError, UuvsimError):  # a full disk, or NaN in the networks
                    save_checkpoint(beside, self._content())
                    self._write_policies("policy")
                    last += f"; {beside} and policy.npz are of then"
                raise error.saying(self.learner.name, last) from None
            error.add_note(last)
            raise
        finally:
            self.cpu += time.process_time() - began
        if self.evaluations[-1]["step"] != self.step:
            self._evaluate()
        self.save()
        return self.evaluations

    def resume(self) -> None:
        """Load the checkpoint, if there is one; a second call does nothing."""
        if self._resumed:
            return
        if not self.checkpoint.is_file():
            if _has_learned(self.folder / "evaluations.csv"):
                raise InputInvalid(
                    self.checkpoint,
                    "no such file, although curves of the training exist",
                    "it, another folder, or a new start (--restart)",
                )
            return
        read = load_checkpoint(self.checkpoint)
        own = {"task": self.name, "options": self.options, "algorithm": self.learner.name,
               "n": self.n, "seed": self.seed}  # fmt: skip
        for what, expected in own.items():
            if read.get(what) != expected:
                raise InputInvalid(
                    self.checkpoint,
                    f"{what} {read.get(what)!r}",
                    f"{expected!r}, or another folder",
                )
        try:
            self.rollout.set_state(read["rollout"])
            self.learner.set_state(read["learner"])
        except InputInvalid as error:
            raise InputInvalid(f"{self.checkpoint}: {error}") from None
        counters = read["counters"]
        self.step, self.episodes = int(counters["step"]), int(counters["episodes"])
        self.best, self.updates = float(counters["best"]), counters.get("updates")
        self._rows, self.evaluations = read["rows"], read["evaluations"]
        if self.step - self.n >= self.steps:
            raise InputInvalid(
                self.checkpoint,
                f"of step {self.step}, {self.steps} asked for",
                "at least as many steps, another folder, or a new start (--restart)",
            )
        self._resumed = True

    def _one_step(self) -> None:
        actions = self.learner.act(self.rollout.observation)
        transitions, ended = self.rollout.step(actions)
        over = self.rollout.steps == 0
        losses = self.learner.learn(transitions, over)
        self.step += self.n
        if losses:
            one_more = None if self.updates is None else self.updates + 1
            self.updates = int(losses["updates"]) if "updates" in losses else one_more
        if ended is not None:
            for i in range(len(ended.returns)):
                row = {"step": float(self.step), "return": float(ended.returns[i])}
                self._rows.append(row | {k: float(v[i]) for k, v in ended.metrics.items()})
            self.episodes += len(ended.returns)
            means = {"return": float(ended.returns.mean())}
            self._tell("episodes", means | {k: float(v.mean()) for k, v in ended.metrics.items()})
        self._tell("step", losses)

    def _passed(self, every: int) -> bool:
        return self.step // every > (self.step - self.n) // every

    def _evaluate(self) -> None:
        judged = evaluate(
            self.task, acting(self.task, self.policies()), self._evaluation_episodes,
            seed=EVALUATION_SEED,
        )  # fmt: skip
        row = {"step": float(self.step), "episodes": float(self.episodes), **judged.summary()}
        row["stopped"] = float(self._stop is not None and self._stop(judged))
        self.evaluations.append(row)
        self._tell("evaluation", row)
        if row["return"] > self.best:
            self.best = row["return"]
            self._write_policies("best")

    def policies(self) -> dict[str, Policy]:
        """Return each agent's present policy, without exploration."""
        seen, acts = self.rollout.named()
        given = {}
        for i, agent in enumerate(self.rollout.agents):
            kind, tensors = self.learner.tensors(i)
            given[agent] = Policy(
                kind=kind,  # type: ignore[arg-type]
                tensors=tensors,
                observation=seen,
                action=acts,
                task=self.name,
                options=self.options,
                agent=agent if len(self.rollout.agents) > 1 else "",
                trained={
                    "algorithm": self.learner.name,
                    "seed": self.seed,
                    "step": self.step,
                    "episodes": self.episodes,
                    **self.learner.settings,
                },
            )
        return given

    def save(self) -> None:
        """Write curves, policies and the checkpoint."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._write_curves()
        self._write_policies("policy")
        # Last: a resumed training rewrites curves and policies from its checkpoint.
        save_checkpoint(self.checkpoint, self._content())
        self._tell("checkpoint", {})

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        self.rollout.close()

    # ---- inside ---------------------------------------------------------------------------

    def _content(self) -> dict[str, object]:
        return {
            "task": self.name,
            "options": self.options,
            "algorithm": self.learner.name,
            "n": self.n,
            "seed": self.seed,
            "counters": {
                "step": self.step,
                "episodes": self.episodes,
                "best": self.best,
                "updates": self.updates,
            },
            "rows": self._rows,
            "evaluations": self.evaluations,
            "rollout": self.rollout.state(),
            "learner": self.learner.state(),
        }

    def _write_curves(self) -> None:
        _write_csv(self.folder / "episodes.csv", self._rows)
        _write_csv(self.folder / "evaluations.csv", self.evaluations)

    def _write_policies(self, stem: str) -> None:
        several = len(self.rollout.agents) > 1
        self.folder.mkdir(parents=True, exist_ok=True)
        for agent, policy in self.policies().items():
            policy.save(self.folder / f"{stem}{f'-{agent}' if several else ''}.npz")

    def _tell(self, what: str, row: Mapping[str, float]) -> None:
        for observer in self._observers:
            observer(Progress(self.step, self.steps, self.episodes, row, what))


def acting(task: Task | TeamTask, policies: Mapping[str, Policy]) -> Policies:
    """Return policies in the form that `evaluate` expects: of a team by agent, else one policy."""
    if isinstance(task, TeamTask):
        return dict(policies)
    (only,) = policies.values()
    return only


def _has_learned(curves: Path) -> bool:
    """Return whether a file of evaluations has rows after step 0."""
    try:
        rows = list(csv.DictReader(io.StringIO(curves.read_text(encoding="utf-8"))))
        return any(float(row.get("step") or 0) > 0 for row in rows)
    except (OSError, ValueError):
        return False


def _write_csv(path: Path, rows: list[dict[str, float]]) -> None:
    if not rows:
        return
    names = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)


BEFORE = ("samples", "warm_up", "batch")  # settings: environment steps before the first update


def taught_nothing(settings: Mapping[str, float], steps: int, updates: int | None) -> str | None:
    """Return the reason if no actor was updated, else None, also if `updates` is unknown.

    `settings` are those of the learner, which made `updates` updates in `steps` environment steps.
    """
    if updates is None:
        return None
    late = int(settings.get("critic_only", 0))
    if updates and updates > late:
        return None
    if updates:
        return (
            f"no actor was updated: critic_only is {late}, updates made {updates}; expected more "
            "steps, or a lower critic_only"
        )
    value, name = max((int(settings.get(name, 0)), name) for name in BEFORE)
    if value > steps:
        return (
            f"no update was made: {name} is {value}, steps {steps}; expected at least {value} "
            f"steps, or a lower {name}"
        )
    return (
        f"no update was made: updates is {settings.get('updates', 0):g} for each step of all "
        f"environments, steps {steps}; expected more of them"
    )
