"""Runs an FMU by FMPy and writes findings as JSON: `check_fmu` starts this in its own process."""

from __future__ import annotations

import csv
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.model_description import element_names
from uuvsim_cosim.fmus.read_description import FmuArchive, read_fmu

__all__ = ["trial"]

TOLERANCE = 1e-9  # of the reference result, relative to the largest value of its column
STEPS = 5
_NUMERIC = ("Float64", "Int32", "Boolean")

Entry = dict[str, str]


def trial(path: Path) -> list[Entry]:
    """Run the FMU in three ways; each doubt is one entry."""
    fmu = read_fmu(path)
    messages: list[str] = []
    findings: list[Entry] = []
    exchange = fmu.interface == "ModelExchange"
    looks = (("run", _run), ("state", _state_of_exchange if exchange else _state),
             *(() if exchange else (("reference", _reference),)))  # fmt: skip
    for name, look in looks:
        try:
            findings += [{"check": name, "text": text} for text in look(fmu, messages)]
        except Exception as error:  # whatever FMPy makes of the FMU's status
            words = " | ".join([str(error), *messages[-3:]])
            findings.append({"check": name, "text": words})
            break
    return findings


def _run(fmu: FmuArchive, messages: list[str]) -> Iterator[str]:
    """Simulate with the start values."""
    import fmpy

    result = fmpy.simulate_fmu(
        str(fmu.path), validate=False, timeout=60.0, logger=_collector(messages)
    )
    for name in result.dtype.names:
        values = np.asarray(result[name], dtype=float).reshape(len(result), -1)
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if bad.size:
            yield f"output {name!r} is not finite from t = {result['time'][bad[0]]:.9g} s on"


def _state(fmu: FmuArchive, messages: list[str]) -> Iterator[str]:
    """Repeat a step from a state that was serialized."""
    description = fmu.description
    if not (description.can_get_and_set_state and description.can_serialize_state):
        return
    h = description.default_step_size or 0.01
    with _instance(fmu, messages) as x:
        _start(x, {})
        for k in range(STEPS):
            x.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
        state = _call(x, "getFMUState")
        data = _call(x, "serializeFMUState", state)
        _call(x, "freeFMUState", state)
        runs = []
        for again in (False, True):
            if again:
                state = _call(x, "deserializeFMUState", data)
                _call(x, "setFMUState", state)
                _call(x, "freeFMUState", state)
            for k in range(STEPS, 2 * STEPS):
                x.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
            runs.append(_read(x, description))
        for name, value in runs[0].items():
            if not np.array_equal(value, runs[1][name], equal_nan=True):
                yield f"output {name!r} differs after the state was restored"


def _state_of_exchange(fmu: FmuArchive, messages: list[str]) -> Iterator[str]:
    """Repeat a step from a state, where the master integrates."""
    description = fmu.description
    if not description.can_get_and_set_state:
        return
    h = description.default_step_size or 0.01
    x = instantiate_fmu(fmu, "trial")
    try:
        x.enter_initialization_mode(0.0, None)
        x.exit_initialization_mode()
        x.do_step(0.0, h)
        state = x.get_fmu_state()
        runs = []
        for again in (False, True):
            if again:
                x.set_fmu_state(state)
            x.do_step(h, h)
            runs.append({v.name: np.asarray(x.get(v)) for v in description.of("output")})
        for name, value in runs[0].items():
            if not np.array_equal(value, runs[1][name]):
                yield f"output {name!r} differs after the state was restored"
    finally:
        messages += [text for _, text in getattr(x, "messages", [])]
        x.free()


