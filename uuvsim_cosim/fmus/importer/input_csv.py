"""Inputs over time, read from CSV or from arrays; errors name the line and the column."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.fmus.values import parse_value
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Series", "apply_series", "find_element", "read_input_csv", "series_of"]


@dataclass(frozen=True)
class Series:
    """One element of an input over time; `element` is its flat index, row by row."""

    variable: Variable
    element: int
    time: np.ndarray
    values: np.ndarray

    def at(self, t: float) -> Any:
        """Return the value at a time: interpolated linearly if continuous, else that before.

        Before the first and after the last sample, the value is constant. Of two samples at one
        time, the later one is used. A time that differs from a sample's by rounding is that of the
        sample.
        """
        # k h is not always the number that a file has for it: 3 * 0.1 is above 0.3.
        rounding = 8.0 * float(np.spacing(abs(t)))
        i = int(np.searchsorted(self.time, t + rounding, side="right")) - 1
        if i < 0:
            return self.values[0]
        if self.variable.variability != "continuous" or i + 1 >= self.time.size:
            return self.values[i]
        if t <= self.time[i] + rounding:
            return self.values[i]
        fraction = (t - self.time[i]) / (self.time[i + 1] - self.time[i])
        return (1 - fraction) * self.values[i] + fraction * self.values[i + 1]


def find_element(variables: Sequence[Variable], name: str, place: str) -> tuple[Variable, int]:
    """Find a scalar, or one element of an array, by name; raises InputInvalid."""
    names: list[str] = []
    wanted = name.replace(" ", "")
    for variable in variables:
        elements = variable.element_names
        if wanted in elements:
            return variable, elements.index(wanted)
        names += elements
    raise InputInvalid(place, f"unknown name {name!r}", expected_names(name, names))


def read_input_csv(path: Path, description: Description) -> list[Series]:
    """Read a table whose first column is the time [s] and whose others are inputs.

    Raises InputInvalid that names the file, the line and the column.
    """
    rows = _rows(path)
    if not rows:
        raise InputInvalid(path, "is empty", "a header line: time and names of inputs")
    line, header = rows[0]
    if header[0].strip().lower() not in ("time", "t"):
        hint = " (columns are separated by commas)" if len(header) == 1 else ""
        raise InputInvalid(f"{path}, line {line}, column 1", f"{header[0]!r}", f"'time'{hint}")
    names = [name.strip() for name in header]
    inputs = description.of("input")
    targets = [
        find_element(inputs, name, f"{path}, line {line}, column {c}")
        for c, name in enumerate(names[1:], 2)
    ]
    repeated = next((n for i, n in enumerate(names) if n in names[:i]), None)
    if repeated is not None:
        raise InputInvalid(f"{path}, line {line}: column {repeated!r} is given twice")
    if len(rows) == 1:
        raise InputInvalid(path, "has no line after the header", "at least one")
    return _series(path, rows[1:], names, targets)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputInvalid(
            path, f"cannot be read ({error.strerror})", "a CSV of inputs over time"
        ) from None
    except UnicodeDecodeError:
        raise InputInvalid(path, "is not UTF-8 text", "CSV") from None
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputInvalid(f"{path}, line {reader.line_num}", error, "CSV") from None


def _series(
    path: Path,
    rows: list[tuple[int, list[str]]],
    names: list[str],
    targets: list[tuple[Variable, int]],
) -> list[Series]:
    """Read the rows after the header; each target is an element of an input."""
    time = np.empty(len(rows))
    columns: list[list[object]] = [[] for _ in targets]
    for k, (line, row) in enumerate(rows):
        if len(row) != len(names):
            raise InputInvalid(f"{path}, line {line}", f"{len(row)} cells", len(names))
        time[k] = _number(row[0], f"{path}, line {line}, column 1 (time)")
        if k and time[k] < time[k - 1]:
            raise InputInvalid(
                f"{path}, line {line}, column 1 (time)",
                f"{time[k]:g} s after {time[k - 1]:g} s",
                "times that do not decrease",
            )
        for c, (variable, _) in enumerate(targets):
            place = f"{path}, line {line}, column {c + 2} ({names[c + 1]})"
            if variable.type in ("Float64", "Float32"):
                columns[c].append(_number(row[c + 1], place))
                continue
            try:
                columns[c].append(parse_value(replace(variable, shape=()), row[c + 1], place))
            except ParameterInvalid as error:
                raise InputInvalid(str(error)) from None
    return [
        Series(variable, element, time, np.array(column, dtype=DTYPES[variable.type]))
        for (variable, element), column in zip(targets, columns, strict=True)
    ]


def _number(text: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputInvalid(place, f"{text!r}", "a finite number")
    return value


def series_of(columns: Mapping[str, Any], description: Description) -> list[Series]:
    """Read a mapping of arrays, one of them ``time``; arrays of vectors are (samples, n)."""
    time = np.asarray(columns["time"], dtype=float).ravel()
    if time.size == 0 or not np.all(np.isfinite(time)) or np.any(np.diff(time) < 0):
        raise InputInvalid("inputs: times must be finite, at least one, and not decrease")
    inputs = {v.name: v for v in description.of("input")}
    result: list[Series] = []
    for name, given in columns.items():
        if name == "time":
            continue
        if name in inputs:
            chosen = [(inputs[name], e) for e in range(inputs[name].size)]
        else:
            chosen = [find_element(list(inputs.values()), name, "inputs")]
        values = np.asarray(given)
        if values.dtype.kind in "fO" and DTYPES[chosen[0][0].type] is not np.object_:
            # NumPy would convert large integers to floats.
            whole = np.asarray(given, dtype=object)
            if all(isinstance(x, (int, np.integer)) for x in whole.ravel()):
                values = whole
        if values.size != time.size * len(chosen):
            raise InputInvalid(
                "inputs",
                f"{name!r} has shape {values.shape}",
                f"{len(chosen)} values at each of {time.size} times",
            )
        table = values.reshape(time.size, len(chosen))
        result += [Series(v, e, time, table[:, i]) for i, (v, e) in enumerate(chosen)]
    return result


def apply_series(component: Component, series: Iterable[Series], t: float) -> None:
    """Set the inputs that have a series; elements of an array without one keep their values."""
    groups: dict[str, list[Series]] = {}
    for s in series:
        groups.setdefault(s.variable.name, []).append(s)
    for group in groups.values():
        variable = group[0].variable
        if not variable.shape:
            component.set(variable, group[0].at(t))
            continue
        flat: np.ndarray = np.empty(variable.size, dtype=DTYPES[variable.type])
        if len(group) < variable.size:
            flat[:] = np.asarray(component.get(variable)).ravel()
        for s in group:
            flat[s.element] = s.at(t)
        component.set(variable, flat.reshape(variable.shape))
