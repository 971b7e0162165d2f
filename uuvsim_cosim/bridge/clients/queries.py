"""The questions of a client, on a session that is renewed so that its memory stays bounded.

A call may take hours, so its query must not time out; but Zenoh keeps about 1 kB of each query
until the query's timeout, also when it has long been answered (eclipse-zenoh 1.10). Closing the
session frees all of it, so after some thousand calls another session takes over, in a few
milliseconds.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, final

from uuvsim_cosim.bridge.zenoh.session import Disconnected, WrappedSession

__all__ = ["CALLS_OF_A_SESSION", "Asking"]

CALLS_OF_A_SESSION = 4096  # about 4 MB


@dataclass(eq=False)
class _Line:
    """A session, and how many calls it has carried and carries now."""

    session: WrappedSession
    askers: dict[str, Any] = field(default_factory=dict)
    made: int = 0
    under_way: int = 0
    closes: bool = True  # not the session that was given, which its owner closes

    def end(self) -> None:
        """Close the session; queriers that are not undeclared before would keep it in memory."""
        for asker in self.askers.values():
            with contextlib.suppress(Exception):  # the other end may be gone already
                asker.undeclare()
        self.session.close()


@final
class Asking:
    """Asks queries from any thread; `opened` opens another session to the same server."""

    def __init__(self, session: WrappedSession, opened: Callable[[], WrappedSession]) -> None:
        self._opened = opened
        self._lock = threading.Lock()
        self._line = _Line(session, closes=False)
        self._closed = False

    def ask(self, key: str, message: str, block: bytes) -> Any:
        """Return the reply to a query, or None if the other end is gone.

        Raises Disconnected or InputInvalid if the session cannot be renewed.
        """
        import zenoh

        line = self._taken()
        try:
            with line.session.inside():
                asker = line.askers.get(key)
                if asker is None:
                    asker = line.askers[key] = line.session.asker(key)
                replies = asker.get(
                    payload=message, attachment=block or None, encoding="application/json"
                )
                return next(iter(replies), None)
        except (zenoh.ZError, Disconnected):
            return None
        finally:
            self._done(line)

    def close(self) -> None:
        """Close the session that has taken over, if one has."""
        with self._lock:
            self._closed = True
            line = self._line
        if line.closes:
            line.end()

    def _taken(self) -> _Line:
        with self._lock:
            if self._line.made >= CALLS_OF_A_SESSION and not self._closed:
                old, self._line = self._line, _Line(self._opened())
                if old.closes and not old.under_way:
                    old.end()
            self._line.made += 1
            self._line.under_way += 1
            return self._line

    def _done(self, line: _Line) -> None:
        with self._lock:
            line.under_way -= 1
            over = line is not self._line and line.closes and not line.under_way
        if over:
            line.end()
