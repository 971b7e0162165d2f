"""A request as TCP and HTTP carry it becomes a call at the desk, and its result an answer."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any, TypeVar

from uuvsim_cosim.bridge.desk import Client, Desk, Moment, SignalInfo
from uuvsim_cosim.bridge.wire import Disconnected
from uuvsim_cosim.bridge.wire_values import find, json_of, near
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["CALLS", "Answer", "Calls", "failure", "steps_of", "whole"]

STEPS_MAX = 1e12
_LOOK = 0.2  # [s] between two looks whether who waits for steps is there still

_T = TypeVar("_T")


@dataclass(frozen=True)
class Answer:
    """What a call gives: words and numbers for the header, and values of variables."""

    header: Mapping[str, Any]
    values: Mapping[str, Any]


class Calls:
    """Carries requests of one client out at a desk; keeps the schema, which `replace` changes."""

    def __init__(self, desk: Desk, client: Client) -> None:
        self.desk = desk
        self.client = client
        self.schema: dict[str, SignalInfo] = {}
        self.tick = Fraction(0)
        self._asking = threading.local()
        self.refresh()

    def attended(self, gone: Callable[[], bool]) -> None:
        """Have the calls of this thread end once `gone` says that nobody waits for them."""
        self._asking.gone = gone

    def waited(self, call: str, *arguments: Any) -> Any:
        """Carry out a call that may take long; raises Disconnected if nobody waits any more."""
        gone, ask = getattr(self._asking, "gone", None), getattr(self.desk, "ask", None)
        if gone is None or ask is None:
            return getattr(self.desk, call)(self.client, *arguments)
        answer = ask(call, self.client, *arguments)
        while True:
            try:
                return answer.result(_LOOK)
            except TimeoutError:
                if answer.done():
                    raise
            if gone():
                self.desk.abandon(answer)  # type: ignore[attr-defined]
                raise Disconnected(f"{call}: who asked is gone")

    def refresh(self) -> None:
        """Read schema and tick anew."""
        self.schema = {info.name: info for info in self.desk.schema()}
        self.tick = Fraction(str(self.desk.describe()["tick"]))

    def knowing(self, work: Callable[[], _T]) -> _T:
        """Do what looks names up; once more if another client has replaced a component since."""
        try:
            return work()
        except InputInvalid:
            before = set(self.schema)
            self.refresh()
            if set(self.schema) == before:
                raise
            return work()

    def answer(self, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
        """Carry a request out; raises UuvsimError in words for what cannot be done."""
        name = request.get("call")
        if not isinstance(name, str) or name not in CALLS:
            raise InputInvalid(
                f"call {name!r} does not exist{near(str(name), CALLS)}; "
                f"expected one of {', '.join(CALLS)}"
            )
        call, fields = CALLS[name]
        for field in request:
            if field not in fields and field != "call":
                raise InputInvalid(
                    f"{name}: field {field!r} does not exist{near(field, fields)}; "
                    f"expected some of {', '.join(fields) or 'none'}"
                )
        if values and name not in ("set", "step", "reset"):
            raise InputInvalid(f"{name}: values were given; only set, step and reset take them")
        return call(self, request, values)


def steps_of(dt: float, tick: Fraction) -> int:
    """Give how many communication steps a time [s] is; raises InputInvalid if not whole."""
    count = round(dt / tick) if abs(dt) < STEPS_MAX else 0
    if count < 0 or (count == 0 and dt != 0) or abs(count * float(tick) - dt) > 1e-9 + 1e-6 * tick:
        raise InputInvalid(
            f"dt = {dt:g} s was read; expected a whole multiple of the communication step, "
            f"{float(tick):g} s"
        )
    return count


def whole(n: float) -> int:
    """Give a number of communication steps; raises InputInvalid if it is none."""
    if not 0 <= n <= STEPS_MAX or n != int(n):
        raise InputInvalid(f"n = {n:g} was read; expected a whole number of steps, not negative")
    return int(n)


def failure(error: BaseException) -> dict[str, Any]:
    """Give the answer that says what is wrong."""
    if isinstance(error, UuvsimError):
        return {"ok": False, "error": str(error), "kind": type(error).__name__}
    return {
        "ok": False,
        "error": f"unexpected {type(error).__name__}: {error}; this is a mistake in "
        "uuvsim-cosim, please report it with the output of `uuvsim doctor`",
        "kind": "Unexpected",
    }


def _at(moment: Moment) -> dict[str, Any]:
    return {"tick": moment.tick, "time": moment.time, "running": moment.running}


def _names(request: Mapping[str, Any], field: str) -> list[str]:
    read = request.get(field, [])
    read = [read] if isinstance(read, str) else read
    if not isinstance(read, list) or not all(isinstance(n, str) for n in read):
        raise InputInvalid(f"{field}: {read!r} was read; expected a list of names")
    return read


def _number(request: Mapping[str, Any], field: str) -> float | None:
    read = request.get(field)
    if read is None or read == []:
        return None
    if not isinstance(read, int | float) or isinstance(read, bool):
        raise InputInvalid(f"{field}: {read!r} was read; expected a number")
    return float(read)


def _text(request: Mapping[str, Any], field: str) -> str:
    read = request.get(field)
    if not isinstance(read, str):
        raise InputInvalid(f"{field}: {read!r} was read; expected a text")
    return read


def _describe(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    return Answer({"system": json_of(calls.desk.describe()), **_at(calls.desk.moment())}, {})


def _schema(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    calls.refresh()
    return Answer({"signals": [json_of(asdict(info)) for info in calls.schema.values()]}, {})


def _get(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    found = calls.desk.get(calls.client, _names(request, "names"))
    return Answer(_at(calls.desk.moment()), found)


def _set(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    return Answer(_at(calls.desk.set(calls.client, values)), {})


def _step(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    dt, n = _number(request, "dt"), _number(request, "n")
    if dt is not None and n is not None:
        raise InputInvalid("step: both n and dt were given; expected one of them")
    count = steps_of(dt, calls.tick) if dt is not None else 1 if n is None else whole(n)
    outputs = _names(request, "outputs")
    moment, found = calls.waited("step", count, values, outputs)
    return Answer(_at(moment), found)


def _run(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    until, duration = _number(request, "until"), _number(request, "duration")
    if until is not None and duration is not None:
        raise InputInvalid("run: both until and duration were given; expected one of them")
    if duration is not None:
        moment = calls.desk.moment()
        until = float((moment.tick + steps_of(duration, calls.tick)) * calls.tick)
    record = _names(request, "record")
    for name in record:
        find(calls.schema, name)
    found = calls.waited("run", until, _number(request, "factor"), record)
    return Answer(_at(calls.desk.moment()), found)


def _pause(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    return Answer(_at(calls.desk.pause(calls.client)), {})


def _reset(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    seed = _number(request, "seed")
    if seed is not None and not seed.is_integer():
        raise InputInvalid(f"seed: {seed!r} was read; expected a whole number")
    moment = calls.desk.reset(calls.client, None if seed is None else int(seed), values or None)
    return Answer(_at(moment), {})


def _snapshot(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    name = calls.desk.snapshot(calls.client)
    return Answer({"snapshot": name, **_at(calls.desk.moment())}, {})


def _restore(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    return Answer(_at(calls.desk.restore(calls.client, _text(request, "snapshot"))), {})


def _replace(calls: Calls, request: Mapping[str, Any], values: Mapping[str, Any]) -> Answer:
    mapping = request.get("mapping")
    if mapping is not None and not isinstance(mapping, dict):
        raise InputInvalid(f"mapping: {mapping!r} was read; expected an object of name: name")
    component, source = _text(request, "component"), _text(request, "source")
    moment = calls.desk.replace(calls.client, component, source, mapping)
    calls.refresh()
    return Answer(_at(moment), {})


_Call = Callable[[Calls, Mapping[str, Any], Mapping[str, Any]], Answer]

CALLS: dict[str, tuple[_Call, tuple[str, ...]]] = {
    "describe": (_describe, ()),
    "schema": (_schema, ()),
    "get": (_get, ("names",)),
    "set": (_set, ()),
    "step": (_step, ("n", "dt", "outputs")),
    "run": (_run, ("until", "duration", "factor", "record")),
    "pause": (_pause, ()),
    "reset": (_reset, ("seed",)),
    "snapshot": (_snapshot, ()),
    "restore": (_restore, ("snapshot",)),
    "replace": (_replace, ("component", "source", "mapping")),
}
"""Each call with the fields that it takes."""
