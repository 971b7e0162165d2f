"""Files of datasets: a `.npz` of this program, or a folder of Minari's.

The `.npz` holds numbers in half precision (11 bits) and one JSON text.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.data.dataset import Dataset, Episode
from uuvsim_cosim.learn.data.minari_dataset import read_minari, write_minari
from uuvsim_cosim.learn.policies.policy import Named

__all__ = ["read_dataset", "refuse_taken", "write_dataset"]

FORMAT = 1
VERSIONED = re.compile(r"[-\w]+-v\d+")


def refuse_taken(path: Path, overwrite: bool = False) -> None:
    """Raise InputInvalid where a dataset cannot be written, or would replace another."""
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

    Nothing that is there already is replaced without `overwrite`, and no folder is.
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
    """Read what `write_dataset` wrote, or another's of Minari; raises InputInvalid."""
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
