"""The queries of a client, on a session that is renewed so that its memory stays bounded.

A call may take hours, so its query must not time out. However, Zenoh keeps about 1 kB of each query
until the query's timeout, even if it was answered long ago (eclipse-zenoh 1.10). Closing the
session frees this memory. After some thousand calls, another session therefore takes over, which
takes a few milliseconds.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, final

from uuvsim_cosim.bridge.zenoh.session import Disconnected, WrappedSession

if TYPE_CHECKING:
    import zenoh

__all__ = ["CALLS_OF_A_SESSION", "QuerySender"]

CALLS_OF_A_SESSION = 4096  # about 4 MB


@dataclass(eq=False)
class _QuerySession:
    """A session, the number of its calls so far, and of those that run now."""

    session: WrappedSession
    queriers: dict[str, zenoh.Querier] = field(default_factory=dict)
    made: int = 0
    running: int = 0
    closes: bool = True  # false for the first session, which its owner closes

    def end(self) -> None:
        """Close the session; queriers that are not undeclared first would keep it in memory."""
        for querier in self.queriers.values():
            with contextlib.suppress(Exception):  # the other end may be gone already
                querier.undeclare()
        self.session.close()


@final
class QuerySender:
    """Sender of queries, from any thread; `opened` opens another session to the same server."""

    def __init__(self, session: WrappedSession, opened: Callable[[], WrappedSession]) -> None:
        self._opened = opened
        self._lock = threading.Lock()
        self._line = _QuerySession(session, closes=False)
        self._closed = False

    def ask(self, key: str, message: str, block: bytes) -> zenoh.Reply | None:
        """Return the reply to a query, or None if the other end is gone.

        Raises Disconnected or InputInvalid if the session cannot be renewed.
        """
        import zenoh

        with self._lock:
            if self._line.made >= CALLS_OF_A_SESSION and not self._closed:
                old, self._line = self._line, _QuerySession(self._opened())
                if old.closes and not old.running:
                    old.end()
            line = self._line
            line.made += 1
            line.running += 1
        try:
            with line.session.inside():
                querier = line.queriers.get(key)
                if querier is None:
                    querier = line.queriers[key] = line.session.asker(key)
                replies = querier.get(
                    payload=message, attachment=block or None, encoding="application/json"
                )
                return next(iter(replies), None)
        except (zenoh.ZError, Disconnected):
            return None
        finally:
            with self._lock:
                line.running -= 1
                over = line is not self._line and line.closes and not line.running
            if over:  # the last call of a session that another one has replaced
                line.end()

    def close(self) -> None:
        """Close the current session, unless it is the first one."""
        with self._lock:
            self._closed = True
            line = self._line
        if line.closes:
            line.end()
