"""Export of a whole system as one FMU: model description, page of documentation, archive."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.runtime import runtime_file, runtime_files
from uuvsim_cosim.fmus.codegen.toolchain import (
    compile_shared,
    component_flags,
    fmi_headers,
    platform_named,
)
from uuvsim_cosim.fmus.description import UNITS_ANNOTATION, Description, Variable
from uuvsim_cosim.fmus.export.fmu_file import _build_description, _licence_of_headers, _packed
from uuvsim_cosim.fmus.export.model_description import (
    FmiVersion,
    _common,
    _number,
    _units,
    _value,
    xml_text,
)

__all__ = [
    "Whole",
    "WholeFmu",
    "compiled",
    "component_table",
    "index_page",
    "sources_of",
    "whole_description",
]

_FMI2_TYPES = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean", "String": "String"}


@dataclass(frozen=True)
class Whole:
    """The description of a whole system's FMU; value references are offsets in its block."""

    identifier: str
    description: Description
    token: str
    tick: Fraction  # s
    stop_time: float  # s
    states: bool  # its state can be saved
    needs_tool: bool  # it needs another program

    @property
    def size(self) -> int:
        """The number of values of the block; texts follow it."""
        variables = [v for v in self.description.variables.values() if v.type != "String"]
        last = max(variables, key=lambda v: v.value_references[0])
        return last.value_references[0] + last.size


def whole_description(w: Whole, fmi: FmiVersion, sources: Sequence[str] = ()) -> str:
    """Return the XML text of FMI 2.0 or FMI 3.0.

    An output at a communication point results from the last step, so that it depends on no input;
    in initialization it may depend on all.
    """
    d = w.description
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0" if fmi == 2 else "3.0",
            "modelName": d.name,
            ("guid" if fmi == 2 else "instantiationToken"): w.token,
            "description": " ".join(d.description.split()),
            "generationTool": f"uuvsim-cosim {__version__}",
            "license": "Apache-2.0",
            "variableNamingConvention": "structured",
        },
    )
    _co_simulation(root, w, fmi, sources)
    _units(root, d)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="refused calls")
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=_number(w.stop_time),
        stepSize=_number(float(w.tick)),
    )
    _variables_and_structure(root, d, fmi)
    return xml_text(root)


def _co_simulation(root: Element, w: Whole, fmi: FmiVersion, sources: Sequence[str]) -> None:
    attributes = {"modelIdentifier": w.identifier}
    if w.needs_tool:
        attributes["needsExecutionTool"] = "true"
        # Two instances would control the same co-simulation.
        attributes["canBeInstantiatedOnlyOncePerProcess"] = "true"
    if w.states:
        state = "FMUstate" if fmi == 2 else "FMUState"
        attributes |= {f"canGetAndSet{state}": "true", f"canSerialize{state}": "true"}
    if fmi == 2:
        attributes["canNotUseMemoryManagementFunctions"] = "true"
    else:
        attributes["fixedInternalStepSize"] = _number(float(w.tick))
    element = SubElement(root, "CoSimulation", attributes)
    if fmi == 2 and sources:
        files = SubElement(element, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)


def _variables_and_structure(root: Element, d: Description, fmi: FmiVersion) -> None:
    parent = SubElement(root, "ModelVariables")
    outputs: list[str] = []
    if fmi == 3:
        time = {"name": "time", "valueReference": "0", "causality": "independent"}
        SubElement(parent, "Float64", {**time, "variability": "continuous", "unit": "s"})
    index = 0
    for v in d.variables.values():
        first = v.value_references[0]
        if fmi == 3:
            _fmi3_variable(parent, v)
            if v.causality == "output":
                outputs.append(str(first))
            continue
        starts = None if v.start is None or v.type == "String" else np.ravel(v.start).tolist()
        for i, name in enumerate(v.element_names):
            index += 1
            start = None if starts is None else [starts[i]]
            scalar = SubElement(parent, "ScalarVariable", _common(v, name, first + i))
            values = {"start": str(v.start)}
            if v.type != "String":
                values = _value(v, v.unit_of_element(i), start)
            SubElement(scalar, _FMI2_TYPES[v.type], values)
            if v.causality == "output":
                outputs.append(str(index))
    structure = SubElement(root, "ModelStructure")
    key = "index" if fmi == 2 else "valueReference"
    for tag, more in (("Output", {"dependencies": ""}), ("InitialUnknown", {})):
        inside = SubElement(structure, f"{tag}s") if fmi == 2 and outputs else structure
        for known_as in outputs:
            SubElement(inside, "Unknown" if fmi == 2 else tag, {key: known_as, **more})


