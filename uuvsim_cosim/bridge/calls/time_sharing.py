"""How clients share the server's time: calls at a limited rate, and reading beside stepping.

A server is one process. While it answers a client that reads, it cannot step. Reading calls
therefore wait for each other as long as other clients step: together they get a fixed share.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import final

from uuvsim_cosim.bridge.calls.call_table import CALLS
from uuvsim_cosim.bridge.calls.service import Client, Service

__all__ = ["READS", "Pace", "Share", "share_of"]

READS = frozenset(name for name, call in CALLS.items() if call.needs == "read") | {
    "describe",
    "schema",
}
_SHARE = 0.04  # of the time; measured by benchmarks/readers.py
_WAKES = 0.0005  # [s] that waking another thread costs the stepping, beside its own work
_RECENT = 0.5  # [s] after its last step for which a client counts as stepping
_OWN = 1.0  # [s] after its last step for which a client's own reading does not wait
_FIRST = 0.0005  # [s] that a reading call takes, until some have been measured
_LONGEST = 1.0  # [s] that a reading call waits at most
_LEAST, _LOOK = 0.0005, 0.05  # [s] between two looks whether a turn has come


@final
class Pace:
    """A limit of calls a second for one connection: those beyond it wait."""

    def __init__(
        self,
        rate: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._rate, self._clock, self._sleep = rate, clock, sleep
        self._left, self._last = rate, clock()

    def wait(self) -> None:
        """Count a call, and sleep until it may be answered."""
        now = self._clock()
        self._left = min(self._left + (now - self._last) * self._rate, self._rate) - 1
        self._last = now
        if self._left < 0:
            self._sleep(-self._left / self._rate)


@final
class Share:
    """The part of the server's processor time that reading calls get while other clients step.

    A reading call is given a turn: the next instant of processor time at which the share allows
    one. Turns follow each other in the order in which they are asked for, whoever asks. `hurries`
    returns whether a run steps without waiting for the clock. `busy` is the processor time [s] of
    the process: on a loaded machine it advances slower than the clock, and so do the turns.
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
        self._steppers: dict[int, tuple[Client, float]] = {}  # kept, so that an id stays its own
        self._next = 0.0
        self._takes = _FIRST

    def steps(self, client: Client) -> None:
        """Note that a client asks for a step."""
        self._steppers[id(client)] = (client, self._clock())

    def turn(self, client: Client) -> float | None:
        """Return the turn of a reading call; None if it need not wait."""
        now = self._busy()
        with self._lock:
            if not self._must_wait(client):
                return None
            begins = max(now, self._next)
            self._next = begins + self._takes / _SHARE
        return begins

    def wait(self, client: Client, turn: float | None) -> None:
        """Sleep until a turn has come, nobody else steps any more, or too long has passed."""
        end = self._clock() + _LONGEST
        while turn is not None and (left := turn - self._busy()) > 0.0:
            if self._clock() >= end or not self._must_wait(client):
                return
            self._sleep(min(max(left, _LEAST), _LOOK))

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
    """Return the share of a service, which all its endpoints use; one that never waits without."""
    share = getattr(service, "share", None)
    return share if isinstance(share, Share) else Share(lambda: False)
