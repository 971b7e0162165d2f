"""The clients of a co-simulation, and lockstep: the steps of several clients are made as one."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Literal, final, get_args

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.call_queue import Answer
from uuvsim_cosim.bridge.server.current_master import CurrentMaster
from uuvsim_cosim.bridge.server.signal_names import Fitted
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Barrier", "FailSafe", "Holder", "Lockstep", "Request"]

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
        self.holders: dict[str, Holder] = {}  # by the name of their client
        self._since: float | None = None  # time of the first request of this round

    def hold(self, client: Client, lag: float) -> None:
        """Add a client to the holders."""
        self.holders[client.name] = Holder(client, lag)

    def release(self, name: str) -> Holder | None:
        """Remove a holder; return it, with its request."""
        holder = self.holders.pop(name, None)
        if not any(h.request for h in self.holders.values()):
            self._since = None
        return holder

    def ask(self, name: str, request: Request, now: float) -> None:
        """Add the request of a holder."""
        holder = self.holders[name]
        holder.request, holder.behind = request, False
        if self._since is None:
            self._since = now

    @property
    def is_ready(self) -> bool:
        """Whether there is a request of every holder that is not behind, and of at least one."""
        expected = [h for h in self.holders.values() if not h.behind]
        return bool(expected) and all(h.request is not None for h in expected)

    def asked(self) -> list[tuple[str, Request]]:
        """List the requests of this round, in the order of the clients' names.

        The result therefore does not depend on the order in which the requests arrived.
        """
        return [(n, h.request) for n, h in sorted(self.holders.items()) if h.request is not None]

    def made(self, n: int, now: float) -> list[tuple[str, Request]]:
        """Count n steps as made; return the requests that are complete."""
        done = []
        for name, request in self.asked():
            request.n -= n
            if request.n <= 0:
                done.append((name, request))
                self.holders[name].request = None
        self._since = now if self.asked() else None
        return done

    def clear(self) -> list[Request]:
        """Remove all requests; return them, to be answered."""
        waiting = [request for _, request in self.asked()]
        for holder in self.holders.values():
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
        return [h for h in self.holders.values() if h.request is None and not h.behind]


_DROPPED = 64  # dropped clients whose reason is kept, for the error of their next step


@final
class Lockstep:
    """The clients that have joined, and the barrier that some of them hold.

    All methods run in the conductor's thread.
    """

    def __init__(self, current: CurrentMaster, fail_safe: FailSafe) -> None:
        if fail_safe not in get_args(FailSafe):
            known = ", ".join(get_args(FailSafe))
            raise InputInvalid(f"fail-safe {fail_safe!r}", f"one of {known}")
        self._current, self._fail_safe = current, fail_safe
        self.barrier = Barrier()
        self._clients: dict[str, Client] = {}
        self._dropped: dict[str, str] = {}

    def describe(self) -> dict[str, object]:
        """Return the clients, and which of them hold the barrier."""
        return {
            "clients": [
                {"name": c.name, "door": c.transport, "lockstep": c.name in self.barrier.holders}
                for c in self._clients.values()
            ],
            "mode": "lockstep" if self.barrier.holders else "free",
            "fail_safe": self._fail_safe,
        }

    # ---- clients --------------------------------------------------------------------------

    def join(self, client: Client, lockstep: bool, lag: float) -> Client:
        """Add a client, under an unused name."""
        if lockstep and not (isfinite(lag) and lag > 0.0):
            raise InputInvalid("join", f"lag {lag:g} s", "more than 0")
        if lockstep and "step" not in client.allowed:
            raise InputInvalid(
                "join", f"client {client.name!r} may not step", "a role that may, for lockstep"
            )
        if lockstep and self._current.running is not None:
            raise InputInvalid("join", "the co-simulation runs", "pause before lockstep")
        name, number = client.name, 1
        while name in self._clients:
            number += 1
            name = f"{client.name}-{number}"
        client = replace(client, name=name)
        self._clients[name] = client
        self._dropped.pop(name, None)
        if lockstep:
            self.barrier.hold(client, lag)
        return client

    def leave(self, client: Client, why: str = "has left") -> None:
        """Remove a client; the barrier no longer waits for it."""
        self._clients.pop(client.name, None)
        self._release(client.name, why)
        self.make()

    def lost(self, client: Client) -> None:
        """Remove a client that has disconnected; with the fail-safe `pause`, the others stop."""
        if client.name in self.barrier.holders and self._fail_safe == "pause":
            self.end(
                f"lockstep: client {client.name!r} has disconnected, and the co-simulation is "
                "paused"
            )
        self.leave(client, "has disconnected")

    def dismiss(self, name: str, by: Client) -> None:
        """Remove a client from the barrier; its next step raises an error."""
        if name not in self.barrier.holders:
            known = [n for n in self.barrier.holders if n != by.name]
            raise InputInvalid(
                "dismiss", f"no client {name!r} holds time in lockstep", expected_names(name, known)
            )
        self._drop(name, f"was removed from lockstep by {by.name!r}")
        self.make()

    # ---- stepping together ----------------------------------------------------------------

    def holds(self, client: Client) -> bool:
        """Return whether a client holds the barrier."""
        return client.name in self.barrier.holders

    def check_free(self, client: Client, call: str) -> None:
        """Refuse a call that moves time from a client outside the barrier that others hold."""
        if client.name in self._dropped:
            raise InputInvalid(call, self._dropped[client.name], "to join again")
        others = [name for name in self.barrier.holders if name != client.name]
        if others:
            raise InputInvalid(
                call,
                f"time is held in lockstep by {', '.join(others)}",
                "to join with lockstep, or that they leave",
            )

    def ask(
        self,
        client: Client,
        n: int,
        inputs: Mapping[str, object],
        outputs: Sequence[str],
        answer: Answer,
    ) -> None:
        """Add a holder's request for n steps, and step if it was the last one missing."""
        for name in outputs:
            self._current.names.find(name)
        if self.barrier.holders[client.name].request is not None:
            raise InputInvalid(
                "step", f"client {client.name!r} waits for a step already", "one at a time"
            )
        for other, request in self.barrier.asked():
            if both := request.names & set(inputs):
                raise InputInvalid(
                    "step",
                    f"{', '.join(sorted(both))}: is set in this step by {other!r} already",
                    "one client for each input",
                )
        fitted = self._current.names.fit(inputs)
        request = Request(n, fitted, frozenset(inputs), tuple(outputs), answer)
        self.barrier.ask(client.name, request, time.monotonic())
        self.make()

    def make(self) -> None:
        """Make steps as long as all holders request them."""
        while self.barrier.is_ready:
            asked = self.barrier.asked()
            n = min(request.n for _, request in asked)
            try:
                for _, request in asked:
                    self._current.set(request.inputs)
                    request.inputs = ()  # they hold in all steps of the request
                self._current.step(n)
            except UuvsimError as error:
                self._stop(error)
                return
            for _, done in self.barrier.made(n, time.monotonic()):
                try:
                    values = self._current.names.get(done.outputs)
                    done.answer.set_result((self._current.moment(), values))
                except UuvsimError as error:
                    done.answer.set_exception(error)

    @property
    def wait(self) -> float | None:
        """The time until a holder is late [s]; None if no request waits."""
        deadline = self.barrier.deadline()
        return None if deadline is None else max(0.0, deadline - time.monotonic())

    def advance(self) -> None:
        """Apply the fail-safe to the holders that are late."""
        late = self.barrier.late(time.monotonic())
        if not late:
            return
        if self._fail_safe == "pause":
            names = ", ".join(repr(h.client.name) for h in late)
            lag = max(h.lag for h in late)
            self.end(
                f"lockstep: {names} did not request a step within {lag:g} s, and the "
                "co-simulation is paused; expected its step, or that it leaves"
            )
            return
        for holder in late:
            if self._fail_safe == "go-on":
                holder.behind = True
                continue
            self._drop(
                holder.client.name,
                "was removed from lockstep, because it did not request a step within "
                f"{holder.lag:g} s",
            )
        self.make()

    def end(self, why: str) -> None:
        """End all requests that wait by an error."""
        self._stop(InputInvalid(why))

    # ---- inside ---------------------------------------------------------------------------

    def _drop(self, name: str, why: str) -> None:
        self._release(name, why)
        self._dropped[name] = f"client {name!r} {why}"
        while len(self._dropped) > _DROPPED:
            del self._dropped[next(iter(self._dropped))]

    def _release(self, name: str, why: str) -> None:
        holder = self.barrier.release(name)
        if holder is not None and holder.request is not None:
            error = InputInvalid(f"step: client {name!r} {why} before its step was made")
            holder.request.answer.set_exception(error)

    def _stop(self, error: UuvsimError) -> None:
        for request in self.barrier.clear():
            request.answer.set_exception(error)