def _fmi3_variable(parent: Element, v: Variable) -> None:
    common = _common(v, v.name, v.value_references[0])
    if v.type == "String":
        SubElement(SubElement(parent, "String", common), "Start", value=str(v.start))
        return
    starts = None if v.start is None else np.ravel(v.start).tolist()
    element = SubElement(parent, v.type, {**common, **_value(v, v.unit, starts)})
    if v.element_units:  # FMI 3.0 has one unit for the whole array
        note = SubElement(SubElement(element, "Annotations"), "Annotation", type=UNITS_ANNOTATION)
        note.text = " ".join(unit or "1" for unit in v.element_units)
    for extent in v.shape:
        SubElement(element, "Dimension", start=str(extent))


def component_table(w: Whole) -> str:
    """Return the C of the table that the shells read: names, kinds, bounds, start values."""
    numeric = [v for v in w.description.variables.values() if v.type != "String"]
    first = min((v.value_references[0] for v in numeric if v.causality == "output"), default=w.size)
    start = np.zeros(w.size)
    inputs = sum(v.size for v in numeric if v.causality == "input")  # they come first
    rows = []
    for v in numeric:
        at = v.value_references[0]
        if v.start is not None:
            start[at : at + v.size] = np.ravel(v.start)
        kind = {"input": "UUV_INPUT", "output": "UUV_OUTPUT"}.get(
            v.causality, "UUV_TUNABLE" if v.variability == "tunable" else "UUV_FIXED"
        )
        rows.append(
            f'    {{"{v.name}", {at}, {v.size}, UUV_{v.type.upper()}, {kind}, '
            f"{1 if v.shape else 0}, {_bound(v.min, '-')}, {_bound(v.max, '')}}},"
        )
    numbers = ", ".join(float(x).hex() for x in start)
    lines = [
        f"static const double block_start[] = {{{numbers}}};",
        "static const uuv_variable block_variables[] = {",
        '    {"time", 0, 1, UUV_FLOAT64, UUV_TIME, 0, -__builtin_inf(), __builtin_inf()},',
        *rows,
        "};",
        "const uuv_component uuv_the_component = {",
        f'    .name = "{w.identifier}", .token = "{w.token}", .n_block = {w.size},',
        f"    .off_x = {first}, .off_y = {first}, .n_y = {w.size - first},",
        f"    .off_u = 1, .n_u = {inputs}, .off_seed = -1,",
        "    .start = block_start, .variables = block_variables,",
        f"    .n_variables = {len(rows) + 1},",
        "};",
    ]
    return "\n".join(lines) + "\n"


def _bound(value: float | None, sign: str) -> str:
    return f"{sign}__builtin_inf()" if value is None else float(value).hex()


def index_page(w: Whole, text: str) -> str:
    """Return the page that FMI tools show: a text, then the variables."""
    rows = []
    for v in w.description.variables.values():
        shape = f"[{', '.join(map(str, v.shape))}]" if v.shape else ""
        cells = (v.name + shape, v.type, v.causality, v.variability, v.unit_text, v.description)
        rows.append("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in cells) + "</tr>")
    columns = ("name", "type", "causality", "variability", "unit", "meaning")
    head = "".join(f"<th>{c}</th>" for c in columns)
    name = html.escape(w.description.name)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{name}</title>'
        "</head>\n<body>\n"
        f"<h1>{name}</h1>\n<p>{html.escape(text)}</p>\n<table>\n<tr>{head}</tr>\n"
        + "\n".join(rows)
        + "\n</table>\n</body>\n</html>\n"
    )


