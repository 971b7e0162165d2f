"""Notebooks of the gallery are stored without outputs and are listed; the docs build runs them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "gallery"
NOTEBOOKS = sorted(p.name for p in FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_is_stored_without_outputs_and_is_in_the_list(name: str) -> None:
    notebook = json.loads((FOLDER / name).read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert code
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
    assert notebook["cells"][0]["source"][0].startswith("# ")
    index = (FOLDER / "index.md").read_text(encoding="utf-8")
    assert f"({name})" in index
    assert f"\n{name.removesuffix('.ipynb')}\n" in index
