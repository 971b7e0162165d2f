"""Owner and lock of a training's folder: one training, and one process at a time."""

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

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.config import TrainingConfig

__all__ = ["has_owner", "locked", "refuse_other", "write_about", "write_owner"]

ABOUT = "training.json"
LOCK = ".in_use"
OURS = (
    ABOUT, LOCK, "checkpoint.pt", "diverged.pt", "episodes.csv", "evaluations.csv", "judged.json",
    "report.html", "best*.npz", "policy*.npz", "events.out.tfevents.*",
)  # fmt: skip


def refuse_other(folder: Path, config: TrainingConfig, restart: bool) -> None:
    """Raise InputInvalid for a folder of another training, or with other files.

    The number of steps may differ; with `restart`, everything may.
    """
    about = folder / ABOUT
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
            f"{now[k]!r}, another folder (-o), or to begin anew (--restart)",
        )


def write_owner(folder: Path, config: TrainingConfig, restart: bool) -> None:
    """Write the configuration into the folder; `restart` first deletes the files of trainings."""
    if restart:
        for path in (p for pattern in OURS if pattern != LOCK for p in folder.glob(pattern)):
            path.unlink()
        shutil.rmtree(folder / "pictures", ignore_errors=True)
    write_about(folder / ABOUT, {"config": config.plain(), "version": __version__})


def has_owner(about: Path) -> bool:
    """Return whether the file with a folder's owner exists.

    Raises InputInvalid for a folder without it that holds other files.
    """
    if about.is_file():
        return True
    folder = about.parent
    if folder.exists() and (not folder.is_dir() or any(p.name != LOCK for p in folder.iterdir())):
        raise InputInvalid(folder, "holds other things", "an empty or a new folder")
    return False


def write_about(about: Path, content: Mapping[str, object]) -> None:
    """Write the file with a folder's owner, whole or not at all; raises InputInvalid."""
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
