"""Simulation of runs elsewhere: in a process with a master, or by the workers of a Ray cluster.

A process gets requests on stdin and answers on stdout. It exits as soon as the process that started
it ends, for whatever reason: its stdin then closes.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Literal, final

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.studies.simulate_runs import (
    KernelRuns,
    MasterRuns,
    Outcome,
    Script,
    Simulated,
    Starts,
)

if TYPE_CHECKING:
    from ray import ObjectRef

    from uuvsim_cosim.cluster.ray_cluster import Cluster

__all__ = ["ProcessRuns", "RayRuns", "main", "ray_runs"]

Request = Script | tuple[list[int], Starts]  # the script first; then seeds and start values


@final
class ProcessRuns:
    """A master in another process, which ends when its stdin closes or this process ends."""

    def __init__(self, script: Script) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-m", "uuvsim_cosim.studies.worker", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is handled here, not by the child
        )
        try:
            self._ask(script)
        except BaseException:
            self.close()
            raise

    def runs(self, seeds: Sequence[int], start: Starts) -> list[Outcome]:
        """Simulate runs in the other process."""
        answer = self._ask((list(seeds), dict(start)))
        assert answer is not None
        return answer

    def close(self) -> None:
        """End the process."""
        self._child.kill()
        for pipe in (self._child.stdin, self._child.stdout):
            if pipe is not None:
                try:
                    pipe.close()
                except OSError:
                    continue
        self._child.wait()

    def _ask(self, request: Request) -> list[Outcome] | None:
        to, back = self._child.stdin, self._child.stdout
        assert to is not None
        assert back is not None
        try:
            pickle.dump(request, to)
            to.flush()
            good, answer = pickle.load(back)
        except (EOFError, OSError, pickle.UnpicklingError, ValueError):
            status = self._child.poll()
            raise UuvsimError(
                f"a process that simulates runs has ended (status {status}); finished runs are kept"
            ) from None
        if not good:
            raise answer
        outcomes: list[Outcome] | None = answer
        return outcomes


def main() -> None:
    """Answer requests until stdin closes."""
    if len(sys.argv) > 1 and sys.platform.startswith("linux"):
        # Let Linux end this process with its parent, even while a component blocks Python.
        PR_SET_PDEATHSIG = 1
        with suppress(AttributeError, OSError):  # the end of stdin is noticed anyway
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
            if os.getppid() != int(sys.argv[1]):
                os._exit(0)  # it ended before this call
    # Assumptions about a system were reported by the parent process already.
    logging.getLogger("uuvsim_cosim").addHandler(logging.NullHandler())
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of a component must not mix with the answers
    requests: queue.SimpleQueue[Request | Exception] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    runs: MasterRuns | None = None
    while True:
        request = requests.get()
        try:
            if isinstance(request, Exception):
                raise request
            if isinstance(request, Script):
                runs = MasterRuns(request)
                answer: list[Outcome] | None = None
            else:
                assert runs is not None
                answer = runs.runs(*request)
            pickle.dump((True, answer), answers)
        except UuvsimError as error:
            pickle.dump((False, UuvsimError(str(error))), answers)
        except Exception as error:
            wrong = UuvsimError(f"{type(error).__name__}: {error}")
            pickle.dump((False, wrong), answers)
        try:
            answers.flush()
        except BrokenPipeError:
            os._exit(0)  # the parent process has ended


def _listen(requests: queue.SimpleQueue[Request | Exception]) -> None:
    """Queue requests; exit when stdin closes, even during a run."""
    while True:
        try:
            requests.put(pickle.load(sys.stdin.buffer))
        except EOFError:
            os._exit(0)
        except Exception as error:
            requests.put(error)


IN_FLIGHT = 2  # requests for each CPU: one is worked on, one waits

_made: dict[tuple[str, str, int], Simulated] = {}  # of a worker's process


def ray_runs(
    cluster: Cluster, script: Script, by: Literal["kernel", "master"], n: int
) -> list[Simulated]:
    """Return enough simulators to keep the cluster busy; a kernel's batch has `n` places."""
    content = pickle.dumps(script)
    key = (hashlib.blake2b(content, digest_size=16).hexdigest(), by, n)
    kept = cluster.put(content)
    return [RayRuns(cluster, key, kept) for _ in range(IN_FLIGHT * max(cluster.cpus, 1))]


@final
class RayRuns:
    """One request at a time to the cluster; a run depends on seed and start values only."""

    def __init__(self, cluster: Cluster, key: tuple[str, str, int], kept: ObjectRef) -> None:
        self._cluster, self._key, self._kept = cluster, key, [kept]

    def runs(self, seeds: Sequence[int], start: Starts) -> list[Outcome]:
        """Simulate runs on the cluster."""
        return self._cluster.call(_runs, self._key, self._kept, list(seeds), dict(start))

    def close(self) -> None:
        """Do nothing: the cluster ends its own work."""


def _runs(
    key: tuple[str, str, int], kept: list[ObjectRef], seeds: list[int], start: Starts
) -> list[Outcome]:
    """Simulate in a worker, which keeps its kernel or master for the next call."""
    if key not in _made:
        import ray

        script: Script = pickle.loads(ray.get(kept[0]))
        _, by, n = key
        for other in list(_made):  # one at a time: a kernel's batch may fill the memory
            _made.pop(other).close()
        _made[key] = KernelRuns(script, n, 1) if by == "kernel" else MasterRuns(script)
    return _made[key].runs(seeds, start)


if __name__ == "__main__":
    main()