# Headers of the same folders that no component of float64 without a server includes.
_OTHERS = ("uuv_float_", "uuv_client", "uuv_json", "uuv_socket", "uuv_token")


@dataclass(frozen=True)
class WholeFmu:
    """The parts of a whole system's FMU; `texts` are its generated C files by name."""

    whole: Whole
    texts: Mapping[str, str]
    include: tuple[Path, ...]  # folders of headers, which go into the archive's sources
    page: str
    libraries: Mapping[str, Sequence[str]] | None = None  # by suffix of the binary
    portable: bool = True  # the FMU can be compiled from its sources only


@lru_cache
def sources_of() -> tuple[bytes, ...]:
    """Return the contents of the C that is not generated, which is a part of a token's hash."""
    folders = [content("fmus", "whole"), content("fmus", "kernels")]
    files = [f for folder in folders for f in sorted(folder.glob("*.[ch]"))]
    return tuple(f.read_bytes() for f in [*files, *runtime_files()])


def compiled(
    fmu: WholeFmu, *, fmi: FmiVersion, platforms: Sequence[str], target: Path | None
) -> Path:
    """Compile and pack; return the path. The same system gives the same bytes."""
    whole = fmu.whole
    if fmi not in (2, 3):
        raise InputInvalid(whole.identifier, f"FMI version {fmi!r}", "2 or 3")
    members = {k: v.encode() for k, v in _texts(fmu, fmi).items()}
    for place in map(platform_named, sorted({platform_named(p).fmi2 for p in platforms})):
        folder = place.fmi2 if fmi == 2 else place.fmi3
        binary = library(fmu, place.fmi2).read_bytes()
        members[f"binaries/{folder}/{whole.identifier}{place.suffix}"] = binary
    return _packed(members, f"{whole.identifier}.fmu", target)


def library(fmu: WholeFmu, platform: str = "host") -> Path:
    """Compile the library, which has both shells; cached."""
    folder = cache_dir("generated", content_hash([p for kv in fmu.texts.items() for p in kv]))
    generated = [folder / name for name in fmu.texts]
    for path, text in zip(generated, fmu.texts.values(), strict=True):
        if not intact(path):
            keep(path, text.encode())
    place = platform_named(platform)
    shells = [content("fmus", "whole") / f"whole_fmi{fmi}.c" for fmi in (2, 3)]
    return compile_shared(
        [*shells, *generated],
        name=fmu.whole.identifier,
        platform=platform,
        include=[*fmu.include, fmi_headers()],
        flags=[*component_flags(place), *(fmu.libraries or {}).get(place.suffix, ())],
    )


def _texts(fmu: WholeFmu, fmi: FmiVersion) -> dict[str, str]:
    """Return the members that are text."""
    whole = fmu.whole
    shell = f"whole_fmi{fmi}.c"
    listed = [*fmu.texts, shell] if fmu.portable else []
    texts = {
        "modelDescription.xml": whole_description(whole, fmi, listed),
        "documentation/index.html": index_page(whole, fmu.page),
        "documentation/licenses/fmi_headers.txt": _licence_of_headers(fmi),
        "resources/README.txt": "This component needs no resources.\n",
    }
    licence = content("LICENSE")
    if licence.is_file():
        texts["documentation/licenses/license.txt"] = licence.read_text()
    if listed:
        texts |= {f"sources/{name}": text for name, text in fmu.texts.items()}
        every = [f for folder in fmu.include for f in sorted(folder.glob("*.h"))]
        headers = [f for f in every if not f.name.startswith(_OTHERS)]
        wanted = [content("fmus", "whole") / shell, runtime_file(f"fmi{fmi}_shell.c"), *headers]
        texts |= {f"sources/{f.name}": f.read_text() for f in wanted}
        if fmi == 3:
            texts["sources/buildDescription.xml"] = _build_description(whole.identifier, listed)
    return texts
