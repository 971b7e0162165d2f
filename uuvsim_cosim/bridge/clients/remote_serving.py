"""Server of a remote component: a Python class that steps here, for masters in other processes."""

from __future__ import annotations

import contextlib
import json
import secrets
import threading
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, final

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access.authentication import everybody
from uuvsim_cosim.bridge.access.token import TokenFile, guarded_by_token
from uuvsim_cosim.bridge.access.zenoh_permissions import guarded_component
from uuvsim_cosim.bridge.calls.zenoh_keys import remote_component_key
from uuvsim_cosim.bridge.zenoh.codec import PROTOCOL, message_of, read_message, unpacked
from uuvsim_cosim.bridge.zenoh.session import listening
from uuvsim_cosim.closing import Owner
from uuvsim_cosim.errors import FmuError, InputInvalid
from uuvsim_cosim.orchestrator.python.class_file import load
from uuvsim_cosim.orchestrator.python.component import PythonComponent

if TYPE_CHECKING:
    import zenoh

__all__ = ["COMPONENT_PORT", "ComponentServer", "serve_component"]

COMPONENT_PORT = 7480


def serve_component(
    component: type[Any] | str,
    name: str | None = None,
    *,
    port: int = COMPONENT_PORT,
    host: str = "127.0.0.1",
    anyone: bool = False,
) -> ComponentServer:
    """Serve a Python class of this process to masters in other processes, as ``remote:NAME``.

    `component` is a class with `inputs`, `outputs` and ``step(t, dt, u)``, or the text
    ``FILE.py:Class``. `name` is by default the name of the class. Each master gets an object of its
    own. The server listens at `host` and `port`; port 0 is any free one. Masters need the token of
    this user, which they find on this machine; with `anyone`, every process that reaches the port
    may use the class. The result has `source`, the component's source for a system, `wait`, which
    returns after Ctrl-C, and `close`. Raises InputInvalid for a class that is not a component, for
    an invalid name, and if it cannot listen there.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.bridge import serve_component
    >>> class Tether:  # a force against the surge speed
    ...     inputs = {"speed": "m/s"}
    ...     outputs = {"force": "N"}
    ...     def step(self, t, dt, u):
    ...         return {"force": -20.0 * u["speed"]}
    >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
    >>> with serve_component(Tether, "tether", port=0) as server:
    ...     towed = boat.add("tether", server.source).connect("hull.nu[1]", "tether.speed")
    ...     uuv.run(towed.connect("tether.force", "hull.tau[1]"), until=1).steps
    10
    """
    cls = load(component) if isinstance(component, str) else component
    return ComponentServer(cls, name or cls.__name__, port, host, anyone=anyone)


