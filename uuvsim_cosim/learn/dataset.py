"""Experience kept: episodes of observations, actions and rewards, and the task they are from.

A file `.npz` holds numbers in half precision (11 bits) and one JSON text; a folder is a dataset of
Minari's (learn/minari_dataset.py).
"""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policy import Named

__all__ = ["Dataset", "Episode", "Stacked", "read_dataset", "refuse_taken", "write_dataset"]

Array = NDArray[np.float32]
FORMAT = 1
VERSIONED = re.compile(r"[-\w]+-v\d+")


@dataclass(frozen=True)
class Episode:
    """T actions of one agent in [-1, 1], between T + 1 observations."""

    observation: Array  # (T + 1, d)
    action: Array  # (T, a)
    reward: Array  # (T,)
    terminated: bool  # ended by itself, not by its time limit


@dataclass(frozen=True)
class Stacked:
    """Episodes one below another, filled with zeros after their ends."""

    observation: Array  # (E, T + 1, d)
    action: Array  # (E, T, a)
    reward: Array  # (E, T)
    steps: NDArray[np.int64]  # (E,)
    terminated: NDArray[np.bool_]  # (E,)

    @property
    def lived(self) -> NDArray[np.bool_]:
        """Say which steps there have been, of shape (E, T)."""
        return np.asarray(np.arange(self.action.shape[1]) < self.steps[:, None])


@dataclass(frozen=True)
class Dataset:
    """Episodes of a task; of a team, each agent's are episodes of their own.

    `task` and `options` make the task, "" if nothing is known of it; `told` says where they come
    from. Raises InputInvalid for episodes of other widths than named, and for NaN.
    """

    episodes: Sequence[Episode]
    observation: tuple[Named, ...]
    action: tuple[Named, ...]
    task: str
    options: Mapping[str, Any] = field(default_factory=dict)
    told: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what cannot be learned from."""
        if not self.episodes:
            raise InputInvalid("dataset: no episode; expected at least one")
        seen, acts = len(self.observation), len(self.action)
        for i, e in enumerate(self.episodes):
            steps = len(e.action)
            shapes = (e.observation.shape, e.action.shape, e.reward.shape)
            wanted = ((steps + 1, seen), (steps, acts), (steps,))
            if shapes != wanted or not steps:
                raise InputInvalid(
                    f"dataset, episode {i}: observations, actions and rewards of shapes "
                    f"{', '.join(map(str, shapes))}; expected (T + 1, {seen}), (T, {acts}) and "
                    "(T,), T at least 1"
                )
            for name in ("observation", "action", "reward"):
                if not np.all(np.isfinite(getattr(e, name))):
                    raise InputInvalid(f"dataset, episode {i}: NaN or infinity in its {name}s; "
                                       "expected numbers")  # fmt: skip
            if np.abs(e.action).max() > 1.0 + 1e-3:
                raise InputInvalid(
                    f"dataset, episode {i}: an action of {np.abs(e.action).max():g}; expected "
                    "actions in [-1, 1]"
                )

    @property
    def returns(self) -> NDArray[np.float64]:
        """Give each episode's sum of rewards."""
        return np.array([float(e.reward.sum(dtype=np.float64)) for e in self.episodes])

    @property
    def steps(self) -> int:
        """Count the actions of all episodes."""
        return sum(len(e.action) for e in self.episodes)

    def stacked(self) -> Stacked:
        """Give all episodes as arrays."""
        steps = np.array([len(e.action) for e in self.episodes])
        n, most = len(steps), int(steps.max())
        o = np.zeros((n, most + 1, len(self.observation)), np.float32)
        a = np.zeros((n, most, len(self.action)), np.float32)
        r = np.zeros((n, most), np.float32)
        for i, e in enumerate(self.episodes):
            o[i, : steps[i] + 1], a[i, : steps[i]], r[i, : steps[i]] = (
                e.observation, e.action, e.reward,
            )  # fmt: skip
        ended = np.array([e.terminated for e in self.episodes])
        return Stacked(o, np.clip(a, -1.0, 1.0), r, steps, ended)


def refuse_taken(path: Path, overwrite: bool = False) -> None:
    """Raise InputInvalid where a dataset cannot be written, or would replace another."""
    path = path.expanduser()
    if path.suffix.lower() == ".npz":
        if path.is_dir():
            raise InputInvalid(f"{path}: is a folder; expected a file")
        if path.exists() and not overwrite:
            raise InputInvalid(f"{path}: exists; expected a new file, or --overwrite")
        return
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputInvalid(f"{path}: exists; expected a new folder, as NAME-v0, or a .npz")
    # Minari takes a folder's name for its id; one without a version breaks its tools for all.
    if not VERSIONED.fullmatch(path.name):
        right = re.sub(r"[^\w-]+", "-", path.stem).strip("-") or "data"
        what = f"no dataset is written as {path.suffix}" if path.suffix else "has no version"
        raise InputInvalid(
            f"{path}: {what}; expected a .npz, or a folder of Minari's, as {right}-v0"
        )


def write_dataset(given: Dataset, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a `.npz`, or a new folder of Minari's, as NAME-v0; raises InputInvalid.

    Nothing that is there already is replaced without `overwrite`, and no folder is.
    """
    path = Path(path).expanduser()
    refuse_taken(path, overwrite)
    if path.suffix.lower() != ".npz":
        from uuvsim_cosim.learn.minari_dataset import write_minari

        return write_minari(given, path)
    every = given.stacked()
    head = {"uuvsim_dataset": FORMAT, "task": given.task, "options": dict(given.options),
            "told": dict(given.told), "observation": [asdict(x) for x in given.observation],
            "action": [asdict(x) for x in given.action]}  # fmt: skip
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, head=np.frombuffer(json.dumps(head, sort_keys=True).encode(), np.uint8),
        observation=every.observation.astype(np.float16), action=every.action.astype(np.float16),
        reward=every.reward, steps=every.steps.astype(np.int32), terminated=every.terminated,
    )  # fmt: skip
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, buffer.getvalue())
    except OSError as error:
        raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None
    return path


def read_dataset(path: str | Path) -> Dataset:
    """Read what `write_dataset` wrote, or another's of Minari; raises InputInvalid."""
    path = Path(path).expanduser()
    if path.is_dir():
        from uuvsim_cosim.learn.minari_dataset import read_minari

        return read_minari(path)
    if not path.is_file():
        raise InputInvalid(f"{path}: no such dataset; expected a folder of Minari's, or a .npz")
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as read:
            found = {name: read[name] for name in read.files}
        head = json.loads(bytes(found.pop("head")))
        version = head["uuvsim_dataset"]
        if version != FORMAT:
            raise InputInvalid(f"{path}: format {version}; expected {FORMAT}")
        o, a, r = (found[k].astype(np.float32) for k in ("observation", "action", "reward"))
        episodes = [
            Episode(o[i, : n + 1], a[i, :n], r[i, :n], bool(found["terminated"][i]))
            for i, n in enumerate(found["steps"].tolist())
        ]
        seen, acts = (tuple(Named(**x) for x in head[k]) for k in ("observation", "action"))
        return Dataset(episodes, seen, acts, head["task"], head["options"], head["told"])
    except InputInvalid as error:
        raise InputInvalid(f"{path}: {error}") from None
    except (ValueError, KeyError, TypeError, IndexError, OSError, EOFError,
            zipfile.BadZipFile) as error:  # fmt: skip
        raise InputInvalid(
            f"{path}: {type(error).__name__}: {error}; expected a whole dataset as "
            "`uuvsim collect` writes it"
        ) from None
