"""A plant that is masters in worker processes: systems that no kernel runs, on all cores."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, BinaryIO, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.plant import Seeds
from uuvsim_cosim.envs.process_memory import Shared
from uuvsim_cosim.envs.process_worker import receive, send
from uuvsim_cosim.errors import (
    ComponentFailed,
    FmuError,
    InputInvalid,
    LoopNotConverged,
    UuvsimError,
)
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.flatten import flatten
from uuvsim_cosim.orchestrator.system import System

__all__ = ["ProcessPlant"]

Array = NDArray[np.float64]
_ERRORS: dict[str, type[UuvsimError]] = {
    c.__name__: c for c in (ComponentFailed, FmuError, InputInvalid, LoopNotConverged)
}
_GRACE = 5.0  # [s] that a worker is given to free its components


@final
class ProcessPlant:
    """The `Plant` protocol over `MasterPlant`s, each with some of the rows in a process.

    Signals and actions lie in shared memory. A worker ends when this process does; when a worker
    ends before, the next call says so and the plant is closed.
    """

    def __init__(
        self,
        system: System,
        n: int,
        *,
        reads: Sequence[str],
        acts: Sequence[tuple[str, int]],
        processes: int | None = None,
    ) -> None:
        count = (os.cpu_count() or 1) if processes is None else processes
        if count < 1:
            raise InputInvalid(f"processes {processes}; expected at least 1, or None")
        count = min(count, n)
        plan = flatten(system)
        self.n = n
        self.tick = plan.tick
        self.variables: Mapping[str, Variable] = {
            f"{c.path}.{v.name}": v
            for c in plan.components
            for v in c.description.variables.values()
        }
        self._failures: dict[int, ComponentFailed] = {}
        self._acted = False  # whether there are actions that the workers have not seen
        bounds = np.linspace(0, n, count + 1).astype(int).tolist()
        size = sum(self.variables[name].size for name in reads)
        self._memory = Shared(None, size, len(acts), n)
        self._workers: list[_Process] = []
        job = {"plan": plan, "reads": tuple(reads), "acts": tuple(acts),
               "path": self._memory.path, "shape": (size, len(acts), n)}  # fmt: skip
        try:
            for first, end in pairwise(bounds):
                worker = _Process(first, end)
                self._workers.append(worker)
                worker.send("begin", {**job, "n": end - first, "first": first})
                if first == 0:  # compiles what the others load
                    worker.answer()
            for worker in self._workers[1:]:
                worker.answer()
        except BaseException:
            self.close()
            raise
        finally:
            self._memory.unlink()

    def read(self, name: str) -> NDArray[Any]:
        """Copy a variable: of shape (n, *shape)."""
        return np.concatenate(self._call("read", name))

    def write(self, name: str, values: NDArray[Any]) -> None:
        """Set an unconnected input or a tunable parameter in all copies: (n, *shape)."""
        for worker in self._live():
            self._send(worker, "write", name, values[worker.rows])
        self._answers()

    def gather(self) -> Array:
        """Copy what is read: of shape (size, n)."""
        self._live()
        return self._memory.signals.copy()

    def scatter(self, values: Array) -> None:
        """Set what is acted on: of shape (width, n)."""
        self._live()
        self._memory.actions[...] = values
        self._acted = True

    def step(self, ticks: int) -> None:
        """Make communication steps in all copies that have not failed."""
        acted, self._acted = self._acted, False
        self._took_failures(self._call("step", ticks, acted))

    def reset(
        self, mask: NDArray[np.bool_], seeds: Seeds, start: Mapping[str, NDArray[Any]]
    ) -> None:
        """Go back to time 0 where the mask is true."""
        workers = self._live()
        self._memory.mask[...] = mask
        self._memory.seeds[...] = np.asarray(seeds, np.uint64)
        for worker in workers:
            rows = worker.rows
            self._send(worker, "reset", {name: v[rows] for name, v in start.items()})
        self._took_failures(self._answers())

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Say which copies have failed since their reset."""
        return self._memory.failed.copy()

    def failure(self, row: int) -> ComponentFailed | None:
        """Say what failed in a copy."""
        return self._failures.get(row)

    def close(self) -> None:
        """End the processes; a second call does nothing."""
        workers, self._workers = self._workers, []
        for worker in workers:
            worker.hang_up()
        for worker in workers:
            worker.end()

    # ---- inside ---------------------------------------------------------------------------

    def _call(self, name: str, *arguments: Any) -> list[Any]:
        for worker in self._live():
            self._send(worker, name, *arguments)
        return self._answers()

    def _send(self, worker: _Process, name: str, *arguments: Any) -> None:
        try:
            worker.send(name, *arguments)
        except UuvsimError:
            self.close()
            raise

    def _answers(self) -> list[Any]:
        """Take the answers of all, then raise the first error; a worker that is gone closes all."""
        results, errors = [], []
        for worker in self._live():
            try:
                results.append(worker.answer())
            except UuvsimError as error:
                errors.append(error)
        if any(worker.is_gone for worker in self._workers):
            self.close()
        if errors:
            raise errors[0]
        return results

    def _took_failures(self, told: Sequence[Mapping[int, tuple[str, float, str]]]) -> None:
        self._failures = {}
        for worker, failures in zip(self._workers, told, strict=True):
            for row, failure in failures.items():
                self._failures[worker.rows.start + row] = ComponentFailed(*failure)

    def _live(self) -> list[_Process]:
        if not self._workers:
            raise UuvsimError("the worker processes have ended; expected new environments")
        return self._workers


class _Process:
    """One worker and its pipes; rows are those from `first` to before `end`."""

    def __init__(self, first: int, end: int) -> None:
        self.rows = slice(first, end)
        self.is_gone = False
        search = os.pathsep.join(p for p in sys.path if p)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "uuvsim_cosim.envs.process_worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": search},
        )

    def send(self, name: str, *arguments: Any) -> None:
        try:
            send(self._pipe(self._process.stdin), (name, arguments))
        except (BrokenPipeError, ValueError):
            raise self._gone(name) from None

    def answer(self) -> Any:
        try:
            kind, result = receive(self._pipe(self._process.stdout))
        except (EOFError, ValueError):
            raise self._gone("answering") from None
        if kind is not None:
            raise _ERRORS.get(kind, UuvsimError)(*result)
        return result

    def hang_up(self) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()

    def end(self) -> None:
        try:
            self._process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _gone(self, doing: str) -> UuvsimError:
        self.is_gone = True
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE)
        code = self._process.returncode
        how = f"by signal {-code}" if code is not None and code < 0 else f"with status {code}"
        return UuvsimError(
            f"the worker process of environments {self.rows.start} to {self.rows.stop - 1} ended "
            f"{how} ({doing}); expected new environments, or a component that does not crash"
        )

    @staticmethod
    def _pipe(pipe: Any) -> BinaryIO:
        stream: BinaryIO = pipe
        return stream