@final
class ComponentServer(Owner):
    """Server of a Python class, from construction to `close`; `wait` waits for Ctrl-C."""

    def __init__(
        self, cls: type[Any], name: str, port: int, host: str, *, anyone: bool = False
    ) -> None:
        if not name.replace("_", "").replace("-", "").isalnum():
            raise InputInvalid(f"component name {name!r}", "letters, digits, _ and -")
        self.name, self.host = name, host
        self._class = cls
        self._description = PythonComponent(cls, name).description
        self._instances: dict[str, PythonComponent] = {}
        self._over = threading.Event()
        authenticator = None if anyone else guarded_by_token()
        self._admit = authenticator or everybody
        token = None if authenticator is None else authenticator.access.token
        guard: AbstractContextManager[dict[str, object]]
        guard = nullcontext({}) if token is None else guarded_component(token)
        with self._opening() as opened:
            with guard as settings:
                session = opened.enter_context(listening(port, [host], settings))
            self.port = session.port
            opened.enter_context(TokenFile(self._admit, self.port))
            opened.callback(self._over.set)
            self._answering = session.answer(remote_component_key(name), self._asked)
            self._token = session.token(remote_component_key(name, "live"))

    @property
    def source(self) -> str:
        """The source of the component for a system."""
        return f"remote:{self.name}@{self.host}:{self.port}"

    def wait(self) -> None:
        """Wait until it is closed, or for Ctrl-C."""
        with contextlib.suppress(KeyboardInterrupt):
            self._over.wait()
        self.close()

    # ---- inside ---------------------------------------------------------------------------

    def _asked(self, query: zenoh.Query) -> None:
        """Answer a query, in Zenoh's thread: one after another."""
        call = str(query.key_expr).rpartition("/")[2]
        try:
            payload, attached = query.payload, query.attachment
            message = read_message(b"" if payload is None else payload.to_bytes())
            block = b"" if attached is None else attached.to_bytes()
            answer, values = self._answer(call, message, block)
            query.reply(
                query.key_expr, json.dumps(answer), attachment=values or None, express=True,
                encoding="application/json",
            )  # fmt: skip
        except BaseException as error:
            query.reply_err(json.dumps(message_of(error)), encoding="application/json")
        finally:
            query.drop()

    def _answer(
        self, call: str, message: dict[str, Any], block: bytes
    ) -> tuple[dict[str, object], bytes]:
        """Carry out a call; return the fields of its answer, and its block of numbers."""
        if call in ("describe", "instantiate"):
            token = message.get("token")
            self._admit(None, None, None, token if isinstance(token, str) else None)
        if call == "describe":
            return self._described(), b""
        if call == "instantiate":
            made = secrets.token_urlsafe(16)  # a secret: it replaces the token in later calls
            self._instances[made] = PythonComponent(self._class, str(message["path"]))
            return {"instance": made}, b""
        number = message.get("instance")
        if not isinstance(number, str) or number not in self._instances:
            raise InputInvalid(
                f"{self.name}: no instance {number!r}; the component was served again meanwhile"
            )
        component = self._instances[number]
        if call == "get_state":
            return {}, component.serialize_fmu_state(component.get_fmu_state())
        if call == "set_state":
            component.set_fmu_state(component.deserialize_fmu_state(block))
            return {}, b""
        values = message.get("values", {})
        inputs = component.description.of("input")
        if call == "step":
            times, numbers = np.frombuffer(block, "<f8", 2), np.frombuffer(block, "<f8", -1, 16)
            at = 0
            for v in inputs:
                part = numbers[at : at + v.size]
                component.set(v, part.reshape(v.shape) if v.shape else float(part[0]))
                at += v.size
            component.do_step(float(times[0]), float(times[1]))
            return {}, _outputs(component)
        for name, value in unpacked(values, block).items():
            component.set(component.description.variables[name], value)
        match call:
            case "set":
                return {}, b""
            case "enter":
                component.enter_initialization_mode(message["start"], message.get("stop"))
            case "exit":
                component.exit_initialization_mode()
            case "reset":
                component.reset()
            case "free":
                component.free()
                del self._instances[number]
                return {}, b""
            case _:
                raise InputInvalid(f"no call {call!r}")
        return {}, _outputs(component)

    def _described(self) -> dict[str, object]:
        """Return the answer to `describe`; whether the state can be copied is tried out."""
        variables = []
        for v in self._description.variables.values():
            start = {} if v.start is None else {"start": np.asarray(v.start).tolist()}
            variables.append(
                {
                    "name": v.name, "type": v.type, "causality": v.causality,
                    "variability": v.variability, "shape": list(v.shape), "unit": v.unit,
                    "description": v.description, "element_units": list(v.element_units), **start,
                }
            )  # fmt: skip
        fresh, can_copy_state = PythonComponent(self._class, self.name), True
        try:
            fresh.serialize_fmu_state(fresh.get_fmu_state())
        except FmuError:
            can_copy_state = False
        return {
            "name": self._description.name,
            "description": self._description.description,
            "protocol": PROTOCOL,
            "version": __version__,
            "variables": variables,
            "can_copy_state": can_copy_state,
        }


def _outputs(component: PythonComponent) -> bytes:
    parts = [np.ravel(component.get(v)) for v in component.description.of("output")]
    return np.concatenate(parts).astype("<f8").tobytes() if parts else b""
