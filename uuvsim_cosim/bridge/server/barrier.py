"""The lockstep barrier: a step is made when all of its holders have requested one.

Each holder has a lag budget [s]: the others wait for it at most this time, then the fail-safe
decides. The barrier uses neither threads nor clocks; times are arguments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, final

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.call_queue import Answer
from uuvsim_cosim.bridge.server.signal_names import Fitted

__all__ = ["Barrier", "FailSafe", "Holder", "Request"]

# The reaction to a client that is late or gone: it is removed from the barrier; or all requests
# end with an error, and time stops; or steps continue without it until its next request.
FailSafe = Literal["drop", "pause", "go-on"]


@dataclass
class Request:
    """The request of a holder; `n` is the number of steps that are still to be made."""

    n: int
    inputs: Sequence[Fitted]
    names: frozenset[str]  # of its inputs
    outputs: Sequence[str]
    answer: Answer


@dataclass
class Holder:
    """A client that holds the barrier; if it is `behind`, the others do not wait for it."""

    client: Client
    lag: float
    request: Request | None = None
    behind: bool = False


@final
class Barrier:
    """The holders and their requests."""

    def __init__(self) -> None:
        self._holders: dict[str, Holder] = {}
        self._since: float | None = None  # time of the first request of this round

    @property
    def holders(self) -> Mapping[str, Holder]:
        """The holders by the name of their client."""
        return self._holders

    def hold(self, client: Client, lag: float) -> None:
        """Add a client to the holders."""
        self._holders[client.name] = Holder(client, lag)

    def release(self, name: str) -> Holder | None:
        """Remove a holder; return it, with its request."""
        holder = self._holders.pop(name, None)
        if not any(h.request for h in self._holders.values()):
            self._since = None
        return holder

    def ask(self, name: str, request: Request, now: float) -> None:
        """Add the request of a holder."""
        holder = self._holders[name]
        holder.request, holder.behind = request, False
        if self._since is None:
            self._since = now

    @property
    def is_ready(self) -> bool:
        """Whether there is a request of every holder that is not behind, and of at least one."""
        expected = [h for h in self._holders.values() if not h.behind]
        return bool(expected) and all(h.request is not None for h in expected)

    def asked(self) -> list[tuple[str, Request]]:
        """List the requests of this round, in the order of the clients' names.

        The result therefore does not depend on the order in which the requests arrived.
        """
        return [(n, h.request) for n, h in sorted(self._holders.items()) if h.request is not None]

    def made(self, n: int, now: float) -> list[tuple[str, Request]]:
        """Count n steps as made; return the requests that are complete."""
        done = []
        for name, request in self.asked():
            request.n -= n
            if request.n <= 0:
                done.append((name, request))
                self._holders[name].request = None
        self._since = now if self.asked() else None
        return done

    def clear(self) -> list[Request]:
        """Remove all requests; return them, to be answered."""
        waiting = [request for _, request in self.asked()]
        for holder in self._holders.values():
            holder.request = None
        self._since = None
        return waiting

    def deadline(self) -> float | None:
        """Return the time at which the next holder will be late; None if no request waits."""
        if self._since is None:
            return None
        missing = [h.lag for h in self._missing()]
        return self._since + min(missing) if missing else None

    def late(self, now: float) -> list[Holder]:
        """List the holders that the others have waited for longer than the lag budget."""
        if self._since is None:
            return []
        return [h for h in self._missing() if now >= self._since + h.lag]

    def _missing(self) -> list[Holder]:
        return [h for h in self._holders.values() if h.request is None and not h.behind]
