"""Sharing of the server's processor time: a rate limit for calls, and a share for reading calls.

A server is one process: while it answers a reading call, it cannot step. While other clients step,
reading calls are therefore delayed, so that all of them together get a fixed share of the time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import final

from uuvsim_cosim.bridge.calls.call_table import CALLS
from uuvsim_cosim.bridge.calls.service import Client, Service

__all__ = ["READS", "RateLimit", "Share", "share_of"]

READS = frozenset(name for name, call in CALLS.items() if call.needs == "read") | {
    "describe",
    "schema",
}
_SHARE = 0.04  # of the time; measured by benchmarks/readers.py
_WAKES = 0.0005  # [s] that waking another thread costs the stepping, beside its own work
_RECENT = 0.5  # [s] after its last step for which a client counts as stepping
_OWN = 1.0  # [s] after its last step for which a client's own reading calls do not wait
_FIRST = 0.0005  # [s] first estimate of the duration of a reading call
_LONGEST = 1.0  # [s] that a reading call waits at most
_LEAST, _LOOK = 0.0005, 0.05  # [s] shortest and longest sleep of a call that waits for its turn


@final
class RateLimit:
    """A limit of calls per second for one connection; calls beyond it wait (a token bucket)."""

    def __init__(
        self,
        rate: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._rate, self._clock, self._sleep = rate, clock, sleep
        self._tokens, self._last = rate, clock()

    def wait(self) -> None:
        """Count a call, and sleep until it may be answered."""
        now = self._clock()
        self._tokens = min(self._tokens + (now - self._last) * self._rate, self._rate) - 1
        self._last = now
        if self._tokens < 0:
            self._sleep(-self._tokens / self._rate)


@final
class Share:
    """The share of the server's processor time that reading calls get while other clients step.

    A reading call gets a turn: the next instant of processor time at which the share allows one.
    Turns are given in the order of the requests, for all clients together. `hurries` returns
    whether a run steps without waiting for the clock. `busy` is the processor time [s] of the
    process: on a loaded machine it advances slower than the clock, and so do the turns.
    """

    def __init__(
        self,
        hurries: Callable[[], bool],
        clock: Callable[[], float] = time.monotonic,
        busy: Callable[[], float] = time.process_time,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._hurries, self._clock, self._busy, self._sleep = hurries, clock, busy, sleep
        self._lock = threading.Lock()
        # By id, with the client itself: as long as it is referenced, its id is not used again.
        self._steppers: dict[int, tuple[Client, float]] = {}
        self._next = 0.0
        self._takes = _FIRST

    def steps(self, client: Client) -> None:
        """Note that a client requests a step."""
        self._steppers[id(client)] = (client, self._clock())

    def turn(self, client: Client) -> float | None:
        """Return the turn of a reading call; None if it does not have to wait."""
        now = self._busy()
        with self._lock:
            if not self._must_wait(client):
                return None
            begins = max(now, self._next)
            self._next = begins + self._takes / _SHARE
        return begins

    def wait(self, client: Client, turn: float | None) -> None:
        """Sleep until the turn; at most `_LONGEST`, and only while other clients step."""
        end = self._clock() + _LONGEST
        while turn is not None and (remaining := turn - self._busy()) > 0.0:
            if self._clock() >= end or not self._must_wait(client):
                return
            self._sleep(min(max(remaining, _LEAST), _LOOK))

    def took(self, client: Client, seconds: float) -> None:
        """Note the processor time [s] of a reading call in the thread that sends its answer."""
        seconds += _WAKES
        with self._lock:
            if self._must_wait(client):
                self._next += (seconds - self._takes) / _SHARE
                self._takes += 0.1 * (seconds - self._takes)

    def also_took(self, client: Client, seconds: float) -> None:
        """Note the processor time [s] of the same call in another thread."""
        with self._lock:
            if self._must_wait(client):
                self._next += seconds / _SHARE

    def _must_wait(self, client: Client) -> bool:
        now, others = self._clock(), False
        for key, (stepper, then) in list(self._steppers.items()):
            if now - then > _OWN:
                self._steppers.pop(key, None)
            elif stepper is client:
                return False
            elif now - then <= _RECENT:
                others = True
        return others or self._hurries()


def share_of(service: Service) -> Share:
    """Return the share that all endpoints of a service use; without one, a share that never waits.

    A `Conductor` has one; other services need not.
    """
    share = getattr(service, "share", None)
    return share if isinstance(share, Share) else Share(lambda: False)
