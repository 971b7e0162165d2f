"""Each example runs, and each page is in the table of contents."""

from __future__ import annotations

import contextlib
import io
import runpy
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = sorted(p.name for p in (DOCS / "examples").glob("*.py"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(sys, "argv", [name])  # not the arguments of pytest
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        runpy.run_path(str(DOCS / "examples" / name), run_name="__main__")
    assert printed.getvalue()


def test_each_page_of_the_documentation_is_in_the_table_of_contents() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    pages = [p.relative_to(DOCS).with_suffix("") for p in DOCS.rglob("*.md")]
    missing = [
        str(p)
        for p in pages
        if p.parts[0] != "_build"
        and p.parent.parent.name != "reference"  # generated, with indices of their own
        and f"\n{p.as_posix()}\n" not in index
    ]
    assert [p for p in missing if p != "index"] == []
