"""Plant of masters in worker processes: on all cores, for systems that cannot be fused."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.plants.plant import Seeds
from uuvsim_cosim.envs.plants.worker_process import Failures, Job, Shared, WorkerProcess
from uuvsim_cosim.envs.task.signals import variables_of
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["ProcessPlant"]

Array = NDArray[np.float64]


@final
class ProcessPlant:
    """The `Plant` protocol over `MasterPlant`s, each with some of the rows in a process.

    Signals and actions are in shared memory. A worker ends when this process does. If a worker
    ends earlier, the next call raises UuvsimError and the plant is closed. After a call that was
    interrupted by an exception, only a reset of all environments is accepted; it replaces a worker
    that was interrupted within a message.
    """

    def __init__(
        self,
        plan: Plan,
        n: int,
        *,
        reads: Sequence[str],
        acts: Sequence[tuple[str, int]],
        processes: int | None = None,
    ) -> None:
        count = (os.cpu_count() or 1) if processes is None else processes
        if count < 1:
            raise InputInvalid(f"processes {processes}", "at least 1, or None")
        self.n = n
        self.tick = plan.tick
        self.variables = variables_of(plan)
        self._owner = os.getpid()
        self._failures: dict[int, ComponentFailed] = {}
        self._acted = False  # whether there are actions that the workers have not seen
        self._broken = False  # whether a call has begun and not ended
        bounds = np.linspace(0, n, min(count, n) + 1).astype(int).tolist()
        size = sum(self.variables[name].size for name in reads)
        self._memory = Shared(None, size, len(acts), n)
        self._workers: list[WorkerProcess] = []
        self._job = Job(
            plan, tuple(reads), tuple(acts), self._memory.key, (size, len(acts), n), 0, n
        )
        try:
            for first, end in pairwise(bounds):
                worker = self._begun(first, end)
                self._workers.append(worker)
                if first == 0:  # it compiles the components, which the others then load
                    worker.answer()
            for worker in self._workers[1:]:
                worker.answer()
        except BaseException:
            self._end(now=True)
            raise

    def gather(self) -> Array:
        """Copy the variables that are read, of shape (size, n)."""
        self._live()
        return self._memory.signals.copy()

    def scatter(self, values: Array) -> None:
        """Set the inputs that are acted on, of shape (width, n)."""
        self._live()
        self._memory.actions[...] = values
        self._acted = True

    def step(self, ticks: int) -> None:
        """Make communication steps in all copies that have not failed."""
        acted, self._acted = self._acted, False
        self._keep_failures(self._each("step", [(ticks, acted)] * len(self._live())))

    def reset(
        self, mask: NDArray[np.bool_], seeds: Seeds, start: Mapping[str, NDArray[np.generic]]
    ) -> None:
        """Go back to time 0 where the mask is true."""
        if self._broken and mask.all():
            self._settle()
        workers = self._live()
        self._memory.mask[...] = mask
        self._memory.seeds[...] = np.asarray(seeds, np.uint64)
        starts = [({name: v[w.rows] for name, v in start.items()},) for w in workers]
        self._keep_failures(self._each("reset", starts))
        self._acted = self._acted and not mask.all()

    @property
    def failed(self) -> NDArray[np.bool_]:
        """The copies that have failed since their reset."""
        return self._memory.failed.copy()

    def failure(self, row: int) -> ComponentFailed | None:
        """Return the failure of a copy, or None."""
        return self._failures.get(row)

    def close(self) -> None:
        """End the processes; a second call does nothing."""
        self._end()

    # ---- inside ---------------------------------------------------------------------------

    def _begun(self, first: int, end: int) -> WorkerProcess:
        """Start a worker and send its job; the caller must receive the answer."""
        worker = WorkerProcess(first, end, self._memory.handles)
        worker.send("begin", replace(self._job, first=first, n=end - first))
        return worker

    def _each(self, name: str, arguments: Sequence[tuple[object, ...]]) -> list[Any]:
        """Send to all workers, receive all answers, then raise the first error.

        All answers are received first, so that no answer stays in a pipe. If a worker has ended,
        the others are ended too.
        """
        workers, results, errors = self._live(), [], []
        self._broken = True
        try:
            for worker, given in zip(workers, arguments, strict=True):
                worker.send(name, *given)
        except UuvsimError:
            self._end()
            raise
        for worker in workers:
            try:
                results.append(worker.answer())
            except UuvsimError as error:
                errors.append(error)
        self._broken = False
        if any(worker.is_gone for worker in workers):
            self._end()
        if errors:
            raise errors[0]
        return results

    def _settle(self) -> None:
        """Make all workers ready after an interruption."""
        for i, worker in enumerate(self._workers):
            try:
                worker.settle()
            except UuvsimError:
                self._end()
                raise
            if worker.torn:
                worker.end(now=True)
                self._workers[i] = self._begun(worker.rows.start, worker.rows.stop)
                self._workers[i].answer()
        self._broken = False

    def _keep_failures(self, answers: Sequence[Failures]) -> None:
        self._failures = {
            worker.rows.start + row: ComponentFailed(*failure)
            for worker, failures in zip(self._workers, answers, strict=True)
            for row, failure in failures.items()
        }

    def _live(self) -> list[WorkerProcess]:
        if os.getpid() != self._owner:
            read = (
                "the worker processes are those of another process, which this one was forked from"
            )
            raise UuvsimError(read, "new environments")
        if not self._workers:
            raise UuvsimError("the worker processes have ended", "new environments")
        if self._broken:
            raise UuvsimError("a call was interrupted", "reset() of all environments")
        return self._workers

    def _end(self, *, now: bool = False) -> None:
        workers, self._workers = self._workers, []
        if workers and os.getpid() == self._owner:
            for worker in workers:
                worker.hang_up()
            for worker in workers:
                worker.end(now=now)
        for worker in workers:
            worker.forget()
        self._memory.release()
