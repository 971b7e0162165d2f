"""modelDescription.xml of every shipped component in FMI 2.0 and 3.0, and the archives' names.

The archives are built without a compiler: the binary and the reference result are empty here. Both
are held by the recordings of `values`.
"""

from __future__ import annotations

import lzma
import re
import zipfile
from collections.abc import Iterable, Iterator
from difflib import unified_diff
from itertools import islice
from pathlib import Path
from typing import Any
from unittest.mock import patch

import uuvsim_cosim as uuv
from tests.freeze.canary import hash_of
from tests.freeze.differences import RECORDS
from tests.freeze.moved import definition, resolve
from uuvsim_cosim.errors import UuvsimError

TEXTS = RECORDS / "model_descriptions.txt.xz"
ROOT = Path(__file__).parents[2]
_SOURCE = re.compile(r"\b[a-z][a-z0-9_]*(?:@[a-z0-9_]+)?\?[a-z_]+=[A-Za-z0-9_.&=/+-]*[A-Za-z0-9]")
_SEPARATOR = "\x1e"


def archives(folder: Path) -> Iterator[tuple[str, str, list[str]]]:
    """Yield for each component and FMI version its name, description and list of files."""
    build = resolve("uuvsim_cosim.fmus.export", "build_fmu")
    lower = definition("lower", "fmus")
    empty = folder / "empty"
    empty.write_bytes(b"")
    stubs = {
        "compile_fmu": lambda *_, **__: empty,
        "reference_result": lambda *_, **__: ([], []),
    }
    with (
        patch.dict(build.__globals__, stubs),
        patch.dict("os.environ", UUVSIM_CACHE=str(folder / "cache")),
    ):
        for name in definition("available", "models")():
            lowered = lower(uuv.declare(name))
            for fmi in (2, 3):
                with zipfile.ZipFile(build(lowered, fmi=fmi)) as archive:
                    text = archive.read("modelDescription.xml").decode()
                    yield f"{name}, FMI {fmi}.0", normal(text), sorted(archive.namelist())


def sources() -> list[str]:
    """Return components with presets and options: all presets, and what pages and tests write.

    The shipped defaults do not reach every equation; these reach those of instruments and options.
    """
    docs = [
        path
        for path in (*ROOT.glob("docs/**/*.md"), *ROOT.glob("docs/**/*.ipynb"))
        if "_build" not in path.parts and path.parents[1].name != "reference"  # generated
    ]
    pages = [*ROOT.glob("*.md"), *docs, *ROOT.glob("tests/**/*.py")]
    pages += ROOT.glob("orchestrator/systems/*/*.ssd")
    texts = [path.read_text(encoding="utf-8").replace("&amp;", "&") for path in pages]
    written = {found for text in texts for found in _SOURCE.findall(text)}
    components = [name for name in definition("available", "models")() if "@" not in name]
    folders = [ROOT / "models" / kind for kind in ("sensors", "thrusters")]
    presets = [path.name for folder in folders for path in folder.iterdir()]
    written |= {f"{component}@{preset}" for component in components for preset in presets}
    return [text for text in sorted(written) if not tokens([text])[text].startswith("refused")]


def tokens(texts: Iterable[str]) -> dict[str, str]:
    """Return the token of each source: it changes with the generated C, and so with an equation."""
    declare, lower = definition("declare_source", "models"), definition("lower", "fmus")
    found = {}
    for text in texts:
        try:
            found[text] = lower(declare(text)).token
        except (UuvsimError, TypeError) as error:
            found[text] = f"refused: {error}"
    return found


def normal(text: str) -> str:
    """Return a description without the package's version; GUID and token stay."""
    return re.sub(r'(generationTool="uuvsim-cosim )[^"]*"', r'\1<version>"', text)


def summary(found: dict[str, tuple[str, list[str]]]) -> dict[str, Any]:
    """Return for each description its token, its hash without the token, and unusual files."""
    common = sorted(set.intersection(*(set(files) for _, files in found.values())))
    record: dict[str, Any] = {"files of all": [_platform(f) for f in common]}
    for name, (text, files) in found.items():
        token = _token(text)
        own = [_platform(f) for f in files if f not in common]
        record[name] = {"token": token, "text": hash_of(_apart(text).encode()), "files": own}
    return record


def without_values(record: dict[str, Any]) -> dict[str, Any]:
    """Return a summary without what constants of a declaration enter: token and text."""
    return {
        name: {"files": value["files"]} if isinstance(value, dict) else value
        for name, value in record.items()
    }


def structure(text: str) -> str:
    """Return a description without numbers and token: another C library may round otherwise."""
    found = re.search(r'(?:guid|instantiationToken)="<token>"', text)
    return re.sub(r"-?\d+(\.\d+)?(e[+-]?\d+)?", "0", text if found else _apart(text))


def write_texts(found: dict[str, tuple[str, list[str]]]) -> None:
    """Keep the descriptions, so that a difference can be shown line by line."""
    parts = [f"{name}\n{_apart(text)}" for name, (text, _) in found.items()]
    TEXTS.write_bytes(lzma.compress(_SEPARATOR.join(parts).encode(), preset=9))


def read_texts() -> dict[str, str]:
    """Return the recorded descriptions, without their tokens."""
    parts = lzma.decompress(TEXTS.read_bytes()).decode().split(_SEPARATOR)
    return {name: text for name, _, text in (p.partition("\n") for p in parts)}


def first_difference(name: str, text: str, recorded: dict[str, str]) -> str:
    """Return the first lines in which a description differs from the recorded one, or nothing."""
    before, after = recorded[name].splitlines(), _apart(text).splitlines()
    lines = unified_diff(before, after, f"{name}, recorded", "now", lineterm="", n=0)
    return "\n".join(islice(lines, 8))


def _token(text: str) -> str:
    found = re.search(r'(?:guid|instantiationToken)="([^"]*)"', text)  # FMI 2.0, FMI 3.0
    assert found is not None, text[:500]
    return found[1]


def _apart(text: str) -> str:
    return text.replace(_token(text), "<token>")


def _platform(name: str) -> str:
    return re.sub(r"^binaries/[^/]+/(.*)\.\w+$", r"binaries/<platform>/\1.<library>", name)
