"""Who asks at the Zenoh door: a client that has joined proves it, and its answers wait for itself.

Zenoh does not say who asks, so a client that joins is given a proof which it sends with each call.
Answers leave by a thread for each client: one that does not take its own holds nobody up.
"""

from __future__ import annotations

import contextlib
import hmac
import queue
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, final

from uuvsim_cosim.bridge.access_doorkeeper import Doorkeeper, everybody
from uuvsim_cosim.bridge.access_zenoh import READER, reader_password
from uuvsim_cosim.bridge.desk import Client
from uuvsim_cosim.errors import InputInvalid

__all__ = ["MOST_BYTES", "Gate", "Lane"]

MOST_BYTES = {"message": 1 << 20, "block of numbers": 8 << 20}  # as the TCP door reads
_CLIENTS = 64
_WAITING = 64  # calls of one client that wait for their answer
_REFUSALS = 64  # more of them are told so; those beyond are dropped


@final
class Lane:
    """The answers of one client leave one after another, in a thread of their own."""

    def __init__(self, name: str) -> None:
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._waiting = 0
        self._lock = threading.Lock()
        self._name = name
        self._thread: threading.Thread | None = None

    def take(self) -> bool | None:
        """Count a call in: True if it may be asked, False if it is to be refused, None: dropped."""
        with self._lock:
            if self._waiting >= _WAITING + _REFUSALS:
                return None
            self._waiting += 1
            return self._waiting <= _WAITING

    def put(self, work: Callable[[], None]) -> None:
        """Let a call that was counted in be answered."""
        if self._thread is None:
            with self._lock:
                if self._thread is None:
                    self._thread = threading.Thread(
                        target=self._run, name=f"uuvsim-zenoh-{self._name}", daemon=True
                    )
                    self._thread.start()
        self._work.put(work)

    def close(self) -> None:
        """End after what waits still."""
        self._work.put(None)

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            with contextlib.suppress(Exception):  # whoever asked is gone
                work()
            with self._lock:
                self._waiting -= 1


@dataclass(frozen=True)
class _Joined:
    client: Client
    lane: Lane
    proof: str


@final
class Gate:
    """The clients that have joined, and those who have not."""

    def __init__(self, keeper: Doorkeeper | None) -> None:
        self._keeper = keeper
        self._admit = keeper or everybody
        self._joined: dict[str, _Joined] = {}
        self._lock = threading.Lock()
        self.guests, self._joining = Lane("guests"), Lane("joining")
        self.reader = reader_password()

    def lane(self, call: str, message: Mapping[str, Any]) -> Lane:
        """Give the lane of who asks; that who joins does what takes long as well."""
        if call in ("join", "leave"):
            return self._joining
        joined = self._joined.get(str(message.get("client", "")))
        return self.guests if joined is None or not self._proven(joined, message) else joined.lane

    def client(self, call: str, message: Mapping[str, Any]) -> Client:
        """Give who asks; raises InputInvalid if it has not joined where it must."""
        token = str(message.get("client", ""))
        with self._lock:
            joined = self._joined.get(token)
        if joined is None and token:
            raise InputInvalid(
                f"{call}: this client has not joined, or was let go; expected to join first"
            )
        if joined is None:
            return Client("zenoh", "zenoh", self._admit(None, None, self._shown))
        if not self._proven(joined, message):
            raise InputInvalid(
                f"{call}: expected the `proof` that this client was given on joining"
            )
        return joined.client

    def allowed(self, message: Mapping[str, Any], certificate: str | None) -> frozenset[str]:
        """Give what one who joins may do; raises InputInvalid in words if it may not enter."""
        token = str(message.get("client", ""))
        if not token or "/" in token or token in self._joined or len(token) > 64:
            raise InputInvalid(f"join: client {token[:64]!r}; expected an id of its own")
        if len(self._joined) >= _CLIENTS:
            raise InputInvalid(f"join: {_CLIENTS} clients have joined, which is all that may")
        user, password = message.get("user"), message.get("password")
        for what, read in (("user", user), ("password", password)):
            if read is not None and not isinstance(read, str):
                raise InputInvalid(f"join: {what} is no text; expected one")
        return self._admit(user, password, self._shown if certificate is None else certificate)

    def enter(self, message: Mapping[str, Any], client: Client) -> dict[str, Any]:
        """Enter a client that the desk has joined; gives what it is told beside its name."""
        token, proof = str(message["client"]), secrets.token_urlsafe(24)
        joined = _Joined(client, Lane(client.name), proof if self._keeper is not None else "")
        with self._lock:
            self._joined[token] = joined
        told: dict[str, Any] = {"allowed": sorted(client.allowed)}
        if self._keeper is not None:
            told["proof"] = proof
            if "read" in client.allowed:
                told["reader"] = [READER, self.reader]
        return told

    def leave(self, token: str) -> Client | None:
        """Let a client go; gives it if it had joined."""
        with self._lock:
            joined = self._joined.pop(token, None)
        if joined is None:
            return None
        joined.lane.close()
        return joined.client

    def close(self) -> None:
        """Let all go."""
        for token in list(self._joined):
            self.leave(token)
        self.guests.close()
        self._joining.close()

    @property
    def _shown(self) -> str | None:
        """Give "" where Zenoh has verified a certificate whose name it does not tell."""
        tls = None if self._keeper is None else self._keeper.access.tls
        return None if tls is None or tls.ca is None else ""

    @staticmethod
    def _proven(joined: _Joined, message: Mapping[str, Any]) -> bool:
        return hmac.compare_digest(joined.proof.encode(), str(message.get("proof", "")).encode())
