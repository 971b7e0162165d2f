"""Comparison of an FMU with a reference result, row by row."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from itertools import pairwise

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.check.reference_result import Reference, default_experiment, result_table
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.input_csv import Series, read_input_csv
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.values import checked_start, parse_value
from uuvsim_cosim.models.declaration.element_names import split_element_name

__all__ = ["deviations"]

_MOST = 100_000  # communication steps
_TRUE = {"true": 1.0, "false": 0.0}


def deviations(
    fmu: FmuArchive,
    x: Component,
    reference: Reference,
    feed: Callable[[Component, Iterable[Series], float], None],
) -> tuple[list[str], str]:
    """Run a new instance; return the deviations of the columns, and a summary of the comparison.

    A deviation is the distance of a number, relative to the largest value of its column.
    """
    texts, columns = result_table(reference.result)
    wanted = {n: c for n, c in columns.items() if not reference.signals or n in reference.signals}
    lost = [f"{reference.name}: has no column {n!r}" for n in reference.signals if n not in columns]
    targets: dict[str, tuple[Variable, int | None]] = {}
    unknown: list[str] = []
    for name in wanted:
        target = _target(fmu, name)
        if target is None:
            unknown.append(name)
        else:
            targets[name] = target
    if unknown and (reference.signals or not targets):
        lost.append(f"{reference.name}: the FMU has no variable {', '.join(unknown)}")
    start = Fraction(str(reference.start_time))
    h, rows = _grid(fmu, reference, start, [Fraction(t) for t in texts])
    series = [] if reference.inputs is None else read_input_csv(reference.inputs, fmu.description)
    scale = {
        n: max([1e-12, *(abs(v) for cell in wanted[n] for v in _numbers(cell) or ())])
        for n in targets
    }
    worst: dict[str, tuple[float, float]] = {}  # by column: error, and its time [s]

    def compare(k: int) -> None:
        for row in rows.get(k, ()):
            for name, (variable, element) in targets.items():
                error = _error(x.get(variable), element, wanted[name][row], scale[name])
                if not error <= max(reference.tolerance, worst.get(name, (0.0, 0.0))[0]):
                    worst[name] = (error, float(start + k * h))

    for name, text in reference.parameters.items():
        variable = fmu.description.variables.get(name)
        if variable is None:
            raise FmuError(f"{reference.name}: parameter {name!r} is no variable of the FMU")
        x.set(variable, checked_start(variable, parse_value(variable, text, name), name))
    x.enter_initialization_mode(float(start), None)
    feed(x, series, float(start))
    x.exit_initialization_mode()
    compare(0)
    reached = 0
    for k in range(max(rows)):
        if k:
            feed(x, series, float(start + k * h))
        try:
            x.do_step(float(start + k * h), float(h))
        except ComponentFailed as error:
            if not error.asks_to_end:
                raise
            break
        reached = k + 1
        compare(reached)
    off = [
        f"{reference.name}: {targets[name][0].causality} {name!r} is off by {error:.3g} of its "
        f"range at t = {t:.9g} s; expected at most {reference.tolerance:g}"
        for name, (error, t) in worst.items()
    ]
    compared = sum(len(found) for k, found in rows.items() if k <= reached)
    message = (
        f"{reference.name}: {len(targets)} columns within {reference.tolerance:g} of their range, "
        f"at {compared} of {len(texts)} times, steps of {float(h):g} s"
    )
    if unknown:
        message += f"; not in the FMU, so left out: {', '.join(unknown)}"
    return lost + off, message


def _target(fmu: FmuArchive, name: str) -> tuple[Variable, int | None] | None:
    """Find a variable, or one element of an array; the cells of a whole array have many words."""
    variables = fmu.description.variables
    if name in variables:
        return variables[name], None
    for v in variables.values():
        if v.shape and v.name == split_element_name(name)[0] and name in v.element_names:
            return v, v.element_names.index(name)
    return None


def _grid(
    fmu: FmuArchive, reference: Reference, start: Fraction, times: list[Fraction]
) -> tuple[Fraction, dict[int, list[int]]]:
    """Return the step, and the rows by communication point; of two rows at a time, the later."""
    step = reference.step_size or default_experiment(fmu)[2]
    gaps = [b - a for a, b in pairwise(times) if b > a]
    if step is None or (gaps and max(gaps) < Fraction(str(step))):
        if not gaps:
            raise FmuError(reference.name, "fewer than two times", "a result over time")
        step = float(min(gaps))
    h = Fraction(str(round(step, 12)))
    rows: dict[int, list[int]] = {}
    for row, t in enumerate(times):
        k = round((t - start) / h)
        if k >= 0 and abs(float(t - start - k * h)) <= 1e-6 * float(h):
            rows[k] = [row]
    if not rows or max(rows) > _MOST:
        raise FmuError(
            reference.name,
            f"{max(rows, default=0)} steps of {step:g} s meet its times",
            f"1 to {_MOST}",
        )
    return h, rows


def _numbers(cell: str) -> list[float] | None:
    try:
        return [_TRUE[w.lower()] if w.lower() in _TRUE else float(w) for w in cell.split()]
    except ValueError:
        return None


def _error(value: object, element: int | None, cell: str, scale: float) -> float:
    """Return the distance of a value from a cell, relative to `scale`; infinite for other text."""
    flat = np.asarray(value).ravel()
    if isinstance(value, bytes | str) or flat.dtype == object:
        text = value if isinstance(value, bytes | str) else flat[element or 0]
        shown = text.hex() if isinstance(text, bytes) else str(text)
        return 0.0 if shown == cell else float("inf")
    expected = _numbers(cell)
    if element is not None:
        flat = flat[element : element + 1]
    if expected is None or len(expected) != flat.size:
        return float("inf")
    return max((abs(float(a) - b) / scale for a, b in zip(flat, expected, strict=True)), default=0)
