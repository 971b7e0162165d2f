"""Sessions over HTTP: a client that joins gets a token, and may hold the lockstep barrier."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import monotonic
from typing import final

from uuvsim_cosim.bridge.calls.call_table import checked
from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.bridge.tcp.requests import Calls
from uuvsim_cosim.errors import InputInvalid

__all__ = ["HEADER", "Sessions"]

HEADER = "Uuvsim-Session"
SESSIONS = 32
IDLE = 60.0  # [s] without a request after which a session is lost; its lag budget if that is longer


@dataclass
class _Session:
    calls: Calls
    idle: float
    last_request: float
    pending: int = 0  # requests that are being answered


@final
class Sessions:
    """The sessions of one server. HTTP does not show that a client is gone: a timeout decides."""

    def __init__(
        self,
        service: Service,
        answer_bytes: int | None = None,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._service, self._clock, self._most = service, clock, answer_bytes
        self._lock = threading.Lock()
        self._open: dict[str, _Session] = {}

    def join(self, asking: Client, request: Mapping[str, object]) -> dict[str, object]:
        """Add a client; return its token and the name that it got."""
        self.forget_silent()
        wanted = checked("join", request)
        name = wanted.get("name", asking.name)
        lockstep, lag = wanted.get("lockstep", False), wanted.get("lag", 5.0)
        with self._lock:
            if len(self._open) >= SESSIONS:
                raise InputInvalid(f"join: {SESSIONS} sessions are open, the maximum")
        joining = Client(name, "http", asking.allowed, self._most)
        client = self._service.join(joining, lockstep=lockstep, lag=lag)
        token = secrets.token_urlsafe(16)
        calls = Calls(self._service, client)
        with self._lock:
            self._open[token] = _Session(calls, max(IDLE, lag), self._clock())
        return {"session": token, "name": client.name, "lockstep": lockstep, "lag": lag}

    def calls(self, token: str, allowed: frozenset[str]) -> Calls:
        """Return the calls of a session; raises InputInvalid if it is unknown or another user's."""
        self.forget_silent()
        with self._lock:
            session = self._open.get(token)
            if session is not None:
                session.last_request = self._clock()
        if session is None or session.calls.client.allowed != allowed:
            raise InputInvalid(
                f"session {token[:40]!r} is unknown or has ended",
                "the session that POST /join returned to the same user",
            )
        return session.calls

    def note_request(self, token: str | None, *, begins: bool) -> None:
        """Note that the answer to a request of a session begins or ends: it is not silent."""
        with self._lock:
            session = self._open.get(token or "")
            if session is not None:
                session.pending += 1 if begins else -1
                session.last_request = self._clock()

    def leave(self, token: str) -> None:
        """End a session."""
        with self._lock:
            session = self._open.pop(token, None)
        if session is not None:
            self._service.leave(session.calls.client)

    def forget_silent(self) -> None:
        """End sessions that have been silent for too long: in lockstep the fail-safe decides."""
        now = self._clock()
        with self._lock:
            silent = [
                t for t, s in self._open.items() if not s.pending and now - s.last_request > s.idle
            ]  # fmt: skip
            gone = [self._open.pop(token) for token in silent]
        for session in gone:
            self._service.lost(session.calls.client)

    def close(self) -> None:
        """End all sessions."""
        with self._lock:
            tokens = list(self._open)
        for token in tokens:
            self.leave(token)
