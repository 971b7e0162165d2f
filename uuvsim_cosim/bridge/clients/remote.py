"""Remote components: components that step in another process or on another machine.

``remote:NAME`` is one that `serve_component` serves on this machine.
``remote:NAME@HOST:PORT?timeout=SECONDS`` names another server, and the time to wait for an answer.
"""

from __future__ import annotations

import contextlib
import copy
import json
import re
import struct
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access.token import known_token
from uuvsim_cosim.bridge.calls.zenoh_keys import remote_component_key
from uuvsim_cosim.bridge.clients.access import Credentials
from uuvsim_cosim.bridge.clients.remote_serving import (
    COMPONENT_PORT,
    ComponentServer,
    serve_component,
)
from uuvsim_cosim.bridge.zenoh.codec import PROTOCOL, error_of, packed, read_message
from uuvsim_cosim.bridge.zenoh.session import Disconnected, WrappedSession
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.python.component import pickled, unpickled
from uuvsim_cosim.orchestrator.system.sources import Backend

if TYPE_CHECKING:
    import zenoh

__all__ = ["ComponentServer", "RemoteComponent", "RemoteSource", "serve_component", "source"]

_TEXT = re.compile(
    r"remote:(?P<name>[\w-]+)(@(?P<host>\[[^\]]+\]|[^:?\s]+)(:(?P<port>\d+))?)?"
    r"(\?timeout=(?P<timeout>[\d.]+))?"
)
_TIMEOUT = 10.0  # s
# State of the server's object, values, values to send, and time [s].
_State = tuple[bytes, dict[str, Any], dict[str, object], float]
_sessions: dict[tuple[str, int], WrappedSession] = {}
_lock = threading.Lock()


def source(text: str, base: Path) -> RemoteSource:
    """Resolve ``remote:…``; the entry point of the scheme."""
    match = _TEXT.fullmatch(text)
    if match is None:
        raise InputInvalid(
            f"source {text!r}", "remote:NAME, or remote:NAME@HOST:PORT?timeout=SECONDS"
        )
    host = (match["host"] or "127.0.0.1").strip("[]")
    port, timeout = match["port"], match["timeout"]
    try:
        seconds = float(timeout or _TIMEOUT)
    except ValueError:
        raise InputInvalid(f"source {text!r}", f"timeout {timeout}", "seconds") from None
    return RemoteSource(match["name"], host, int(port) if port else COMPONENT_PORT, seconds)


@dataclass(frozen=True)
class RemoteSource:
    """A component that is served at a host and port under a name."""

    name: str
    host: str
    port: int
    timeout: float  # s
    kind: str = "remote"

    @property
    def text(self) -> str:
        """The whole source."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"remote:{self.name}@{host}:{self.port}?timeout={self.timeout:g}"

    @property
    def shown(self) -> dict[str, str]:
        """Return the field with the token, if this user has one for the server."""
        token = known_token(self.host, self.port)
        return {} if token is None else {"token": token}

    def describe(self) -> Description:
        """zenoh.Query the interface."""
        answer, _ = _Server(self).ask("describe", self.shown)
        if answer.get("protocol") != PROTOCOL:
            raise InputInvalid(
                self.text,
                (
                    f"is served by uuvsim-cosim {answer.get('version')} with protocol "
                    f"{answer.get('protocol')}"
                ),
                f"protocol {PROTOCOL}, as {__version__} has",
            )
        return Description(
            name=answer["name"], kind="python", description=answer["description"],
            variables={v["name"]: _variable(v) for v in answer["variables"]},
            can_get_and_set_state=bool(answer.get("can_copy_state", False)),
            can_serialize_state=bool(answer.get("can_copy_state", False)),
        )  # fmt: skip

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Let the server make an object for this master."""
        return RemoteComponent(self, path)


