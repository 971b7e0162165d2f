"""Learning from a dataset, without simulation: `train_offline("data.npz", "dt")`."""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, get_type_hints

import numpy as np

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.data.dataset import Dataset
from uuvsim_cosim.learn.data.dataset_files import read_dataset
from uuvsim_cosim.learn.policies.policy import Named, Policy
from uuvsim_cosim.learn.shared.errors import LearningDiverged, check_torch
from uuvsim_cosim.learn.shared.task_ids import make_task, short_name
from uuvsim_cosim.learn.training.rollout import Rollout
from uuvsim_cosim.learn.training.train import one_thread
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.notebook_bar import shown

if TYPE_CHECKING:
    from uuvsim_cosim.learn.offline.behaviour_cloning import BcSettings
    from uuvsim_cosim.learn.offline.decision_transformer import DtSettings
    from uuvsim_cosim.learn.offline.iql import IqlSettings

__all__ = ["OFFLINE", "LearnedOffline", "OfflineLearner", "offline_learner", "train_offline"]

OFFLINE = {
    "bc": "behaviour cloning",
    "iql": "implicit Q-learning",
    "dt": "decision transformer",
}
_SHARES = ("gamma", "tau", "expectile", "wanted")  # settings in [0, 1]
EVERY = 100  # updates, between rows of losses.csv


class OfflineLearner(Protocol):
    """Learner from a dataset; equal seeds give equal bits on one thread."""

    name: str

    def update(self) -> dict[str, float]:
        """Make one gradient step; return the losses.

        Raises LearningDiverged if a loss or a gradient is not finite.
        """

    def policy(self) -> Policy:
        """Return the policy learned so far."""


@dataclass(frozen=True)
class LearnedOffline:
    """The result of learning from a dataset."""

    folder: Path
    policy: Policy
    data: Dataset
    updates: int
    losses: Mapping[str, float]  # means over the last updates
    cpu: float  # s
    interrupted: bool


def train_offline(
    data: str | Path | Dataset,
    algorithm: str = "dt",
    *,
    seed: int = 0,
    settings: Mapping[str, object] | None = None,
    task: str | None = None,
    options: Mapping[str, object] | None = None,
    folder: str | Path | None = None,
    progress: Callable[[int, int, Mapping[str, float]], None] | None = None,
) -> LearnedOffline:
    """Learn a policy from a dataset, without simulation; write it into a new folder.

    `data` is a dataset, its file (.npz) or a folder of Minari. `algorithm` is "bc" (behaviour
    cloning), "iql" (implicit Q-learning) or "dt" (decision transformer), and `settings` are its
    settings: `lr`, `batch`, `steps` (updates), `hidden`, …; docs/learning/offline.md lists them.
    Equal `seed`s give equal bits on one thread. `task` is needed if the dataset has none, and
    `options` are those of the task; its spaces must be those of the dataset. `folder` is by default
    runs/train/TASK-ALGORITHM-SEED; policy.npz, losses.csv and offline.json are written there.
    `progress(updates, of, losses)` is called every 100 updates; without it, a notebook shows a bar.

    The result has `policy`, `losses` (means over the last updates), `updates`, and `interrupted`:
    after Ctrl-C, the policy learned so far is written and returned. Needs the extra `rl`. Raises
    InputInvalid for invalid arguments and for a folder that is not empty, and LearningDiverged if a
    loss is not finite; the policy learned so far is written before.

    Example:

    >>> from uuvsim_cosim.learn import collect, train_offline
    >>> data = collect("source", "scripted", episodes=4)
    >>> learned = train_offline(data, "bc", folder="bc", settings={"steps": 20, "hidden": 16})
    >>> learned.updates, learned.policy.kind
    (20, 'tanh')
    >>> sorted(file.name for file in learned.folder.iterdir())
    ['losses.csv', 'offline.json', 'policy.npz']
    """
    given = data if isinstance(data, Dataset) else read_dataset(data)
    given = of_task(given, task, options)
    learner, chosen = offline_learner(given, algorithm, settings or {}, seed)
    name = f"{short_name(given.task)}-{algorithm}-{seed}"
    place = Path("runs") / "train" / name if folder is None else Path(folder).expanduser()
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise InputInvalid(place, "contains other files", "an empty or a new folder")
    began, rows, recent, done = time.process_time(), [], [], 0
    interrupted = False
    try:
        with one_thread(), shown(None if progress is None else False) as bar:
            while done < chosen.steps:
                recent.append(learner.update())
                done += 1
                if done % EVERY == 0 or done == chosen.steps:
                    row = {k: float(np.mean([x[k] for x in recent])) for k in recent[0]}
                    rows.append({"updates": done, **row})
                    recent = []
                    if progress is not None:
                        progress(done, chosen.steps, row)
                    elif bar is not None:
                        bar("training", done, chosen.steps)
    except KeyboardInterrupt:
        interrupted = True
    except LearningDiverged as diverged:
        kept = _write(place, _described(learner, given, chosen, seed, done), rows)
        raise diverged.saying(
            algorithm, f"the previous training, of {done} updates, is in {kept}"
        ) from None
    policy = _described(learner, given, chosen, seed, done)
    _write(place, policy, rows)
    last = {k: v for k, v in rows[-1].items() if k != "updates"} if rows else {}
    cpu = time.process_time() - began
    return LearnedOffline(place, policy, given, done, last, cpu, interrupted)


