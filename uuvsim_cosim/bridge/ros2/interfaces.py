"""Services of ROS 2: their definitions, which rosbags lacks, and their type hashes.

A service is three messages: request, response and event. The hash of its type (REP 2011) is that of
a structure of these three. The definitions are those of std_srvs, rcl_interfaces,
simulation_interfaces and service_msgs (Apache-2.0), without comments and default values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["add_service", "decoded", "with_services"]

_MESSAGES = {
    "service_msgs/msg/ServiceEventInfo": "uint8 event_type\nbuiltin_interfaces/Time stamp\n"
    "uint8[16] client_gid\nint64 sequence_number\n",  # rosbags 0.11.9 has char[16]
    "simulation_interfaces/msg/Result": "uint8 result\nstring error_message\n",
}
_SERVICES = {
    "std_srvs/srv/Trigger": ("", "bool success\nstring message\n"),
    "simulation_interfaces/srv/StepSimulation": ("uint64 steps\n", "Result result\n"),
    "rcl_interfaces/srv/ListParameters": (
        "string[] prefixes\nuint64 depth\n",
        "ListParametersResult result\n",
    ),
    "rcl_interfaces/srv/GetParameters": ("string[] names\n", "ParameterValue[] values\n"),
    "rcl_interfaces/srv/GetParameterTypes": ("string[] names\n", "uint8[] types\n"),
    "rcl_interfaces/srv/DescribeParameters": (
        "string[] names\n",
        "ParameterDescriptor[] descriptors\n",
    ),
    "rcl_interfaces/srv/SetParameters": (
        "Parameter[] parameters\n",
        "SetParametersResult[] results\n",
    ),
    "rcl_interfaces/srv/SetParametersAtomically": (
        "Parameter[] parameters\n",
        "SetParametersResult result\n",
    ),
}
_NOTHING = "uint8 structure_needs_at_least_one_member\n"  # ROS has no empty message


def with_services(store: Typestore) -> Typestore:
    """Add the services of the node to a store of messages, and return it.

    The request of a service `s` becomes the type ``s_Request``, its response ``s_Response``. The
    hash of `s` is that of the service.
    """
    for type_, text in _MESSAGES.items():
        store.fielddefs.pop(type_, None)
        store.cache.pop(type_, None)
        _register(store, type_, text)
    for type_, (request, response) in _SERVICES.items():
        add_service(store, type_, request, response)
    return store


def add_service(store: Typestore, type_: str, request: str, response: str) -> None:
    """Add a service by the definitions of its request and response, such as ``int64 a``."""
    _register(store, f"{type_}_Request", request or _NOTHING)
    _register(store, f"{type_}_Response", response or _NOTHING)
    _register(
        store,
        f"{type_}_Event",
        f"service_msgs/ServiceEventInfo info\n{type_}_Request[<=1] request\n"
        f"{type_}_Response[<=1] response\n",
    )
    _register(
        store,
        type_,
        f"{type_}_Request request_message\n{type_}_Response response_message\n"
        f"{type_}_Event event_message\n",
    )


def decoded(store: Typestore, type_: str, data: bytes) -> Any:
    """Return the message that bytes hold; raises InputInvalid for bytes that hold none."""
    try:
        return store.deserialize_cdr(data, type_)
    except Exception as error:  # rosbags raises no class of its own for bytes that are cut off
        reason = str(error) or type(error).__name__
        raise InputInvalid(
            f"{len(data)} bytes that are no {type_} ({reason})", "a whole message in CDR"
        ) from None


def _register(store: Typestore, type_: str, definition: str) -> None:
    """Register a message by its definition; names without a package mean that of the type."""
    from rosbags.typesys import get_types_from_msg

    package = type_.split("/", 1)[0]
    [(constants, fields)] = get_types_from_msg(definition, f"{package}/msg/X").values()
    store.register({type_: (constants, [(name, _field(node)) for name, node in fields])})


def _field(node: Any) -> Any:
    """Return a field whose type is part of a service, which rosbags takes for a message."""
    kind, detail = node
    if kind.name == "NAME":
        package, *rest = detail.split("/")
        return kind, f"{package}/srv/{rest[-1]}" if "srv" in rest else detail
    if kind.name in ("ARRAY", "SEQUENCE"):
        return kind, (_field(detail[0]), detail[1])
    return node
