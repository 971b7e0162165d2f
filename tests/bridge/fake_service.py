"""A service whose system is y' = -y + u in two dimensions, exact at each communication point."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np

from uuvsim_cosim.bridge.access.roles import check
from uuvsim_cosim.bridge.calls.service import Client, Moment, Schema, Service, SignalInfo
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.values.values import Misfit, as_array, fit

STEP = 0.01
DECAY = math.exp(-STEP)
SIGNALS = (
    SignalInfo("plant.u", "Float64", (2,), "N", "input", True, "force"),
    SignalInfo("plant.y", "Float64", (2,), "m/s", "output", False, "speed"),
    SignalInfo("plant.table", "Float64", (2, 3), "1", "output", False, "rows of a matrix"),
    SignalInfo("plant.count", "Int32", (), "1", "parameter", True),
    SignalInfo("plant.on", "Boolean", (), "1", "parameter", True),
    SignalInfo("plant.mode", "String", (), "1", "parameter", True),
)
SCHEMA = Schema(SIGNALS)


class FakeService(Service):
    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.tick = 0
        self.running = False
        self.values: dict[str, Any] = {}
        self.kept: dict[str, tuple[int, dict[str, Any]]] = {}
        self.clients: list[Client] = []
        self.left: list[str] = []
        self._start()

    def _start(self) -> None:
        self.tick = 0
        self.values = {
            "plant.u": np.zeros(2),
            "plant.y": np.zeros(2),
            "plant.table": np.arange(6.0).reshape(2, 3),
            "plant.count": np.int32(3),
            "plant.on": np.bool_(True),
            "plant.mode": "free",
        }

    def moment(self) -> Moment:
        return Moment(self.tick, self.tick * STEP, self.running)

    def describe(self) -> Mapping[str, Any]:
        return {"system": "fake", "version": "1", "tick": STEP, "mode": "free"}

    def schema(self) -> Schema:
        return SCHEMA

    def ask(self, call: str, client: Client, *arguments: Any) -> Future[Any]:
        answer: Future[Any] = Future()
        try:
            answer.set_result(getattr(self, call)(client, *arguments))
        except Exception as error:
            answer.set_exception(error)
        return answer

    def abandon(self, answer: Future[Any]) -> None:
        raise AssertionError("each call is answered at once")

    def lost(self, client: Client) -> None:
        self.leave(client)

    def _info(self, name: str) -> SignalInfo:
        for info in SIGNALS:
            if info.name == name:
                return info
        raise InputInvalid(f"signal {name!r} does not exist (did you mean plant.y?)")

    def get(self, client: Client, names: Sequence[str]) -> Mapping[str, Any]:
        check(client, "get")
        with self.lock:
            return {name: self.values[self._info(name).name] for name in names}

    def set(self, client: Client, values: Mapping[str, Any]) -> Moment:
        check(client, "set")
        with self.lock:
            self.values.update({name: self._fitted(name, value) for name, value in values.items()})
            return self.moment()

    def _fitted(self, name: str, value: Any) -> Any:
        """Check a value as a master does."""
        info = self._info(name)
        if not info.settable:
            raise InputInvalid(f"{name} is an output; expected an input")
        variable = Variable(name, info.type, "input", "continuous", info.shape, info.unit)
        try:
            return as_array(variable, fit(variable, value))
        except Misfit as misfit:
            raise InputInvalid(str(misfit.at(name))) from None

    def step(
        self,
        client: Client,
        n: int = 1,
        inputs: Mapping[str, Any] | None = None,
        outputs: Sequence[str] = (),
    ) -> tuple[Moment, Mapping[str, Any]]:
        check(client, "step")
        with self.lock:
            if inputs:
                self.set(client, inputs)
            for _ in range(n):
                u, y = self.values["plant.u"], self.values["plant.y"]
                self.values["plant.y"] = DECAY * y + (1 - DECAY) * np.asarray(u)
                self.tick += 1
            return self.moment(), self.get(client, outputs)

    def run(
        self,
        client: Client,
        until: float | None = None,
        factor: float | None = None,
        record: Sequence[str] = (),
    ) -> Mapping[str, np.ndarray]:
        check(client, "run")
        if until is None:
            self.running = True
            return {}
        rows: dict[str, list[Any]] = {"time": [], **{name: [] for name in record}}
        while self.tick * STEP < until - STEP / 2:
            moment, values = self.step(client, 1, None, record)
            rows["time"].append(moment.time)
            for name in record:
                rows[name].append(values[name])
        return {name: np.array(kept) for name, kept in rows.items()}

    def pause(self, client: Client) -> Moment:
        self.running = False
        return self.moment()

    def reset(
        self, client: Client, seed: int | None = None, start: Mapping[str, Any] | None = None
    ) -> Moment:
        with self.lock:
            self._start()
            return self.set(client, start or {})

    def snapshot(self, client: Client) -> str:
        with self.lock:
            name = f"s{len(self.kept) + 1}"
            self.kept[name] = (self.tick, dict(self.values))
            return name

    def restore(self, client: Client, snapshot: str) -> Moment:
        with self.lock:
            if snapshot not in self.kept:
                raise InputInvalid(f"snapshot {snapshot!r} does not exist")
            self.tick, self.values = self.kept[snapshot][0], dict(self.kept[snapshot][1])
            return self.moment()

    def discard(self, client: Client, snapshot: str) -> Moment:
        self.restore(client, snapshot)
        del self.kept[snapshot]
        return self.moment()

    def dismiss(self, client: Client, name: str) -> Moment:
        raise InputInvalid(f"no client {name!r}")

    def replace(
        self, client: Client, component: str, source: str, mapping: Mapping[str, str] | None = None
    ) -> Moment:
        check(client, "replace")
        return self.reset(client)

    def join(self, client: Client, *, lockstep: bool = False, lag: float = 5.0) -> Client:
        with self.lock:
            self.clients.append(client)
        return client

    def leave(self, client: Client) -> None:
        with self.lock:
            self.clients.remove(client)
            self.left.append(client.name)