def _reference(fmu: FmuArchive, messages: list[str]) -> Iterator[str]:
    """Repeat the reference result inside."""
    folder = fmu.folder / "documentation"
    if not ((folder / "input.csv").is_file() and (folder / "reference.csv").is_file()):
        return
    given, expected = _table(folder / "input.csv"), _table(folder / "reference.csv")
    description = fmu.description
    outputs = [v for v in description.of("output") if v.type in _NUMERIC]
    scale = {n: max(1e-12, float(np.max(np.abs(c)))) for n, c in expected.items()}
    h = float(given["time"][1])
    worst: dict[str, tuple[float, float]] = {}
    row = 0
    with _instance(fmu, messages) as x:
        for k, t in enumerate(given["time"]):
            if k == 0:
                _start(x, _elements(description, given, 0))
            else:
                _set(x, _elements(description, given, k))
            x.doStep(currentCommunicationPoint=float(t), communicationStepSize=h)
            if row < len(expected["time"]) and abs(t + h - expected["time"][row]) < 0.5 * h:
                values = _read(x, description)
                for v in outputs:
                    for name, value in zip(element_names(v), values[v.name].ravel(), strict=True):
                        error = abs(float(value) - float(expected[name][row])) / scale[name]
                        if not error <= max(TOLERANCE, worst.get(name, (0.0, 0.0))[0]):
                            worst[name] = (error, float(t + h))
                row += 1
    for name, (error, t) in worst.items():
        yield f"output {name!r} is off by {error:.3g} of its range at t = {t:.9g} s"


# ---- FMPy ---------------------------------------------------------------------------------


def _collector(messages: list[str]) -> Any:
    def collect(*arguments: Any) -> None:
        text = arguments[-1]
        messages.append(text.decode(errors="replace") if isinstance(text, bytes) else str(text))

    return collect


@contextmanager
def _instance(fmu: FmuArchive, messages: list[str]) -> Iterator[Any]:
    from fmpy.model_description import read_model_description
    from fmpy.simulation import instantiate_fmu

    md = read_model_description(str(fmu.folder), validate=False)
    x = instantiate_fmu(str(fmu.folder), md, "CoSimulation", logger=_collector(messages))
    try:
        yield x
    finally:
        x.freeInstance()


def _start(x: Any, elements: Mapping[str, tuple[Variable, Any]]) -> None:
    two = hasattr(x, "setupExperiment")
    if two:
        x.setupExperiment(startTime=0.0)
    x.enterInitializationMode()
    _set(x, elements)
    x.exitInitializationMode()


def _call(x: Any, name: str, *arguments: Any) -> Any:
    """Call a function by its FMI 3 name; FMPy's FMI 2 class spells some differently."""
    spellings = {
        "getFMUState": "getFMUstate",
        "setFMUState": "setFMUstate",
        "freeFMUState": "freeFMUstate",
        "serializeFMUState": "serializeFMUstate",
        "deserializeFMUState": "deSerializeFMUstate",
    }
    return getattr(x, name if hasattr(x, name) else spellings[name])(*arguments)


def _elements(
    description: Description, table: Mapping[str, np.ndarray], row: int
) -> dict[str, tuple[Variable, Any]]:
    return {
        v.name: (v, [table[n][row].item() for n in element_names(v)])
        for v in description.of("input")
        if element_names(v)[0] in table
    }


def _set(x: Any, elements: Mapping[str, tuple[Variable, Any]]) -> None:
    for v, values in elements.values():
        cast = {"Float64": float, "Int32": int, "Boolean": bool}[v.type]
        getattr(x, "set" + _type(x, v))(list(v.value_references), [cast(e) for e in values])


def _read(x: Any, description: Description) -> dict[str, np.ndarray]:
    values = {}
    for v in description.of("output"):
        if v.type in _NUMERIC:
            get = getattr(x, "get" + _type(x, v))
            three = hasattr(x, "getFloat64")
            flat = get(list(v.value_references), *([v.size] if three else []))
            values[v.name] = np.array(flat, dtype=float)
    return values


def _type(x: Any, v: Variable) -> str:
    if hasattr(x, "getFloat64"):
        return v.type
    return {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}[v.type]


def _table(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="") as file:
        names, *rows = list(csv.reader(file))
    columns = np.array([[float(cell) for cell in row] for row in rows])
    return {name: columns[:, i] for i, name in enumerate(names)}


def main() -> None:
    """Write the findings of one FMU as the last line of the standard output."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(sys.argv[1]).resolve()
        os.chdir(scratch)  # for FMUs that write where they are
        findings = trial(path)
        os.chdir("/")
    sys.stdout.write("\n" + json.dumps(findings) + "\n")


if __name__ == "__main__":
    main()
