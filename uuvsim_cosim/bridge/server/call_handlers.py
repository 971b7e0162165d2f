"""What each call does, in the conductor's thread; each answers now, or keeps the answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.call_queue import Answer
from uuvsim_cosim.bridge.server.current_master import CurrentMaster
from uuvsim_cosim.bridge.server.lockstep import Lockstep
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Acts"]

_AT_ONCE = 1000  # steps; more are made in pieces, so that others are answered meanwhile


@final
class Acts:
    """The calls of the service, on the current master."""

    def __init__(self, current: CurrentMaster, lockstep: Lockstep) -> None:
        self._current, self._lockstep = current, lockstep
        self._acts: dict[str, Callable[..., None]] = {
            "get": self._get, "set": self._set, "step": self._step, "run": self._run,
            "pause": self._pause, "reset": self._reset, "snapshot": self._snapshot,
            "restore": self._restore, "replace": self._replace, "join": self._join,
            "leave": self._leave, "lost": self._lost, "describe": self._describe,
            "schema": self._schema, "discard": self._discard, "dismiss": self._dismiss,
        }  # fmt: skip

    def carry_out(self, call: str, client: Client, answer: Answer, *arguments: Any) -> None:
        """Carry a call out; raises what it refuses."""
        self._acts[call](client, answer, *arguments)

    def _describe(self, client: Client, answer: Answer) -> None:
        answer.set_result({**self._current.describe(), **self._lockstep.describe()})

    def _schema(self, client: Client, answer: Answer) -> None:
        answer.set_result(self._current.names.schema)

    def _get(self, client: Client, answer: Answer, names: Sequence[str]) -> None:
        answer.set_result(self._current.names.get(names))

    def _set(self, client: Client, answer: Answer, values: Mapping[str, Any]) -> None:
        self._current.names.set(self._current.names.fit(values))
        answer.set_result(self._current.moment())

    def _step(
        self,
        client: Client,
        answer: Answer,
        n: int,
        inputs: Mapping[str, Any] | None,
        outputs: Sequence[str],
    ) -> None:
        if isinstance(n, bool) or not isinstance(n, int) or n < 1:
            raise InputInvalid(f"step: {n!r} steps; expected a whole number from 1")
        current = self._current
        current.check_idle("step")
        if self._lockstep.holds(client):
            self._lockstep.ask(client, n, inputs or {}, outputs, answer)
            return
        self._lockstep.check_free(client, "step")
        for name in outputs:
            current.names.find(name)
        current.names.set(current.names.fit(inputs or {}))

        def reached() -> Any:
            return current.moment(), current.names.get(outputs)

        if n > _AT_ONCE:
            current.run_for(n, answer, reached)
            return
        current.step(n)
        answer.set_result(reached())

    def _run(
        self,
        client: Client,
        answer: Answer,
        until: float | None,
        factor: float | None,
        record: Sequence[str],
    ) -> None:
        self._current.check_idle("run")
        self._lockstep.check_free(client, "run")
        self._current.run(until, factor, record, answer, client.answer_bytes)

    def _pause(self, client: Client, answer: Answer) -> None:
        self._current.pause()
        answer.set_result(self._current.moment())

    def _reset(
        self, client: Client, answer: Answer, seed: int | None, start: Mapping[str, Any] | None
    ) -> None:
        if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int)):
            raise InputInvalid(f"reset: seed {seed!r}; expected a whole number")
        self._current.reset(seed, start or {})
        self._lockstep.end(f"the co-simulation was reset by {client.name!r} meanwhile")
        answer.set_result(self._current.moment())

    def _snapshot(self, client: Client, answer: Answer) -> None:
        answer.set_result(self._current.snapshot(client.name))

    def _discard(self, client: Client, answer: Answer, snapshot: str) -> None:
        self._current.snapshots.discard(snapshot)
        answer.set_result(self._current.moment())

    def _restore(self, client: Client, answer: Answer, snapshot: str) -> None:
        self._current.restore(snapshot)
        self._lockstep.end(f"a snapshot was restored by {client.name!r} meanwhile")
        answer.set_result(self._current.moment())

    def _replace(
        self,
        client: Client,
        answer: Answer,
        component: str,
        source: str,
        mapping: Mapping[str, str] | None,
    ) -> None:
        self._current.replace(component, source, mapping)
        self._lockstep.end(f"{component} was replaced by {client.name!r} meanwhile")
        answer.set_result(self._current.moment())

    def _join(self, client: Client, answer: Answer, lockstep: bool, lag: float) -> None:
        answer.set_result(self._lockstep.join(client, lockstep, lag))

    def _leave(self, client: Client, answer: Answer) -> None:
        self._lockstep.leave(client)
        self._current.snapshots.left(client.name)
        answer.set_result(None)

    def _dismiss(self, client: Client, answer: Answer, name: str) -> None:
        self._lockstep.dismiss(name, client)
        answer.set_result(self._current.moment())

    def _lost(self, client: Client, answer: Answer) -> None:
        self._lockstep.lost(client)
        self._current.snapshots.left(client.name)
        answer.set_result(None)
