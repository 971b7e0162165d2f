"""The conductor: the session of a co-simulation. One thread owns the master and makes all calls."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, final

from uuvsim_cosim.bridge.access.roles import check
from uuvsim_cosim.bridge.calls.service import Client, Moment, Schema, Service
from uuvsim_cosim.bridge.calls.time_sharing import READS, Share
from uuvsim_cosim.bridge.server.call_queue import Answer, Calls
from uuvsim_cosim.bridge.server.current_master import CurrentMaster
from uuvsim_cosim.bridge.server.lockstep import FailSafe, Lockstep
from uuvsim_cosim.bridge.server.playback import Playback
from uuvsim_cosim.closing import Closing, close_at_exit, started
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import Observer
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Conductor"]

_AT_ONCE = 1000  # steps; more are made in pieces, so that other calls are answered meanwhile


_LATER = object()  # result of a call whose answer is set later
_CALLS = 16  # calls that are carried out at most before steps that are due


@final
class Conductor(Service, Closing):
    """`Service` of one running co-simulation, or of a recording; all transports pass calls to it.

    A given master must not be initialized; from now on only the conductor may use it. `record` is a
    folder for recordings: each run from a start to the next reset, restore or replacement gets its
    own. `fail_safe` is the reaction to a client in lockstep that is late or gone (see `Barrier`).
    Without `loads_code` no client may replace a component, whatever its role.
    """

    def __init__(
        self,
        system: System | Plan | Master | Playback | str | Path,
        seed: int = 0,
        backend: Backend = "native",
        *,
        record: str | Path | None = None,
        fail_safe: FailSafe = "drop",
        loads_code: bool = True,
    ) -> None:
        if not isinstance(system, System | Plan | Master | Playback | str | Path):
            kind = type(system).__name__
            raise InputInvalid(
                f"a {kind} was given", "a system, its plan, a master, a recording or a path"
            )
        self._calls = Calls()
        self._loads_code = loads_code
        self._ended = False
        self._ending = threading.Lock()
        self._current: CurrentMaster | None = None
        self.share = Share(self._hurries)
        self._thread = started("uuvsim-conductor", self._conduct)
        folder = None if record is None else Path(record)

        def begin(answer: Answer) -> None:
            current = CurrentMaster(system, seed, backend, folder)
            self._lockstep = Lockstep(current, fail_safe)
            self._current = current  # last, as other threads use it once it is set
            current.moment()
            answer.set_result(None)

        try:
            self._calls.put(begin).result()
        except BaseException:
            self.close()
            raise
        close_at_exit(self)

    # ---- state, from any thread -----------------------------------------------------------

    def moment(self) -> Moment:
        """Return the current communication point."""
        return Moment(0, 0.0, False) if self._current is None else self._current.last

    @property
    def folders(self) -> tuple[Path, ...]:
        """The folders of the recordings so far."""
        return () if self._current is None else tuple(self._current.rows.folders)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the plan; after `close`, also those of the whole run."""
        return () if self._current is None else self._current.warnings

    @property
    def failed(self) -> UuvsimError | None:
        """The error of a failed step, after which it is paused until a reset or restore."""
        return None if self._current is None else self._current.failed

    # ---- the service -------------------------------------------------------------------------

    def schema(self) -> Schema:
        """List all variables; the same object until a component is replaced."""
        return self._on.names.schema

    def ask(self, call: str, client: Client, *arguments: object) -> Answer:
        """Put a call in the queue, without waiting for its answer."""

        def work(answer: Answer) -> None:
            check(client, call)  # first, so that no code is loaded for a client that may not
            if call == "replace" and not self._loads_code:
                raise InputInvalid(
                    "replace",
                    "this server loads no code for its clients (--no-code)",
                    (
                        "to replace the component when the server starts, by `uuvsim serve "
                        "--replace`"
                    ),
                )
            if call == "step":
                self.share.steps(client)
            begun = time.thread_time() if call in READS else 0.0
            result = self._carried_out(call, client, answer, *arguments)
            if result is not _LATER:
                answer.set_result(result)
            if begun:
                self.share.also_took(client, time.thread_time() - begun)

        return self._calls.put(work)

    def abandon(self, answer: Answer) -> None:
        """End the run of an answer that its client does not wait for any more."""

        def work(done: Answer) -> None:
            self._on.abandon(answer)
            done.set_result(None)

        with suppress(InputInvalid):  # the co-simulation has ended already
            self._calls.put(work)

    def watch(self, observer: Observer) -> None:
        """Pass the rows of every communication point to an observer, in the conductor's thread."""
        self._now(lambda: self._on.rows.add(observer))

    def unwatch(self, observer: Observer) -> None:
        """Stop passing rows to an observer."""
        self._now(lambda: self._on.rows.remove(observer))

    def close(self) -> None:
        """End the co-simulation and complete its recordings; a second call does nothing."""
        with self._ending:
            if self._ended:
                return
            self._ended = True
        answer = self._calls.close(self._end)
        self._thread.join()
        self._calls.drain()
        error = answer.exception()
        if error is not None:
            raise error

    # ---- in the conductor's thread --------------------------------------------------------

    def _conduct(self) -> None:
        """Carry out calls and make the steps that are due, until the co-simulation ends.

        During a run, calls are carried out between its steps. Without a run, and if no request
        waits in lockstep, the thread sleeps until the next call.
        """
        while self._current is None:
            self._calls.carry_out(None)
            if self._current is None and self._ended:
                return
        current, lockstep, carried = self._current, self._lockstep, 0
        while not current.is_closed:
            current.moment()
            waits = [w for w in (current.wait, lockstep.wait) if w is not None]
            if self._calls.carry_out(min(waits) if waits else None) and carried < _CALLS:
                carried += 1
                continue
            carried = 0
            current.advance()
            lockstep.advance()

    def _carried_out(self, call: str, client: Client, answer: Answer, *arguments: Any) -> object:
        """Carry out a call; return its result, or `_LATER` if the answer is set later."""
        current, lockstep = self._on, self._lockstep
        match call:
            case "describe":
                return {**current.describe(), **lockstep.describe()}
            case "get":
                return current.names.get(*arguments)
            case "set":
                current.set(current.names.fit(*arguments))
            case "step":
                return self._step(client, answer, *arguments)
            case "run":
                current.check_idle("run")
                lockstep.check_free(client, "run")
                until, factor, record = arguments
                current.run(until, factor, record, answer, client.answer_bytes)
                return _LATER
            case "pause":
                current.pause()
            case "reset":
                seed, start = arguments
                if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int)):
                    raise InputInvalid("reset", f"seed {seed!r}", "a whole number")
                current.reset(seed, start or {})
                lockstep.end(f"the co-simulation was reset by {client.name!r} meanwhile")
            case "snapshot":
                return current.snapshot(client.name)
            case "discard":
                current.snapshots.discard(*arguments)
            case "restore":
                current.restore(*arguments)
                lockstep.end(f"a snapshot was restored by {client.name!r} meanwhile")
            case "replace":
                current.replace(*arguments)
                lockstep.end(f"{arguments[0]} was replaced by {client.name!r} meanwhile")
            case "join":
                return lockstep.join(client, *arguments)
            case "leave" | "lost":
                lockstep.leave(client) if call == "leave" else lockstep.lost(client)
                current.snapshots.client_left(client.name)
                return None
            case "dismiss":
                (name,) = arguments
                lockstep.dismiss(name, client)
            case "schema":
                return current.names.schema
            case _:
                raise KeyError(call)
        return current.moment()

    def _step(
        self,
        client: Client,
        answer: Answer,
        n: int,
        inputs: Mapping[str, object] | None,
        outputs: Sequence[str],
    ) -> object:
        if isinstance(n, bool) or not isinstance(n, int) or n < 1:
            raise InputInvalid("step", f"{n!r} steps", "a whole number from 1")
        current = self._on
        current.check_idle("step")
        if self._lockstep.holds(client):
            self._lockstep.ask(client, n, inputs or {}, outputs, answer)
            return _LATER
        self._lockstep.check_free(client, "step")
        for name in outputs:  # before anything changes, as it may raise
            current.names.find(name)
        current.set(current.names.fit(inputs or {}))

        def result() -> tuple[Moment, dict[str, Any]]:
            return current.moment(), current.names.get(outputs)

        if n > _AT_ONCE:
            current.run_for(n, answer, result)
            return _LATER
        current.step(n)
        return result()

    def _end(self, answer: Answer) -> None:
        try:
            if self._current is not None:
                self._lockstep.end("the co-simulation has ended")
                self._current.close()
        except UuvsimError as error:
            answer.set_exception(error)
        else:
            answer.set_result(None)

    def _hurries(self) -> bool:
        running = None if self._current is None else self._current.running
        return running is not None and running.hurries

    @property
    def _on(self) -> CurrentMaster:
        assert self._current is not None
        return self._current

    def _now(self, call: Callable[[], object]) -> None:
        """Make a call in the conductor's thread, and wait for its end."""
        self._calls.put(lambda answer: answer.set_result(call())).result()
