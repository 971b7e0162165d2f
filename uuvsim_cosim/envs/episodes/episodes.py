"""Episodes of a task in a plant: seeds and counters, moments, time limits and failures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TypeVar, Unpack, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.spaces import ActionBox
from uuvsim_cosim.envs.plants.choice import PlantOptions, plant_of
from uuvsim_cosim.envs.task.episode_draws import Asked, Draws
from uuvsim_cosim.envs.task.signals import Instant, Signals, mixed, refuse
from uuvsim_cosim.envs.task.task import Array, Mask, Task, TeamTask
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, Problem
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["AGENT", "Episodes", "check_times"]

AGENT = "agent"  # the agent of a task of one
T = TypeVar("T", bound=np.generic)


def check_times(task: Task | TeamTask, tick: Fraction) -> list[Problem]:
    """Find what is wrong with a task's action step and horizon."""
    step, horizon = task.action_step, task.horizon
    if step <= 0 or (step / tick).denominator != 1:
        read = f"{_seconds(step)}, where a communication step takes {_seconds(tick)}"
        return [Problem("action_step", read, "a whole multiple of it")]
    if horizon <= 0 or (horizon / step).denominator != 1:
        read = f"{_seconds(horizon)}, where an action takes {_seconds(step)}"
        return [Problem("horizon", read, "a whole multiple of it")]
    return []


@final
class Episodes:
    """n episodes side by side; episode k of seed s depends on (s, k) and the actions alone.

    `boxes` are the actions by agent. `problems` are known mistakes of the task, which are reported
    with those of its times. Makes the plant, and frees it when closed.
    """

    def __init__(
        self,
        task: Task | TeamTask,
        n: int,
        signals: Signals,
        boxes: Mapping[str, ActionBox],
        problems: Sequence[Problem],
        **options: Unpack[PlantOptions],
    ) -> None:
        place = f"task {type(task).__name__}"
        refuse(place, [*check_times(task, signals.plan.tick), *problems])
        acts = [target for box in boxes.values() for target in box.targets]
        plant = plant_of(task.system, n, reads=signals.names, acts=acts, **options)
        self.task, self.plant, self.signals, self.n = task, plant, signals, n
        self._boxes = dict(boxes)
        self._ticks = int(task.action_step / plant.tick)
        self._steps = int(task.horizon / task.action_step)
        self._step_seconds = task.action_step.numerator, task.action_step.denominator
        self.seeds = np.zeros(n, np.uint64)
        self.episodes = np.zeros(n, np.int64)
        self._start: dict[str, Array] = {}
        self._asked: Asked = {}
        self._moment: Instant | None = None
        self.any_failed = False  # whether a component of any has failed
        self.seeded = False  # whether seeds and counters are those of a reset
        self.stillborn: Mask | None = None  # episodes whose start has failed, if any
        self._every = np.ones(n, bool)
        self._idle = {agent: np.zeros((n, box.width)) for agent, box in self._boxes.items()}

    # ---- life -----------------------------------------------------------------------------

    @property
    def moment(self) -> Instant:
        """The present moment."""
        if self._moment is None:
            raise InputInvalid("no episode has begun, or a call was interrupted", "reset() first")
        return self._moment

    @property
    def begun(self) -> bool:
        """Whether there has been a reset."""
        return self._moment is not None

    def reset(
        self,
        mask: Mask | None = None,
        *,
        seeds: Sequence[int] | NDArray[np.uint64] | None = None,
        start: Mapping[str, object] | None = None,
    ) -> Instant:
        """Begin the next episodes where the mask is true, or the first of other seeds (n rows).

        `start` gives start values instead of those drawn, of the variable's shape or with an axis
        of n rows. A failed start is reported by the first step. Raises ComponentFailed if, without
        a mask, all starts fail.
        """
        old = self._moment
        chosen = self._every if mask is None or old is None else mask
        self._begin(chosen, seeds, start or {})
        if mask is None and self.stillborn is not None and self.stillborn.all():
            failure = self.plant.failure(0)
            assert failure is not None
            more = f" in environment 0, and all others of {self.n} fail" if self.n > 1 else ""
            raise ComponentFailed(failure.path, failure.time, failure.reason + more)
        values, rows = self._living(self.plant.gather()), np.flatnonzero(chosen)
        step, before = np.zeros(self.n, np.int64), None
        action: Mapping[str, Array] = self._idle
        if old is not None and len(rows) < self.n:
            values, before, step = mixed(old.values, values, rows), old.before, old.step
            step, action = self._cleared(rows, step, old.action)
        self._moment = Instant(
            self.signals, values, step, self._step_seconds, action, self._start, before, rows
        )
        return self._moment

    def count(self, seeds: NDArray[np.uint64], episodes: NDArray[np.int64]) -> None:
        """Set the counters: the next reset begins the episodes after these."""
        self.seeds, self.episodes, self.seeded = seeds, episodes, True

    def step(self, actions: Mapping[str, Array], again: Mask | None = None) -> Instant:
        """Act for one action step; `actions` by agent are checked, of shape (n, width).

        Where `again` is true the next episodes begin instead.
        """
        before = self.moment.alone()
        self._moment = None  # there is none if this is interrupted
        plant, steps, rows = self.plant, before.step + 1, None
        scaled = [box.scaled(actions[agent]) for agent, box in self._boxes.items()]
        plant.scatter(scaled[0] if len(scaled) == 1 else np.concatenate(scaled))
        plant.step(self._ticks)
        if again is not None:  # ended rows were stepped too: a kernel steps all of them
            self._begin(again, None, {})
            rows = np.flatnonzero(again)
            steps, actions = self._cleared(rows, steps, actions)
        values = plant.gather()
        failed = plant.failed
        self.any_failed = bool(failed.any())
        if self.any_failed:
            values = self._living(np.where(failed, before.values, values))
        self._moment = Instant(
            self.signals, values, steps, self._step_seconds, actions, self._start, before, rows
        )
        return self._moment

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        self.plant.close()

    # ---- how episodes end -----------------------------------------------------------------

    @property
    def over(self) -> Mask:
        """The episodes that have reached the horizon."""
        return np.asarray(self.moment.step >= self._steps)

    @property
    def failed(self) -> Mask:
        """The environments in which a component has failed."""
        return self.plant.failed

    def failure(self, row: int) -> str:
        """Return a message of a failure, which names the environment if there are several."""
        failure = self.plant.failure(row)
        if failure is None:
            return ""
        return str(failure) if self.n == 1 else f"environment {row}: {failure}"

    def rewarded(self, reward: Array) -> Array:
        """Replace the rewards of failures by the task's `failure_reward`; 0 for a failed start."""
        if not self.any_failed:
            return reward
        reward = np.where(self.failed, self.task.failure_reward, reward)
        return reward if self.stillborn is None else np.where(self.stillborn, 0.0, reward)

    # ---- inside ---------------------------------------------------------------------------

    def _begin(
        self,
        chosen: Mask,
        seeds: Sequence[int] | NDArray[np.uint64] | None,
        start: Mapping[str, object],
    ) -> None:
        """Count, draw, and reset the plant."""
        whole = bool(chosen.all())
        counted = self.seeds, self.episodes + chosen
        if seeds is not None:
            given = np.array([int(s) % 2**64 for s in seeds], np.uint64)
            counted = np.where(chosen, given, self.seeds), np.where(chosen, 0, self.episodes)
        draws = Draws(*counted, asked=self._asked if self.n > 1 else None)
        if not whole:
            draws = draws.rows(chosen)
        given_by_task = self.task.start(draws)
        if not isinstance(given_by_task, Mapping):
            raise InputInvalid(
                f"task {type(self.task).__name__}",
                f"start(): {given_by_task!r}",
                "start values by name",
            )
        variables = self.plant.variables
        drawn = {k: rows_of(variables, k, v, draws.n) for k, v in given_by_task.items()}
        for name, value in start.items():
            wide = rows_of(variables, name, value, self.n)
            drawn[name] = wide if whole else wide[chosen]
        system_seeds = draws.seeds()
        if not whole:
            for name, rows in drawn.items():  # put them among the rows of all environments
                old = self._start.get(name)
                wide = np.repeat(rows[:1], self.n, axis=0) if old is None else old.copy()
                wide[chosen] = rows
                drawn[name] = wide
            few, system_seeds = system_seeds, np.zeros(self.n, np.uint64)
            system_seeds[chosen] = few
        self._moment = None  # there is none if this is interrupted
        self.plant.reset(chosen, system_seeds, drawn)
        # Only now: after an interrupted reset the next one begins the same episodes.
        self.count(*counted)
        self._start = drawn if whole else {**self._start, **drawn}
        failed = self.plant.failed
        self.any_failed = bool(failed.any())
        dead = failed & (chosen if self.stillborn is None else chosen | self.stillborn)
        self.stillborn = dead if self.any_failed and dead.any() else None

    def _cleared(
        self, rows: NDArray[np.intp], step: NDArray[np.int64], action: Mapping[str, Array]
    ) -> tuple[NDArray[np.int64], Mapping[str, Array]]:
        """Copy step counts and actions of all environments, with zeros for some."""
        idle = {agent: mixed(a.T, self._idle[agent].T, rows).T for agent, a in action.items()}
        return mixed(step, np.zeros_like(step), rows), idle

    def _living(self, values: Array) -> Array:
        """Return values with zeros where a start has failed: the plant's may not be finite."""
        return values if self.stillborn is None else np.where(self.stillborn, 0.0, values)


