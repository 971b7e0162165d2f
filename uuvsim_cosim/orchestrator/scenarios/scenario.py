"""Scenarios: changes and faults at given times of a run, as values and as YAML or JSON files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.files_read import noted
from uuvsim_cosim.models.declaration.parameter_files import line_of, read_yaml
from uuvsim_cosim.orchestrator.master.faults import Fault

__all__ = [
    "Change",
    "Event",
    "Manipulation",
    "Scenario",
    "SignalFault",
    "changes_text",
    "read_scenario",
    "recorded_scenario",
    "scenario_of_record",
]


@dataclass(frozen=True)
class Change:
    """At time `at` [s] a tunable parameter or an unconnected input gets a value, in its unit."""

    at: float
    variable: str
    value: object


@dataclass(frozen=True)
class SignalFault:
    """From `at` to `until` [s] a signal is faulty: at the communication points in [at, until)."""

    at: float
    fault: Fault
    until: float = math.inf


@dataclass(frozen=True)
class Manipulation:
    """From `at` to `until` [s] a variable of any causality is overridden, or biased.

    Its meaning depends on the system (see `played.events_of`): a fault of an output, a change of a
    parameter or an unconnected input, a fault of the output that feeds a connected input.
    """

    at: float
    variable: str
    kind: Literal["override", "bias"]
    value: float
    until: float = math.inf


Event = Change | SignalFault | Manipulation


@dataclass(frozen=True)
class Scenario:
    """Events in any order; events of the same time are applied in the order of the list.

    `end` [s] is the end of a run if the run itself has none.
    """

    name: str
    events: tuple[Event, ...]
    description: str = ""
    end: float | None = None


_BEGIN, _ITEM = "events:\n", "- "
_LIBCOSIM: dict[str, Literal["override", "bias"]] = {"override": "override", "bias": "bias"}


def read_scenario(path: str | Path) -> Scenario:
    """Read a scenario; raises InputInvalid with every mistake and its line."""
    path = Path(path)
    if not path.is_file():
        raise InputInvalid(path, "no such file", "a scenario, .yaml or .json")
    if path.suffix.lower() == ".json":
        return _libcosim(path)
    if (changes := _changes_alone(path)) is not None:
        return Scenario(path.stem, changes)
    data = read_yaml(path, "scenario.schema.json")
    events: list[Change | SignalFault] = []
    wrong: list[str] = []
    for i, item in enumerate(data["events"]):
        try:
            events.append(_event(item))
        except InputInvalid as error:
            wrong.append(f"{path}:{line_of(data, ['events', i])}: event {i + 1}: {error}")
    if wrong:
        raise InputInvalid.of(wrong)
    return Scenario(
        str(data.get("name", path.stem)), tuple(events), str(data.get("description", ""))
    )


def changes_text(changes: Iterable[Change], *, begins: bool = False) -> str:
    """Return changes as lines of a scenario's file, each a JSON object; `begins` it with its key.

    Files of nothing else are read without a YAML library, which needs 0.7 ms for each event.
    """
    items = ({"at": c.at, "set": c.variable, "value": c.value} for c in changes)
    return (_BEGIN if begins else "") + "".join(f"{_ITEM}{json.dumps(i)}\n" for i in items)


def _changes_alone(path: Path) -> tuple[Change, ...] | None:
    """Return the changes of a file as `changes_text` writes it; None for all other files."""
    try:
        with noted(path).open(encoding="utf-8") as file:
            if next(file, "") != _BEGIN:
                return None
            lines = list(file)
        if not all(line.startswith(_ITEM) for line in lines):
            return None
        items = json.loads(f"[{','.join(line.removeprefix(_ITEM) for line in lines)}]")
        if not all(_is_change(item) for item in items):
            return None
    except (OSError, ValueError):
        return None
    return tuple(Change(float(i["at"]), i["set"], i["value"]) for i in items)


def _is_change(item: Any) -> bool:
    return (
        isinstance(item, dict)
        and item.keys() == {"at", "set", "value"}
        and type(item["at"]) in (int, float)
        and 0.0 <= item["at"] < math.inf
        and isinstance(item["set"], str)
    )


def recorded_scenario(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario for run.json; `scenario_of_record` reads it."""
    events = []
    for e in scenario.events:
        item: dict[str, Any] = {"at": e.at}
        if isinstance(e, Change):
            item |= {"set": e.variable, "value": e.value}
        elif isinstance(e, SignalFault):
            item |= {"signal": e.fault.signal, "fault": e.fault.kind, "value": e.fault.value}
        else:
            item |= {"variable": e.variable, "action": e.kind, "value": e.value}
        if not isinstance(e, Change) and math.isfinite(e.until):
            item["until"] = e.until
        events.append(item)
    return {"name": scenario.name, "events": events}


