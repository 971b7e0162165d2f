"""Episodes from recorded runs: the observations and rewards of a task, and the recorded actions.

Signals are read at every action step. The action of a step is the value that was held until the
next step; it is recorded under its channel's name, or as a policy's output `action` of the same
component.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.envs.episodes.spaces import ActionBox, ObservationBox
from uuvsim_cosim.envs.task.signals import Instant, Signals, resolved
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.data.dataset import Dataset, Episode
from uuvsim_cosim.learn.policies.policy import Named, names_of
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals as Recorded

__all__ = ["Reading", "from_recordings", "refuse_times"]

Array = NDArray[np.float64]


def refuse_times(run: Path, time: Array) -> None:
    """Raise InputInvalid for times that are not finite or that decrease.

    Two equal times are accepted, since a restart records a communication point twice.
    """
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise InputInvalid(run, f"time {time[bad[0]]:g} in row {bad[0] + 1}", "a number")
    falls = np.flatnonzero(np.diff(time) < 0)
    if len(falls):
        k = falls[0]
        raise InputInvalid(
            run, f"time {time[k + 1]:g} s in row {k + 2}, after {time[k]:g} s", "times that rise"
        )


@final
class Reading:
    """Recorded signals of a task; `renamed` maps its names to other names in a recording.

    `names` are the signals that the task needs. Raises InputInvalid for other names in `renamed`.
    """

    def __init__(self, task: str, names: Mapping[str, int], renamed: Mapping[str, str]) -> None:
        self.task, self._renamed = task, renamed
        for name in renamed:
            if name not in names:
                raise InputInvalid(
                    f"signal {name!r}",
                    f"{task} reads none of this name",
                    expected_names(name, names),
                )

    def finds(self, read: Recorded, name: str) -> bool:
        """Return whether a signal has a name in `renamed`, or is recorded under its own name."""
        return name in self._renamed or name in read

    def of(self, run: Path, read: Recorded, sizes: Mapping[str, int]) -> list[Array]:
        """Return signals of the given sizes, each of shape (instants, size).

        Raises InputInvalid that names every element that was not recorded.
        """
        missing: list[str] = []
        bare = False
        for name, size in sizes.items():
            place = self._renamed.get(name, name)
            absent, there = [place], read.elements.get(place, ())
            if place in read:  # its missing elements, if the recording lists them
                absent = [f"{place}[{i}]" for i in range(1, size + 1) if there and i not in there]
            # A column without Arrow's metadata is a signal with an index in its name.
            bare |= bool(absent) and any(f"{place}[{i + 1}]" in read for i in range(size))
            missing += [a if place == name else f"{a} (given for {name})" for a in absent]
        if missing:
            why = ", or without the Arrow metadata that describes its columns" if bare else ""
            raise InputInvalid(
                run,
                f"{', '.join(missing)} not recorded{why}",
                f"the signals of {self.task} (a signal of another name is given by "
                "--signal NAME=RECORDED)",
            )
        values = []
        for name, size in sizes.items():
            place = self._renamed.get(name, name)
            found = read[place]
            columns = found.reshape(len(found), -1) if len(found) else np.zeros((0, size))
            if columns.shape[1] != size:
                raise InputInvalid(
                    run, f"{place} has {columns.shape[1]} elements", f"{size}, as {self.task} reads"
                )
            if columns.dtype.kind not in "fiub":
                held = type(columns.flat[0]).__name__
                raise InputInvalid(run, f"{place} holds {held}", "numbers")
            values.append(np.asarray(columns, float))
        return values


def from_recordings(
    name: str,
    runs: Sequence[str | Path],
    *,
    options: Mapping[str, object] | None = None,
    renamed: Mapping[str, str] | None = None,
) -> Dataset:
    """Return a task's observations, actions and rewards in recorded runs, cut at its horizon.

    A run is its folder, a .parquet or a .mcap. `renamed` maps signals of the task to names in the
    recording. `told["clipped"]` of the dataset counts the numbers beyond limits. Raises
    InputInvalid that names the signals that were not recorded.
    """
    task = make_task(name, options)
    reader = _Reader(task, name, dict(renamed or {}))
    kept = [episode for run in runs for episode in reader.episodes(Path(run))]
    told = {"recordings": [Path(run).name for run in runs], "clipped": reader.clipped}
    return Dataset(kept, reader.seen, reader.acts, name, dict(options or {}), told)


class _Start(Mapping[str, Array]):
    """Start values, which a recording does not contain."""

    def __getitem__(self, name: str) -> Array:
        raise InputInvalid(
            name,
            "the task reads random values of its episodes, which no recording contains",
            "a task without it",
        )

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


class _Reader:
    def __init__(self, task: Task | TeamTask, name: str, renamed: dict[str, str]) -> None:
        self.task = task
        self.clipped = {"observations": 0, "actions": 0}
        plan = flatten(task.system)
        team = isinstance(task, TeamTask)
        self.channels = (
            dict(task.actions) if isinstance(task, TeamTask) else {"agent": task.actions}
        )
        names = list(task.signals)
        if isinstance(task, Task):
            names += [c.name for c in task.observations]
        self.signals = Signals(plan, names)
        self.boxes = {a: ActionBox(plan, c) for a, c in self.channels.items()}
        self.box = None
        if isinstance(task, TeamTask):
            sides: tuple[NDArray[np.generic], ...] = task.limits(task.agents[0])
        else:
            self.box = ObservationBox(plan, self.signals, task.observations, task.extra_limits)
            sides = self.box.low, self.box.high
        self.low, self.high = (np.asarray(s, np.float32) for s in sides)
        self.seen = names_of(self.low, self.high)
        agent, first = next(iter(self.boxes.items()))
        short = [
            first.name(i).removeprefix(f"{agent}." if team else "") for i in range(first.width)
        ]
        self.acts = tuple(Named(n, -1.0, 1.0) for n in short)
        keys = [key for box in self.boxes.values() for key, _ in box.targets]
        self.sizes = {
            n: resolved(plan, n).variable.size for n in dict.fromkeys([*self.signals.names, *keys])
        }
        self.reading = Reading(name, self.sizes, renamed)

    def episodes(self, run: Path) -> list[Episode]:
        read = read_signals(run)
        time = np.asarray(read.time, float)
        refuse_times(run, time)
        # The rows where actions begin.
        step = float(self.task.action_step)
        count = int((time[-1] - time[0]) / step + 1e-6) if len(time) else 0
        begins = time[0] + step * np.arange(count + 1) if count else np.zeros(0)
        at = np.clip(np.searchsorted(time, begins - 1e-6), 0, max(len(time) - 1, 0))
        if not count or np.abs(time[at] - begins).max() > 1e-6 or np.any(np.diff(at) < 2):
            raise InputInvalid(
                run,
                f"{len(time)} instants",
                f"one at each action step of {step:g} s, and others between",
            )
        wanted = {n: self.sizes[n] for n in self.signals.names}
        values = np.concatenate(self.reading.of(run, read, wanted), axis=1)
        # The action of step k: recorded last before step k + 1 begins.
        acted = {a: self._action(run, read, a)[at[1:] - 1] for a in self.channels}
        length, found = int(self.task.horizon / self.task.action_step), []
        for first in range(0, len(at) - 1, length):
            piece = at[first : first + length + 1]
            mine = {a: x[first : first + length] for a, x in acted.items()}
            if len(piece) > 1:
                found += self._cut(values[piece].T, mine)
        return found

    def _cut(self, values: Array, recorded: Mapping[str, Array]) -> list[Episode]:
        n = values.shape[1]
        acted = {a: np.clip(x, -1.0, 1.0) for a, x in recorded.items()}
        step, before = np.arange(n), np.maximum(np.arange(n) - 1, 0)
        action = {a: x[before] * (step > 0)[:, None] for a, x in acted.items()}
        earlier = {a: x[before] for a, x in action.items()}
        names, s = self.signals, self.task.action_step.as_integer_ratio()
        m = Instant(
            names, values.copy(), step, s, action, _Start(),
            before=Instant(names, values[:, before], before, s, earlier, _Start()),
        )  # fmt: skip
        seen: Mapping[str, NDArray[np.generic]]
        beyond: Mapping[str, NDArray[np.generic]]
        if isinstance(self.task, TeamTask):
            seen, reward, ended = self.task.observe(m), self.task.reward(m), self.task.terminated(m)
            beyond = self.task.unclipped(m)
        else:
            assert self.box is not None
            extra = self.task.extra(m) if self.box.n_extra else None
            seen = {"agent": self.box.of(m.values, extra)}
            raw = self.task.unclipped(m) if self.box.n_extra else None
            # A subclass may override `extra` with more numbers, and not `unclipped`.
            if raw is not None and extra is not None and raw.shape == extra.shape:
                extra = raw
            beyond = {"agent": self.box.of(m.values, extra, clipped=False)}
            reward, ended = {"agent": self.task.reward(m)}, {"agent": self.task.terminated(m)}
        made = []
        for agent, a in acted.items():
            over = np.flatnonzero(np.asarray(ended[agent])[1:])
            k = int(over[0]) + 1 if len(over) else n - 1
            o = np.clip(np.asarray(seen[agent], np.float32), self.low, self.high)
            r = np.asarray(reward[agent], np.float32)
            made.append(
                Episode(o[: k + 1], a[:k].astype(np.float32), r[1 : k + 1], bool(len(over)))
            )
            sides = self.low, self.high
            self.clipped["observations"] += _clipped(beyond[agent][: k + 1], o[: k + 1], *sides)
            self.clipped["actions"] += _clipped(recorded[agent][:k], made[-1].action, -1.0, 1.0)
        return made

    def _action(self, run: Path, read: Recorded, agent: str) -> Array:
        """Return the recorded actions (instants, width), scaled to [-1, 1] but not clipped."""
        box = self.boxes[agent]
        low, high = (box.scaled(np.full((1, box.width), s))[:, 0] for s in (-1.0, 1.0))
        columns: list[Array] = []
        for i, (key, element) in enumerate(box.targets):
            output = f"{key.rpartition('.')[0]}.action"
            if self.reading.finds(read, key):
                (own,) = self.reading.of(run, read, {key: self.sizes[key]})
                columns.append((2.0 * own[:, element] - low[i] - high[i]) / (high[i] - low[i]))
            elif output in read:
                (own,) = self.reading.of(run, read, {output: box.width})
                columns.append(own[:, i])
            else:
                raise InputInvalid(
                    run,
                    f"neither {key} nor {output} recorded",
                    f"the action of {self.reading.task} (a signal of another name is given by "
                    "--signal NAME=RECORDED)",
                )
        return np.stack(columns, axis=1)


def _clipped(
    given: NDArray[np.generic], kept: NDArray[np.float32], low: ArrayLike, high: ArrayLike
) -> int:
    """Return how many numbers were clipped; 0 if `given` has another shape than `kept`."""
    if given.shape != kept.shape:
        return 0
    with np.errstate(over="ignore"):
        numbers = given.astype(np.float32)
    return int(np.count_nonzero((numbers != kept) & (np.clip(numbers, low, high) == kept)))
