"""Who takes part, and lockstep: several clients' steps are made as one."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, final, get_args

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.barrier import Barrier, FailSafe, Holder, Request
from uuvsim_cosim.bridge.server.call_queue import Answer
from uuvsim_cosim.bridge.server.current_master import CurrentMaster
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Lockstep"]

_DROPPED = 64  # clients whose dropping is remembered, to tell them


@final
class Lockstep:
    """The clients that have joined, and the barrier that some of them hold."""

    def __init__(self, current: CurrentMaster, fail_safe: FailSafe) -> None:
        if fail_safe not in get_args(FailSafe):
            known = ", ".join(get_args(FailSafe))
            raise InputInvalid(f"fail-safe {fail_safe!r}; expected one of {known}")
        self._current, self._fail_safe = current, fail_safe
        self.barrier = Barrier()
        self._clients: dict[str, Client] = {}
        self._dropped: dict[str, str] = {}

    def describe(self) -> dict[str, Any]:
        """Return the clients, and who of them holds the barrier."""
        return {
            "clients": [
                {"name": c.name, "door": c.transport, "lockstep": c.name in self.barrier.holders}
                for c in self._clients.values()
            ],
            "mode": "lockstep" if self.barrier.holders else "free",
            "fail_safe": self._fail_safe,
        }

    # ---- who takes part -------------------------------------------------------------------

    def join(self, client: Client, lockstep: bool, lag: float) -> Client:
        """Enter a client under a name that is free."""
        if lockstep and not (isfinite(lag) and lag > 0.0):
            raise InputInvalid(f"join: lag {lag:g} s; expected more than 0")
        if lockstep and "step" not in client.allowed:
            raise InputInvalid(
                f"join: client {client.name!r} may not step; expected a role that may, for lockstep"
            )
        if lockstep and self._current.running is not None:
            raise InputInvalid("join: the co-simulation runs; expected pause before lockstep")
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
        """Let a client go; the barrier no longer waits for it."""
        self._clients.pop(client.name, None)
        self._release(client.name, why)
        self.make()

    def lost(self, client: Client) -> None:
        """Let a client go that is gone without leaving; the others may be told to pause."""
        held = self.barrier.holders.get(client.name)
        if held is not None and self._fail_safe == "pause":
            self._tell(f"lockstep: client {client.name!r} is gone, and the co-simulation pauses")
        self.leave(client, "is gone")

    def dismiss(self, name: str, by: Client) -> None:
        """Take the barrier from a client; it is told at its next step."""
        if name not in self.barrier.holders:
            known = [n for n in self.barrier.holders if n != by.name]
            raise InputInvalid(
                f"dismiss: no client {name!r} holds time in lockstep; expected "
                f"{expected_names(name, known)}"
            )
        self._drop(name, f"was dismissed from lockstep by {by.name!r}")
        self.make()

    # ---- stepping together ----------------------------------------------------------------

    def holds(self, client: Client) -> bool:
        """Return whether a client holds the barrier."""
        return client.name in self.barrier.holders

    def check_free(self, client: Client, call: str) -> None:
        """Refuse a client outside the barrier to move time that others hold."""
        if client.name in self._dropped:
            raise InputInvalid(f"{call}: {self._dropped[client.name]}; expected to join again")
        others = [name for name in self.barrier.holders if name != client.name]
        if others:
            raise InputInvalid(
                f"{call}: time is held in lockstep by {', '.join(others)}; expected to join with "
                "lockstep, or that they leave"
            )

    def ask(
        self,
        client: Client,
        n: int,
        inputs: Mapping[str, Any],
        outputs: Sequence[str],
        answer: Answer,
    ) -> None:
        """Take a holder's request for n steps, and step if it was the last that was missing."""
        for name in outputs:
            self._current.names.find(name)
        if self.barrier.holders[client.name].request is not None:
            raise InputInvalid(
                f"step: client {client.name!r} waits for a step already; expected one at a time"
            )
        for other, request in self.barrier.asked():
            if both := request.names & set(inputs):
                raise InputInvalid(
                    f"step: {', '.join(sorted(both))}: is set in this step by {other!r} already; "
                    "expected one client for each input"
                )
        fitted = self._current.names.fit(inputs)
        request = Request(n, fitted, frozenset(inputs), tuple(outputs), answer)
        self.barrier.ask(client.name, request, time.monotonic())
        self.make()

    def make(self) -> None:
        """Make the steps that all have asked for."""
        while self.barrier.is_ready:
            asked = self.barrier.asked()
            n = min(request.n for _, request in asked)
            try:
                for _, request in asked:
                    self._current.names.set(request.inputs)
                    request.inputs = ()
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
        """The time until somebody is late [s]; None if nobody is waited for."""
        deadline = self.barrier.deadline()
        return None if deadline is None else max(0.0, deadline - time.monotonic())

    def advance(self) -> None:
        """Do about those who are late what the fail-safe says."""
        late = self.barrier.late(time.monotonic())
        if not late:
            return
        if self._fail_safe == "pause":
            names = ", ".join(repr(h.client.name) for h in late)
            lag = max(h.lag for h in late)
            self._tell(
                f"lockstep: {names} did not ask for a step within {lag:g} s, and the "
                "co-simulation pauses; expected its step, or that it leaves"
            )
            return
        for holder in late:
            self._let_fall(holder)
        self.make()

    def end(self, why: str) -> None:
        """Answer all who wait that nothing will come."""
        self._tell(why)

    # ---- inside ---------------------------------------------------------------------------

    def _let_fall(self, holder: Holder) -> None:
        if self._fail_safe == "go-on":
            holder.behind = True
            return
        lag = holder.lag
        self._drop(
            holder.client.name,
            f"was dropped from lockstep, for it did not ask for a step within {lag:g} s",
        )

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

    def _tell(self, why: str) -> None:
        self._stop(InputInvalid(why))

    def _stop(self, error: UuvsimError) -> None:
        for request in self.barrier.clear():
            request.answer.set_exception(error)
