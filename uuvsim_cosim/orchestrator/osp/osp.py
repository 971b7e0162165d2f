"""Reader of OspSystemStructure.xml, the system file of the Open Simulation Platform."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid, SystemInvalid, UuvsimError
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.orchestrator.osp.connections import Connections
from uuvsim_cosim.orchestrator.osp.ecco import NANOSECOND, read_ecco
from uuvsim_cosim.orchestrator.osp.variable_groups import (
    VariableGroup,
    find_model_description,
    read_variable_groups,
)
from uuvsim_cosim.orchestrator.osp.xml import Reading, children, opened
from uuvsim_cosim.orchestrator.system.elements import Element, step_text
from uuvsim_cosim.orchestrator.system.resolve import REMARK, proxy_file, resolve
from uuvsim_cosim.orchestrator.system.sources import FmuSource
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.system.validation import as_step, problem_of
from uuvsim_cosim.orchestrator.system.variable_step import VariableStep
from uuvsim_cosim.orchestrator.values.values import flat
from uuvsim_cosim.orchestrator.values.xml_values import BOOLEANS, local_name

__all__ = ["read_osp"]

_SECTIONS = ["StartTime", "EndTime", "BaseStepSize", "Algorithm", "Simulators", "Functions",
             "Connections", "EccoConfiguration", "Description"]  # fmt: skip
DEFAULT_STEP = "0.1"  # of libcosim, for files without a step
_TYPES: dict[str, Callable[[str], float | str]] = {
    "Real": float, "Integer": int, "Boolean": lambda text: BOOLEANS[text.strip().lower()],
    "String": str, "Enumeration": int,
}  # fmt: skip


def read_osp(path: Path, tick: str | None = None) -> System:
    """Read a system from an OspSystemStructure.xml; `tick` is the step if the file has none.

    Sums become components, linear transformations become part of their connections, and both
    use numbers without units. With the algorithm ecco, the tick is a nanosecond, and the step is
    variable (see `VariableStep`). Raises SystemInvalid with every problem.
    """
    root = opened(path, "OspSystemStructure")
    reading = Reading(path.name)
    for child in root:
        reading.known(local_name(child), _SECTIONS, "<OspSystemStructure>", "section")
    if next(children(root, "Simulators"), None) is None:
        reading.wrong("<OspSystemStructure>", "no <Simulators>", "at least one <Simulator>")
    step = _only(root, "BaseStepSize")
    if step is None:
        step = tick or DEFAULT_STEP
        if tick is None:
            reading.remark(f"no BaseStepSize: {step} s is used, as in libcosim")
    base = _step(step, "<BaseStepSize>", reading) or Fraction(DEFAULT_STEP)
    start = reading.number(_only(root, "StartTime"), "<StartTime>", "time", 0.0)
    end_text = _only(root, "EndTime")
    end = reading.number(end_text, "<EndTime>", "time", start)
    if end < start:
        reading.wrong("<EndTime>", f"{end:g} s", f"a time after StartTime, {start:g} s")
    if start < 0.0:
        reading.remark(f"StartTime {start:g} s: a run starts at 0 s, the first possible time")
        start = 0.0
    elements = _simulators(root, reading, base)
    described = _described(elements, path.parent, reading)
    groups = _variable_groups(elements, described, path.parent, reading)
    joined = Connections(root, reading, {e.name: e for e in elements}, described, groups)
    algorithm = _only(root, "Algorithm") or "fixedStep"
    varied: VariableStep | None = None
    if algorithm.lower() == "ecco":
        varied = read_ecco(root, joined.power_bonds, reading)
        if varied is None:
            reading.remark(f"Algorithm ecco: every step is {step_text(base)} s")
        else:
            base = NANOSECOND
            fixed = [e.name for e in elements if e.rate is not None]
            if fixed:
                reading.remark(f"Algorithm ecco: the stepSize of {', '.join(fixed)} is not used")
            elements = tuple(replace(e, rate=None) for e in elements)
    elif algorithm.lower() != "fixedstep":
        reading.known(algorithm, ["fixedStep", "ecco"], "<Algorithm>", "algorithm")
    if reading.problems:
        raise SystemInvalid(list(dict.fromkeys(reading.problems)))
    elements = tuple(_without_default_values(e, described.get(e.name)) for e in elements)
    stem = path.stem.removeprefix("OspSystemStructure").strip("_-. ")
    name = stem or path.absolute().parent.name or "system"
    try:
        return System(
            "".join(c if c.isalnum() or c in "_-" else "_" for c in name),
            base,
            _only(root, "Description") or "",
            (*elements, *joined.sums),
            tuple(joined.connections),
            tuple(joined.step_groups()),
            base=path.parent,
            remarks=tuple(dict.fromkeys(reading.remarks)),
            stop_time=end if end_text is not None and end > start else None,
            start_time=start,
            variable_step=varied,
        )
    except SystemInvalid as error:
        raise SystemInvalid(
            [replace(p, place=f"{path.name}: {p.place}") for p in error.problems]
        ) from None


def _only(root: Xml, name: str) -> str | None:
    """Return the text of the first child of this name; None if there is none."""
    found = next(children(root, name), None)
    return None if found is None else (found.text or "").strip()


# ---- steps --------------------------------------------------------------------------------------


def _step(text: str, place: str, reading: Reading) -> Fraction | None:
    try:
        return as_step(text, place)
    except UuvsimError as error:
        reading.wrong(place, error.problems[0].read, error.problems[0].expected)
        return None


def _rate(text: str | None, base: Fraction, place: str, reading: Reading) -> Fraction | None:
    """Round a simulator's step to whole base steps, at least one, as libcosim does."""
    if text is None or not text.strip():
        return None
    if text.strip() in ("0", "0.0"):  # no step of its own
        return None
    step = _step(text, place, reading)
    if step is None:
        return None
    rounded = max(round(step / base), 1) * base
    if rounded != step:
        reading.remark(
            f"{place}: stepSize {step_text(step)} s is no multiple of the base step of "
            f"{step_text(base)} s: {step_text(rounded)} s is used, as in libcosim"
        )
    return None if rounded == base else rounded


