"""Reference results in an .fmu (our own, and those of fmi-ls-ref), and comparison with them."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.input_csv import apply_series, read_input_csv
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.importer.safe_xml import read_xml
from uuvsim_cosim.fmus.values import checked_start, parse_value
from uuvsim_cosim.models.declaration.element_names import split_element_name

__all__ = [
    "LS_REF",
    "TOLERANCE",
    "Reference",
    "default_experiment",
    "deviations",
    "references",
    "result_table",
]

LS_REF = "extra/org.fmi-standard.fmi-ls-ref"
OWN_TOLERANCE = 1e-9  # our components have the same bits everywhere; a CSV cell may be rounded
TOLERANCE = 1e-4  # of a foreign result, which another solver may have made
_INPUTS = ("input", "inputs", "stimulus", "stimuli")
_RESULTS = ("result", "results", "reference")


@dataclass(frozen=True)
class Reference:
    """An experiment with its expected result; `tolerance` is relative to a column's range."""

    name: str
    result: Path
    inputs: Path | None = None
    tolerance: float = TOLERANCE
    start_time: float = 0.0
    step_size: float | None = None
    signals: tuple[str, ...] = ()  # the columns that are compared; none named: all
    parameters: Mapping[str, str] = field(default_factory=dict)


def default_experiment(fmu: FmuArchive) -> tuple[float, float | None, float | None]:
    """Return start time, stop time and step size [s] of the description.

    Without a step size, it is the internal one of an FMI 3.0 FMU: steps must be its multiples.
    """
    root = read_xml(fmu.folder / "modelDescription.xml", place=str(fmu.path))
    experiment, element = root.find("DefaultExperiment"), root.find(fmu.interface)
    start = 0.0 if experiment is None else _number(experiment, "startTime") or 0.0
    step = fmu.description.default_step_size
    if step is None and element is not None:
        step = _number(element, "fixedInternalStepSize")
    return start, fmu.default_stop_time, step


def references(fmu: FmuArchive) -> list[Reference]:
    """List the reference results in the archive; raises FmuError for a manifest that is wrong."""
    found: list[Reference] = []
    own = fmu.folder / "documentation"
    if (own / "input.csv").is_file() and (own / "reference.csv").is_file():
        time = [float(row[0]) for row in _rows(own / "input.csv")[1:3]]
        found.append(
            Reference("documentation/reference.csv", own / "reference.csv", own / "input.csv",
                      OWN_TOLERANCE, step_size=time[1] - time[0])
        )  # fmt: skip
    folder = fmu.folder / LS_REF
    if (folder / "fmi-ls-manifest.xml").is_file():
        found += _related(fmu, folder)
    for file in (folder / "experiments.xml", folder / "fmi-ls-experiments.xml"):
        if file.is_file():
            root = read_xml(file, place=f"{LS_REF}/{file.name}")
            for element in root.iterfind("{*}Experiment"):
                found += _experiment(fmu, folder, element)
    return found


def result_table(path: Path) -> tuple[list[str], dict[str, list[str]]]:
    """Read a result: the times as text, and the other columns' cells by name."""
    rows = _rows(path)
    if not rows or rows[0][0].strip().lower() not in ("time", "t"):
        raise FmuError(f"{path.name}: expected CSV whose first column is 'time'")
    names = [name.strip() for name in rows[0]]
    for n, row in enumerate(rows[1:], start=2):
        if len(row) != len(names):
            raise FmuError(f"{path.name}, row {n}", f"{len(row)} cells", len(names))
    columns = {name: [row[i].strip() for row in rows[1:]] for i, name in enumerate(names)}
    return columns.pop(names[0]), columns


def _related(fmu: FmuArchive, folder: Path) -> Iterator[Reference]:
    """Read the manifest's related files: results, and the inputs that belong to the experiment."""
    root = read_xml(folder / "fmi-ls-manifest.xml", place=f"{LS_REF}/fmi-ls-manifest.xml")
    files: dict[str, list[str]] = {"input": [], "result": []}
    for related in root.iterfind("{*}Related"):
        role, source = related.get("role", "").lower(), related.get("source", "")
        csv_text = related.get("type", "text/csv") == "text/csv"
        if csv_text and role in (*_INPUTS, *_RESULTS):
            files["input" if role in _INPUTS else "result"].append(source)
    start, _, _ = default_experiment(fmu)
    for n, source in enumerate(files["result"]):
        given = files["input"][min(n, len(files["input"]) - 1)] if files["input"] else None
        yield Reference(
            f"fmi-ls-ref {source}",
            _inside(fmu, folder, source),
            None if given is None else _inside(fmu, folder, given),
            start_time=start,
        )


