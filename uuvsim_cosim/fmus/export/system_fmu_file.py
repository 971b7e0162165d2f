"""The archive of a whole system's FMU: binaries, sources, a page of documentation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

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
from uuvsim_cosim.fmus.export.fmu_file import _build_description, _licence_of_headers, _packed
from uuvsim_cosim.fmus.export.model_description import FmiVersion
from uuvsim_cosim.fmus.export.system_description import Whole, index_page, whole_description

__all__ = ["WholeFmu", "compiled", "sources_of"]

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
