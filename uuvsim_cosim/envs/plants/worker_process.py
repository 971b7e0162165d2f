"""Parent's side of a worker process: numbered requests and answers, and shared memory."""

from __future__ import annotations

import contextlib
import mmap
import os
import pickle
import select
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, final

import numpy as np

from uuvsim_cosim.errors import (
    ComponentFailed,
    FmuError,
    InputInvalid,
    LoopNotConverged,
    UuvsimError,
)

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Failures", "Job", "Shared", "WorkerProcess", "receive", "send"]

Failures = Mapping[int, tuple[str, float, str]]  # by row of the worker: path, time [s], reason

_ERRORS: dict[str, type[UuvsimError]] = {
    c.__name__: c for c in (ComponentFailed, FmuError, InputInvalid, LoopNotConverged)
}
_GRACE = 5.0  # [s] that a worker is given to free its components
BY_HANDLE = os.name == "posix"  # children inherit the handle, and the file needs no name


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
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._requests, self._answers = self._process.stdin, self._process.stdout

    def send(self, name: str, *arguments: object) -> None:
        """Send a request: the name of a method, and its arguments."""
        try:
            self.torn = True
            self._asked += 1
            send(self._requests, (self._asked, name, arguments))
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
        with contextlib.suppress(OSError):
            self._requests.close()

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
        for pipe in (self._requests, self._answers):
            with contextlib.suppress(OSError):
                pipe.close()

    def _next(self) -> tuple[int, str | None, Any]:
        """Return the next answer: number of the request, name of an error if any, result."""
        try:
            if os.name == "posix":  # an exception may interrupt this wait without a torn message
                ready = select.poll()
                ready.register(self._answers, select.POLLIN)
                ready.poll()
            self.torn = True
            number, error, result = receive(self._answers)
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
        worker = f"the worker process of environments {self.rows.start} to {self.rows.stop - 1}"
        expected = "new environments, or a component that does not crash"
        return UuvsimError(f"{worker} ended {how} ({doing})", expected)


@final
class Shared:
    """Arrays over one mapped file, without a name where children inherit handles.

    So no file remains when a process is killed. `source` is the `key` of another process.
    """

    def __init__(self, source: int | str | None, n_read: int, n_acted: int, n: int) -> None:
        parts = (n_read * n, n_acted * n, n, n, n)
        size = 8 * sum(parts)
        self.key: int | str
        self._is_owner = source is None
        if source is None:
            self._handle, path = _new(size)
            self.key = self._handle if BY_HANDLE else path
        else:
            self._handle = source if isinstance(source, int) else os.open(source, os.O_RDWR)
            self.key = source
        try:
            self._map = mmap.mmap(self._handle, size)
        except BaseException:
            self.release()
            raise
        ends = np.cumsum((0, *parts)) * 8
        doubles = [np.frombuffer(self._map, np.float64, c, int(e))
                   for c, e in zip(parts, ends, strict=False)]  # fmt: skip
        self.signals = doubles[0].reshape(n_read, n)
        self.actions = doubles[1].reshape(n_acted, n)
        self.seeds = doubles[2].view(np.uint64)
        self.mask = doubles[3].view(np.uint8)[:n].view(bool)
        self.failed = doubles[4].view(np.uint8)[:n].view(bool)

    @property
    def handles(self) -> tuple[int, ...]:
        """The handles that a child must inherit, until `release`."""
        return (self._handle,) if BY_HANDLE else ()

    def release(self) -> None:
        """Close the handle, and delete the file's name if there is one: no process can join."""
        handle, self._handle = self._handle, -1
        if handle >= 0:
            os.close(handle)
        if isinstance(self.key, str) and self._is_owner:
            with contextlib.suppress(OSError):
                os.unlink(self.key)


def _new(size: int) -> tuple[int, str]:
    """Make a file of zeros, in memory where there is such a folder with room for it."""
    fast = Path("/dev/shm")
    folders = [fast] if fast.is_dir() and os.access(fast, os.W_OK) else []
    folders.append(Path(tempfile.gettempdir()))
    available = {folder: shutil.disk_usage(folder).free for folder in folders}
    folder = next((f for f in folders if available[f] > size), None)
    if folder is None:
        free = ", ".join(f"{n_bytes / 1e9:.3g} GB in {f}" for f, n_bytes in available.items())
        raise InputInvalid(
            f"{size / 1e9:.3g} GB of memory to share with processes, where there are {free}",
            "fewer environments, or more room",
        )
    handle, path = tempfile.mkstemp(prefix=f"uuvsim-{os.getpid()}-", dir=folder)
    try:
        if BY_HANDLE:
            os.unlink(path)
        os.truncate(handle, size)
    except BaseException:
        os.close(handle)
        raise
    return handle, path
