"""The effect of each call, in the conductor's thread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

from uuvsim_cosim.bridge.calls.service import Client, Moment
from uuvsim_cosim.bridge.server.call_queue import Answer
from uuvsim_cosim.bridge.server.current_master import CurrentMaster
from uuvsim_cosim.bridge.server.lockstep import Lockstep
from uuvsim_cosim.errors import InputInvalid

__all__ = ["CallHandlers"]

_AT_ONCE = 1000  # steps; more are made in pieces, so that other calls are answered meanwhile


@final
class CallHandlers:
    """The calls of the service, on the current master."""

    def __init__(self, current: CurrentMaster, lockstep: Lockstep) -> None:
        self._current, self._lockstep = current, lockstep

    def carry_out(self, call: str, client: Client, answer: Answer, *arguments: Any) -> None:
        """Carry a call out: set its answer now, or keep it for later; raises to refuse the call."""
        current, lockstep = self._current, self._lockstep
        match call:
            case "describe":
                answer.set_result({**current.describe(), **lockstep.describe()})
            case "schema":
                answer.set_result(current.names.schema)
            case "get":
                answer.set_result(current.names.get(*arguments))
            case "set":
                current.names.set(current.names.fit(*arguments))
                answer.set_result(current.moment())
            case "step":
                self._step(client, answer, *arguments)
            case "run":
                current.check_idle("run")
                lockstep.check_free(client, "run")
                until, factor, record = arguments
                current.run(until, factor, record, answer, client.answer_bytes)
            case "pause":
                current.pause()
                answer.set_result(current.moment())
            case "reset":
                self._reset(client, *arguments)
                answer.set_result(current.moment())
            case "snapshot":
                answer.set_result(current.snapshot(client.name))
            case "discard":
                current.snapshots.discard(*arguments)
                answer.set_result(current.moment())
            case "restore":
                current.restore(*arguments)
                lockstep.end(f"a snapshot was restored by {client.name!r} meanwhile")
                answer.set_result(current.moment())
            case "replace":
                current.replace(*arguments)
                lockstep.end(f"{arguments[0]} was replaced by {client.name!r} meanwhile")
                answer.set_result(current.moment())
            case "join":
                answer.set_result(lockstep.join(client, *arguments))
            case "leave" | "lost":
                if call == "leave":
                    lockstep.leave(client)
                else:
                    lockstep.lost(client)
                current.snapshots.client_left(client.name)
                answer.set_result(None)
            case "dismiss":
                (name,) = arguments
                lockstep.dismiss(name, client)
                answer.set_result(current.moment())
            case _:
                raise KeyError(call)

    def _step(
        self,
        client: Client,
        answer: Answer,
        n: int,
        inputs: Mapping[str, object] | None,
        outputs: Sequence[str],
    ) -> None:
        if isinstance(n, bool) or not isinstance(n, int) or n < 1:
            raise InputInvalid("step", f"{n!r} steps", "a whole number from 1")
        current = self._current
        current.check_idle("step")
        if self._lockstep.holds(client):
            self._lockstep.ask(client, n, inputs or {}, outputs, answer)
            return
        self._lockstep.check_free(client, "step")
        for name in outputs:  # before anything changes, as it may raise
            current.names.find(name)
        current.names.set(current.names.fit(inputs or {}))

        def result() -> tuple[Moment, dict[str, Any]]:
            return current.moment(), current.names.get(outputs)

        if n > _AT_ONCE:
            current.run_for(n, answer, result)
            return
        current.step(n)
        answer.set_result(result())

    def _reset(self, client: Client, seed: int | None, start: Mapping[str, object] | None) -> None:
        if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int)):
            raise InputInvalid("reset", f"seed {seed!r}", "a whole number")
        self._current.reset(seed, start or {})
        self._lockstep.end(f"the co-simulation was reset by {client.name!r} meanwhile")
