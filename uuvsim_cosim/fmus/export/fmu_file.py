"""Export of a declaration as an .fmu: binaries, sources, documentation and a reference result."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Collection, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from xml.etree.ElementTree import Element, SubElement, fromstring

from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep, write_whole
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.describe import describe
from uuvsim_cosim.fmus.codegen.lowering import Lowered, lower
from uuvsim_cosim.fmus.codegen.runtime import runtime, runtime_file, runtime_files
from uuvsim_cosim.fmus.codegen.toolchain import (
    WASM32,
    Platform,
    compile_shared,
    component_flags,
    fmi_headers,
    generated_sources,
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
from uuvsim_cosim.fmus.export.web_assembly import MANIFEST, component_file, manifest
from uuvsim_cosim.fmus.pairs import MADE_FOR, PEERS, pairs_text
from uuvsim_cosim.models.declaration.library import declare_source
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["build_fmu", "build_many", "compile_fmu", "fmi_headers", "packed", "write_archive"]


def build_fmu(
    model: Model | Lowered,
    *,
    fmi: FmiVersion = 3,
    platforms: Sequence[str] = ("host",),
    target: Path | None = None,
) -> Path:
    """Build an .fmu from a declaration, `model`, and return its path.

    It is `target` (a file, or a folder), else in the cache. `fmi` is the version, 2 or 3;
    `platforms` are "host", "linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin", and
    with FMI 3.0 "wasm32", which needs the extra `sandbox`. The same declaration, platforms and
    compiler give the same bytes. Raises ToolchainError if a platform cannot be compiled for, and
    InputInvalid if `target` cannot be written.

    Example:

    >>> from pathlib import Path
    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.fmus import build_fmu
    >>> build_fmu(uuv.declare("battery"), fmi=2, target=Path("battery.fmu")).name
    'battery.fmu'
    """
    declared = model.model if isinstance(model, Lowered) else model
    if fmi not in (2, 3):
        raise InputInvalid(declared.name, f"FMI version {fmi!r}", "2 or 3")
    wanted = {platform_named(p) for p in platforms}
    lowered = model if isinstance(model, Lowered) else lower(model)
    identifier = model_identifier(declared.name)
    description = describe(declared, lowered.equations)
    given, results = reference_result(lowered, compile_fmu(lowered))
    sources = [f"{identifier}.c", "uuv_runtime.c", f"fmi{fmi}_shell.c"]
    texts = {
        "modelDescription.xml": model_description(
            lowered.equations, fmi=fmi, token=lowered.token, sources=sources
        ),
        f"sources/{identifier}.c": lowered.source,
        "documentation/index.html": index_html(description),
        "documentation/variables.md": variables_markdown(description),
        "documentation/input.csv": csv_text(description.of("input"), given),
        "documentation/reference.csv": csv_text(description.of("output"), results),
    }
    for file in runtime_files():
        if file.suffix == ".h" or file.name in sources:
            texts[f"sources/{file.name}"] = file.read_text()
    # Of a vehicle in a folder, only the folder's name is written.
    vehicles = {what: Path(address).name for what, address in declared.made_for.items()}
    for name, pairs in ((PEERS, declared.peers), (MADE_FOR, vehicles)):
        if pairs:
            texts[name] = pairs_text(name, pairs)

    def library(place: Platform) -> Path:
        if place is not WASM32:
            return compile_fmu(lowered, place.fmi2)
        shells = [runtime_file("uuv_runtime.c"), runtime_file("fmi3_shell.c")]
        return component_file(
            [*shells, *generated_sources(lowered.files)],
            name=identifier,
            description=fromstring(texts["modelDescription.xml"]),
            include=[*runtime(), fmi_headers()],
        )

    return packed(texts, identifier, sources, fmi, wanted, library, target)


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
        [runtime_file("uuv_runtime.c"), *shells, *generated_sources(lowered.files)],
        name=model_identifier(lowered.model.name),
        platform=platform,
        include=[*runtime(), fmi_headers()],
        flags=component_flags(platform_named(platform)),
    )


def write_archive(path: Path, members: Mapping[str, bytes]) -> None:
    """Write a zip file completely or not at all; equal members give equal bytes."""
    _write(path, _archive(members))


def packed(
    texts: Mapping[str, str],
    identifier: str,
    sources: Sequence[str],
    fmi: FmiVersion,
    platforms: Collection[Platform],
    library: Callable[[Platform], Path],
    target: Path | None,
    more: Mapping[str, bytes] = MappingProxyType({}),
) -> Path:
    """Return the path of an .fmu: `target` (a file, or a folder), else in the cache.

    `texts` are members by name, and `more` are members that are no text. Added to them are the
    libraries, the licences, and in FMI 3.0 the list of the `sources`, if the FMU can be compiled
    from them.
    """
    if WASM32 in platforms:
        if fmi == 2:
            raise InputInvalid(
                "platform wasm32", "FMI 2.0, for which the layered standard has no WebAssembly",
                "FMI 3.0: --fmi 3 (in Python, fmi=3)",
            )  # fmt: skip
        texts = {**texts, MANIFEST: manifest()}
    # This notice must accompany a binary that was made with FMI's headers.
    notice = (fmi_headers() / f"fmi{fmi}FunctionTypes.h").read_text(encoding="utf-8")
    notice = notice[notice.index("Copyright") :].partition("*/")[0].strip()
    texts = {
        **texts,
        "resources/README.txt": "This component needs no resources.\n",
        "documentation/licenses/fmi_headers.txt": "The binaries were compiled with the headers of "
        f"FMI {fmi}.0:\n\n{notice}\n",
    }
    if content("LICENSE").is_file():
        texts["documentation/licenses/license.txt"] = content("LICENSE").read_text()
    if fmi == 3 and sources:
        root = Element("fmiBuildDescription", fmiVersion="3.0")
        configuration = SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
        options = "-O2 -ffp-contract=off -fno-math-errno"
        files = SubElement(configuration, "SourceFileSet", language="C11", compilerOptions=options)
        for source in sources:
            SubElement(files, "SourceFile", name=source)
        texts["sources/buildDescription.xml"] = xml_text(root)
    members = {k: v.encode() for k, v in texts.items()} | dict(more)
    for place in sorted(platforms, key=lambda p: p.fmi2):
        folder = place.fmi2 if fmi == 2 else place.fmi3
        members[f"binaries/{folder}/{identifier}{place.suffix}"] = library(place).read_bytes()
    parts = [part for k in sorted(members) for part in (k, members[k])]
    cached = cache_dir("fmus", content_hash(parts)) / f"{identifier}.fmu"
    if not intact(cached):
        keep(cached, _archive(members))
    if target is None:
        return cached
    file = target if target.suffix == ".fmu" else target / cached.name
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
