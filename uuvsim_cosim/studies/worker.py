"""A process that simulates runs with a master: requests on stdin, answers on stdout.

It exits as soon as the process that started it ends, for whatever reason: its stdin then closes.
"""

from __future__ import annotations

import ctypes
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
from typing import final

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.studies.simulate_runs import MasterRuns, Outcome, Script, Starts

__all__ = ["ProcessRuns", "main"]

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


if __name__ == "__main__":
    main()
