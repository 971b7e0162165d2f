"""Each published page works by copy and paste: its blocks run in order, as in `reader`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from reader import DOCS, ROOT, Reader, blocks

# test_vehicle_pages runs these and checks the figures that they print.
WITH_FIGURES = {"docs/vehicles/identification.md", "docs/vehicles/import_a_vehicle.md"}
PAGES = {
    str(page.relative_to(ROOT)): page
    for page in sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md")])
    if "_build" not in page.parts
    and page.parents[1].name != "reference"  # generated; see test_reference
    and any(b.language not in ("{toctree}", "{gallery}") for b in blocks(page))
}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PAGES.keys() - WITH_FIGURES))
def test_a_page_works_by_copy_and_paste(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with Reader(PAGES[name]) as reader:
        for block in blocks(PAGES[name]):
            reader.reads(block)


def test_a_block_that_no_test_runs_says_why() -> None:
    for name, page in PAGES.items():
        for block in blocks(page):
            key, _, reason = block.note.partition(": ")
            assert key != "not run" or len(reason.split()) > 3, f"{name}:{block.line}"
