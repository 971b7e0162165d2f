"""The conductor: the session of a co-simulation. One thread owns the master and makes all calls."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, final

import numpy as np

from uuvsim_cosim.bridge.access.roles import check
from uuvsim_cosim.bridge.calls.at_exit import close_at_exit
from uuvsim_cosim.bridge.calls.service import Client, Moment, Schema
from uuvsim_cosim.bridge.calls.time_sharing import READS, Share
from uuvsim_cosim.bridge.server.barrier import FailSafe
from uuvsim_cosim.bridge.server.call_handlers import CallHandlers
from uuvsim_cosim.bridge.server.call_queue import Answer, Calls
from uuvsim_cosim.bridge.server.current_master import CurrentMaster
from uuvsim_cosim.bridge.server.lockstep import Lockstep
from uuvsim_cosim.bridge.server.playback import Replay
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import Observer
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Conductor"]

_ANYBODY = Client("anybody", "local", frozenset())
_CALLS = 16  # calls that are carried out at most before steps that are due


@final
class Conductor(Closing):
    """`Service` of one running co-simulation, or of a recording; all transports pass calls to it.

    A given master must not be initialized; from now on only the conductor may use it. `record` is a
    folder for recordings: each run from a start to the next reset, restore or replacement gets its
    own. `fail_safe` is the reaction to a client in lockstep that is late or gone (see `Barrier`).
    Without `loads_code` no client may replace a component, whatever its role.
    """

    def __init__(
        self,
        system: System | Plan | Master | Replay | str | Path,
        seed: int = 0,
        backend: Backend = "native",
        *,
        record: str | Path | None = None,
        fail_safe: FailSafe = "drop",
        loads_code: bool = True,
    ) -> None:
        if not isinstance(system, System | Plan | Master | Replay | str | Path):
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
        self._thread = threading.Thread(target=self._conduct, name="uuvsim-conductor", daemon=True)
        self._thread.start()
        folder = None if record is None else Path(record)

        def begin(answer: Answer) -> None:
            current = CurrentMaster(system, seed, backend, folder)
            self._lockstep = Lockstep(current, fail_safe)
            self._handlers = CallHandlers(current, self._lockstep)
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
        return () if self._current is None else tuple(self._current.tap.folders)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the plan; after `close`, also those of the whole run."""
        return () if self._current is None else self._current.warnings

    @property
    def failed(self) -> UuvsimError | None:
        """The error of a failed step, after which it is paused until a reset or restore."""
        return None if self._current is None else self._current.failed

    # ---- the service -------------------------------------------------------------------------

    def describe(self) -> Mapping[str, Any]:
        """Return the system: name, version, tick, components, clients, mode."""
        return dict(self.ask("describe", _ANYBODY).result())

    def schema(self) -> Schema:
        """List all variables; the same object until a component is replaced."""
        return self._on.names.schema

    def get(self, client: Client, names: Sequence[str]) -> Mapping[str, Any]:
        """Read variables at the current communication point."""
        return dict(self.ask("get", client, names).result())

    def set(self, client: Client, values: Mapping[str, object]) -> Moment:
        """Set unconnected inputs and tunable parameters, all or none."""
        return _moment(self.ask("set", client, values).result())

    def step(
        self,
        client: Client,
        n: int = 1,
        inputs: Mapping[str, object] | None = None,
        outputs: Sequence[str] = (),
    ) -> tuple[Moment, Mapping[str, Any]]:
        """Set inputs, make n communication steps, and return outputs; in lockstep, with others."""
        moment, values = self.ask("step", client, n, inputs, outputs).result()
        return moment, values

    def run(
        self,
        client: Client,
        until: float | None = None,
        factor: float | None = None,
        record: Sequence[str] = (),
    ) -> Mapping[str, np.ndarray]:
        """Run to a time [s], or stream without `until`; return the time and recorded signals."""
        return dict(self.ask("run", client, until, factor, record).result())

    def pause(self, client: Client) -> Moment:
        """Stop streaming at a communication point."""
        return _moment(self.ask("pause", client).result())

    def reset(
        self, client: Client, seed: int | None = None, start: Mapping[str, object] | None = None
    ) -> Moment:
        """Go back to the start, with another seed or other start values."""
        return _moment(self.ask("reset", client, seed, start).result())

    def snapshot(self, client: Client) -> str:
        """Store the whole state; return the name of the snapshot."""
        return str(self.ask("snapshot", client).result())

    def restore(self, client: Client, snapshot: str) -> Moment:
        """Go back to a snapshot."""
        return _moment(self.ask("restore", client, snapshot).result())

    def discard(self, client: Client, snapshot: str) -> Moment:
        """Delete a snapshot."""
        return _moment(self.ask("discard", client, snapshot).result())

    def replace(
        self, client: Client, component: str, source: str, mapping: Mapping[str, str] | None = None
    ) -> Moment:
        """Replace the source of a component; the run begins again from the start."""
        return _moment(self.ask("replace", client, component, source, mapping).result())

    def join(self, client: Client, *, lockstep: bool = False, lag: float = 5.0) -> Client:
        """Add a client; with `lockstep` it holds the barrier."""
        joined = self.ask("join", client, lockstep, lag).result()
        assert isinstance(joined, Client)
        return joined

    def leave(self, client: Client) -> None:
        """Remove a client; the barrier no longer waits for it."""
        self.ask("leave", client).result()

    def dismiss(self, client: Client, name: str) -> Moment:
        """Remove another client from the barrier."""
        return _moment(self.ask("dismiss", client, name).result())

    # ---- more than the service ---------------------------------------------------------------

    def lost(self, client: Client) -> None:
        """Remove a client that has disconnected; if it held the barrier, the fail-safe decides."""
        self.ask("lost", client).result()

    def ask(self, call: str, client: Client, *arguments: object) -> Answer:
        """Put a call in the queue, without waiting for its answer."""

        def work(answer: Answer) -> None:
            check(client, call)  # first, so that no code is loaded for a client that may not
            if call == "replace" and not self._loads_code:
                raise InputInvalid(
                    "replace",
                    "this server loads no code for its clients (--no-code)",
                    (
                        "the component to be replaced where it is served, by `uuvsim serve "
                        "--replace`"
                    ),
                )
            if call == "step":
                self.share.steps(client)
            begun = time.thread_time() if call in READS else 0.0
            self._handlers.carry_out(call, client, answer, *arguments)
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
        self._now(lambda: self._on.tap.listen(observer))

    def unwatch(self, observer: Observer) -> None:
        """Stop passing rows to an observer."""
        self._now(lambda: self._on.tap.leave(observer))

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


def _moment(answer: object) -> Moment:
    assert isinstance(answer, Moment)
    return answer