@final
class RemoteComponent:
    """The `Component` protocol over queries; each step is one query."""

    def __init__(self, source: RemoteSource, path: str) -> None:
        self.path = path
        self.description = source.describe()
        self._server = _Server(source)
        answer, _ = self._server.ask("instantiate", {"path": path, **source.shown})
        self._instance: str | None = answer["instance"]
        self._time = 0.0
        self._inputs = self.description.of("input")
        self._outputs = self.description.of("output")
        self._values: dict[str, Any] = {}
        self._pending: dict[str, object] = {}  # values that the next query carries
        self._forget()

    def get(self, variable: Variable) -> Any:
        """Read a value as of the last answer; a copy."""
        value = self._values[variable.name]
        return value.copy() if isinstance(value, np.ndarray) else value

    def set(self, variable: Variable, value: object) -> None:
        """Set an input or a parameter; the next query sends it."""
        if variable.causality not in ("input", "parameter"):
            raise FmuError(
                f"{self.path}.{variable.name}",
                f"is {variable.causality}",
                "an input or a parameter",
            )
        if variable.causality == "parameter":
            self._values[variable.name] = self._pending[variable.name] = value
        else:  # each step sends all inputs
            numbers = np.array(value, float)
            self._values[variable.name] = numbers if variable.shape else float(numbers)

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Begin at `start_time`."""
        self._time = start_time
        self._ask("enter", {"start": start_time, "stop": stop_time})

    def exit_initialization_mode(self) -> None:
        """End initialization; outputs are valid from here on."""
        self._pending |= {v.name: self._values[v.name] for v in self._inputs}
        self._set_outputs(self._ask("exit", {}))

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance by one communication step; raises ComponentFailed."""
        self._time = current_communication_point
        if self._pending:
            self._ask("set", {})
        numbers = [np.ravel(self._values[v.name]) for v in self._inputs]
        block = struct.pack("<dd", current_communication_point, step_size)
        if numbers:
            block += np.concatenate(numbers).astype("<f8").tobytes()
        self._set_outputs(self._query("step", {"instance": self._instance}, block))

    def reset(self) -> None:
        """Let the server make a new object, with its start values."""
        self._forget()
        self._ask("reset", {})

    def terminate(self) -> None:
        """Nothing to end."""

    def free(self) -> None:
        """Let the server free the object; a second call does nothing."""
        instance, self._instance = self._instance, None
        if instance is not None:
            # The server may have ended already.
            with contextlib.suppress(Disconnected, InputInvalid, ComponentFailed):
                self._server.ask("free", {"instance": instance})

    def get_fmu_state(self) -> _State:
        """Copy the state of the server's object, and the values that are known here."""
        if not self.description.can_get_and_set_state:
            raise FmuError(
                self.path,
                f"{self.description.name}, which is remote, cannot copy its state",
                "a class whose attributes are numbers, text, arrays and containers of them",
            )
        state = self._query("get_state", {"instance": self._instance}, b"")
        return state, copy.deepcopy(self._values), dict(self._pending), self._time

    def set_fmu_state(self, state: _State) -> None:
        """Send a copy of the state to the server."""
        there, values, pending, self._time = state
        self._query("set_state", {"instance": self._instance}, there)
        self._values, self._pending = copy.deepcopy(values), dict(pending)

    def serialize_fmu_state(self, state: _State) -> bytes:
        """Convert a copy of the state to bytes."""
        return pickled(state, self.path)

    def deserialize_fmu_state(self, data: bytes) -> Any:
        """Convert bytes to a copy of the state."""
        return unpickled(data, self.path)

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: ArrayLike
    ) -> np.ndarray:
        """Raise FmuError: a Python class has no directional derivatives."""
        raise FmuError(f"{self.path}: a remote component gives no directional derivatives")

    def binding(self) -> Binding:
        """Return that the stepping loop in C has to call Python."""
        return Binding(BindingKind.CALLBACK, 0, {})

    # ---- inside ---------------------------------------------------------------------------

    def _forget(self) -> None:
        """Set all values to their start values."""
        self._pending = {}
        for v in self.description.variables.values():
            self._values[v.name] = np.array(v.start) if v.shape else v.start

    def _ask(self, call: str, fields: Mapping[str, object]) -> bytes:
        """Send a query with the pending values; return the block of its answer."""
        pending, self._pending = self._pending, {}
        values, block = packed(pending)
        return self._query(call, {"instance": self._instance, "values": values, **fields}, block)

    def _query(self, call: str, message: Mapping[str, object], block: bytes) -> bytes:
        """Send a query; raises ComponentFailed for every error."""
        try:
            return self._server.ask(call, message, block)[1]
        except ComponentFailed:
            raise
        except (Disconnected, InputInvalid, FmuError) as error:
            raise ComponentFailed(self.path, self._time, str(error)) from None

    def _set_outputs(self, data: bytes) -> None:
        numbers = np.frombuffer(data, "<f8")
        if len(numbers) != sum(v.size for v in self._outputs):
            raise ComponentFailed(
                self.path, self._time, f"answered with {len(numbers)} numbers; expected "
                f"{sum(v.size for v in self._outputs)}, as it described itself",
            )  # fmt: skip
        at = 0
        for v in self._outputs:
            part = numbers[at : at + v.size]
            self._values[v.name] = part.reshape(v.shape).copy() if v.shape else float(part[0])
            at += v.size