# ---- simulators ---------------------------------------------------------------------------------


def _simulators(root: Xml, reading: Reading, base: Fraction) -> tuple[Element, ...]:
    found: dict[str, Element] = {}
    for section in children(root, "Simulators"):
        for item in children(section):
            place = f"<Simulator name={item.get('name', '')!r}>"
            if not reading.known(local_name(item), ["Simulator"], "<Simulators>", "element"):
                continue
            name = reading.required(item, "name", place, "the name of the simulator")
            source = reading.required(item, "source", place, "an FMU")
            try:
                file = proxy_file(source)
            except InputInvalid as error:
                problem = error.at(place, "")
                reading.wrong(place, problem.read, problem.expected)
            else:
                if file is not None:  # an FMU in its own process
                    reading.remark(f"{place}: {REMARK}")
                source = unquote(source.replace("file:///", "/")) if file is None else file
            rate = _rate(item.get("stepSize"), base, place, reading)
            if name in found:
                reading.wrong(place, "a second simulator of this name", "a name of its own")
            found[name] = Element(name, source, _initial_values(item, place, reading), rate)
    return tuple(found.values())


def _initial_values(xml: Xml, place: str, reading: Reading) -> dict[str, object]:
    found: dict[str, object] = {}
    for section in children(xml, "InitialValues"):
        for item in children(section, "InitialValue"):
            name = reading.required(item, "variable", f"{place} <InitialValue>", "its variable")
            here = f"{place} <InitialValue variable={name!r}>"
            typed = next(children(item), None)
            if typed is None:
                reading.wrong(here, "no value", 'one such as <Real value="1"/>')
                continue
            tag, text = local_name(typed), typed.get("value")
            if not reading.known(tag, list(_TYPES), here, "type"):
                continue
            found[name] = None
            if text is None:
                reading.wrong(here, f"<{tag}> without value", f'<{tag} value="…"/>')
                continue
            try:
                found[name] = _TYPES[tag](text)
            except (ValueError, KeyError):
                reading.wrong(here, f"<{tag} value={text!r}>", f"a value of type {tag}")
    return found


def _without_default_values(element: Element, description: Description | None) -> Element:
    """Remove values of variables that cannot be set if they equal the default start value.

    libcosim ignores them, so existing files contain them.
    """
    if description is None:
        return element
    start = {}
    for name, value in element.start.items():
        variable = description.variables.get(name)
        same = variable is not None and variable.start is not None
        if same and variable is not None and flat(variable.start) == [value]:
            settable = variable.causality in ("input", "parameter", "structuralParameter")
            if not settable and variable.initial not in ("exact", "approx"):
                continue
        start[name] = value
    return replace(element, start=start)


def _described(
    elements: tuple[Element, ...], folder: Path, reading: Reading
) -> Mapping[str, Description]:
    found: dict[str, Description] = {}
    for element in elements:
        assert isinstance(element.source, str)
        if not element.source:
            continue
        try:
            source = resolve(element.source, folder)
            if not isinstance(source, FmuSource):
                raise InputInvalid(f"source {element.source!r}", "an FMU")
            found[element.name] = source.describe()
        except UuvsimError as error:
            problem = problem_of(f"<Simulator name={element.name!r}>", error)
            reading.wrong(problem.place, problem.read, problem.expected)
    return found


def _variable_groups(
    elements: tuple[Element, ...],
    described: Mapping[str, Description],
    folder: Path,
    reading: Reading,
) -> Mapping[str, tuple[VariableGroup, ...]]:
    found: dict[str, tuple[VariableGroup, ...]] = {}
    for element in elements:
        if element.name not in described:
            continue
        fmu = Path(resolve(str(element.source), folder).text)
        path = find_model_description(fmu, described[element.name].name, folder)
        if path is None:
            continue
        try:
            found[element.name] = read_variable_groups(path, reading)
        except UuvsimError as error:
            problem = problem_of(shown(path), error)
            reading.wrong(f"<Simulator name={element.name!r}>", problem.read, problem.expected)
    return found
