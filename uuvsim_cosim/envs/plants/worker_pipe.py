"""Requests and answers between a plant and a worker process, each with its number."""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any, final

from uuvsim_cosim.errors import (
    ComponentFailed,
    FmuError,
    InputInvalid,
    LoopNotConverged,
    UuvsimError,
)

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Failures", "Job", "WorkerProcess", "receive", "send"]

Failures = Mapping[int, tuple[str, float, str]]  # by row of the worker: path, time [s], reason

_ERRORS: dict[str, type[UuvsimError]] = {
    c.__name__: c for c in (ComponentFailed, FmuError, InputInvalid, LoopNotConverged)
}
_GRACE = 5.0  # [s] that a worker is given to free its components


@dataclass(frozen=True)
class Job:
    """The first message to a worker: its system, and its rows of the shared arrays."""

    plan: Plan
    reads: tuple[str, ...]
    acts: tuple[tuple[str, int], ...]
    memory: int | str  # key of the shared memory
    shape: tuple[int, int, int]  # signals, actions, environments of all workers together
    first: int  # row
    n: int  # rows


def send(pipe: IO[bytes], message: object) -> None:
    """Write a message: its length in 8 bytes, then its pickle."""
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    rest = memoryview(len(data).to_bytes(8, "little") + data)
    while rest:  # an unbuffered pipe may accept only a part
        rest = rest[pipe.write(rest) :]
    pipe.flush()


def receive(pipe: IO[bytes]) -> Any:
    """Read a message; raises EOFError when the other side has gone."""
    return pickle.loads(_read(pipe, int.from_bytes(_read(pipe, 8), "little")))


def _read(pipe: IO[bytes], size: int) -> bytes:
    parts = []
    while size:
        part = pipe.read(size)
        if not part:
            raise EOFError
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


@final
class WorkerProcess:
    """One worker, with the rows from `first` to before `end`, and its pipes.

    Any call may be interrupted by an exception of a signal handler. Its request is answered
    nevertheless, and `settle` discards the answer. A worker that was interrupted within a message
    is `torn`: it cannot be used any more.
    """

    def __init__(self, first: int, end: int, handles: Sequence[int]) -> None:
        self.rows = slice(first, end)
        self.is_gone = False
        self.torn = True  # until its job has been sent
        self._asked = self._answered = 0
        search = os.pathsep.join(p for p in sys.path if p)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "uuvsim_cosim.envs.plants.worker"],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=tuple(handles),
            env={**os.environ, "PYTHONPATH": search},
        )

    def send(self, name: str, *arguments: object) -> None:
        """Send a request: the name of a method, and its arguments."""
        try:
            self.torn = True
            self._asked += 1
            send(self._pipe(self._process.stdin), (self._asked, name, arguments))
            self.torn = False
        except (BrokenPipeError, ValueError):
            raise self._gone(name) from None

    def answer(self) -> Any:
        """Wait for the answer to the last request; raises the error that the worker has raised."""
        while True:  # an answer with an older number belongs to an interrupted call
            number, error, result = self._next()
            if number == self._asked:
                break
        if error is not None:
            raise _ERRORS.get(error, UuvsimError)(*result)
        return result

    def settle(self) -> None:
        """Receive the answers to all requests, and discard them."""
        while not self.torn and self._answered < self._asked:
            self._next()

    def hang_up(self) -> None:
        """Close the requests' pipe, at which the worker ends."""
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()

    def end(self, *, now: bool = False) -> None:
        """Wait until the worker has ended; with `now`, kill it."""
        try:
            if now:
                self._process.kill()
            self._process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self.forget()

    def forget(self) -> None:
        """Close the pipes."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def _next(self) -> tuple[int, str | None, Any]:
        """Return the next answer: number of the request, name of an error if any, result."""
        try:
            pipe = self._pipe(self._process.stdout)
            if os.name == "posix":  # an exception may interrupt this wait without a torn message
                ready = select.poll()
                ready.register(pipe, select.POLLIN)
                ready.poll()
            self.torn = True
            number, error, result = receive(pipe)
            self._answered, self.torn = number, False
        except (EOFError, ValueError):
            raise self._gone("answering") from None
        return number, error, result

    def _gone(self, doing: str) -> UuvsimError:
        self.is_gone = True
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE)
        code = self._process.returncode
        how = f"by signal {-code}" if code is not None and code < 0 else f"with status {code}"
        return UuvsimError(
            (
                f"the worker process of environments {self.rows.start} to "
                f"{self.rows.stop - 1} ended {how} ({doing})"
            ),
            "new environments, or a component that does not crash",
        )

    @staticmethod
    def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
        assert pipe is not None  # both were made with PIPE
        return pipe
