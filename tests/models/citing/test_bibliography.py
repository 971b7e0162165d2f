"""Every source of the library has an entry, or is documented as nobody else's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.models.citing.bibliography import bibliography, escaped
from uuvsim_cosim.models.citing.component_sources import equations_of, sources_in
from uuvsim_cosim.models.declaration.library import IN_PROCESS, LIBRARY

FOLDERS = ("vehicles", "sensors", "controllers", "thrusters", "scenes")
FILES = sorted(f for d in FOLDERS for f in content("models", d).glob("*/*.yaml"))
FILES.append(content("models", "materials.yaml"))
DECLARED = {**LIBRARY, **IN_PROCESS}
# A name or "et al." and a year, as citations in docstrings are written.
CITATION = re.compile(r"[A-Z][\w'-]+(?:,? (?:and [A-Z][\w-]+|et al\.))* \(?(?:18|19|20)\d\d\b")


@pytest.mark.parametrize("file", FILES, ids=lambda f: "/".join(f.parts[-2:]))
def test_every_source_of_a_parameter_file_is_resolved(file: Path) -> None:
    known = bibliography()
    place = file.relative_to(content()).as_posix()
    missing = [
        text
        for text in sources_in(file)
        if not list(known.cited_in(text, place)) and known.own_meaning(text) is None
    ]
    assert not missing


@pytest.mark.parametrize("name", sorted(DECLARED))
def test_every_citation_of_a_components_equations_is_resolved(name: str) -> None:
    known = bibliography()
    for cited in equations_of(*DECLARED[name].split(":")):
        words = " ".join(cited.text.split())
        for entry in known.cited_in(cited.text, cited.place):
            for form, _ in entry.cited_as:
                words = words.replace(form, "")
        assert not CITATION.findall(words), cited.place


def test_a_citation_without_an_entry_would_be_found() -> None:
    assert CITATION.findall("(Nobody et al. 2019, a journal)")
    assert CITATION.findall("as Nobody and Noone 1987 state")
    assert not list(bibliography().cited_in("Nobody (2019)", "models/x.yaml"))
    assert bibliography().own_meaning("Nobody (2019)") is None


def test_every_entry_is_cited() -> None:
    known = bibliography()
    others = [*content("models", "recordings").glob("*/recording.yaml")]
    others += content("fmus", "runtime", "worlds").glob("*.h")
    texts = [(f.read_text("utf-8"), f.relative_to(content()).as_posix()) for f in FILES + others]
    for target in DECLARED.values():
        texts += [(c.text, c.place) for c in equations_of(*target.split(":"))]
    modules = ["declaration.philox"]
    modules += [
        f"acoustics.{m}" for m in ("absorption", "backscatter", "reflection", "target_strength")
    ]
    for module in modules:
        texts += [(c.text, c.place) for c in equations_of(f"uuvsim_cosim.models.{module}", "")]
    cited = {entry.key for text, place in texts for entry in known.cited_in(text, place)}
    assert set(known.entries) == cited


def test_special_characters_of_latex_are_escaped() -> None:
    assert escaped(r"a_b & 5% {x} \n ~^#$") == (
        r"a\_b \& 5\% \{x\} \textbackslash{}n \textasciitilde{}\textasciicircum{}\#\$"
    )
