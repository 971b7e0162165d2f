"""The child of `Isolated`: makes one component and answers calls until its input ends."""

from __future__ import annotations

import itertools
import os
import pickle
from collections.abc import Callable
from typing import Any

from uuvsim_cosim.errors import ComponentFailed, UuvsimError
from uuvsim_cosim.fmus.component import Component

__all__ = ["main"]


class Served:
    """The component in the child, and the states that the parent holds by number."""

    def __init__(self) -> None:
        self.component: Component | None = None
        self._states: dict[int, Any] = {}
        self._numbers = itertools.count()
        self._told = 0

    def call(self, method: str, arguments: tuple[Any, ...], dropped: list[int]) -> Any:
        """Answer one call of the parent."""
        for number in dropped:
            self._states.pop(number, None)
        if method == "instantiate":
            factory: Callable[..., Component]
            factory, given = arguments
            self.component = factory(*given)
            return None
        if method in ("set_fmu_state", "serialize_fmu_state"):
            return getattr(self.component, method)(self._states[arguments[0]])
        result = getattr(self.component, method)(*self._resolved(method, arguments))
        if method in ("get_fmu_state", "deserialize_fmu_state"):
            number = next(self._numbers)
            self._states[number] = result
            return number
        return result

    def _resolved(self, method: str, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        """Put variables where the parent sent their names, which are quicker to send."""
        if self.component is None or method not in ("get", "set", "directional_derivative"):
            return arguments
        variables = self.component.description.variables
        if method == "directional_derivative":
            groups = tuple([variables[n] for n in names] for names in arguments[:2])
            return (*groups, *arguments[2:])
        return (variables[arguments[0]], *arguments[1:])

    def messages(self) -> list[tuple[str, str]]:
        """Give the messages that have come since the last call."""
        kept: list[tuple[str, str]] = getattr(self.component, "messages", [])
        fresh = kept[self._told :]
        self._told = len(kept)
        return list(fresh)

    def free(self) -> None:
        """Free the component."""
        self._states.clear()
        if self.component is not None:
            self.component.free()


def main() -> None:
    """Serve the parent; what the component prints goes to standard error."""
    import logging

    logging.getLogger("uuvsim_cosim").addHandler(logging.NullHandler())
    calls = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    served = Served()
    while True:
        try:
            method, arguments, dropped = pickle.load(calls)
        except EOFError:
            break
        answer: tuple[str, Any]
        try:
            answer = "ok", served.call(method, arguments, dropped)
        except ComponentFailed as error:
            answer = "failed", (error.path, error.time, error.reason)
        except UuvsimError as error:
            answer = "refused", str(error)
        except Exception as error:  # a Python component may raise anything
            words = f"{type(error).__name__}: {error}"
            component = served.component
            if method == "do_step" and component is not None:
                answer = "failed", (component.path, arguments[0], words)
            else:
                answer = "refused", words
        pickle.dump((*answer, served.messages()), answers)
        answers.flush()
    served.free()


if __name__ == "__main__":
    main()