def scenario_of_record(record: Mapping[str, Any]) -> Scenario:
    """Return the scenario that `recorded_scenario` has written."""
    events = tuple(
        Manipulation(
            float(item["at"]), item["variable"], item["action"], float(item["value"]),
            float(item.get("until", math.inf)),
        )
        if "variable" in item
        else _event(item)
        for item in record["events"]
    )  # fmt: skip
    return Scenario(str(record["name"]), events)


def _event(item: Mapping[str, Any]) -> Change | SignalFault:
    """Read an event of a YAML file; raises InputInvalid."""
    at = float(item["at"])
    if "set" in item and "signal" not in item:
        extra = [k for k in ("fault", "until") if k in item]
        if extra or "value" not in item:
            read = f"set with {extra[0]}" if extra else "set without value"
            raise InputInvalid(read, "at, set and value")
        return Change(at, str(item["set"]), _plain(item["value"]))
    if "signal" not in item or "fault" not in item or "set" in item:
        raise InputInvalid(
            ", ".join(item), "set with value, or signal with fault (and value, until)"
        )
    value = item.get("value", 0.0 if item["fault"] == "freeze" else None)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputInvalid(f"value {value!r}", f"a number for the fault {item['fault']}")
    fault = Fault(str(item["signal"]), item["fault"], float(value))
    return SignalFault(at, fault, float(item.get("until", math.inf)))


def _plain(value: object) -> object:
    """Return numbers, texts and plain lists; those of the YAML library know their lines."""
    return [_plain(v) for v in value] if isinstance(value, list) else value


def _libcosim(path: Path) -> Scenario:
    """Read libcosim's form: overrides and biases of variables of models, each until a reset.

    A new event of a variable ends the one before it.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputInvalid(f"{path}: cannot be read as JSON: {error}") from None
    items = data.get("events") if isinstance(data, dict) else None
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise InputInvalid(path, "no list of events", "a scenario of libcosim")
    given: list[tuple[str, Manipulation]] = []  # action, and an event without its end
    for i, item in enumerate(items, start=1):
        event, place = {**data.get("defaults", {}), **item}, f"{path}: event {i}"
        missing = [k for k in ("time", "model", "variable", "action") if k not in event]
        action = event.get("action")
        if missing or action not in (*_LIBCOSIM, "reset"):
            read = f"without {missing[0]}" if missing else f"action {action!r}"
            raise InputInvalid(
                f"{place} {read}", "time, model, variable and action (override, bias or reset)"
            )
        at = _seconds(event["time"], f"{place}: time")
        value = event.get("value", 0.0 if action == "reset" else None)
        if not isinstance(value, int | float):
            raise InputInvalid(place, f"value {value!r}", "a number or a Boolean")
        variable, kind = f"{event['model']}.{event['variable']}", _LIBCOSIM.get(action, "override")
        given.append((action, Manipulation(at, variable, kind, float(value))))
    open_: dict[str, Manipulation] = {}
    events: list[Manipulation] = []
    for action, new in sorted(given, key=lambda g: g[1].at):
        begun = open_.pop(new.variable, None)
        if begun is not None and new.at > begun.at:
            events.append(replace(begun, until=new.at))
        if action != "reset":
            open_[new.variable] = new
    end = data.get("end")
    return Scenario(
        path.stem,
        (*events, *open_.values()),
        str(data.get("description", "")),
        None if end is None else _seconds(end, f"{path}: end"),
    )


def _seconds(value: object, place: str) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise InputInvalid(f"{place} {value!r}", "seconds")
