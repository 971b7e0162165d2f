"""Export of a whole system as one FMU: model description, page of documentation, archive."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from xml.etree.ElementTree import SubElement, fromstring

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.runtime import runtime_file, runtime_files
from uuvsim_cosim.fmus.codegen.toolchain import (
    WASM32,
    Platform,
    compile_shared,
    component_flags,
    fmi_headers,
    generated_sources,
    platform_named,
)
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.fmus.export.fmu_file import packed
from uuvsim_cosim.fmus.export.model_description import (
    FmiVersion,
    add_experiment,
    add_interface,
    add_units,
    add_variables,
    document,
    number_text,
    xml_text,
)
from uuvsim_cosim.fmus.export.web_assembly import component_file

__all__ = [
    "Whole",
    "WholeFmu",
    "compiled",
    "component_table",
    "index_page",
    "sources_of",
    "whole_description",
]


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
    root = document(fmi, d.name, w.token, d.description, f"uuvsim-cosim {__version__}")
    attributes = {}
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
        attributes["fixedInternalStepSize"] = number_text(float(w.tick))
    add_interface(root, fmi, "CoSimulation", w.identifier, attributes, sources)
    add_units(root, d.units)
    add_experiment(root, w.stop_time, float(w.tick), d)
    reference = add_variables(root, fmi, d.variables.values())
    outputs = [  # each element in FMI 2.0
        reference[v.value_references[0] + i]
        for v in d.of("output")
        for i in range(v.size if fmi == 2 else 1)
    ]
    structure = SubElement(root, "ModelStructure")
    key = "index" if fmi == 2 else "valueReference"
    for tag, more in (("Output", {"dependencies": ""}), ("InitialUnknown", {})):
        inside = SubElement(structure, f"{tag}s") if fmi == 2 and outputs else structure
        for known_as in outputs:
            SubElement(inside, "Unknown" if fmi == 2 else tag, {key: known_as, **more})
    return xml_text(root)


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
            f"{1 if v.shape else 0}, {int(v.soft_min)}, "
            f"{_bound(v.min, '-')}, {_bound(v.max, '')}}},"
        )
    numbers = ", ".join(float(x).hex() for x in start)
    lines = [
        f"static const double block_start[] = {{{numbers}}};",
        "static const uuv_variable block_variables[] = {",
        '    {"time", 0, 1, UUV_FLOAT64, UUV_TIME, 0, 0, -__builtin_inf(), __builtin_inf()},',
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
    members: Mapping[str, bytes] = field(default_factory=dict)  # more of the archive, as they are


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
    wanted = {platform_named(p) for p in platforms}
    shell = f"whole_fmi{fmi}.c"
    sources = [*fmu.texts, shell] if fmu.portable else []
    texts = {
        "modelDescription.xml": whole_description(whole, fmi, sources),
        "documentation/index.html": index_page(whole, fmu.page),
    }
    if sources:
        texts |= {f"sources/{name}": text for name, text in fmu.texts.items()}
        every = [f for folder in fmu.include for f in sorted(folder.glob("*.h"))]
        headers = [f for f in every if not f.name.startswith(_OTHERS)]
        files = [content("fmus", "whole") / shell, runtime_file(f"fmi{fmi}_shell.c"), *headers]
        texts |= {f"sources/{f.name}": f.read_text() for f in files}

    def library(place: Platform) -> Path:
        if place is not WASM32:
            return _library(fmu, place)
        if not fmu.portable:
            raise InputInvalid(
                "platform wasm32", "the client of a server, which needs sockets", "another platform"
            )
        return component_file(
            [content("fmus", "whole") / shell, *generated_sources(fmu.texts)],
            name=whole.identifier,
            description=fromstring(texts["modelDescription.xml"]),
            include=[*fmu.include, fmi_headers()],
        )

    return packed(texts, whole.identifier, sources, fmi, wanted, library, target, fmu.members)


def _library(fmu: WholeFmu, place: Platform) -> Path:
    """Compile the library, which has both shells; cached."""
    shells = [content("fmus", "whole") / f"whole_fmi{fmi}.c" for fmi in (2, 3)]
    return compile_shared(
        [*shells, *generated_sources(fmu.texts)],
        name=fmu.whole.identifier,
        platform=place.fmi2,
        include=[*fmu.include, fmi_headers()],
        flags=[*component_flags(place), *(fmu.libraries or {}).get(place.suffix, ())],
    )
