"""Services of a node: calls of the co-simulation, and its parameters, as ROS 2 asks for them.

A service is a queryable that answers whole queries. The calls are those of `bridge/calls`, with its
checks, so that a request is refused here with the same message as over any other transport.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from fractions import Fraction
from typing import Any, final

from uuvsim_cosim.bridge.calls.call_table import arguments
from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.bridge.ros2.ends import Ends
from uuvsim_cosim.bridge.ros2.interfaces import decoded
from uuvsim_cosim.bridge.ros2.parameters import Parameters
from uuvsim_cosim.bridge.ros2.rmw_zenoh import KEEP_10, attachment, read_attachment
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["NEEDED", "Services"]

_CLIENT = Client("ros2", "ros2", frozenset({"read", "set", "step"}))
# The permission that each service needs, if clients are known by their certificates.
NEEDED = {
    "reset": "step", "pause": "step", "resume": "step", "step": "step", "step_simulation": "step",
    "list_parameters": "read", "get_parameters": "read", "get_parameter_types": "read",
    "describe_parameters": "read", "set_parameters": "set", "set_parameters_atomically": "set",
}  # fmt: skip
_TRIGGER = "std_srvs/srv/Trigger"
_OK, _FAILED = 1, 4  # of simulation_interfaces/msg/Result
_Handle = Callable[[Any], dict[str, Any]]  # request -> fields of the response


@final
class Services:
    """The services of a node, named below it: ``/<node>/reset`` and so on.

    `factor` is the factor of real time at which `resume` runs the system.
    """

    def __init__(self, service: Service, ends: Ends, factor: float = 1.0) -> None:
        self._service, self._ends = service, ends
        parameters = Parameters(service, _CLIENT, ends.store)
        handled: dict[str, tuple[str, _Handle]] = {
            "reset": (_TRIGGER, self._trigger("reset")),
            "pause": (_TRIGGER, self._trigger("pause")),
            "resume": (_TRIGGER, self._trigger("run", factor=factor)),
            "step": (_TRIGGER, self._trigger("step")),
            "step_simulation": ("simulation_interfaces/srv/StepSimulation", self._steps),
            "list_parameters": ("rcl_interfaces/srv/ListParameters", parameters.list),
            "get_parameters": ("rcl_interfaces/srv/GetParameters", parameters.get),
            "get_parameter_types": ("rcl_interfaces/srv/GetParameterTypes", parameters.types),
            "describe_parameters": ("rcl_interfaces/srv/DescribeParameters", parameters.describe),
            "set_parameters": ("rcl_interfaces/srv/SetParameters", parameters.set),
            "set_parameters_atomically": (
                "rcl_interfaces/srv/SetParametersAtomically",
                parameters.set_atomically,
            ),
        }
        self.names = {f"/{ends.node.name}/{name}": type_ for name, (type_, _) in handled.items()}
        self._kept = [
            kept
            for name, (type_, handle) in handled.items()
            for kept in self._declared(f"/{ends.node.name}/{name}", type_, handle)
        ]

    def _declared(self, name: str, type_: str, handle: _Handle) -> tuple[object, object]:
        """Declare a service; its queryable and its token must be kept."""
        ends, key = self._ends, self._ends.key(name, type_)

        def answer(query: Any) -> None:
            with query:  # its client waits until it ends
                try:
                    number, gid = _numbered(query)
                    payload = b"" if query.payload is None else query.payload.to_bytes()
                    fields = handle(decoded(ends.store, f"{type_}_Request", payload))
                except UuvsimError as error:
                    expected = error.problems[0].expected
                    ends.reports.once(name, expected, f"{error}; such requests are refused")
                    query.reply_err(str(error).encode())
                    return
                response = ends.store.types[f"{type_}_Response"](**fields)
                data = bytes(ends.store.serialize_cdr(response, f"{type_}_Response"))
                query.reply(key, data, attachment=attachment(number, time.time_ns(), gid))

        queryable = ends.session.answer(key, answer, complete=True)
        return queryable, ends.session.token(ends.token("SS", name, type_, KEEP_10))

    def _call(self, name: str, **fields: object) -> None:
        made = arguments(name, fields, lambda: Fraction(0), lambda: self._service.moment().tick)
        self._service.ask(name, _CLIENT, *made).result()

    def _trigger(self, call: str, **fields: object) -> _Handle:
        def handle(_: Any) -> dict[str, Any]:
            try:
                self._call(call, **fields)
            except UuvsimError as error:
                return {"success": False, "message": str(error)}
            moment = self._service.moment()
            state = "runs" if moment.running or call == "run" else "is paused"
            return {"success": True, "message": f"{state} at t = {moment.time:.6g} s"}

        return handle

    def _steps(self, request: Any) -> dict[str, Any]:
        result, text = _OK, ""
        try:
            self._call("step", n=int(request.steps))
        except UuvsimError as error:
            result, text = _FAILED, str(error)
        made = self._ends.store.types["simulation_interfaces/msg/Result"]
        return {"result": made(result=result, error_message=text)}


def _numbered(query: Any) -> tuple[int, bytes]:
    """Return the number of a request, and the GID of its client."""
    given = b"" if query.attachment is None else query.attachment.to_bytes()
    if (read := read_attachment(given)) is None:
        raise InputInvalid(
            f"a request with an attachment of {len(given)} bytes", "33: number, time and GID"
        )
    return read[0], read[2]
