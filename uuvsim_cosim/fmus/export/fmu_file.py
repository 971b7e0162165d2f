"""Export of a declaration as an .fmu: binaries, sources, documentation and a reference result."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep, write_whole
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.describe import describe
from uuvsim_cosim.fmus.codegen.lowering import Lowered, lower
from uuvsim_cosim.fmus.codegen.native import generated_source
from uuvsim_cosim.fmus.codegen.runtime import runtime, runtime_file, runtime_files
from uuvsim_cosim.fmus.codegen.toolchain import (
    compile_shared,
    component_flags,
    fmi_headers,
    platform_named,
)
from uuvsim_cosim.fmus.export.documentation import csv_text, index_html, variables_markdown
from uuvsim_cosim.fmus.export.experiment import reference_result
from uuvsim_cosim.fmus.export.model_description import (
    FmiVersion,
    model_description,
    model_identifier,
    xml_text,
)
from uuvsim_cosim.fmus.peers import PEERS, peers_text
from uuvsim_cosim.models.declaration.library import declare_source
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["build_fmu", "build_many", "compile_fmu", "fmi_headers", "write_archive"]


def build_fmu(
    model: Model | Lowered,
    *,
    fmi: FmiVersion = 3,
    platforms: Sequence[str] = ("host",),
    target: Path | None = None,
) -> Path:
    """Build an .fmu and return its path: `target` (a file, or a folder), else in the cache.

    The same declaration, platforms and compiler give the same bytes. Raises ToolchainError if a
    platform cannot be compiled for, and InputInvalid if `target` cannot be written.
    """
    declared = model.model if isinstance(model, Lowered) else model
    if fmi not in (2, 3):
        raise InputInvalid(declared.name, f"FMI version {fmi!r}", "2 or 3")
    wanted = sorted({platform_named(p).fmi2 for p in platforms})
    lowered = model if isinstance(model, Lowered) else lower(model)
    identifier = model_identifier(declared.name)
    members = {k: v.encode() for k, v in _texts(lowered, fmi).items()}
    for place in map(platform_named, wanted):
        folder = place.fmi2 if fmi == 2 else place.fmi3
        binary = f"{identifier}{place.suffix}"
        members[f"binaries/{folder}/{binary}"] = compile_fmu(lowered, place.fmi2).read_bytes()
    description = describe(declared, lowered.equations)
    given, results = reference_result(lowered, compile_fmu(lowered))
    rows = {
        "documentation/input.csv": csv_text(description.of("input"), given),
        "documentation/reference.csv": csv_text(description.of("output"), results),
    }
    members |= {k: v.encode() for k, v in rows.items()}
    return _packed(members, f"{identifier}.fmu", target)


def build_many(
    names: Sequence[str],
    fmi: FmiVersion = 3,
    platforms: Sequence[str] = ("host",),
    target_dir: Path | None = None,
) -> list[Path]:
    """Build an .fmu for each named declaration of the library, and return their paths.

    A name may have options, as in a system: ``multibeam@p900?scene=tacoma``.
    """
    models = [declare_source(name) for name in names]  # all, before any is built, as it may raise
    if len({model_identifier(m.name) for m in models}) < len(models):
        raise InputInvalid(", ".join(names), "two would be the same file", "one a call")
    return [build_fmu(m, fmi=fmi, platforms=platforms, target=target_dir) for m in models]


def compile_fmu(lowered: Lowered, platform: str = "host") -> Path:
    """Compile one library with both FMI shells and the native functions; cached.

    One library serves FMI 2.0 and FMI 3.0; the compiler caches the objects of the shells.
    """
    shells = [runtime_file(f"fmi{fmi}_shell.c") for fmi in (2, 3)]
    return compile_shared(
        [runtime_file("uuv_runtime.c"), *shells, generated_source(lowered)],
        name=model_identifier(lowered.model.name),
        platform=platform,
        include=[*runtime(), fmi_headers()],
        flags=component_flags(platform_named(platform)),
    )


def write_archive(path: Path, members: Mapping[str, bytes]) -> None:
    """Write a zip file completely or not at all; equal members give equal bytes."""
    _write(path, _archive(members))


def _packed(members: Mapping[str, bytes], name: str, target: Path | None) -> Path:
    """Return the path of an archive: `target` (a file, or a folder), else in the cache."""
    parts = [part for k in sorted(members) for part in (k, members[k])]
    cached = cache_dir("fmus", content_hash(parts)) / name
    if not intact(cached):
        keep(cached, _archive(members))
    if target is None:
        return cached
    file = target if target.suffix == ".fmu" else target / name
    _write(file, cached.read_bytes())
    return file


def _archive(members: Mapping[str, bytes]) -> bytes:
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in sorted(members):
            info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, members[name])
    return buffer.getvalue()


def _write(path: Path, data: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, data)
    except OSError as error:
        raise InputInvalid(
            path, f"cannot be written ({error.strerror})", "a folder that can be written"
        ) from error


def _texts(lowered: Lowered, fmi: FmiVersion) -> dict[str, str]:
    """Return the members that are text, except the reference result."""
    identifier = model_identifier(lowered.model.name)
    description = describe(lowered.model, lowered.equations)
    compiled = [f"{identifier}.c", "uuv_runtime.c", f"fmi{fmi}_shell.c"]
    texts = {
        "modelDescription.xml": model_description(
            lowered.equations, fmi=fmi, token=lowered.token, sources=compiled
        ),
        f"sources/{identifier}.c": lowered.source,
        "documentation/index.html": index_html(description),
        "documentation/variables.md": variables_markdown(description),
        "resources/README.txt": "This component needs no resources.\n",
    }
    for file in runtime_files():
        if file.suffix == ".h" or file.name in compiled:
            texts[f"sources/{file.name}"] = file.read_text()
    if fmi == 3:
        texts["sources/buildDescription.xml"] = _build_description(identifier, compiled)
    if lowered.model.peers:
        texts[PEERS] = peers_text(lowered.model.peers)
    licence = content("LICENSE")
    if licence.is_file():
        texts["documentation/licenses/license.txt"] = licence.read_text()
    texts["documentation/licenses/fmi_headers.txt"] = _licence_of_headers(fmi)
    return texts


def _licence_of_headers(fmi: FmiVersion) -> str:
    """Return the notice of FMI's headers, which must accompany a binary made with them."""
    text = (fmi_headers() / f"fmi{fmi}FunctionTypes.h").read_text(encoding="utf-8")
    begin = text.index("Copyright")
    notice = text[begin : text.index("*/", begin)].strip()
    return f"The binaries were compiled with the headers of FMI {fmi}.0:\n\n{notice}\n"


def _build_description(identifier: str, compiled: Sequence[str]) -> str:
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = SubElement(
        configuration,
        "SourceFileSet",
        language="C11",
        compilerOptions="-O2 -ffp-contract=off -fno-math-errno",
    )
    for name in compiled:
        SubElement(files, "SourceFile", name=name)
    return xml_text(root)
