"""A training from its configuration: `train("transition_1", algorithm="sac", seed=3)`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.registry import algorithm_for, check_settings, learner_of
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.agents import agents_of, widths
from uuvsim_cosim.learn.training.config import TrainingConfig, read_config
from uuvsim_cosim.learn.training.events import Events
from uuvsim_cosim.learn.training.folders import locked, refuse_other, write_owner
from uuvsim_cosim.learn.training.interruption import Interruption, TrainingInterrupted
from uuvsim_cosim.learn.training.loading import load_policies

if TYPE_CHECKING:
    from uuvsim_cosim.learn.algorithms.learner import Learner
    from uuvsim_cosim.learn.training.training import Training, TrainingObserver

__all__ = [
    "Trained",
    "learner_in",
    "one_thread",
    "resolved",
    "train",
    "training_folder",
    "training_of",
]


@dataclass(frozen=True)
class Trained:
    """The results of a training, from its folder."""

    folder: Path
    config: TrainingConfig
    evaluations: Sequence[Mapping[str, float]]  # one row each, the first before learning
    cpu: float  # s, of this call
    note: str | None = None  # why nothing was learned, where that is so

    def policies(self, which: str = "best") -> dict[str, Policy]:
        """Return the policies by agent: "best" of the evaluations, or "policy", the last."""
        return {p.agent or "agent": p for p in load_policies(self.folder, which)}


def train(
    given: TrainingConfig | str | Path,
    *,
    folder: str | Path | None = None,
    restart: bool = False,
    observers: tuple[TrainingObserver, ...] = (),
    tensorboard: bool = True,
    first: int | None = None,
    interrupted: Callable[[], bool] | None = None,
    **changes: Any,
) -> Trained:
    """Train, or resume a training, in `folder` (runs/train/TASK-ALGORITHM-SEED).

    `given` is a configuration, a YAML file of one, or a task's name; `changes` are fields of
    TrainingConfig. After Ctrl-C, the current step is saved and TrainingInterrupted raised; the
    same call resumes, to the same bits. Torch computes on one thread. `first` is the first seed of
    the environments, see `Training`; `interrupted` is called after each step too.
    """
    if isinstance(given, TrainingConfig):
        config = given.changed(**changes)
    elif isinstance(given, Path) or str(given).endswith((".yaml", ".yml")):
        config = read_config(given, **changes)
    else:
        config = TrainingConfig(given, **changes)
    task = make_task(config.task, config.task_options, profile=config.profile)
    config = config.changed(algorithm=algorithm_for(config.algorithm, len(agents_of(task))).name)
    place = training_folder(config) if folder is None else Path(folder)
    with ExitStack() as stack:
        refuse_other(place, config, restart)
        stack.enter_context(one_thread())
        if tensorboard and Events.possible():
            observers = (*observers, stack.enter_context(Events(place)))
        interruption = Interruption()

        def either() -> bool:
            return interruption() or (interrupted is not None and interrupted())

        training = training_of(
            config, task, place, observers=observers, interrupted=either, first=first
        )
        stack.callback(training.close)
        stack.enter_context(locked(place))
        if not restart:
            training.resume()  # an error here leaves the folder unchanged
        write_owner(place, config, restart)
        with interruption:
            try:
                rows = training.run()
            except KeyboardInterrupt:
                raise TrainingInterrupted(
                    f"interrupted after step {training.step} of {config.steps}; the same command "
                    f"goes on from {training.checkpoint}",
                    interruption.status,
                ) from None
        return Trained(place, config, rows, training.cpu, training.note)


def training_of(
    config: TrainingConfig,
    task: Task | TeamTask,
    folder: Path,
    *,
    observers: tuple[TrainingObserver, ...] = (),
    interrupted: Callable[[], bool] | None = None,
    first: int | None = None,
) -> Training:
    """Make a training, ready to `run`; raises InputInvalid if it cannot be."""
    learner = learner_in(task, config.algorithm, config.settings, n=config.envs, seed=config.seed)
    from uuvsim_cosim.learn.training.training import Training

    options = dict(config.plain()["task_options"])
    if config.profile != "default":  # the task is made again from its name and options
        options["profile"] = config.profile
    return Training(
        task, learner, name=config.task, options=options, n=config.envs, seed=config.seed,
        steps=config.steps, folder=folder, evaluate_every=config.evaluate_every,
        evaluation_episodes=config.evaluation_episodes, checkpoint_every=config.checkpoint_every,
        observers=observers, interrupted=interrupted, first=first,
    )  # fmt: skip


def learner_in(
    task: Task | TeamTask, name: str | None, settings: Mapping[str, object], *, n: int, seed: int
) -> Learner:
    """Make a learner for n copies of a task; raises InputInvalid."""
    agents = len(agents_of(task))
    observed, acted = widths(task)
    return learner_of(
        algorithm_for(name, agents), settings, agents=agents, observed=observed, acted=acted, n=n,
        seed=seed, symmetries=task.symmetries(),
    )  # fmt: skip


def resolved(config: TrainingConfig) -> TrainingConfig:
    """Return the configuration with the algorithm's name and settings with their types.

    Raises InputInvalid for an invalid task, algorithm or setting.
    """
    task = make_task(config.task, config.task_options, profile=config.profile)
    algorithm = algorithm_for(config.algorithm, len(agents_of(task)))
    return config.changed(
        algorithm=algorithm.name, settings=check_settings(algorithm, config.settings)
    )


def training_folder(config: TrainingConfig, parent: Path = Path("runs") / "train") -> Path:
    """Return runs/train/TASK-ALGORITHM-SEED."""
    return parent / config.name


def one_thread() -> ExitStack:
    """Let torch and NumPy compute on one thread until the exit.

    One thread is faster for small batches. NumPy's product of matrices has other bits with more
    threads on some processors, so that a worker of a cluster and this process would differ.
    """
    stack = ExitStack()
    try:
        import torch
    except ModuleNotFoundError:
        return stack  # learner_of raises the error
    try:
        from threadpoolctl import threadpool_limits
    except ModuleNotFoundError as error:
        raise InputInvalid("threadpoolctl is not installed", "pip install threadpoolctl") from error
    stack.callback(torch.set_num_threads, torch.get_num_threads())
    torch.set_num_threads(1)
    stack.enter_context(threadpool_limits(1, user_api="blas"))
    return stack
