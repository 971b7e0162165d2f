"""A process that simulates runs with a master: requests come in by stdin, answers go to stdout."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from typing import Any, final

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.studies.simulate_runs import MasterRuns, Outcome, Script, Starts

__all__ = ["ProcessRuns", "main"]


@final
class ProcessRuns:
    """A master in a process of its own, which ends with its input."""

    def __init__(self, script: Script) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-m", "uuvsim_cosim.studies.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is ours to deal with, not the child's
        )
        try:
            self._ask(script)
        except BaseException:
            self.close()
            raise

    def runs(self, seeds: Sequence[int], start: Starts) -> list[Outcome]:
        """Simulate runs there."""
        answer: list[Outcome] = self._ask((list(seeds), dict(start)))
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

    def _ask(self, request: Any) -> Any:
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
        return answer


def main() -> None:
    """Answer until the input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a component prints must not come between the answers
    requests = sys.stdin.buffer
    runs: MasterRuns | None = None
    while True:
        try:
            request = pickle.load(requests)
        except EOFError:
            return
        try:
            if isinstance(request, Script):
                runs = MasterRuns(request)
                answer: Any = None
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
            os._exit(0)  # whoever asked has ended


if __name__ == "__main__":
    main()
