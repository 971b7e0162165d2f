"""An FMU's modelDescription.xml becomes a `Description`, or one sentence on why it cannot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.archive import shown, unpack
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.fmus.description_xml import Source, flag, read_units
from uuvsim_cosim.fmus.safe_xml import read_xml
from uuvsim_cosim.fmus.variables_fmi2 import read_variables_fmi2
from uuvsim_cosim.fmus.variables_fmi3 import read_variables_fmi3

__all__ = ["FmuArchive", "read_description", "read_fmu"]

LIBRARY_SUFFIXES = (".so", ".dll", ".dylib")


@dataclass(frozen=True)
class FmuArchive:
    """An unpacked FMU: its description, and what is needed to load it."""

    path: Path  # of the .fmu
    description: Description
    folder: Path  # with the unpacked members
    model_identifier: str
    binaries: tuple[str, ...]  # platform folders that hold a library, such as linux64
    enumerations: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    default_stop_time: float | None = None
    log_categories: tuple[str, ...] = ()


def read_description(path: Path) -> Description:
    """Read what an .fmu says of itself; see `read_fmu`."""
    return read_fmu(path).description


def read_fmu(path: Path) -> FmuArchive:
    """Unpack an .fmu into the cache and read it.

    Raises FmuError for an archive that cannot be read, for FMI versions other than 2.0 and 3.0,
    and for FMUs without Co-Simulation.
    """
    folder = unpack(path)
    source = Source(f"{shown(path)}/modelDescription.xml")
    root = read_xml(folder / "modelDescription.xml", place=source.place)
    if root.tag != "fmiModelDescription":
        raise source.fault("the document", f"<{root.tag}>", "<fmiModelDescription>")
    version = _version(source, root)
    co_simulation = _co_simulation(path, root)
    read = read_variables_fmi2 if version == "2.0" else read_variables_fmi3
    variables, enumerations = read(source, root)
    experiment = root.find("DefaultExperiment")
    where = "DefaultExperiment"
    description = Description(
        name=source.required(root, "modelName", "the document"),
        kind="FMI 2.0" if version == "2.0" else "FMI 3.0",
        variables=variables,
        token=source.required(
            root, "guid" if version == "2.0" else "instantiationToken", "the document"
        ),
        description=root.get("description", ""),
        generation_tool=root.get("generationTool", ""),
        units=read_units(source, root),
        default_step_size=(
            None if experiment is None else source.optional_number(experiment, "stepSize", where)
        ),
        can_get_and_set_state=flag(co_simulation, "canGetAndSetFMUstate", "canGetAndSetFMUState"),
        can_serialize_state=flag(co_simulation, "canSerializeFMUstate", "canSerializeFMUState"),
        can_be_instantiated_only_once=flag(co_simulation, "canBeInstantiatedOnlyOncePerProcess"),
        provides_directional_derivatives=flag(
            co_simulation, "providesDirectionalDerivative", "providesDirectionalDerivatives"
        ),
        needs_execution_tool=flag(co_simulation, "needsExecutionTool"),
    )
    identifier = source.required(co_simulation, "modelIdentifier", "CoSimulation")
    return FmuArchive(
        path=path,
        description=description,
        folder=folder,
        model_identifier=identifier,
        binaries=_binaries(folder, identifier),
        enumerations=enumerations,
        default_stop_time=(
            None if experiment is None else source.optional_number(experiment, "stopTime", where)
        ),
        log_categories=tuple(c.get("name", "") for c in root.iterfind("LogCategories/Category")),
    )


def _version(source: Source, root: Element) -> str:
    text = root.get("fmiVersion", "")
    for version in ("2.0", "3.0"):
        if text == version or text.startswith(f"{version}."):
            return version
    raise source.fault("fmiVersion", f"{text!r}", "an FMU of FMI 2.0 or 3.0")


def _co_simulation(path: Path, root: Element) -> Element:
    found = root.find("CoSimulation")
    if found is not None:
        return found
    kinds = [k for k in ("ModelExchange", "ScheduledExecution") if root.find(k) is not None]
    raise FmuError(
        f"{shown(path)}: is for {' and '.join(kinds) or 'nothing that FMI knows'} only; "
        "expected Co-Simulation, so export it as a Co-Simulation FMU"
    )


def _binaries(folder: Path, identifier: str) -> tuple[str, ...]:
    names = {identifier + suffix for suffix in LIBRARY_SUFFIXES}
    found = (p.parent.name for p in folder.glob("binaries/*/*") if p.name in names)
    return tuple(sorted(set(found)))
