"""Folder of a run: it never holds another run, and is removed if the run is refused.

Whoever makes the file of the recording, which only one can, has the folder.
"""

from __future__ import annotations

import itertools
import math
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.files import STREAM

__all__ = ["RunFolder", "check_room", "claim"]

_SMALL = 20e6  # bytes; less than this is not worth asking


@dataclass(frozen=True)
class RunFolder:
    """A fresh folder; `made` lists it and those above it that did not exist before."""

    path: Path
    asked: Path
    made: tuple[Path, ...]

    @property
    def renamed(self) -> bool:
        """Return whether the asked name was taken by something else."""
        return self.path != self.asked

    def discard(self) -> None:
        """Remove what was made, as far as nothing else has come to lie in it."""
        for file in self.path.iterdir():  # the claim's last: until then the folder is this run's
            if file.is_file() and file.name != STREAM:
                file.unlink()
        (self.path / STREAM).unlink(missing_ok=True)
        _remove(self.made)


def claim(asked: str | Path) -> RunFolder:
    """Make the folder, or the first of NAME-2, NAME-3, … if it has something in it already.

    It holds an empty file of a recording from then on, so that no other run claims it. Raises
    InputInvalid if it cannot be made or written into.
    """
    asked = Path(asked).expanduser().absolute()
    for number in itertools.count(1):
        path = asked if number == 1 else asked.with_name(f"{asked.name}-{number}")
        if path.exists() and not path.is_dir():
            raise InputInvalid(f"--out {path}: is a file; expected a folder")
        try:
            if path.is_dir() and any(path.iterdir()):
                continue
            made = _made(path)
        except OSError as error:
            raise InputInvalid(
                f"output folder {path}: cannot be made ({error.strerror}); expected a folder "
                "that can be written"
            ) from None
        try:
            if _marked(path):
                return RunFolder(path, asked, made)
        except OSError as error:
            _remove(made)
            raise InputInvalid(
                f"output folder {path}: cannot be written ({error.strerror}); expected a folder "
                "that can be written"
            ) from None
    raise AssertionError("the count does not end")


def _marked(path: Path) -> bool:
    """Put the empty recording there; False if another run was quicker."""
    while True:
        try:
            os.close(os.open(path / STREAM, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except FileExistsError:
            return False
        except FileNotFoundError:  # a run that was refused has removed the folder meanwhile
            path.mkdir(parents=True, exist_ok=True)
            continue
        if os.listdir(path) == [STREAM]:
            return True
        (path / STREAM).unlink()  # that run is over already
        return False


def check_room(folder: Path, wanted: float) -> None:
    """Refuse a recording of `wanted` bytes that the disk cannot hold, before the first step."""
    free = shutil.disk_usage(folder).free
    if wanted > _SMALL and wanted > 0.9 * free:
        times = math.ceil(wanted / (0.5 * free + 1.0))
        raise InputInvalid(
            f"output folder {folder}: the recording would take about {wanted / 1e9:.3g} GB, and "
            f"{free / 1e9:.3g} GB are free; expected a shorter run, or fewer rows "
            f"(--record-every {times} records every {times}th step)"
        )


def _made(path: Path) -> tuple[Path, ...]:
    missing = [p for p in (path, *path.parents) if not p.exists()][::-1]
    done: list[Path] = []
    try:
        for folder in missing:
            try:
                folder.mkdir()
            except FileExistsError:  # another run makes the same; what it made is not this one's
                if not folder.is_dir():
                    raise
                continue
            done.append(folder)
    except OSError:
        _remove(done)
        raise
    return tuple(done)


def _remove(folders: Sequence[Path]) -> None:
    """Remove empty folders, the innermost first."""
    for folder in reversed(folders):
        try:
            folder.rmdir()
        except OSError:  # it is not empty
            return
