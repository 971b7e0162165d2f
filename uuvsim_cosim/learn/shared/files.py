"""A folder of small files as a value, which can be sent to another machine and come back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid

__all__ = ["read_files", "write_files"]

NOT_SENT = (".in_use", "events.out.tfevents")
LAST = (".pt", ".json")  # refer to other files, which must exist before them


def read_files(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder, and of those in it, by path; none, where it is not there."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(NOT_SENT)
    }


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files, each whole or not at all; checkpoints and JSON files last."""

    def when(name: str) -> int:
        return next((i + 1 for i, end in enumerate(LAST) if name.endswith(end)), 0)

    for name in sorted(files, key=when):
        path = folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, files[name])
        except OSError as error:
            raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None
