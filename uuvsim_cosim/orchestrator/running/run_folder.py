"""Folder of a run: it never holds another run, and is removed if the run is refused.

The file of the recording is the lock of the folder: the run that creates it owns the folder.
"""

from __future__ import annotations

import itertools
import json
import os
import platform
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.resources import refuse_unless_it_fits
from uuvsim_cosim.orchestrator.master.isolation import isolations
from uuvsim_cosim.orchestrator.plan.algebraic_loops import hops_of
from uuvsim_cosim.orchestrator.plan.loop_delays import loop_delays
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.recording.recording_reader import STREAM
from uuvsim_cosim.orchestrator.running.mission import path_of
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.strict_json import strict

__all__ = [
    "SCHEMA_VERSION",
    "RunFolder",
    "lock_run_folder",
    "provenance_of",
    "refuse_too_large",
    "write_run_json",
]

# Bytes, at least: an instance of a small component, and the process of an isolated one.
_COMPONENT: Mapping[Backend, float] = {"native": 2e3, "fmu": 1e4}
_PROCESS = 2e7


@dataclass(frozen=True)
class RunFolder:
    """A new folder; `made` lists it and its parents that did not exist before."""

    path: Path
    asked: Path
    made: tuple[Path, ...]

    @property
    def renamed(self) -> bool:
        """Return whether the folder has another name, because the asked one was in use."""
        return self.path != self.asked

    def discard(self) -> None:
        """Remove the files, and the folders that are empty then."""
        for file in self.path.iterdir():  # the lock last: until then the folder is this run's
            if file.is_file() and file.name != STREAM:
                file.unlink()
        (self.path / STREAM).unlink(missing_ok=True)
        _remove(self.made)


def lock_run_folder(asked: str | Path) -> RunFolder:
    """Make and lock the folder, or the first of NAME-2, NAME-3, … if it is not empty.

    It contains an empty file of a recording then, so that no other run uses it. Raises
    InputInvalid if it cannot be made or written into.
    """
    asked = Path(asked).expanduser().absolute()
    for number in itertools.count(1):
        path = asked if number == 1 else asked.with_name(f"{asked.name}-{number}")
        if path.exists() and not path.is_dir():
            raise InputInvalid(f"--out {path}: is a file", "a folder")
        try:
            if path.is_dir() and any(path.iterdir()):
                continue
            made = _make(path)
        except OSError as error:
            raise InputInvalid(
                f"output folder {path}",
                f"cannot be made ({error.strerror})",
                "a folder that can be written",
            ) from None
        try:
            if _is_locked(path):
                return RunFolder(path, asked, made)
        except OSError as error:
            _remove(made)
            raise InputInvalid(
                f"output folder {path}",
                f"cannot be written ({error.strerror})",
                "a folder that can be written",
            ) from None
    raise AssertionError("the count does not end")


def _is_locked(path: Path) -> bool:
    """Create the empty recording, the lock; False if another run was faster."""
    while True:
        try:
            os.close(os.open(path / STREAM, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except FileExistsError:
            return False
        except FileNotFoundError:  # a refused run has removed the folder since
            path.mkdir(parents=True, exist_ok=True)
            continue
        if os.listdir(path) == [STREAM]:
            return True
        (path / STREAM).unlink()  # another run has used the folder, and has ended already
        return False


def refuse_too_large(
    plan: Plan, backend: Backend, isolate: Collection[str], folder: Path, rows: float
) -> None:
    """Raise InputInvalid if a run does not fit in memory, or its `rows` on the disk of `folder`."""
    isolated = isolations(isolate, [c.path for c in plan.components])
    separate = [path for path, way in isolated.items() if way == "process"]
    refuse_unless_it_fits(
        "isolate",
        f"{len(separate)} components in separate processes",
        _PROCESS * len(separate),
        "fewer isolated components",
    )
    refuse_unless_it_fits(
        "system",
        f"{len(plan.components)} components",
        _COMPONENT[backend] * len(plan.components),
        "fewer components",
    )
    numbers = sum(
        v.size for c in plan.components for v in c.description.of("output") if v.type != "Clock"
    )
    refuse_unless_it_fits(
        f"output folder {folder}",
        "the recording",
        rows * 8.0 * (numbers + 2),
        "a shorter run, or fewer rows (--record-every {times} records every {times}th step)",
        folder=folder,
    )


def _make(path: Path) -> tuple[Path, ...]:
    """Make a folder and its missing parents; return those that this run made."""
    missing = [p for p in (path, *path.parents) if not p.exists()][::-1]
    done: list[Path] = []
    try:
        for folder in missing:
            try:
                folder.mkdir()
            except FileExistsError:  # another run has made the same folder
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


SCHEMA_VERSION = 1


def provenance_of(
    system: System, plan: Plan, seed: int, backend: Backend, record_every: int, end: float,
    about: Mapping[str, object],
) -> dict[str, Any]:  # fmt: skip
    """Return the content of run.json that is known before the first step, and `about`."""
    loops = loop_delays(plan)
    path = path_of(plan)
    return {
        "schema_version": SCHEMA_VERSION,
        "version": __version__,
        "system": system.name,
        "seed": seed,
        "backend": {"fmu": "FMUs", "native": "native components"}[backend],
        "start": float(plan.start),
        "until": end,
        "tick": float(plan.tick),
        "record_every": record_every,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "loop_delay": float(loops[0].delay) if loops else None,
        "loop_path": str(loops[0]).partition(": ")[2] if loops else "",
        "loops": plan.loops,
        "algebraic_loops": [
            {"hops": hops_of(plan, x), "iterated": x.iterated, "undeclared": list(x.undeclared)}
            for x in plan.algebraic_loops
        ],
        "notes": list(system.notes),
        "warnings": [w for w in plan.warnings if w not in system.notes],
        "waypoints": None if path is None else path.tolist(),
        "components": [
            {
                "path": c.path,
                "kind": c.description.kind if backend == "native" or "model:" not in c.source
                else "FMI 3.0",
                # Without the folders of this machine.
                "source": c.source if c.source.startswith("model:") else Path(c.source).name,
                "token": c.description.token,
                "step": float(c.step_ticks * plan.tick),
            }
            for c in plan.components
        ],
        **about,
    }  # fmt: skip


def write_run_json(path: Path, content: Mapping[str, object]) -> None:
    """Write the file run.json, never an incomplete one; raises OSError."""
    text = json.dumps(strict(content)[0], indent=2, allow_nan=False)
    write_whole(path, f"{text}\n".encode())