def _seconds(time: Fraction) -> str:
    return f"{float(time):g} s" if time == Fraction(str(float(time))) else f"{time} s"


def rows_of(variables: Mapping[str, Variable], name: str, value: object, n: int) -> Array:
    """Return a start value with one row for each of n environments; raises InputInvalid."""
    variable = variables.get(name)
    if variable is None:
        expected = expected_names(name, variables, "COMPONENT.VARIABLE")
        raise InputInvalid(f"start value {name!r}", "no such variable", expected)
    if variable.causality not in ("input", "parameter"):
        raise InputInvalid(
            f"start value {name!r}",
            f"is of causality {variable.causality}",
            "a parameter or an input",
        )
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputInvalid(f"start value {name!r}", f"{value!r}", "numbers") from None
    shape = (n, *variable.shape)
    good = np.isfinite(array).all()
    if array.shape not in (shape, variable.shape) or not good:
        read = f"of shape {array.shape}" if good else "that are not finite"
        raise InputInvalid(
            f"start value {name!r}",
            f"numbers {read}",
            f"finite ones of shape {variable.shape} or {shape}",
        )
    low = -np.inf if variable.min is None else variable.min
    high = np.inf if variable.max is None else variable.max
    if array.size and not (array.min() >= low and array.max() <= high):
        outside = np.argwhere((array < low) | (array > high))
        first = tuple(outside[0])
        where = f" in environment {first[0]}" if array.shape == shape and n > 1 else ""
        raise InputInvalid(
            f"start value {name!r}", f"{array[first]}{where}", f"finite numbers in [{low}, {high}]"
        )
    return array if array.shape == shape else np.broadcast_to(array, shape)
