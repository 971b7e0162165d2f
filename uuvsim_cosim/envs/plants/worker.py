"""A worker process of a plant: masters for some rows, until the parent is gone."""

from __future__ import annotations

import contextlib
import os
import signal
import sys

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.plants.master_plant import MasterPlant
from uuvsim_cosim.envs.plants.worker_process import Failures, Job, Shared, receive, send
from uuvsim_cosim.errors import ComponentFailed, UuvsimError
from uuvsim_cosim.orchestrator.master.prepared import prepare

__all__ = ["main"]


class _Worker:
    """The rows from `first` on of a plant whose memory is shared."""

    def __init__(self, job: Job) -> None:
        self.plant = MasterPlant(
            job.plan, prepare(job.plan, "native"), job.n, reads=job.reads, acts=job.acts
        )
        shared = Shared(job.memory, *job.shape)
        shared.release()  # the mapping stays; no handle or name is needed any more
        rows = slice(job.first, job.first + job.n)
        self._signals, self._actions = shared.signals[:, rows], shared.actions[:, rows]
        self._seeds, self._mask = shared.seeds[rows], shared.mask[rows]
        self._failed = shared.failed[rows]

    def step(self, ticks: int, acted: bool) -> Failures:
        """Apply the actions if there are new ones, step, and write the signals."""
        if acted:
            self.plant.scatter(self._actions)
        self.plant.step(ticks)
        return self._show()

    def reset(self, start: dict[str, NDArray[np.generic]]) -> Failures:
        """Reset the rows of the mask."""
        self.plant.reset(self._mask.copy(), self._seeds.tolist(), start)
        return self._show()

    def _show(self) -> Failures:
        """Write signals and failures into the shared memory; return the failures in words."""
        self._signals[...] = self.plant.gather()
        failed = self.plant.failed
        self._failed[...] = failed
        failures = {int(i): self.plant.failure(int(i)) for i in np.flatnonzero(failed)}
        return {i: (f.path, f.time, f.reason) for i, f in failures.items() if f is not None}


def main() -> None:
    """Answer until the input ends."""
    if hasattr(signal, "SIGINT"):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a component may print: that must not be read as an answer
    calls = sys.stdin.buffer
    worker: _Worker | None = None
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            number, name, arguments = receive(calls)
            try:
                if name == "begin":
                    worker = _Worker(*arguments)
                    result = None
                else:
                    result = getattr(worker, name)(*arguments)
            except ComponentFailed as error:
                send(answers, (number, "ComponentFailed", (error.path, error.time, error.reason)))
            except UuvsimError as error:
                send(answers, (number, type(error).__name__, (str(error),)))
            except Exception as error:  # a Python component may raise anything
                send(answers, (number, "UuvsimError", (f"{type(error).__name__}: {error}",)))
            else:
                send(answers, (number, None, result))
    if worker is not None:
        worker.plant.close()


if __name__ == "__main__":
    main()
