"""Reader of an FMU's modelDescription.xml, with one clear error message if it is not valid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args
from xml.etree.ElementTree import Element

import numpy as np

from uuvsim_cosim.errors import FmuError, ParameterInvalid
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.description_xml import Source, flag, read_units
from uuvsim_cosim.fmus.importer.archive import shown, unpack
from uuvsim_cosim.fmus.importer.safe_xml import read_xml
from uuvsim_cosim.fmus.importer.source_code import Sources, read_sources
from uuvsim_cosim.fmus.importer.variables_fmi1 import read_variables_fmi1
from uuvsim_cosim.fmus.importer.variables_fmi2 import read_variables_fmi2
from uuvsim_cosim.fmus.importer.variables_fmi3 import read_variables_fmi3
from uuvsim_cosim.fmus.pairs import MADE_FOR, PEERS, read_pairs
from uuvsim_cosim.fmus.values import checked_start, parse_value

__all__ = ["FmuArchive", "read_description", "read_fmu"]

Interface = Literal["CoSimulation", "ModelExchange", "ScheduledExecution"]
_Kind = Literal["FMI 1.0", "FMI 2.0", "FMI 3.0"]
_Reader = Callable[[Source, Element], tuple[dict[str, Variable], dict[str, Mapping[int, str]]]]
_INTERFACES: tuple[Interface, ...] = get_args(Interface)  # the first that an FMU has is used
LIBRARY_SUFFIXES = (".so", ".dll", ".dylib", ".wasm")


@dataclass(frozen=True)
class FmuArchive:
    """An unpacked FMU: its description, and the data to load it."""

    path: Path  # of the .fmu
    description: Description
    folder: Path  # with the unpacked members
    model_identifier: str
    binaries: tuple[str, ...]  # platform folders that hold a library, such as linux64
    enumerations: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    default_start_time: float | None = None
    default_stop_time: float | None = None
    interface: Interface = "CoSimulation"  # the one that is used
    interfaces: tuple[Interface, ...] = ("CoSimulation",)  # those that the FMU has
    adjoint_derivatives: bool = False  # of FMI 3.0; not used here
    n_states: int = 0  # of a Model Exchange FMU; FMI 3.0 has functions for them
    n_event_indicators: int = 0
    tolerance: float = 1e-6  # relative, of the integrator of a Model Exchange FMU
    sources: Sources | None = None  # compiled if there is no binary
    structure: Mapping[str, object] = field(default_factory=dict)  # structural parameters, as set
    clocks: Mapping[str, Variable] = field(default_factory=dict)  # of Scheduled Execution
    events: bool = False  # an instance uses Event Mode and may return early
    remarks: tuple[str, ...] = ()  # properties that differ from FMI, which each run reports


def read_description(path: Path) -> Description:
    """Read the description of the .fmu at `path`: variables with units, and capabilities.

    Raises FmuError for an archive that cannot be read, and for FMI versions other than 1.0, 2.0 and
    3.0.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.fmus import build_fmu, read_description
    >>> battery = read_description(build_fmu(uuv.declare("battery"), fmi=2))
    >>> battery.kind, battery.variables["voltage"].unit, battery.can_get_and_set_state
    ('FMI 2.0', 'V', True)
    """
    return read_fmu(path).description


def read_fmu(
    path: Path, interface: str | None = None, structure: Mapping[str, object] | None = None
) -> FmuArchive:
    """Unpack an .fmu into the cache and read it.

    `interface` is CoSimulation, ModelExchange or ScheduledExecution; by default, the first of these
    that the FMU has. In Scheduled Execution, clocks become Boolean variables.
    `structure` are values of structural parameters, as text or as numbers; each instance gets
    them in Configuration Mode, and the shapes of arrays result from them. Raises FmuError
    for an archive that cannot be read, for FMI versions other than 1.0, 2.0 and 3.0, and for an
    FMU without that interface; ParameterInvalid for a structural parameter that does not exist.
    """
    folder = unpack(path)
    source = Source(f"{shown(path)}/modelDescription.xml")
    root = read_xml(folder / "modelDescription.xml", place=source.place)
    if root.tag != "fmiModelDescription":
        raise source.fault("the document", f"<{root.tag}>", "<fmiModelDescription>")
    text = root.get("fmiVersion", "")
    version = next((v for v in _READERS if text == v or text.startswith(f"{v}.")), None)
    if version is None:
        raise source.fault("fmiVersion", f"{text!r}", "an FMU of FMI 1.0, 2.0 or 3.0")
    if version == "1.0":
        there = _interfaces_fmi1(root, path)
    else:
        known = _INTERFACES if version == "3.0" else _INTERFACES[:2]
        there = {i: e for i in known if (e := root.find(i)) is not None}
    chosen = next((i for i in there if interface in (None, i)), None)
    if chosen is None and interface is not None:
        raise FmuError(shown(path), f"has no {interface}", f"one of {', '.join(there) or 'none'}")
    if chosen is None:
        expected = "Co-Simulation, Model Exchange or, in FMI 3.0, Scheduled Execution"
        raise FmuError(shown(path), "is for nothing that FMI knows only", expected)
    element = there[chosen]
    kind, read, token = _READERS[version]
    variables, enumerations = read(source, root)
    given: dict[str, object] = {}
    for name, value in (structure or {}).items():
        place = f"{shown(path)}: structural parameter {name}"
        variable = variables.get(name)
        if variable is None or variable.causality != "structuralParameter":
            named = [v.name for v in variables.values() if v.causality == "structuralParameter"]
            expected = f"one of {', '.join(named) or 'none'}"
            raise ParameterInvalid(place, "there is none of this name", expected)
        read_value = parse_value(variable, value, place) if isinstance(value, str) else value
        given[name] = checked_start(variable, read_value, place)
    if given:
        _restructure(root, given, variables)
        variables, enumerations = read(source, root)
    for name in variables.keys() & enumerations.keys():
        items = tuple((item, number) for number, item in enumerations[name].items())
        variables[name] = replace(variables[name], items=items)

    clocks: dict[str, Variable] = {}
    if chosen == "ScheduledExecution":
        clocks = {v.name: v for v in variables.values() if v.type == "Clock"}
        _check_priorities(source, root)
        variables = _with_ticks(variables)

    def of_experiment(attribute: str) -> float | None:
        experiment = root.find("DefaultExperiment")
        if experiment is None:
            return None
        return source.optional_number(experiment, attribute, "DefaultExperiment")

    description = Description(
        name=source.required(root, "modelName", "the document"),
        kind=kind,
        variables=variables,
        token=source.required(root, token, "the document"),
        description=root.get("description", ""),
        generation_tool=root.get("generationTool", ""),
        units=read_units(source, root),
        default_step_size=of_experiment("stepSize"),
        can_get_and_set_state=flag(element, "canGetAndSetFMUstate", "canGetAndSetFMUState"),
        can_serialize_state=flag(element, "canSerializeFMUstate", "canSerializeFMUState"),
        can_be_instantiated_only_once=flag(element, "canBeInstantiatedOnlyOncePerProcess"),
        can_handle_variable_step=chosen != "CoSimulation"  # this package ends a step anywhere
        or flag(element, "canHandleVariableCommunicationStepSize"),
        has_event_mode=chosen == "CoSimulation" and flag(element, "hasEventMode"),
        provides_directional_derivatives=flag(
            element, "providesDirectionalDerivative", "providesDirectionalDerivatives"
        ),
        needs_execution_tool=flag(element, "needsExecutionTool"),
        made_for=read_pairs(MADE_FOR, folder),
        peers=read_pairs(PEERS, folder),
    )
    if version == "1.0":
        identifier = source.required(root, "modelIdentifier", "the document")
        n_states = source.natural(
            root.get("numberOfContinuousStates"), "numberOfContinuousStates", "the document"
        )
    else:
        identifier = source.required(element, "modelIdentifier", chosen)
        n_states = len(root.findall("ModelStructure/Derivatives/Unknown"))
    libraries = {identifier + suffix for suffix in LIBRARY_SUFFIXES}
    platforms = {p.parent.name for p in folder.glob("binaries/*/*") if p.name in libraries}
    return FmuArchive(
        path=path,
        description=description,
        folder=folder,
        model_identifier=identifier,
        binaries=tuple(sorted(platforms)),
        enumerations=enumerations,
        default_start_time=of_experiment("startTime"),
        default_stop_time=of_experiment("stopTime"),
        interface=chosen,
        interfaces=tuple(there),
        adjoint_derivatives=element.get("providesAdjointDerivatives", "false").strip()
        in ("true", "1"),
        n_states=n_states,
        n_event_indicators=source.natural(
            root.get("numberOfEventIndicators", "0"), "numberOfEventIndicators", "the document"
        ),
        tolerance=of_experiment("tolerance") or 1e-6,
        sources=read_sources(folder, element, identifier, shown(path)),
        structure=given,
        clocks=clocks,
        remarks=tuple(source.remarks),
    )


# By version: the name, the reader of the variables, and the attribute with the token.
_READERS: Mapping[str, tuple[_Kind, _Reader, str]] = {
    "1.0": ("FMI 1.0", read_variables_fmi1, "guid"),
    "2.0": ("FMI 2.0", read_variables_fmi2, "guid"),
    "3.0": ("FMI 3.0", read_variables_fmi3, "instantiationToken"),
}


def _interfaces_fmi1(root: Element, path: Path) -> dict[Interface, Element]:
    """Return the one interface of an FMU of FMI 1.0, and the element with its capabilities."""
    implementation = root.find("Implementation")
    if implementation is None:
        return {"ModelExchange": Element("ModelExchange")}
    tool = implementation.find("CoSimulation_Tool")
    if tool is not None:
        model = tool.find("Model")
        type_, entry = (
            ("", "") if model is None else (model.get("type", ""), model.get("entryPoint", ""))
        )
        raise FmuError(
            shown(path),
            f"CoSimulation_Tool: the model {entry!r} of type {type_!r} is run by the tool that "
            "exported the FMU, not by the FMU",
            "CoSimulation_StandAlone: export the FMU again with its solver inside",
        )
    capabilities = implementation.find("CoSimulation_StandAlone/Capabilities")
    return {"CoSimulation": Element("CoSimulation") if capabilities is None else capabilities}


def _check_priorities(source: Source, root: Element) -> None:
    for clock in root.iterfind("ModelVariables/Clock[@causality='input']"):
        if clock.get("priority") is None:
            expected = "a whole number, which Scheduled Execution requires"
            raise source.fault(f"clock {clock.get('name')!r}", "no priority", expected)


def _with_ticks(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the variables of Scheduled Execution, with clocks as Booleans.

    A triggered input clock is an input; the others are outputs, true if they ticked in the last
    step. Outputs change if a partition is active, never by an input alone: they depend on none.
    """
    found: dict[str, Variable] = {}
    for name, v in variables.items():
        if v.timing is not None and v.causality in ("input", "output"):
            given = v.causality == "input" and not v.timing.is_time_based
            v = replace(
                v, type="Boolean", start=False, variability="discrete", timing=None,
                causality="input" if given else "output",
            )  # fmt: skip
        v = replace(v, clocks=())
        found[name] = replace(v, dependencies=()) if v.causality == "output" else v
    return found


def _restructure(
    root: Element, given: Mapping[str, object], variables: Mapping[str, Variable]
) -> None:
    """Write values of structural parameters into a model description, to read it again.

    An array whose shape changes loses its start value, which does not fit any more.
    """
    elements = {e.get("name"): e for e in root.iterfind("ModelVariables/*")}
    changed = set()
    for name, value in given.items():
        if np.array_equal(np.asarray(value), np.asarray(variables[name].start)):
            continue
        words = [str(x).lower() for x in np.asarray(value).ravel().tolist()]
        elements[name].set("start", " ".join(words))
        changed.add(elements[name].get("valueReference"))
    for element in elements.values():
        if any(d.get("valueReference") in changed for d in element.iterfind("Dimension")):
            element.attrib.pop("start", None)
            for start in element.findall("Start"):
                element.remove(start)