class _Server:
    """The process that serves a component, as the receiver of queries."""

    def __init__(self, source: RemoteSource) -> None:
        self._source = source
        self._session = _session(source)
        self._queriers: dict[str, zenoh.Querier] = {}

    def ask(
        self, call: str, message: Mapping[str, object], block: bytes = b""
    ) -> tuple[dict[str, Any], bytes]:
        """Return the answer to a query; raises the server's error, or Disconnected."""
        import zenoh

        source = self._source
        try:
            with self._session.inside():
                if call not in self._queriers:
                    key = remote_component_key(source.name, call)
                    self._queriers[call] = self._session.asker(key, source.timeout)
                replies = self._queriers[call].get(
                    payload=json.dumps(message),
                    attachment=block or None,
                    encoding="application/json",
                )
                reply = next(iter(replies), None)
        except (zenoh.ZError, Disconnected):
            reply = None
        if reply is None:
            session = self._session
            live = session.alive(remote_component_key(call="live")) if session.is_open else ()
            served = sorted(key.split("/")[1] for key in live)
            if source.name in served:  # Zenoh may end a query that timed out without saying so
                raise self._late()
            expected = f"serve_component(…, {source.name!r}) to run there"
            if served:
                expected = expected_names(source.name, served)
            raise Disconnected(
                f"{source.text}: no component {source.name!r} is served at {source.host}, port "
                f"{source.port}; expected {expected}"
            )
        if reply.ok is not None:
            attached = reply.ok.attachment
            answer = read_message(reply.ok.payload.to_bytes())
            return answer, b"" if attached is None else attached.to_bytes()
        data = b"" if reply.err is None else reply.err.payload.to_bytes()
        if data == b"Timeout":  # Zenoh's own error
            raise self._late()
        raise error_of(read_message(data))

    def _late(self) -> Disconnected:
        return Disconnected(
            f"{self._source.text}: did not answer within {self._source.timeout:g} s; expected an "
            "answer within this time, or a longer ?timeout="
        )


def _session(source: RemoteSource) -> WrappedSession:
    """Return the session to a host and port, which is shared, and opened again if it was lost."""
    key = (source.host, source.port)
    with _lock:
        session = _sessions.get(key)
        if session is not None and session.is_open and session.is_connected:
            return session
        if session is not None:
            session.close()
        try:
            _sessions[key] = Credentials().opened(*key)
        except Disconnected:
            raise Disconnected(
                f"{source.text}: no server answers at {source.host}, port {source.port}; expected "
                f"serve_component(…, {source.name!r}) to run there"
            ) from None
        return _sessions[key]


def _variable(entry: Mapping[str, Any]) -> Variable:
    """Return a variable of the answer to `describe`; an output has no direct feedthrough."""
    shape, start = tuple(entry["shape"]), entry.get("start")
    return Variable(
        name=entry["name"],
        type=entry["type"],
        causality=entry["causality"],
        variability=entry["variability"],
        shape=shape,
        unit=entry["unit"],
        start=np.array(start) if shape else start,
        description=entry["description"],
        dependencies=() if entry["causality"] == "output" else None,
        element_units=tuple(entry["element_units"]),
    )
