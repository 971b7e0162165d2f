"""The folder of a run: never an older run's, and gone again if the run was refused."""

from __future__ import annotations

import itertools
import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid

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
        """Say whether the asked name was taken by something else."""
        return self.path != self.asked

    def discard(self) -> None:
        """Remove what was made, as far as nothing else has come to lie in it."""
        if self.made:
            for file in self.path.iterdir():
                if file.is_file():
                    file.unlink()
        for folder in reversed(self.made):
            try:
                folder.rmdir()
            except OSError:
                return


def claim(asked: str | Path) -> RunFolder:
    """Make the folder, or the first of NAME-2, NAME-3, … if it has something in it already.

    Raises InputInvalid if it cannot be made or written into.
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
        if not os.access(path, os.W_OK | os.X_OK):
            raise InputInvalid(
                f"output folder {path}: cannot be written; expected a folder that can be written"
            )
        return RunFolder(path, asked, made)
    raise AssertionError("the count does not end")


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
            folder.mkdir()
            done.append(folder)
    except OSError:
        for folder in reversed(done):
            folder.rmdir()
        raise
    return tuple(done)
