"""The environments to examine, made from an id or a function of the user."""

from __future__ import annotations

import copy
import importlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv

from uuvsim_cosim.envs.conformance.subject import Environment, Kind, Make, Subject
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.vector import CosimVectorEnv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

if TYPE_CHECKING:
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.team import CosimParallelEnv

__all__ = ["Fails", "failing_of", "start_of", "subjects_of"]


def subjects_of(
    env: Any,
    *,
    vector: Callable[[int], Any] | None = None,
    single: Make | None = None,
    failing: Make | None = None,
    start: dict[str, Any] | None = None,
    time: Callable[[Any], float] | None = None,
    action_step: Fraction | str | float | None = None,
    time_limit: int | None = None,
    num_envs: int = 3,
    steps: int = 64,
    seed: int = 7,
    strict: bool = False,
) -> tuple[str, list[Subject]]:
    """Return a name, and the subjects: the environment, and its vector if there is one."""
    if steps < 8 or num_envs < 1:
        raise InputInvalid(f"{steps} steps of {num_envs} environments", "at least 8 and 1")
    title, make, bare, batch = _makes(env)
    promised = vector is not None
    vector = vector or batch
    sample = make()
    kind = _kind(sample)
    try:
        limit, step = _time_of(sample)
        failing = failing or failing_of(sample)
        start = start or start_of(sample, seed)
    finally:
        sample.close()
    common = Subject(
        kind,
        make,
        steps,
        seed,
        time=time,
        start=start,
        strict=strict,
        action_step=step if action_step is None else Fraction(str(action_step)),
        limit=limit if time_limit is None else time_limit,
    )
    if kind == "vector":
        return title, [replace(common, single=single, row_seeds=single is not None)]
    found = [replace(common, bare=bare, failing=failing)]
    if kind == "single" and vector is not None:
        batch_of = vector
        sample = batch_of(num_envs)
        known = SyncVectorEnv | AsyncVectorEnv | CosimVectorEnv
        seeds = promised or isinstance(sample, known)
        seeds = seeds or sample.metadata.get("row_seeds") == "seed + row"
        sample.close()
        many = replace(common, kind="vector", make=lambda: batch_of(num_envs))
        found.append(replace(many, single=make, row_seeds=seeds))
    return title, found


def _makes(env: Any) -> tuple[str, Make, Make | None, Callable[[int], Any] | None]:
    """Return a title and functions that make the environment, it without wrappers, its vector."""
    if isinstance(env, gymnasium.Env | VectorEnv) and env.spec is not None:
        env = env.spec.id
    if isinstance(env, str):
        return _registered(env)
    if not callable(env):
        raise InputInvalid(
            f"an environment of type {type(env).__name__} without a spec",
            "a registered id, or a function that makes a new one (several are compared)",
        )
    title = getattr(env, "__name__", type(env).__name__)
    return title, env, lambda: env().unwrapped, None


def _registered(name: str) -> tuple[str, Make, Make | None, Callable[[int], Any] | None]:
    import uuvsim_cosim.envs  # noqa: F401  (registers)

    module, colon, function = name.partition(":")
    if colon and "/" not in function and function not in gymnasium.registry:
        try:
            make = getattr(importlib.import_module(module), function)
        except (ImportError, AttributeError) as error:
            raise InputInvalid(f"{name!r}", error, "module:function") from None
        return name, make, lambda: make().unwrapped, None
    if colon:
        importlib.import_module(module)
    own = function if colon else name
    if own not in gymnasium.registry:
        ours_first = sorted(gymnasium.registry, key=lambda i: (not i.startswith("uuvsim/"), i))
        raise InputInvalid(f"no environment {name!r}", expected_names(own, ours_first))
    return (
        name,
        lambda: gymnasium.make(own),
        lambda: gymnasium.make(own, disable_env_checker=True).unwrapped,
        lambda n: gymnasium.make_vec(own, num_envs=n),
    )


def _kind(env: object) -> Kind:
    if isinstance(env, gymnasium.Env):
        return "single"
    if isinstance(env, VectorEnv):
        return "vector"
    from pettingzoo import ParallelEnv

    if isinstance(env, ParallelEnv):
        return "parallel"
    raise InputInvalid(
        f"an object of type {type(env).__name__}",
        "a gymnasium.Env, a gymnasium.vector.VectorEnv or a pettingzoo.ParallelEnv",
    )


def _time_of(env: Environment) -> tuple[int | None, Fraction | None]:
    """Return an episode's steps and an action's duration, if the environment declares them."""
    spec = getattr(env, "spec", None)
    limit = getattr(spec, "max_episode_steps", None)
    task = getattr(env.unwrapped, "task", None)
    step, horizon = getattr(task, "action_step", None), getattr(task, "horizon", None)
    if not isinstance(step, Fraction) or not isinstance(horizon, Fraction):
        return limit, None
    own = -int(-horizon // step)
    return own if limit is None else min(limit, own), step


class Fails:
    """Raises in the first communication step that begins at or after `at`."""

    inputs: ClassVar[Mapping[str, str]] = {}
    outputs: ClassVar[Mapping[str, str]] = {"y": "1"}
    parameters: ClassVar[Mapping[str, tuple[float, str]]] = {"at": (0.0, "s")}
    at: float

    def step(self, t: float, dt: float, u: Mapping[str, float]) -> dict[str, float]:
        """Do nothing, until it is time."""
        if t >= self.at:
            raise RuntimeError("fails on purpose")
        return {"y": 0.0}


def failing_of(env: Environment) -> Make | None:
    """Return a function that makes an environment of the same task whose second action fails."""
    kind = _own(env)
    if kind is None:
        return None
    task = copy.copy(env.unwrapped.task)
    task.system = task.system.add(
        "conformance_failure",
        f"{__name__}:{Fails.__name__}",
        {"at": float(task.action_step - task.system.base_step / 2)},
    )
    return lambda: kind(task, backend="master")


def start_of(env: Environment, seed: int) -> dict[str, object] | None:
    """Return the options of a reset that always gives the start of a seed's first episode."""
    if _own(env) is None:
        return None
    drawn = env.unwrapped.task.start(Draws([seed], [0]))
    return {"start": {name: rows[0] for name, rows in drawn.items()}}


def _own(env: Environment) -> type[CosimEnv | CosimParallelEnv] | None:
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.team import CosimParallelEnv

    kind = type(env.unwrapped)
    return kind if kind in (CosimEnv, CosimParallelEnv) else None
