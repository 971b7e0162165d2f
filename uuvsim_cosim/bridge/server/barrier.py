"""The lockstep barrier: a step is made when all who hold it have asked for theirs.

Each holder has a lag budget [s]: for so long the others wait for it, then the fail-safe decides.
Nothing here knows threads or clocks; instants are handed in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, final

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.call_queue import Answer

__all__ = ["Barrier", "FailSafe", "Holder", "Request"]

# What is done about a client that is late or gone: it is dropped from the barrier; or all who
# wait are told and nothing moves; or steps go on without it until it asks again.
FailSafe = Literal["drop", "pause", "go-on"]


@dataclass
class Request:
    """What a holder has asked for: `n` steps are left of it."""

    n: int
    inputs: Sequence[tuple[Any, Any]]
    names: frozenset[str]  # of its inputs
    outputs: Sequence[str]
    answer: Answer


@dataclass
class Holder:
    """A client that holds the barrier; one that is `behind` is not waited for."""

    client: Client
    lag: float
    request: Request | None = None
    behind: bool = False


@final
class Barrier:
    """Who holds it, and what they have asked for."""

    def __init__(self) -> None:
        self._holders: dict[str, Holder] = {}
        self._since: float | None = None  # when the first of this round began to wait

    @property
    def holders(self) -> Mapping[str, Holder]:
        """The holders by the name of their client."""
        return self._holders

    def hold(self, client: Client, lag: float) -> None:
        """Let a client hold the barrier."""
        self._holders[client.name] = Holder(client, lag)

    def release(self, name: str) -> Holder | None:
        """Let a holder go; gives it, with what it had asked for."""
        holder = self._holders.pop(name, None)
        if not any(h.request for h in self._holders.values()):
            self._since = None
        return holder

    def ask(self, name: str, request: Request, now: float) -> None:
        """Take a holder's request."""
        holder = self._holders[name]
        holder.request, holder.behind = request, False
        if self._since is None:
            self._since = now

    @property
    def is_ready(self) -> bool:
        """Whether all who are waited for have asked, and somebody has."""
        waited = [h for h in self._holders.values() if not h.behind]
        return bool(waited) and all(h.request is not None for h in waited)

    def asked(self) -> list[tuple[str, Request]]:
        """List the requests of this round, in the order of the clients' names.

        So the result does not depend on who came first.
        """
        return [(n, h.request) for n, h in sorted(self._holders.items()) if h.request is not None]

    def made(self, n: int, now: float) -> list[tuple[str, Request]]:
        """Count n steps as made; gives those whose request is fulfilled."""
        done = []
        for name, request in self.asked():
            request.n -= n
            if request.n <= 0:
                done.append((name, request))
                self._holders[name].request = None
        self._since = now if self.asked() else None
        return done

    def clear(self) -> list[Request]:
        """Forget all requests; gives them, to be answered."""
        waiting = [request for _, request in self.asked()]
        for holder in self._holders.values():
            holder.request = None
        self._since = None
        return waiting

    def deadline(self) -> float | None:
        """Return the next instant at which a holder will be late; None if nobody is waited for."""
        if self._since is None:
            return None
        missing = [h.lag for h in self._missing()]
        return self._since + min(missing) if missing else None

    def late(self, now: float) -> list[Holder]:
        """List who has kept the others waiting for longer than its lag budget."""
        if self._since is None:
            return []
        return [h for h in self._missing() if now >= self._since + h.lag]

    def _missing(self) -> list[Holder]:
        return [h for h in self._holders.values() if h.request is None and not h.behind]