def _experiment(fmu: FmuArchive, folder: Path, element: Element) -> Iterator[Reference]:
    start, _, step = default_experiment(fmu)
    given = element.find("{*}Stimuli")
    first, size = _number(element, "startTime"), _number(element, "stepSize")
    parameters: dict[str, str] = {}
    for file in element.iterfind("{*}Parameters"):
        path = _inside(fmu, folder, file.get("source", ""))
        for parameter in read_xml(path, place=path.name).iterfind(".//{*}Parameter"):
            inner = next(iter(parameter), None)  # it has the value
            parameters[parameter.get("name", "")] = "" if inner is None else inner.get("value", "")
    for expected in element.iterfind("{*}References"):
        source = expected.get("source", "")
        yield Reference(
            f"fmi-ls-ref {element.get('name', '')!r} {source}",
            _inside(fmu, folder, source),
            None if given is None else _inside(fmu, folder, given.get("source", "")),
            _number(element, "tolerance") or TOLERANCE,
            start if first is None else first,
            step if size is None else size,
            tuple(s.get("name", "") for s in expected.iterfind("{*}Signal")),
            parameters,
        )


def _inside(fmu: FmuArchive, folder: Path, source: str) -> Path:
    """Find a file, relative to the manifest or to the root of the archive."""
    root = fmu.folder.resolve()
    for base in (folder, fmu.folder):
        path = (base / source).resolve()
        if path.is_relative_to(root) and path.is_file():
            return path
    raise FmuError(f"{LS_REF}: names {source!r}, which is not in the archive")


def _number(element: Element, name: str) -> float | None:
    text = element.get(name)
    try:
        value = math.nan if text is None else float(text)
    except ValueError:
        raise FmuError(f"<{element.tag}>", f"{name} = {text!r}", "a number") from None
    return value if math.isfinite(value) else None


def _rows(path: Path) -> list[list[str]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FmuError(f"{path.name}: cannot be read as CSV ({error})") from None


_MOST = 100_000  # communication steps
_TRUE = {"true": 1.0, "false": 0.0}


def deviations(fmu: FmuArchive, x: Component, reference: Reference) -> tuple[list[str], str]:
    """Run a new instance; return the deviations of the columns, and a summary of the comparison.

    A deviation is the distance of a number, relative to the largest value of its column.
    """
    texts, columns = result_table(reference.result)
    wanted = {n: c for n, c in columns.items() if not reference.signals or n in reference.signals}
    lost = [f"{reference.name}: has no column {n!r}" for n in reference.signals if n not in columns]
    variables = fmu.description.variables
    targets: dict[str, tuple[Variable, int | None]] = {}  # a whole array's cell has many words
    unknown: list[str] = []
    for name in wanted:
        variable, element = variables.get(name), None
        if variable is None:
            for v in variables.values():
                if v.shape and v.name == split_element_name(name)[0] and name in v.element_names:
                    variable, element = v, v.element_names.index(name)
        if variable is None:
            unknown.append(name)
        else:
            targets[name] = variable, element
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
        variable = variables.get(name)
        if variable is None:
            raise FmuError(f"{reference.name}: parameter {name!r} is no variable of the FMU")
        x.set(variable, checked_start(variable, parse_value(variable, text, name), name))
    x.enter_initialization_mode(float(start), None)
    apply_series(x, series, float(start))
    x.exit_initialization_mode()
    compare(0)
    reached = 0
    for k in range(max(rows)):
        if k:
            apply_series(x, series, float(start + k * h))
        try:
            x.do_step(float(start + k * h), float(h))
        except ComponentFailed as error:
            if not error.asks_to_end:
                raise
            break
        reached = k + 1
        compare(reached)
    off = [
        f"{reference.name}: {targets[name][0].causality} {name!r} deviates by {error:.3g} of its "
        f"range at t = {t:.9g} s; expected at most {reference.tolerance:g}"
        for name, (error, t) in worst.items()
    ]
    compared = sum(len(found) for k, found in rows.items() if k <= reached)
    message = (
        f"{reference.name}: {len(targets)} columns within {reference.tolerance:g} of their range, "
        f"at {compared} of {len(texts)} times, steps of {float(h):g} s"
    )
    if unknown:
        message += f"; ignored, because not in the FMU: {', '.join(unknown)}"
    return lost + off, message


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
