"""Parameters of a system as those of a ROS 2 node: listed, described, read and set.

The name of a parameter is that of the signal, ``controller.Kp``. An array is a list of its elements
row by row. Values have the project's units and frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from uuvsim_cosim.bridge.calls.service import Client, Service, SignalInfo
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.declaration.near_names import expected_names

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["Parameters"]

_NOT_SET, _BOOL, _INTEGER, _DOUBLE, _STRING = range(5)
_ARRAY = 5  # added to a type: BOOL_ARRAY is 6, and so on
_FIELDS = {
    _BOOL: "bool_value",
    _INTEGER: "integer_value",
    _DOUBLE: "double_value",
    _STRING: "string_value",
    _BOOL + _ARRAY: "bool_array_value",
    _INTEGER + _ARRAY: "integer_array_value",
    _DOUBLE + _ARRAY: "double_array_value",
    _STRING + _ARRAY: "string_array_value",
}
_DTYPES: dict[int, Any] = {_BOOL + _ARRAY: bool, _INTEGER + _ARRAY: "i8", _DOUBLE + _ARRAY: "f8"}
_NAMES = {
    _BOOL: "bool", _INTEGER: "integer", _DOUBLE: "double", _STRING: "string", _BOOL + 5: "bool[]",
    _INTEGER + 5: "integer[]", _DOUBLE + 5: "double[]", _STRING + 5: "string[]", 5: "byte[]",
    _NOT_SET: "not set",
}  # fmt: skip
_MSG = "rcl_interfaces/msg/"


@final
class Parameters:
    """The answers of a node's parameter services."""

    def __init__(self, service: Service, client: Client, store: Typestore) -> None:
        self._service, self._client, self._types = service, client, store.types

    def list(self, request: Any) -> dict[str, Any]:
        """List the names below prefixes, `depth` levels deep (0: all)."""
        prefixes, depth = list(request.prefixes), int(request.depth)
        names = [n for n in self._known if _is_listed(n, prefixes, depth)]
        above = sorted({n.rpartition(".")[0] for n in names} - {""})
        result = self._types[f"{_MSG}ListParametersResult"]
        return {"result": result(names=names, prefixes=above)}

    def get(self, request: Any) -> dict[str, Any]:
        """Read values; a parameter that does not exist is not set."""
        known = self._known
        there = [name for name in request.names if name in known]
        values = self._service.get(self._client, there)
        return {
            "values": [
                self._value(known[name], values[name]) if name in values else self._empty()
                for name in request.names
            ]
        }

    def types(self, request: Any) -> dict[str, Any]:
        """Return the types."""
        known = self._known
        types = [_type(known[n]) if n in known else _NOT_SET for n in request.names]
        return {"types": np.array(types, np.uint8)}

    def describe(self, request: Any) -> dict[str, Any]:
        """Describe parameters: type, unit, and whether they can be set."""
        known, made = self._known, self._types[f"{_MSG}ParameterDescriptor"]
        return {
            "descriptors": [
                made(
                    name=name,
                    type=_type(info) if (info := known.get(name)) else _NOT_SET,
                    description=info.description if info else "",
                    additional_constraints=_constraints(info) if info else "",
                    read_only=not info.settable if info else False,
                    dynamic_typing=False,
                    floating_point_range=[],
                    integer_range=[],
                )
                for name in request.names
            ]
        }

    def set(self, request: Any) -> dict[str, Any]:
        """Set parameters one by one; each has its own result."""
        return {"results": [self._result([one]) for one in request.parameters]}

    def set_atomically(self, request: Any) -> dict[str, Any]:
        """Set all parameters or none."""
        return {"result": self._result(request.parameters)}

    @property
    def _known(self) -> Mapping[str, SignalInfo]:
        schema = self._service.schema()
        return {
            info.name: info
            for info in schema
            if info.causality == "parameter" and _type(info) != _NOT_SET
        }

    def _result(self, given: Sequence[Any]) -> Any:
        made = self._types[f"{_MSG}SetParametersResult"]
        try:
            known = self._known
            values = {one.name: _read(known, one.name, one.value) for one in given}
            self._service.set(self._client, values)
        except UuvsimError as error:
            return made(successful=False, reason=str(error))
        return made(successful=True, reason="")

    def _value(self, info: SignalInfo, value: Any) -> Any:
        made, type_ = self._empty(), _type(info)
        made.type = type_
        flat = np.ravel(value)
        if type_ in _DTYPES:
            setattr(made, _FIELDS[type_], flat.astype(_DTYPES[type_]))
        elif type_ > _ARRAY:
            setattr(made, _FIELDS[type_], [str(v) for v in flat])
        else:
            setattr(made, _FIELDS[type_], (bool, int, float, str)[type_ - 1](flat[0]))
        return made

    def _empty(self) -> Any:
        return self._types[f"{_MSG}ParameterValue"](
            type=_NOT_SET, bool_value=False, integer_value=0, double_value=0.0, string_value="",
            byte_array_value=np.zeros(0, np.uint8), bool_array_value=np.zeros(0, bool),
            integer_array_value=np.zeros(0, "i8"), double_array_value=np.zeros(0),
            string_array_value=[],
        )  # fmt: skip


def _type(info: SignalInfo) -> int:
    """Return the type of a parameter; binary data has none."""
    if info.type in ("Binary", "Clock"):
        return _NOT_SET
    if info.type.startswith("Float"):
        scalar = _DOUBLE
    else:
        scalar = {"Boolean": _BOOL, "String": _STRING}.get(info.type, _INTEGER)
    return scalar + _ARRAY if info.shape else scalar


def _constraints(info: SignalInfo) -> str:
    shape = f"{' x '.join(map(str, info.shape))} elements, row by row; " if info.shape else ""
    return f"{shape}unit {info.unit}"


def _is_listed(name: str, prefixes: Sequence[str], depth: int) -> bool:
    if not prefixes:
        return depth == 0 or name.count(".") < depth
    return any(
        name == prefix
        or (name.startswith(f"{prefix}.")
            and (depth == 0 or name[len(prefix) + 1 :].count(".") < depth))
        for prefix in prefixes
    )  # fmt: skip


def _read(known: Mapping[str, SignalInfo], name: str, value: Any) -> object:
    """Return a value for `set`; raises InputInvalid for a name or a type that does not fit."""
    if (info := known.get(name)) is None:
        raise InputInvalid(f"no parameter {name[:80]!r}", expected_names(name, sorted(known)))
    type_, given = _type(info), int(value.type)
    as_integer = {_DOUBLE: _INTEGER, _DOUBLE + _ARRAY: _INTEGER + _ARRAY}.get(type_)
    if given not in (type_, as_integer):
        raise InputInvalid(
            name, f"a value of type {_NAMES.get(given, given)}", f"type {_NAMES[type_]}"
        )
    read = getattr(value, _FIELDS[given])
    if not info.shape:
        return read
    array = np.asarray(read)
    size = int(np.prod(info.shape, dtype=int))
    if array.size != size:
        raise InputInvalid(name, f"{array.size} elements", f"{size}, in {_constraints(info)}")
    return array.reshape(info.shape)
