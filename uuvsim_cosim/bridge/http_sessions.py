"""Sessions over HTTP: who joins is known by a token, and may hold the lockstep barrier."""

from __future__ import annotations

import math
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import monotonic
from typing import Any, final

from uuvsim_cosim.bridge.desk import Client, Desk
from uuvsim_cosim.bridge.wire_calls import Calls
from uuvsim_cosim.errors import InputInvalid

__all__ = ["HEADER", "Sessions"]

HEADER = "Uuvsim-Session"
SESSIONS = 32
IDLE = 60.0  # [s] without a request, or the lag budget if that is longer: then it is lost
_FIELDS = ("name", "lockstep", "lag")


@dataclass
class _Session:
    calls: Calls
    idle: float
    heard: float
    waits: int = 0  # requests that are being answered


@final
class Sessions:
    """The sessions of one door; HTTP says nothing of who is gone, so silence decides."""

    def __init__(self, desk: Desk, clock: Callable[[], float] = monotonic) -> None:
        self._desk, self._clock = desk, clock
        self._lock = threading.Lock()
        self._open: dict[str, _Session] = {}

    def join(self, asking: Client, said: Mapping[str, Any]) -> dict[str, Any]:
        """Enter a client; gives its token and the name that it got."""
        self.forget_silent()
        for field in said:
            if field not in _FIELDS:
                raise InputInvalid(f"join: field {field!r}; expected some of {', '.join(_FIELDS)}")
        name, lockstep, lag = (
            said.get("name", asking.name), said.get("lockstep", False), said.get("lag", 5.0),
        )  # fmt: skip
        if not isinstance(name, str) or not 0 < len(name) <= 64:
            raise InputInvalid(f"join: name {name!r}; expected a text of 1 to 64 letters")
        if not isinstance(lockstep, bool):
            raise InputInvalid(f"join: lockstep {lockstep!r}; expected true or false")
        if (
            isinstance(lag, bool)
            or not isinstance(lag, int | float)
            or not math.isfinite(lag)
            or not 0 < lag <= 3600
        ):
            raise InputInvalid(f"join: lag {lag!r}; expected seconds, above 0, at most 3600")
        with self._lock:
            if len(self._open) >= SESSIONS:
                raise InputInvalid(f"join: {SESSIONS} sessions are open, which is all that may be")
        wanted = Client(name, "http", asking.allowed)
        client = self._desk.join(wanted, lockstep=lockstep, lag=float(lag))
        token = secrets.token_urlsafe(16)
        calls = Calls(self._desk, client)
        with self._lock:
            self._open[token] = _Session(calls, max(IDLE, float(lag)), self._clock())
        return {"session": token, "name": client.name, "lockstep": lockstep, "lag": float(lag)}

    def calls(self, token: str, allowed: frozenset[str]) -> Calls:
        """Give the calls of a session; raises InputInvalid for one that is not, or is another's."""
        self.forget_silent()
        with self._lock:
            session = self._open.get(token)
            if session is not None:
                session.heard = self._clock()
        if session is None or session.calls.client.allowed != allowed:
            raise InputInvalid(
                f"session {token[:40]!r} is not known here, or has ended; expected what POST /join "
                "gave, from the same user"
            )
        return session.calls

    def waiting(self, token: str | None, *, begins: bool) -> None:
        """Note that a request of a session begins to be answered, or ends: it is not silent."""
        with self._lock:
            session = self._open.get(token or "")
            if session is not None:
                session.waits += 1 if begins else -1
                session.heard = self._clock()

    def leave(self, token: str) -> None:
        """Let a client go."""
        with self._lock:
            session = self._open.pop(token, None)
        if session is not None:
            self._desk.leave(session.calls.client)

    def forget_silent(self) -> None:
        """Let those go who have been silent for too long: in lockstep the fail-safe decides."""
        now = self._clock()
        with self._lock:
            silent = [
                t for t, s in self._open.items() if not s.waits and now - s.heard > s.idle
            ]  # fmt: skip
            gone = [self._open.pop(token) for token in silent]
        for session in gone:
            getattr(self._desk, "lost", self._desk.leave)(session.calls.client)

    def close(self) -> None:
        """Let all go."""
        with self._lock:
            tokens = list(self._open)
        for token in tokens:
            self.leave(token)