def offline_learner(
    data: Dataset, algorithm: str, settings: Mapping[str, object], seed: int
) -> tuple[OfflineLearner, BcSettings | IqlSettings | DtSettings]:
    """Make a learner, with its settings; raises InputInvalid."""
    if algorithm not in OFFLINE:
        raise InputInvalid(
            f"algorithm {algorithm!r}",
            "does not learn from a dataset",
            expected_names(algorithm, OFFLINE),
        )
    check_torch()
    from uuvsim_cosim.learn.offline.behaviour_cloning import BcSettings, BehaviourCloning
    from uuvsim_cosim.learn.offline.decision_transformer import DecisionTransformer, DtSettings
    from uuvsim_cosim.learn.offline.iql import Iql, IqlSettings

    makers: dict[str, tuple[Any, type[Any]]] = {
        "bc": (BehaviourCloning, BcSettings),
        "iql": (Iql, IqlSettings),
        "dt": (DecisionTransformer, DtSettings),
    }
    make, form = makers[algorithm]
    hints = {f.name: get_type_hints(form)[f.name] for f in fields(form)}
    given: dict[str, float] = {}
    for name, value in settings.items():
        if name not in hints:
            raise InputInvalid(f"{algorithm}, setting {name!r}", expected_names(name, hints))
        whole = hints[name] is int
        least, most = (1, 10**9) if whole else (0.0, 1.0 if name in _SHARES else 1e6)
        if (
            not isinstance(value, int | float)
            or isinstance(value, bool)
            or ((whole and value != int(value)) or not least <= value <= most)
        ):
            expected = "a whole number from 1" if whole else f"a number, {least:g} … {most:g}"
            raise InputInvalid(f"{algorithm}, {name} {value!r}", expected)
        given[name] = hints[name](value)
    chosen = form(**given)
    if algorithm == "dt" and chosen.hidden % chosen.heads:
        raise InputInvalid(f"dt, heads {chosen.heads}: expected a divisor of hidden, "
                           f"{chosen.hidden}")  # fmt: skip
    return make(data, chosen, seed), chosen


def of_task(
    data: Dataset, task: str | None, options: Mapping[str, object] | None = None
) -> Dataset:
    """Return the dataset with a task; raises InputInvalid if their spaces differ."""
    name = task or data.task
    if not name:
        raise InputInvalid("dataset", "names no task", "one, by --task")
    every = {**(data.options if name == data.task else {}), **(options or {})}
    rollout = Rollout(make_task(name, every), 1, 0)
    try:
        seen, acts = rollout.named()
    finally:
        rollout.close()
    for what, found, wanted in (
        ("observation", data.observation, seen),
        ("action", data.action, acts),
    ):
        same = len(found) == len(wanted) and all(
            np.allclose((f.low, f.high), (w.low, w.high), rtol=1e-5, atol=1e-6)
            for f, w in zip(found, wanted, strict=True)
        )
        if not same:
            raise InputInvalid(
                f"dataset{f' of {data.task}' if data.task else ''}",
                f"an {what} space of {_space(found)}",
                f"{_space(wanted)}, as {name} has (target tracking has an option slots)",
            )
    return replace(data, task=name, options=every, observation=seen, action=acts)


# ---- inside ---------------------------------------------------------------------------------


def _space(named: Sequence[Named]) -> str:
    low, high = min(c.low for c in named), max(c.high for c in named)
    return f"{len(named)} numbers in [{low:g}, {high:g}]"


def _described(learner: OfflineLearner, data: Dataset, chosen: Any, seed: int, done: int) -> Policy:
    """Return the policy with a record of its algorithm, settings and data."""
    return learner.policy().with_training(
        algorithm=learner.name, seed=seed, updates=done, settings=asdict(chosen),
        dataset={"episodes": len(data.episodes), "return": float(data.returns.mean()),
                 **data.told},
    )  # fmt: skip


def _write(place: Path, policy: Policy, rows: list[dict[str, float]]) -> Path:
    try:
        place.mkdir(parents=True, exist_ok=True)
        if rows:
            text = io.StringIO()
            writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
            write_whole(place / "losses.csv", text.getvalue().encode())
        about = {"task": policy.task, "options": dict(policy.options), **policy.trained}
        write_whole(place / "offline.json", json.dumps(about, indent=1, sort_keys=True).encode())
        return policy.save(place / "policy.npz")
    except OSError as error:
        raise InputInvalid(f"{place}: cannot be written ({error.strerror})") from None
