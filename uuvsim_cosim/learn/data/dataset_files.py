"""Files of datasets: a `.npz` of this program, or a folder of Minari's.

The `.npz` holds numbers in half precision (11 bits) and one JSON text.
"""

from __future__ import annotations

import io
import json
import re
import shutil
import tempfile
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.data.dataset import Dataset, Episode
from uuvsim_cosim.learn.policies.policy import Named, names_of

__all__ = ["read_dataset", "read_minari", "refuse_taken", "write_dataset", "write_minari"]

FORMAT = 1
VERSIONED = re.compile(r"[-\w]+-v\d+")


def refuse_taken(path: Path, overwrite: bool = False) -> None:
    """Raise InputInvalid if a dataset cannot be written there, or would replace another one."""
    path = path.expanduser()
    if path.suffix.lower() == ".npz":
        if path.is_dir():
            raise InputInvalid(path, "is a folder", "a file")
        if path.exists() and not overwrite:
            raise InputInvalid(path, "exists", "a new file, or --overwrite")
        return
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputInvalid(path, "exists", "a new folder, as NAME-v0, or a .npz")
    # Minari takes a folder's name for its id; one without a version breaks its tools for all.
    if not VERSIONED.fullmatch(path.name):
        right = re.sub(r"[^\w-]+", "-", path.stem).strip("-") or "data"
        what = f"no dataset is written as {path.suffix}" if path.suffix else "has no version"
        raise InputInvalid(path, what, f"a .npz, or a folder of Minari's, as {right}-v0")


def write_dataset(given: Dataset, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a `.npz`, or a new folder of Minari's, as NAME-v0; raises InputInvalid.

    An existing file is replaced only with `overwrite`, an existing folder never.
    """
    path = Path(path).expanduser()
    refuse_taken(path, overwrite)
    if path.suffix.lower() != ".npz":
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
    """Read a file of `write_dataset`, or any folder of Minari; raises InputInvalid."""
    path = Path(path).expanduser()
    if path.is_dir():
        return read_minari(path)
    if not path.is_file():
        raise InputInvalid(path, "no such dataset", "a folder of Minari's, or a .npz")
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as read:
            found = {name: read[name] for name in read.files}
        head = json.loads(bytes(found.pop("head")))
        version = head["uuvsim_dataset"]
        if version != FORMAT:
            raise InputInvalid(path, f"format {version}", FORMAT)
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
            path,
            f"{type(error).__name__}: {error}",
            "a whole dataset as `uuvsim collect` writes it",
        ) from None


def write_minari(given: Dataset, path: Path) -> Path:
    """Write a new folder, whole or not at all, that `minari.MinariDataset(path / "data")` reads.

    With MINARI_DATASETS_PATH the folder's parent, `minari.load_dataset` finds it by its name.
    """
    minari = _minari()
    from gymnasium.spaces import Box
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    seen, acts = (
        Box(np.array([c.low for c in n], np.float32), np.array([c.high for c in n], np.float32))
        for n in (given.observation, given.action)
    )
    about = {
        "dataset_id": path.name,
        "minari_version": minari.__version__,
        "algorithm_name": str(given.told.get("policy", "")),
        "uuvsim": json.dumps({
            "task": given.task, "options": dict(given.options), "told": dict(given.told),
            "observation": [(c.name, c.unit) for c in given.observation],
            "action": [(c.name, c.unit) for c in given.action],
        }),
    }  # fmt: skip
    buffers = [
        EpisodeBuffer(
            id=i,
            observations=e.observation,
            actions=e.action,
            rewards=list(e.reward),
            terminations=[False] * (len(e.action) - 1) + [e.terminated],
            truncations=[False] * (len(e.action) - 1) + [not e.terminated],
        )
        for i, e in enumerate(given.episodes)
    ]
    path = path.absolute()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as made:
            data = Path(made) / "whole" / "data"
            data.parent.mkdir()
            storage = MinariStorage.new(
                data, observation_space=seen, action_space=acts, data_format="arrow"
            )
            storage.update_metadata(about)
            storage.update_episodes(buffers)
            if path.exists():
                path.rmdir()
            shutil.move(str(data.parent), path)
    except OSError as error:
        raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None
    return path


def read_minari(path: Path) -> Dataset:
    """Read a folder; raises InputInvalid for spaces that are no boxes of one axis."""
    minari = _minari()
    data = path if (path / "metadata.json").is_file() else path / "data"
    if not (data / "metadata.json").is_file():
        raise InputInvalid(path, "no dataset of Minari's (data/metadata.json)", "one")
    try:
        found = minari.MinariDataset(str(data))
        about = json.loads(found.storage.metadata.get("uuvsim", "{}"))
        seen = _named(found.observation_space, "observation", about, path)
        acts = _named(found.action_space, "action", about, path)
        episodes = [
            Episode(
                np.asarray(e.observations, np.float32),
                np.asarray(e.actions, np.float32),
                np.asarray(e.rewards, np.float32),
                bool(e.terminations[-1]) if len(e.terminations) else False,
            )
            for e in found.iterate_episodes()
        ]
        made = Dataset(episodes, seen, acts, about.get("task", ""), about.get("options", {}),
                       about.get("told", {}))  # fmt: skip
    except InputInvalid as error:
        raise InputInvalid(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    except Exception as error:  # whatever a broken file makes readers raise
        raise InputInvalid(
            path, f"{type(error).__name__}: {error}", "a whole dataset of Minari's"
        ) from None
    return made


def _named(space: object, what: str, about: dict[str, Any], path: Path) -> tuple[Named, ...]:
    from gymnasium.spaces import Box

    if not isinstance(space, Box) or len(space.shape) != 1 or space.dtype.kind != "f":
        raise InputInvalid(path, f"an {what} space {space}", "a Box of one axis, of floats")
    units = about.get(what) or [(f"{what[0]}[{i + 1}]", "1") for i in range(space.shape[0])]
    named = names_of(space.low, space.high, [n for n, _ in units])
    return tuple(Named(c.name, c.low, c.high, u) for c, (_, u) in zip(named, units, strict=True))


def _minari() -> Any:
    try:
        import minari
    except ModuleNotFoundError as error:
        raise InputInvalid(
            f"{error}; a folder of Minari's expects minari: pip install 'uuvsim-cosim[rl]' (a "
            ".npz needs none)"
        ) from None
    return minari
