"""The reference results in an .fmu: our own table, and those of fmi-ls-ref."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.importer.safe_xml import read_xml

__all__ = ["LS_REF", "TOLERANCE", "Reference", "default_experiment", "references", "result_table"]

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
        parameters |= _parameters(_inside(fmu, folder, file.get("source", "")))
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


def _parameters(path: Path) -> dict[str, str]:
    """Read an SSV's values as text; a value is on the element inside each parameter."""
    root = read_xml(path, place=path.name)
    values: dict[str, str] = {}
    for parameter in root.iterfind(".//{*}Parameter"):
        inner = next(iter(parameter), None)
        values[parameter.get("name", "")] = "" if inner is None else inner.get("value", "")
    return values


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
