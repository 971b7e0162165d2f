"""Requests of Foxglove's clients as calls of the table: parameters, services, published inputs.

The methods `on_…` are called by threads of foxglove-sdk. A refused request is reported to the
client that called a service, and to all clients otherwise, because the SDK cannot address one.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import wait
from dataclasses import asdict
from fractions import Fraction
from typing import Any, final

from uuvsim_cosim.bridge.access.roles import NEEDS
from uuvsim_cosim.bridge.calls.call_table import arguments, read_object
from uuvsim_cosim.bridge.calls.service import Client, Moment, Service
from uuvsim_cosim.bridge.calls.time_sharing import RateLimit
from uuvsim_cosim.bridge.calls.values import json_of, shown
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["Requests"]

_CALLS_PER_S = 200.0  # of parameters; faster clients are delayed
_INPUTS = 256  # channels that all clients together may publish
_AGAIN, _REPORTS = 1.0, 16  # [s] between two equal reports, and how many there are in this time
_TURN = 0.1  # [s] between two checks of a service that waits for its answer
_SEED = {"type": "integer", "description": "seed of all random numbers; default: as before"}
_START = {"type": "object", "description": "start values by name"}
_FACTOR = {"type": "number", "description": "factor of real time; default 1"}
_N = {"type": "integer", "minimum": 1, "description": "communication steps; default 1"}
_DT = {"type": "number", "description": "seconds instead of n"}
_VALUES = {"type": "object", "description": "inputs to set before, by name"}
_NAMES = {"type": "array", "items": {"type": "string"}, "description": "signals to return"}
# Service: its call, and the fields of its request.
_SERVICES: dict[str, tuple[str, dict[str, object]]] = {
    "reset": ("reset", {"seed": _SEED, "start": _START}),
    "pause": ("pause", {}),
    "resume": ("run", {"factor": _FACTOR}),
    "step": ("step", {"n": _N, "dt": _DT, "inputs": _VALUES, "outputs": _NAMES}),
}
_ANSWER = {
    "tick": {"type": "integer", "description": "communication point"},
    "time": {"type": "number", "description": "simulated time [s]"},
    "running": {"type": "boolean"},
    "values": {"type": "object", "description": "of the signals that were asked for"},
}


@final
class Requests:
    """Listener of Foxglove's server; `report` shows a message to all clients.

    `fresh` holds the topics that somebody has subscribed to since it was cleared; `wake` is called
    when something is to be done by `turn`.
    """

    def __init__(
        self, service: Service, client: Client, reason: str, wake: Callable[[], None]
    ) -> None:
        self._service, self._client, self._reason, self._wake = service, client, reason, wake
        self._limit, self._limiting = RateLimit(_CALLS_PER_S), threading.Lock()
        self._tick: Fraction | None = None
        self.closed = threading.Event()
        self.fresh: set[str] = set()
        self._watched: set[str] = set()  # parameters with a subscriber
        self._shown: dict[str, object] = {}
        self._channels: dict[tuple[int, int], str] = {}  # of clients: the path of a component
        self._inputs: dict[tuple[int, int], bytes] = {}  # their newest messages
        self._reported: dict[str, float] = {}  # when it was last reported
        self._reports: list[str] = []

    # ---- subscriptions ---------------------------------------------------------------------

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Note a topic with a new subscriber."""
        self.fresh.add(channel.topic)
        self._wake()

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Do nothing: the server looks whether a channel has a subscriber."""

    # ---- parameters ------------------------------------------------------------------------

    def on_get_parameters(
        self, client: Any, param_names: list[str], request_id: str | None = None
    ) -> list[Any]:
        """Return the tunable parameters of these names; without names, all."""
        self._wait()
        known = self._tunable()
        return self._read([n for n in param_names if n in known] if param_names else known)

    def on_set_parameters(
        self, client: Any, parameters: Sequence[Any], request_id: str | None = None
    ) -> list[Any]:
        """Set parameters, all or none; return their values afterwards."""
        self._wait()
        known = set(self._tunable())
        names = [p.name for p in parameters]
        try:
            for name in names:
                if name not in known:
                    raise InputInvalid(name, "is no tunable parameter", "one that is listed")
            values = {p.name: _given(p) for p in parameters}
            self._call("set", {"values": values})
        except (UuvsimError, TypeError, ValueError, OverflowError) as error:
            self._report(str(error))
        return self._read([name for name in names if name in known])

    def on_parameters_subscribe(self, param_names: list[str]) -> None:
        """Watch parameters for changes by others."""
        self._watched |= set(param_names)

    def on_parameters_unsubscribe(self, param_names: list[str]) -> None:
        """Stop watching parameters."""
        self._watched -= set(param_names)

    def changed(self) -> list[Any]:
        """Return the watched parameters that have changed since the last call."""
        names = [name for name in self._tunable() if name in self._watched]
        if not names:
            self._shown = {}
            return []
        now = {n: json_of(v) for n, v in self._service.get(self._client, names).items()}
        before, self._shown = self._shown, now
        return [self._parameter(n, v) for n, v in now.items() if n in before and before[n] != v]

    def _tunable(self) -> list[str]:
        return [i.name for i in self._service.schema() if i.settable and i.causality == "parameter"]

    def _read(self, names: Sequence[str]) -> list[Any]:
        try:
            values = self._service.get(self._client, names)
        except UuvsimError as error:
            self._report(str(error))
            return []
        return [self._parameter(name, json_of(value)) for name, value in values.items()]

    def _parameter(self, name: str, value: object) -> Any:
        from foxglove import Parameter

        try:
            return Parameter(name, value=value)
        except (OverflowError, TypeError, ValueError):  # null in an array, or more than int64
            return Parameter(name, value=json.dumps(value))

    # ---- inputs that clients publish -------------------------------------------------------

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        """Note a channel for the inputs of a component: /controller, or /rov/controller."""
        path = channel.topic.strip("/").replace("/", ".")
        paths = {info.name.rpartition(".")[0] for info in self._service.schema() if info.settable}
        if channel.encoding != "json":
            self._report(f"{channel.topic}: encoding {channel.encoding!r}; expected json")
        elif path not in paths:
            expected = ", ".join("/" + p.replace(".", "/") for p in sorted(paths)) or "none"
            self._report(f"{channel.topic}: is no component with inputs; expected {expected}")
        elif len(self._channels) >= _INPUTS:
            self._report(f"{channel.topic}: more than {_INPUTS} published channels")
        else:
            self._channels[client.id, channel.id] = path

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        """Forget a channel."""
        self._channels.pop((client.id, client_channel_id), None)

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        """Keep the newest message of a channel; `turn` sets its values."""
        if (client.id, client_channel_id) in self._channels:
            self._inputs[client.id, client_channel_id] = data
            self._wake()

    def turn(self) -> list[str]:
        """Set the inputs of the newest messages; return reports that are new."""
        for _ in range(len(self._inputs)):
            key, data = self._inputs.popitem()
            path = self._channels.get(key)
            if path is None:
                continue
            try:
                values = read_object(data, f"/{path}")
                self._call("set", {"values": {f"{path}.{k}": v for k, v in values.items()}})
            except (UuvsimError, TypeError, ValueError, OverflowError) as error:
                self._report(str(error))
        return [self._reports.pop(0) for _ in range(len(self._reports))]

    # ---- services --------------------------------------------------------------------------

    def services(self) -> list[Any]:
        """Return the services: reset, pause, resume, step."""
        from foxglove import MessageSchema, Schema, Service, ServiceSchema

        def schema(name: str, properties: Mapping[str, object]) -> Any:
            about = {"type": "object", "title": name, "properties": properties}
            data = json.dumps(about).encode()
            return MessageSchema(
                encoding="json", schema=Schema(name=name, encoding="jsonschema", data=data)
            )

        return [
            Service(
                f"/{name}",
                schema=ServiceSchema(
                    name, request=schema(name, fields), response=schema(f"{name}_answer", _ANSWER)
                ),
                handler=self._serve,
            )
            for name, (_, fields) in _SERVICES.items()
        ]

    def _serve(self, request: Any) -> bytes:
        """Answer the request of a service; an error becomes its failure."""
        name = request.service_name.removeprefix("/")
        call, fields = _SERVICES[name]
        given = read_object(request.payload, name)
        for field in given:
            if field not in fields:
                expected = ", ".join(fields) or "an empty object"
                raise InputInvalid(name, f"field {shown(field)} does not exist", expected)
        answer = self._call(call, given)
        moment, values = answer if isinstance(answer, tuple) else (answer, {})
        if not isinstance(moment, Moment):  # of a run; it has begun when the next call is answered
            self._service.get(self._client, [])
            moment = self._service.moment()
        return json.dumps({**asdict(moment), "values": json_of(values)}).encode()

    def _call(self, name: str, request: Mapping[str, object]) -> Any:
        """Make a call and wait for its answer, at most until the server is closed."""
        given = arguments(name, request, self._step, lambda: self._service.moment().tick)
        answer = self._service.ask(name, self._client, *given)
        while not wait([answer], _TURN).done:
            if self.closed.is_set():
                self._service.abandon(answer)
                raise InputInvalid(name, "the server has ended meanwhile")
        try:
            return answer.result()
        except InputInvalid as error:
            if NEEDS.get(name) not in {None, *self._client.allowed}:
                raise InputInvalid(f"{error}. {self._reason}") from None
            raise

    def _step(self) -> Fraction:
        if self._tick is None:
            self._tick = Fraction(str(self._service.describe()["tick"]))
        return self._tick

    def _wait(self) -> None:
        with self._limiting:
            self._limit.wait()

    def _report(self, text: str) -> None:
        """Report a message, the same one at most once a second."""
        now = time.monotonic()
        if now - self._reported.get(text, -_AGAIN) < _AGAIN:
            return
        self._reported = {t: at for t, at in self._reported.items() if now - at < _AGAIN}
        if len(self._reported) < _REPORTS:
            self._reported[text] = now
            self._reports.append(text)
            self._wake()


def _given(parameter: Any) -> object:
    value = parameter.get_value()
    if value is None:
        raise InputInvalid(parameter.name, "no value", "a value: parameters cannot be removed")
    return value
