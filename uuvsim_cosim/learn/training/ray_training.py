"""Trainings on a Ray cluster: each is a chain of pieces, from checkpoint to checkpoint.

A piece receives the files of the training and returns the changed ones, so that the death of a
worker loses only its piece. Since a resumed training has the same bits, the results are the same as
those of one process.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.cluster.ray_cluster import Cluster
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.config import TrainingConfig
from uuvsim_cosim.learn.training.folders import locked, refuse_other, write_owner
from uuvsim_cosim.learn.training.interruption import TrainingInterrupted
from uuvsim_cosim.learn.training.train import Trained, one_thread, resolved, training_of

__all__ = ["ALIKE", "SECONDS", "changed_files", "clock", "read_files", "train_on", "write_files"]

ALIKE = ("torch", "stable-baselines3")  # libraries whose versions decide the bits
SECONDS = 60.0  # duration of a piece: the most that is lost if a worker dies

Progress = Callable[[str, float, float], None]


@dataclass(frozen=True)
class Advanced:
    """The progress of a training after a piece, and the changed files."""

    files: Mapping[str, bytes]
    step: int
    done: bool
    rows: Sequence[Mapping[str, float]]
    cpu: float  # s
    note: str | None


def train_on(
    cluster: Cluster,
    configs: Sequence[TrainingConfig],
    folders: Sequence[Path],
    *,
    restart: bool = False,
    progress: Progress | None = None,
    seconds: float = SECONDS,
) -> list[Trained]:
    """Train or resume several trainings at once, each in its local folder.

    The results have the same bits as those of `train`. No TensorBoard files are written. Ctrl-C
    raises TrainingInterrupted and loses the unfinished pieces, which take `seconds` each; the same
    call resumes.
    """
    chosen = [resolved(c) for c in configs]
    places = [f.expanduser().absolute() for f in folders]
    for config, place in zip(chosen, places, strict=True):
        refuse_other(place, config, restart)
    steps, cpu = [0] * len(chosen), [0.0] * len(chosen)
    rows: list[Sequence[Mapping[str, float]]] = [()] * len(chosen)
    notes: list[str | None] = [None] * len(chosen)

    def piece(k: int) -> tuple[TrainingConfig, str, Mapping[str, bytes], float]:
        return chosen[k], str(places[k]), read_files(places[k]), seconds

    def follow(
        k: int, advanced: Advanced
    ) -> tuple[TrainingConfig, str, Mapping[str, bytes], float] | None:
        write_files(places[k], advanced.files)
        steps[k], rows[k], notes[k] = advanced.step, advanced.rows, advanced.note
        cpu[k] += advanced.cpu
        return None if advanced.done else piece(k)

    total = sum(c.steps for c in chosen)
    with ExitStack() as stack:
        for config, place in zip(chosen, places, strict=True):
            stack.enter_context(locked(place))
            write_owner(place, config, restart)
        try:
            for _ in cluster.spread(_advance, map(piece, range(len(chosen))), follow):
                if progress is not None:
                    progress("training", sum(steps), total)
        except KeyboardInterrupt:
            raise TrainingInterrupted(
                f"interrupted after step {sum(steps)} of {total}; the same command continues from "
                f"there, and repeats up to {seconds:g} s of each seed",
                130,
            ) from None
    return [Trained(*each) for each in zip(places, chosen, rows, cpu, notes, strict=True)]


def clock(seconds: float) -> Callable[[], bool]:
    """Return a function for `interrupted`: True after `seconds` from its first call."""
    end = 0.0

    def passed() -> bool:
        nonlocal end
        end = end or time.monotonic() + seconds
        return time.monotonic() >= end

    return passed


def changed_files(folder: Path, before: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files that differ from before."""
    return {k: v for k, v in read_files(folder).items() if before.get(k) != v}


# ---- inside -------------------------------------------------------------------------------


def _advance(given: tuple[TrainingConfig, str, Mapping[str, bytes], float]) -> Advanced:
    """Run one piece of a training, in a worker."""
    config, name, files, seconds = given
    task = make_task(config.task, config.task_options, profile=config.profile)
    with tempfile.TemporaryDirectory(prefix="uuvsim-") as temporary, one_thread():
        place = Path(temporary)
        write_files(place, files)
        training = training_of(config, task, place, interrupted=clock(seconds))
        try:
            rows, done = training.run(), True
        except KeyboardInterrupt:
            rows, done = training.evaluations, False
        except UuvsimError as error:
            raise UuvsimError(str(error).replace(temporary, name)) from None
        finally:
            training.close()
        changed = changed_files(place, files)
        return Advanced(changed, training.step, done, rows, training.cpu, training.note)


NOT_SENT = (".in_use", "events.out.tfevents")
LAST = (".pt", ".json")  # refer to other files, which must exist before them


def read_files(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder and its subfolders by path; {} if the folder does not exist."""
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
