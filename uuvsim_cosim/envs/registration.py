"""Registration of tasks with Gymnasium, for `gymnasium.make` and `gymnasium.make_vec`."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING

from uuvsim_cosim.envs.task.checks import refuse_options
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from gymnasium.vector import AutoresetMode

    from uuvsim_cosim.envs.plants.choice import Backend, DType
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.task.task import Task
    from uuvsim_cosim.envs.vector import CosimVectorEnv

__all__ = ["SHIPPED", "make_env", "make_vector_env", "register", "register_shipped"]

_TASKS = {  # names under uuvsim/, and in uuvsim_cosim.envs.tasks
    "StationKeeping-v0": "station_keeping:StationKeeping",
    "TrajectoryFollowing-v0": "trajectory:TrajectoryFollowing",
    "AltitudeFollowing-v0": "altitude_following:AltitudeFollowing",
    "DisturbanceRejection-v0": "disturbance:DisturbanceRejection",
    "TargetTracking-v0": "target_tracking:TargetTracking",
    "TargetTrackingSource-v0": "tracking_scenarios:source",
    "TargetTrackingTransition1-v0": "tracking_scenarios:transition_1",
    "TargetTrackingTransition2-v0": "tracking_scenarios:transition_2",
    "TargetTrackingTarget-v0": "tracking_scenarios:target",
}
_OF_MANY = ("threads", "dtype", "processes", "autoreset_mode")  # options of make_vector_env only
SHIPPED = {f"uuvsim/{id}": f"uuvsim_cosim.envs.tasks.{name}" for id, name in _TASKS.items()}


def register(id: str, make_task: str | Callable[..., Task], **options: object) -> None:
    """Register a task with Gymnasium under an `id`, for `gymnasium.make` and `gymnasium.make_vec`.

    `make_task` is a callable, or its name "package.module:name", which is imported when it is first
    used. It is called with `options` and with the keyword arguments of `gymnasium.make`, and
    returns a task. With a name, the spec of the id can be written as JSON. The time limit is the
    horizon of the task; there is no second limit. Raises InputInvalid for a name of another form.

    Example:

    >>> import gymnasium
    >>> from uuvsim_cosim.envs import register
    >>> register("mine/Near-v0", "uuvsim_cosim.envs.tasks:StationKeeping", away=0.5)  # m
    >>> env = gymnasium.make("mine/Near-v0", horizon=10)  # s
    >>> env.spec.max_episode_steps  # actions of 0.1 s
    100
    """
    import gymnasium

    if isinstance(make_task, str):
        module, colon, name = make_task.partition(":")
        if not colon or not all(part.isidentifier() for part in (*module.split("."), name)):
            raise InputInvalid(f"task {make_task!r} of {id}", "'package.module:name'")
    gymnasium.register(
        id,
        entry_point=f"{__name__}:make_env",
        vector_entry_point=f"{__name__}:make_vector_env",
        kwargs={"make_task": make_task, **options},
    )


def register_shipped() -> None:
    """Register the tasks that ship, once."""
    import gymnasium

    for id, make_task in SHIPPED.items():
        if id not in gymnasium.registry:
            register(id, make_task)


def make_env(
    make_task: str | Callable[..., Task],
    *,
    render_mode: str | None = None,
    backend: Backend = "auto",
    **options: object,
) -> CosimEnv:
    """Make one environment; other options are the task's."""
    from uuvsim_cosim.envs.single import CosimEnv

    return CosimEnv(_task(make_task, options), render_mode=render_mode, backend=backend)


def make_vector_env(
    num_envs: int,
    make_task: str | Callable[..., Task],
    *,
    render_mode: str | None = None,
    backend: Backend = "auto",
    autoreset_mode: AutoresetMode | str = "NextStep",
    threads: int = 1,
    dtype: DType = "float64",
    processes: int | None = None,
    **options: object,
) -> CosimVectorEnv:
    """Make many environments; other options are the task's."""
    from uuvsim_cosim.envs.vector import CosimVectorEnv

    return CosimVectorEnv(
        _task(make_task, options),
        num_envs,
        render_mode=render_mode,
        backend=backend,
        autoreset_mode=autoreset_mode,
        threads=threads,
        dtype=dtype,
        processes=processes,
    )


def _task(make_task: str | Callable[..., Task], options: dict[str, object]) -> Task:
    from uuvsim_cosim.envs.task.task import TeamTask

    steps = options.pop("max_episode_steps", None)  # gymnasium.make_vec passes the spec's
    if isinstance(make_task, str):
        name = make_task
        module, _, own = name.partition(":")
        try:
            make: Callable[..., Task] = getattr(import_module(module), own)
        except (ImportError, AttributeError) as error:
            raise InputInvalid(f"task {name!r}", error, "'package.module:name'") from error
    else:
        make, name = make_task, getattr(make_task, "__name__", "")
    for option in _OF_MANY:
        if option in options:
            raise InputInvalid(option, "applies to many environments", "it in make_vec")
    refuse_options(f"task {name}", make, options)
    task = make(**options)
    if steps is not None and steps != task.horizon / task.action_step:
        raise InputInvalid("max_episode_steps", "is set by the task", "horizon= in seconds")
    if isinstance(task, TeamTask):
        from uuvsim_cosim.envs.solo import Solo

        return Solo(task)
    return task
