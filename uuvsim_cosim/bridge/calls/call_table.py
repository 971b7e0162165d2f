"""The table of calls: the permission that each call needs, and the fields that it accepts.

TCP, HTTP and Zenoh look up each request here. The same request is therefore valid or invalid over
all of them, and is refused with the same message.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from uuvsim_cosim.bridge.calls.values import shown
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import did_you_mean

__all__ = ["CALLS", "LAG_MAX", "Call", "arguments", "checked", "read_object", "steps_of", "whole"]

STEPS_MAX = 1e12
LAG_MAX = 3600.0  # s
NAME_MAX = 64  # letters of a client's name


@dataclass(frozen=True)
class Field:
    """One field of a call: how its value is read, and whether it is required.

    `read` returns the value, or raises ValueError; `valid` checks what it returns. `expected`
    completes the error message. MATLAB's JSON writes a number that is not given as an empty list.
    """

    read: Callable[[object], object]
    expected: str
    required: bool = False
    valid: Callable[[Any], bool] = lambda value: True


@dataclass(frozen=True)
class Call:
    """One call: the permission that it needs, its fields, and the field that holds values."""

    needs: str | None = None
    fields: Mapping[str, Field] = field(default_factory=dict)
    values: str | None = None


def _names(value: object) -> list[str]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise ValueError
    return names


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError
    number = float(value)  # OverflowError for an integer beyond float64
    if not math.isfinite(number):
        raise ValueError
    return number


def _integer(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int | float) or value != int(value):
        raise ValueError
    return int(value)


def whole(value: object) -> int:
    """Return a number of communication steps; raises ValueError if the value is none."""
    count = _integer(value)
    if not 1 <= count <= STEPS_MAX:
        raise ValueError
    return count


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError
    return value


def _boolean(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError
    return value


def _values(value: object) -> dict[str, object]:
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise ValueError
    return dict(value)


NAMES = Field(_names, "a list of names")
VALUES = Field(_values, "an object of names and values")
NUMBER = Field(_number, "a number")
NAME = f"a text of 1 to {NAME_MAX} letters"

CALLS: dict[str, Call] = {
    "describe": Call(),
    "schema": Call(),
    "get": Call("read", {"names": NAMES}),
    "set": Call("set", {"values": Field(_values, VALUES.expected, required=True)}, "values"),
    "step": Call(
        "step",
        {
            "n": Field(whole, "a whole number of steps from 1"),
            "dt": NUMBER,
            "inputs": VALUES,
            "outputs": NAMES,
        },
        "inputs",
    ),
    "run": Call(
        "step",
        {
            "until": NUMBER,
            "duration": NUMBER,
            "factor": Field(_number, "a number more than 0"),
            "record": NAMES,
        },
    ),
    "pause": Call("step"),
    "reset": Call("step", {"seed": Field(_integer, "a whole number"), "start": VALUES}, "start"),
    "snapshot": Call("step"),
    "restore": Call("step", {"snapshot": Field(_text, "the name of a snapshot", required=True)}),
    "discard": Call("step", {"snapshot": Field(_text, "the name of a snapshot", required=True)}),
    "replace": Call(
        "manage",
        {
            "component": Field(_text, "the name of a component", required=True),
            "source": Field(_text, "a source, such as a file", required=True),
            "mapping": Field(
                _values,
                "an object of name: name",
                valid=lambda names: all(isinstance(name, str) for name in names.values()),
            ),
        },
    ),
    "dismiss": Call("manage", {"name": Field(_text, "a client's name", required=True)}),
    "join": Call(
        None,
        {
            "name": Field(_text, NAME, valid=lambda name: 0 < len(name) <= NAME_MAX),
            "lockstep": Field(
                lambda value: value, "true or false", valid=lambda v: isinstance(v, bool)
            ),
            "lag": Field(
                _number,
                f"seconds, more than 0 and at most {LAG_MAX:g}",
                valid=lambda lag: 0 < lag <= LAG_MAX,
            ),
        },
    ),
    "leave": Call(),
}
"""All calls. A field whose value is null counts as not given."""


def checked(name: object, request: Mapping[str, object]) -> dict[str, Any]:
    """Return the fields of a request, each converted to its type.

    Raises InputInvalid for an unknown call, an unknown or missing field, and a wrong value.
    """
    if not isinstance(name, str) or name not in CALLS:
        raise InputInvalid(
            f"call {shown(name)} does not exist{did_you_mean(str(name), CALLS)}",
            f"one of {', '.join(CALLS)}",
        )
    fields = CALLS[name].fields
    for given in request:
        if given not in fields:
            raise InputInvalid(
                name,
                f"field {shown(given)} does not exist{did_you_mean(given, fields)}",
                f"some of {', '.join(fields) or 'none'}",
            )
    found: dict[str, Any] = {}
    for key, expectation in fields.items():
        value = request.get(key)
        # For a list of names, an empty list is a value; for all other fields MATLAB means "none".
        empty = isinstance(value, list) and not value and expectation.read is not _names
        if value is None or empty:
            if expectation.required:
                raise InputInvalid(name, f"{key} is missing", expectation.expected)
            continue
        try:
            found[key] = expectation.read(value)
            if not expectation.valid(found[key]):
                raise ValueError
        except (ValueError, OverflowError):
            raise InputInvalid(
                name, f"{key} {shown(value)} was read", expectation.expected
            ) from None
    return found


def arguments(
    name: object,
    request: Mapping[str, object],
    tick: Callable[[], Fraction],
    now: Callable[[], int],
) -> tuple[Any, ...]:
    """Return the arguments of a call of the service, without the first one, which is the client.

    `tick` returns the communication step [s], `now` the current communication point. Raises
    InputInvalid as `checked` does, and for a time that is no multiple of the communication step.
    """
    found = checked(name, request)
    match name:
        case "get":
            return (found.get("names", []),)
        case "set":
            return (found["values"],)
        case "step":
            _one_of("step", found, "n", "dt")
            n = found.get("n", 1)
            if "dt" in found:
                n = steps_of(found["dt"], tick())
                if n == 0:
                    raise InputInvalid("step", "dt 0 was read", f"{float(tick()):g} s or more")
            return n, found.get("inputs", {}), found.get("outputs", [])
        case "run":
            _one_of("run", found, "until", "duration")
            until = found.get("until")
            if "duration" in found:
                until = float((now() + steps_of(found["duration"], tick())) * tick())
            return until, found.get("factor"), found.get("record", [])
        case "reset":
            return found.get("seed"), found.get("start", {})
        case "replace":
            return found["component"], found["source"], found.get("mapping")
    return tuple(found.values())


def _one_of(name: str, found: Mapping[str, object], one: str, other: str) -> None:
    if one in found and other in found:
        raise InputInvalid(name, f"both {one} and {other} were given", "one of them")


def steps_of(dt: float, tick: Fraction) -> int:
    """Return the number of communication steps in a time [s]; raises InputInvalid if not whole."""
    count = round(dt / tick) if abs(dt) < STEPS_MAX else 0
    if count < 0 or (count == 0 and dt != 0) or abs(count * float(tick) - dt) > 1e-9 + 1e-6 * tick:
        raise InputInvalid(
            f"dt = {dt:g} s was read",
            f"a whole multiple of the communication step, {float(tick):g} s",
        )
    return count


def read_object(data: bytes, what: str) -> dict[str, Any]:
    """Read a JSON object that a client sent; empty data is an empty object.

    Raises InputInvalid for other text, for NaN and infinity, which JSON does not have, and for a
    name that occurs twice in one object.
    """

    def no_constant(name: str) -> float:
        raise ValueError(f"{name} is no JSON")

    def once(pairs: list[tuple[str, object]]) -> dict[str, object]:
        found: dict[str, object] = {}
        for name, value in pairs:
            if name in found:
                raise ValueError(f"{name[:80]!r} is given twice")
            found[name] = value
        return found

    try:
        read = json.loads(data, parse_constant=no_constant, object_pairs_hook=once) if data else {}
    except (ValueError, RecursionError) as error:
        raise InputInvalid(what, f"not JSON ({error})", "a JSON object") from None
    if not isinstance(read, dict):
        raise InputInvalid(what, f"a JSON {type(read).__name__} was read", "an object")
    return read
