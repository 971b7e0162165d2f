"""Folders of trainings and curricula: configuration, lock, and record of the finished stages.

A folder belongs to one training or curriculum, and only one process at a time works in it.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.shared.task_ids import short_name
from uuvsim_cosim.learn.training.curriculum import Curriculum

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.config import TrainingConfig

__all__ = [
    "CURRICULUM",
    "STAGE",
    "SWITCH",
    "begin_anew",
    "done_in",
    "has_owner",
    "last_done",
    "locked",
    "refuse_other",
    "stage_folder",
    "write_about",
    "write_done",
    "write_owner",
]

TRAINING = "training.json"
LOCK = ".in_use"
OURS = (
    TRAINING, LOCK, "checkpoint.pt", "diverged.pt", "episodes.csv", "evaluations.csv",
    "judged.json", "report.html", "best*.npz", "policy*.npz", "events.out.tfevents.*",
)  # fmt: skip


def refuse_other(folder: Path, config: TrainingConfig, restart: bool) -> None:
    """Raise InputInvalid for a folder of another training, or with other files.

    The number of steps may differ; with `restart`, everything may.
    """
    about = folder / TRAINING
    if not has_owner(about) or restart:
        return
    try:
        before = json.loads(about.read_text(encoding="utf-8"))["config"]
        now = config.plain()
        other = [k for k in now if k != "steps" and now[k] != before.get(k)]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputInvalid(
            about, f"cannot be read ({error})", "a training's, or --restart"
        ) from None
    if other:
        k = other[0]
        raise InputInvalid(
            folder,
            f"holds a training with {k} {before.get(k)!r}",
            f"{now[k]!r}, another folder (-o), or a new start (--restart)",
        )


def write_owner(folder: Path, config: TrainingConfig, restart: bool) -> None:
    """Write the configuration into the folder; `restart` first deletes the files of trainings."""
    if restart:
        for path in (p for pattern in OURS if pattern != LOCK for p in folder.glob(pattern)):
            path.unlink()
        shutil.rmtree(folder / "pictures", ignore_errors=True)
    write_about(folder / TRAINING, {"config": config.plain(), "version": __version__})


def has_owner(about: Path) -> bool:
    """Return whether the folder has a file with a configuration.

    Raises InputInvalid if it has none and holds other files.
    """
    if about.is_file():
        return True
    folder = about.parent
    if folder.exists() and (not folder.is_dir() or any(p.name != LOCK for p in folder.iterdir())):
        raise InputInvalid(folder, "contains other files", "an empty or a new folder")
    return False


def write_about(about: Path, content: Mapping[str, object]) -> None:
    """Write the file with a folder's configuration, whole or not at all; raises InputInvalid."""
    try:
        about.parent.mkdir(parents=True, exist_ok=True)
        write_whole(about, (json.dumps(content, indent=1) + "\n").encode())
    except OSError as error:
        raise InputInvalid(f"{about.parent}: cannot be written ({error.strerror})") from None


def locked(folder: Path) -> ExitStack:
    """Lock the folder until the exit; raises InputInvalid while another process has the lock.

    The operating system releases the lock when the process ends, also after a crash.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        number = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise InputInvalid(f"{folder}: cannot be written ({error.strerror})") from None
    stack = ExitStack()
    stack.callback(os.close, number)
    try:
        _lock(number)
    except OSError:
        stack.close()
        raise InputInvalid(
            folder, "another process trains there now", "its end, or another folder"
        ) from None
    return stack


def _lock(number: int) -> None:
    """Lock a file for this process, or raise OSError at once."""
    module: Any
    if sys.platform == "win32":
        import msvcrt as module

        module.locking(number, module.LK_NBLCK, 1)
        return
    import fcntl as module

    module.flock(number, module.LOCK_EX | module.LOCK_NB)


CURRICULUM = "curriculum.json"
STAGE = "stage.json"  # the CPU seconds of a stage, all calls together
SWITCH = "switch.pt"  # the state that a stage began with


def stage_folder(folder: Path, k: int, task: str) -> Path:
    """Return the folder of stage k, counted from 0: "2-transition_1"."""
    return folder / f"{k + 1}-{short_name(task)}"


def done_in(
    folder: Path, curriculum: Curriculum, seed: int, *, restart: bool = False
) -> list[dict[str, Any]]:
    """Return the records of the finished stages.

    Raises InputInvalid for a folder of another curriculum. With `restart`, the folder may be that
    of any curriculum, and no stage counts as finished.
    """
    about = folder / CURRICULUM
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
                f"{now.get(name)!r}, another folder (-o), or a new start (--restart)",
            )
    return done


def write_done(folder: Path, curriculum: Curriculum, seed: int, done: list[dict[str, Any]]) -> None:
    """Write the curriculum and the records of the finished stages into the folder."""
    write_about(folder / CURRICULUM, {"curriculum": curriculum.plain(), "seed": seed, "done": done})


def begin_anew(folder: Path) -> None:
    """Delete the files of a curriculum's stages and its report, except the file CURRICULUM.

    That file marks the folder. Other files stay, too, and so does the folder of a separate training
    below.
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
    about = folder / CURRICULUM
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
