"""A component that steps in another process or machine is a component as any other.

``remote:NAME`` names one that `serve_component` serves on this machine, and
``remote:NAME@HOST:PORT?timeout=SECONDS`` says where, and how long it may take to answer.
"""

from __future__ import annotations

import copy
import json
import re
import struct
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access.token import known_token
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
from uuvsim_cosim.orchestrator.python.state import pickled, unpickled
from uuvsim_cosim.orchestrator.system.sources import Backend

__all__ = ["ComponentServer", "RemoteComponent", "RemoteSource", "serve_component", "source"]

_TEXT = re.compile(
    r"remote:(?P<name>[\w-]+)(@(?P<host>\[[^\]]+\]|[^:?\s]+)(:(?P<port>\d+))?)?"
    r"(\?timeout=(?P<timeout>[\d.]+))?"
)
_TIMEOUT = 10.0
_sessions: dict[tuple[str, int], WrappedSession] = {}
_lock = threading.Lock()


def source(text: str, base: Path) -> RemoteSource:
    """Resolve ``remote:…``; the entry point of the scheme."""
    match = _TEXT.fullmatch(text)
    if match is None:
        raise InputInvalid(
            f"source {text!r}; expected remote:NAME, or remote:NAME@HOST:PORT?timeout=SECONDS"
        )
    host = (match["host"] or "127.0.0.1").strip("[]")
    port, timeout = match["port"], match["timeout"]
    try:
        seconds = float(timeout or _TIMEOUT)
    except ValueError:
        raise InputInvalid(f"source {text!r}: timeout {timeout}; expected seconds") from None
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
    def shown(self) -> dict[str, Any]:
        """Return the token to show, if this user has one for the server."""
        token = known_token(self.host, self.port)
        return {} if token is None else {"token": token}

    def describe(self) -> Description:
        """Ask it for its interface."""
        told, _ = _Far(self).ask("describe", self.shown)
        if told.get("protocol") != PROTOCOL:
            raise InputInvalid(
                f"{self.text}: is served by uuvsim-cosim {told.get('version')} with protocol "
                f"{told.get('protocol')}; expected protocol {PROTOCOL}, as {__version__} has"
            )
        variables = {v["name"]: _variable(v) for v in told["variables"]}
        return Description(
            name=told["name"], kind="python", variables=variables, description=told["description"],
            can_get_and_set_state=bool(told.get("can_copy_state", False)),
            can_serialize_state=bool(told.get("can_copy_state", False)),
        )  # fmt: skip

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Let it make an object for this master."""
        return RemoteComponent(self, path)


@final
class RemoteComponent:
    """The `Component` protocol over queries; one of them for each step."""

    def __init__(self, source: RemoteSource, path: str) -> None:
        self.path = path
        self.description = source.describe()
        self._far = _Far(source)
        told, _ = self._far.ask("instantiate", {"path": path, **source.shown})
        self._instance = told["instance"]
        self._time = 0.0
        self._inputs = self.description.of("input")
        self._outputs = self.description.of("output")
        self._values: dict[str, Any] = {}
        self._told: dict[str, Any] = {}
        self._forget()

    def get(self, variable: Variable) -> Any:
        """Read a value as of the last answer; a copy."""
        value = self._values[variable.name]
        return value.copy() if isinstance(value, np.ndarray) else value

    def set(self, variable: Variable, value: Any) -> None:
        """Set an input or a parameter; it is told with the next call."""
        if variable.causality not in ("input", "parameter"):
            raise FmuError(
                f"{self.path}.{variable.name}: is {variable.causality}; expected an input or a "
                "parameter"
            )
        kept = np.array(value, float) if variable.causality == "input" else value
        self._values[variable.name] = kept if variable.shape or kept is value else float(kept)
        if variable.causality == "parameter":
            self._told[variable.name] = value

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Begin at `start_time`."""
        self._time = start_time
        self._ask("enter", {"start": start_time, "stop": stop_time})

    def exit_initialization_mode(self) -> None:
        """End initialization; outputs are known from here on."""
        self._told |= {v.name: self._values[v.name] for v in self._inputs}
        self._take(self._ask("exit", {}))

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance by one communication step; raises ComponentFailed."""
        self._time = current_communication_point
        if self._told:
            self._ask("set", {})
        numbers = [np.ravel(self._values[v.name]) for v in self._inputs]
        block = struct.pack("<dd", current_communication_point, step_size)
        if numbers:
            block += np.concatenate(numbers).astype("<f8").tobytes()
        self._take(self._far_ask("step", {"instance": self._instance}, block))

    def reset(self) -> None:
        """Let it make a new object, with its start values."""
        self._forget()
        self._ask("reset", {})

    def terminate(self) -> None:
        """Nothing to end."""

    def free(self) -> None:
        """Let the object go; a second call does nothing."""
        instance, self._instance = self._instance, None
        if instance is not None:
            try:
                self._far.ask("free", {"instance": instance})
            except (Disconnected, InputInvalid, ComponentFailed):
                return  # it is gone already

    def get_fmu_state(self) -> Any:
        """Fetch a copy of the state there, and keep what is known of it here."""
        if not self.description.can_get_and_set_state:
            raise FmuError(
                f"{self.path}: {self.description.name}, which is remote, cannot copy its state; "
                "expected a class whose attributes are numbers, text, arrays and containers of them"
            )
        far = self._far_ask("get_state", {"instance": self._instance}, b"")
        return far, copy.deepcopy(self._values), dict(self._told), self._time

    def set_fmu_state(self, state: Any) -> None:
        """Send a copy back."""
        far, values, told, self._time = state
        self._far_ask("set_state", {"instance": self._instance}, far)
        self._values, self._told = copy.deepcopy(values), dict(told)

    def serialize_fmu_state(self, state: Any) -> bytes:
        """Turn a copy into bytes."""
        return pickled(state, self.path)

    def deserialize_fmu_state(self, data: bytes) -> Any:
        """Turn bytes into a copy."""
        return unpickled(data, self.path)

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: Any
    ) -> Any:
        """Refuse: a class has none."""
        raise FmuError(f"{self.path}: a remote component gives no directional derivatives")

    def binding(self) -> Binding:
        """Say that the stepping loop in C has to call Python."""
        return Binding(BindingKind.CALLBACK, 0, {})

    # ---- inside ---------------------------------------------------------------------------

    def _forget(self) -> None:
        self._told = {}
        for v in self.description.variables.values():
            self._values[v.name] = np.array(v.start) if v.shape else v.start

    def _ask(self, call: str, message: Mapping[str, Any]) -> bytes:
        told, self._told = self._told, {}
        values, block = packed(told)
        return self._far_ask(call, {"instance": self._instance, "values": values, **message}, block)

    def _far_ask(self, call: str, message: Mapping[str, Any], block: bytes) -> bytes:
        try:
            return self._far.ask(call, message, block)[1]
        except ComponentFailed:
            raise
        except (Disconnected, InputInvalid, FmuError) as error:
            raise ComponentFailed(self.path, self._time, str(error)) from None

    def _take(self, data: bytes) -> None:
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


class _Far:
    """Queries to the process that serves a component."""

    def __init__(self, source: RemoteSource) -> None:
        self._source = source
        self._session = _session(source)
        self._askers: dict[str, Any] = {}

    def ask(
        self, call: str, message: Mapping[str, Any], block: bytes = b""
    ) -> tuple[dict[str, Any], bytes]:
        """Return the answer; raises what was raised there, or Disconnected."""
        import zenoh

        source = self._source
        try:
            with self._session.inside():
                if call not in self._askers:
                    key = f"uuvsim-component/{source.name}/{call}"
                    asker = self._session.asker(key, source.timeout)
                    self._askers[call] = asker
                replies = self._askers[call].get(
                    payload=json.dumps(message),
                    attachment=block or None,
                    encoding="application/json",
                )
                reply = next(iter(replies), None)
        except (zenoh.ZError, Disconnected):
            reply = None
        if reply is None:
            raise Disconnected(self._nobody())
        if reply.ok is not None:
            attached = reply.ok.attachment
            told = read_message(reply.ok.payload.to_bytes())
            return told, b"" if attached is None else attached.to_bytes()
        data = reply.err.payload.to_bytes()
        if data == b"Timeout":
            raise Disconnected(
                f"{source.text}: did not answer within {source.timeout:g} s; expected an answer "
                "sooner, or a longer ?timeout="
            )
        raise error_of(read_message(data))

    def _nobody(self) -> str:
        source = self._source
        keys = [] if not self._session.is_open else self._session.alive("uuvsim-component/*/live")
        there = sorted(key.split("/")[1] for key in keys)
        missing = (
            expected_names(source.name, there)
            if there
            else f"serve_component(…, {source.name!r}) to run there"
        )
        return (
            f"{source.text}: no component {source.name!r} is served at {source.host}, port "
            f"{source.port}; expected {missing}"
        )


def _session(source: RemoteSource) -> WrappedSession:
    """Return the session to a host and port; it is shared, and opened anew once it was lost."""
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
                f"{source.text}: nobody answers at {source.host}, port {source.port}; expected "
                f"serve_component(…, {source.name!r}) to run there"
            ) from None
        return _sessions[key]


def _variable(told: Mapping[str, Any]) -> Variable:
    shape = tuple(told["shape"])
    start = told.get("start")
    return Variable(
        name=told["name"],
        type=told["type"],
        causality=told["causality"],
        variability=told["variability"],
        shape=shape,
        unit=told["unit"],
        start=np.array(start) if shape else start,
        description=told["description"],
        dependencies=() if told["causality"] == "output" else None,
        element_units=tuple(told["element_units"]),
    )
