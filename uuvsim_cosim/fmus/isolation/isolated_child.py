"""The child process of `Isolated`: makes one component and answers calls until its input ends."""

from __future__ import annotations

import itertools
import logging
import os
import pickle
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

from uuvsim_cosim.errors import ComponentFailed, UuvsimError
from uuvsim_cosim.fmus.component import Component

__all__ = ["main"]

_GRACE = 2.0  # [s] from the parent's end to this process's


class Serving(Protocol):
    """The counterpart of a stepping loop of the parent, over shared memory."""

    def run(self) -> None:
        """Make steps until the parent sends a call on the pipe."""

    def forget(self) -> None:
        """Set every input at the next step, as a call may change the component's inputs."""

    def error(self, time: float) -> BaseException:
        """Return the error of the last step."""

    def close(self) -> None:
        """Release the memory."""


class Served:
    """The component in the child, and the states that the parent holds by number."""

    def __init__(self, segment: int, pipe: int) -> None:
        self.component: Component | None = None
        self.serving: Serving | None = None
        self._segment, self._pipe = segment, pipe
        self._states: dict[int, object] = {}
        self._numbers = itertools.count()
        self._reported = 0  # messages

    def call(self, method: str, arguments: tuple[Any, ...], dropped: list[int]) -> object:
        """Return the result of a call of the parent; `dropped` are states that it has released."""
        for number in dropped:
            self._states.pop(number, None)
        if method == "instantiate":
            factory: Callable[..., Component]
            factory, given = arguments
            self.component = factory(*given)
            return None
        if method in ("ask", "serve", "why", "messages"):
            return self._stepping(method, arguments)
        if self.serving is not None:
            self.serving.forget()
        if method in ("set_fmu_state", "serialize_fmu_state"):
            return getattr(self.component, method)(self._states[arguments[0]])
        result = getattr(self.component, method)(*self._resolved(method, arguments))
        if method in ("get_fmu_state", "deserialize_fmu_state"):
            number = next(self._numbers)
            self._states[number] = result
            if method == "deserialize_fmu_state":
                return number
            data = None
            if self.component is not None and self.component.description.can_serialize_state:
                with suppress(Exception):  # such a state can still be restored in this process
                    data = self.component.serialize_fmu_state(result)
            return number, data
        return result

    def _stepping(self, method: str, arguments: tuple[Any, ...]) -> object:
        """Return the result of a call that concerns a stepping loop of the parent."""
        component = self.component
        if method == "ask":
            return arguments[0](component, *arguments[1])
        if method == "serve":
            self.close()
            make, more = arguments
            self.serving = make(component, self._segment, self._pipe, *more)
        elif method == "why":
            assert self.serving is not None
            raise self.serving.error(*arguments)
        else:
            drain = getattr(component, "drain_messages", None)
            return None if drain is None else drain()
        return None

    def _resolved(self, method: str, arguments: tuple[Any, ...]) -> tuple[object, ...]:
        """Replace names by variables; the parent sends names, as they are shorter."""
        if self.component is None or method not in ("get", "set", "directional_derivative"):
            return arguments
        variables = self.component.description.variables
        if method == "directional_derivative":
            groups = tuple([variables[n] for n in names] for names in arguments[:2])
            return (*groups, *arguments[2:])
        return (variables[arguments[0]], *arguments[1:])

    def messages(self) -> list[tuple[str, str]]:
        """Return the messages since the last call."""
        kept: list[tuple[str, str]] = getattr(self.component, "messages", [])
        new = kept[self._reported :]
        self._reported = len(kept)
        return list(new)

    def close(self) -> None:
        """End the counterpart of the parent's stepping loop."""
        if self.serving is not None:
            self.serving.close()
            self.serving = None

    def free(self) -> None:
        """Free the component."""
        self._states.clear()
        self.close()
        if self.component is not None:
            self.component.free()


def main() -> None:
    """Serve the parent; the component's output goes to standard error, away from the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    logging.getLogger("uuvsim_cosim").addHandler(logging.NullHandler())
    calls = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    _end_with_parent(calls.fileno())
    served = Served(int(sys.argv[1]) if len(sys.argv) > 1 else 0, calls.fileno())
    while True:
        if served.serving is not None:
            served.serving.run()
        try:
            method, arguments, dropped = pickle.load(calls)
        except EOFError:
            break
        if method == "instantiate":  # the first of two answers: the imports have ended
            pickle.dump(("ok", None, []), answers)
            answers.flush()
        answer: tuple[str, object]
        try:
            answer = "ok", served.call(method, arguments, dropped)
        except ComponentFailed as error:
            answer = "failed", (error.path, error.time, error.reason, error.asks_to_end)
        except UuvsimError as error:
            answer = "refused", str(error)
        except Exception as error:  # a Python component may raise anything
            reason = f"{type(error).__name__}: {error}"
            component = served.component
            if method == "do_step" and component is not None:
                answer = "failed", (component.path, arguments[0], reason)
            else:
                answer = "refused", reason
        pickle.dump((*answer, served.messages()), answers)
        answers.flush()
    served.free()


def _end_with_parent(pipe: int) -> None:
    """End this process soon after the parent, also if the component's call never returns."""
    if not hasattr(select, "poll"):
        return

    def wait() -> None:
        gone = select.poll()
        gone.register(pipe, 0)  # reports only that the other end is closed
        gone.poll()
        time.sleep(_GRACE)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


if __name__ == "__main__":
    main()
