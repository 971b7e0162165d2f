"""Training of a policy from its configuration: `train("transition_1", seed=3)`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

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
from uuvsim_cosim.notebook_bar import Progress, shown

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
    note: str | None = None  # the reason, if nothing was learned

    def policies(self, which: str = "best") -> dict[str, Policy]:
        """Return the policies by agent; `which` is "best" (of the evaluations) or "policy" (last).

        The agent of a task of one agent is "agent".
        """
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
    progress: Progress | Literal[False] | None = None,
    **changes: Any,
) -> Trained:
    """Train policies in a folder, or resume the training there; return its results.

    `given` is the name of a task ("source", "uuvsim/StationKeeping-v0", "package.module:Name"), a
    YAML file, or a `TrainingConfig`. `changes` are fields of a configuration, which override those:
    `algorithm`, `seed`, `envs`, `steps`, `task_options`, `settings`, `evaluate_every`, …;
    docs/learning/learning.md lists them with their defaults. `steps` and `evaluate_every` count
    environment steps, summed over all environments.

    `folder` is by default runs/train/TASK-ALGORITHM-SEED. An interrupted training resumes there and
    gives the same bits; `restart` starts it from the beginning. `observers` receive the progress of
    each step. With `tensorboard`, curves are written for TensorBoard, too. `first` is the seed of
    the first environment, by default one that no training with another `seed` uses. If
    `interrupted`, which is called after each step, returns True, the training ends as after Ctrl-C.
    Torch computes on one thread. The result has `evaluations` (one row each, with the mean
    "return"), `policies()`, the CPU time `cpu` [s], and in `note` the reason if nothing was
    learned.

    ``progress("training", done, total)`` counts environment steps; without it, a notebook shows a
    bar while the training lasts. With False, there is no bar.

    Needs the extra `rl`. Raises InputInvalid for an invalid configuration and for a folder of
    another training, TrainingInterrupted after Ctrl-C, when the current step has been saved, and
    LearningDiverged if a loss or a gradient is not finite.

    Example:

    >>> from uuvsim_cosim.learn import train
    >>> result = train(  # much too short to learn the task: it takes about 25,000 steps
    ...     "source",
    ...     folder="first",
    ...     envs=8,
    ...     steps=320,
    ...     evaluate_every=160,
    ...     evaluation_episodes=2,
    ...     settings={"hidden": 16, "batch": 16, "warm_up": 64},
    ... )
    >>> [row["step"] for row in result.evaluations]  # the first one before learning
    [0.0, 160.0, 320.0]
    >>> policy = result.policies("best")["agent"]
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
        if (report := stack.enter_context(shown(progress))) is not None:
            observers = (*observers, lambda p: report("training", p.step, p.steps))
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
                    f"continues from {training.checkpoint}",
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
    """Make a training that can `run`; raises InputInvalid for an invalid configuration."""
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
    """Return the default folder of a training, runs/train/TASK-ALGORITHM-SEED."""
    return parent / config.name


def one_thread() -> ExitStack:
    """Return a context in which torch and NumPy compute on one thread.

    One thread is faster for small batches. On some processors, NumPy's matrix product has other
    bits with more threads, so that a worker of a cluster and this process would differ.
    """
    stack = ExitStack()
    try:
        import torch
    except ModuleNotFoundError:
        return stack  # learner_of raises the error
    try:
        from threadpoolctl import threadpool_limits
    except ModuleNotFoundError as error:
        raise InputInvalid(
            "threadpoolctl is not installed", "pip install 'uuvsim-cosim[rl]'"
        ) from error
    stack.callback(torch.set_num_threads, torch.get_num_threads())
    torch.set_num_threads(1)
    stack.enter_context(threadpool_limits(1, user_api="blas"))
    return stack
