"""Folder of a curriculum: its owner, the finished stages, and the last one."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.shared.task_ids import short_name
from uuvsim_cosim.learn.training.curriculum import Curriculum
from uuvsim_cosim.learn.training.folder_lock import ABOUT as TRAINING
from uuvsim_cosim.learn.training.folder_lock import LOCK, OURS, has_owner, write_about

__all__ = [
    "ABOUT",
    "STAGE",
    "SWITCH",
    "begin_anew",
    "done_in",
    "last_done",
    "stage_folder",
    "write_done",
]

ABOUT = "curriculum.json"
STAGE = "stage.json"  # the CPU seconds of a stage, all calls together
SWITCH = "switch.pt"  # the state that a stage began with


def stage_folder(folder: Path, k: int, task: str) -> Path:
    """Return the folder of stage k, counted from 0: "2-transition_1"."""
    return folder / f"{k + 1}-{short_name(task)}"


def done_in(
    folder: Path, curriculum: Curriculum, seed: int, *, restart: bool = False
) -> list[dict[str, Any]]:
    """Return the records of the finished stages.

    Raises InputInvalid for a folder of another curriculum; with `restart`, it may be any, and no
    stage is finished.
    """
    about = folder / ABOUT
    if not has_owner(about) or restart:
        return []
    try:
        read = json.loads(about.read_text(encoding="utf-8"))
        before, done = _named({**read["curriculum"], "seed": read["seed"]}), list(read["done"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputInvalid(
            about, f"cannot be read ({error})", "a curriculum's, or --restart"
        ) from None
    now = _named({**curriculum.plain(), "seed": seed})
    for name in {**now, **before}:
        if now.get(name) != before.get(name):
            raise InputInvalid(
                folder,
                f"holds a curriculum with {name} {before.get(name)!r}",
                f"{now.get(name)!r}, another folder (-o), or to begin anew (--restart)",
            )
    return done


def write_done(folder: Path, curriculum: Curriculum, seed: int, done: list[dict[str, Any]]) -> None:
    """Write the curriculum and the records of the finished stages into the folder."""
    write_about(folder / ABOUT, {"curriculum": curriculum.plain(), "seed": seed, "done": done})


def begin_anew(folder: Path) -> None:
    """Delete the files of a curriculum's stages and report; ABOUT stays and marks the folder.

    Other files stay too, and so does the folder of a separate training within.
    """
    stages = (p for p in folder.glob("[1-9]*-*") if p.is_dir() and not (p / TRAINING).exists())
    for place in (*stages, folder):
        for path in (p for pattern in (*OURS, STAGE, SWITCH) for p in place.glob(pattern)):
            if path.name != LOCK:
                path.unlink()
        shutil.rmtree(place / "pictures", ignore_errors=True)
        if place != folder and not any(place.iterdir()):
            place.rmdir()


def last_done(folder: Path) -> Path:
    """Return the folder of the last finished stage; raises InputInvalid if there is none."""
    about = folder / ABOUT
    try:
        read = json.loads(about.read_text(encoding="utf-8"))
        places = [
            stage_folder(folder, k, stage["task"])
            for k, stage in enumerate(read["curriculum"]["stages"])
        ]
        done = places[: len(read["done"])]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputInvalid(about, f"cannot be read ({error})", "a curriculum's") from None
    if not done:
        raise InputInvalid(
            folder, "no stage of this curriculum is done", "one, or the folder of a stage"
        )
    return done[-1]


def _named(plain: Mapping[str, Any]) -> dict[str, object]:
    """Return the fields of a curriculum by name, those of each stage separately."""
    return {k: v for k, v in plain.items() if k != "stages"} | {
        f"stage {k + 1}, {name}": value
        for k, stage in enumerate(plain["stages"])
        for name, value in stage.items()
    }
