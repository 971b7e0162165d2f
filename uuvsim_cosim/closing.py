"""Objects that must be closed: by a `with`, after an error, and when the program ends."""

from __future__ import annotations

import itertools
import os
import threading
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import TracebackType
from typing import Self

__all__ = ["Closing", "Owner", "close_at_exit", "started"]


class Closing(ABC):
    """An object that must be closed; a `with` closes it, also after an error."""

    __slots__ = ()

    @abstractmethod
    def close(self) -> None:
        """Free everything; a second call does nothing."""

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it."""
        self.close()


class Owner(Closing):
    """An object that owns others: sockets, files, sessions, threads.

    Its constructor opens them in `_opening`, and registers in the stack how each is closed. They
    are closed in the opposite order, at once if the constructor fails, also if one of them raises.
    """

    @contextmanager
    def _opening(self) -> Iterator[ExitStack]:
        """Yield the stack for the objects that the constructor opens."""
        with ExitStack() as stack:
            yield stack
            self._owned = stack.pop_all()

    def close(self) -> None:
        """Close all that it owns; a second call does nothing."""
        self._owned.close()


def started(name: str, target: Callable[..., None], *arguments: object) -> threading.Thread:
    """Start a thread of this name that does not keep the program from ending."""
    thread = threading.Thread(target=target, args=arguments, name=name, daemon=True)
    thread.start()
    return thread


_open: weakref.WeakValueDictionary[int, Closing] = weakref.WeakValueDictionary()
_numbers = itertools.count()


def close_at_exit(closing: Closing) -> None:
    """Close an object at the end of the program, if it lives then and is open still.

    An object that was registered later is closed earlier, because it may use those before it.
    """
    _open[next(_numbers)] = closing


def _close_all() -> None:
    for _, closing in sorted(_open.items(), reverse=True):
        with suppress(Exception):  # nobody could handle the error any more
            closing.close()


# `atexit` comes too late: Python first joins every thread, and one that waits for a message which
# nobody will send would keep Python from ever ending. There is no public name for this function,
# which runs before threads are joined; `concurrent.futures` uses it too.
threading._register_atexit(_close_all)  # type: ignore[attr-defined]
if hasattr(os, "register_at_fork"):  # a forked child does not own its parent's connections
    os.register_at_fork(after_in_child=_open.clear)
