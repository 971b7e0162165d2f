"""The READMEs of the content folders are short and lead somewhere; the diagrams are up to date."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from uuvsim_cosim.orchestrator.running.library import available, load
from uuvsim_cosim.view.diagram.diagram import diagram

ROOT = Path(__file__).parents[2]
WRITTEN = [p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts]
PAGES = sorted({str(p.parent.relative_to(ROOT)) for p in WRITTEN})
FOLDERS = ["models", "fmus", "orchestrator", "orchestrator/core", "orchestrator/systems"]
SYSTEMS = [f"orchestrator/systems/{name}" for name in available()]
LINK = re.compile(r"\]\(([^)#\s]+)[^)]*\)")


@pytest.mark.parametrize("folder", [*FOLDERS, *SYSTEMS])
def test_a_content_folder_opens_with_a_short_table_of_where_things_are(folder: str) -> None:
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 20
    assert "| you want" in text
    assert re.search(r"^    \w|`python |`uuvsim ", text, re.M), "no command that uses it"


@pytest.mark.parametrize("folder", [".", *PAGES, *FOLDERS, *SYSTEMS])
def test_links_lead_to_files_that_exist(folder: str) -> None:
    for page in (ROOT / folder).glob("*.md"):
        for link in LINK.findall(page.read_text(encoding="utf-8")):
            if not link.startswith(("http://", "https://", "mailto:")):
                assert (page.parent / link).exists(), f"{page.name}: {link}"


@pytest.mark.parametrize("name", available())
def test_a_drawn_diagram_is_that_of_the_system(name: str) -> None:
    file = ROOT / "orchestrator" / "systems" / name / f"{name}.svg"
    assert file.read_text(encoding="utf-8") == diagram(load(name)), f"uuvsim systems show -o {file}"


def test_no_picture_lies_at_the_root() -> None:
    """What `uuvsim systems show` draws where it is called is not committed."""
    assert not [p.name for p in ROOT.iterdir() if p.suffix in (".svg", ".png")]
