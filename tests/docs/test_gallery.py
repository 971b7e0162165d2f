"""Notebooks of the gallery are stored without outputs, are in the list, run, and draw a picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "gallery"
NOTEBOOKS = sorted(p.name for p in FOLDER.glob("*.ipynb"))


def cells(name: str) -> list[dict[str, str]]:
    found: list[dict[str, str]] = json.loads((FOLDER / name).read_text(encoding="utf-8"))["cells"]
    return found


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_is_stored_without_outputs_and_is_in_the_list(name: str) -> None:
    code = [cell for cell in cells(name) if cell["cell_type"] == "code"]
    assert code
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
    assert cells(name)[0]["source"][0].startswith("# ")
    index = (FOLDER / "index.md").read_text(encoding="utf-8")
    assert f"\n{name.removesuffix('.ipynb')}: " in index  # its card
    assert f"\n{name.removesuffix('.ipynb')}\n" in index  # its entry in the table of contents


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_runs_and_draws_a_picture(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.close("all")
    variables: dict[str, object] = {"__name__": "__main__"}
    for number, cell in enumerate(cells(name)):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{name}, cell {number}", "exec"), variables)
    assert pyplot.get_fignums()
    pyplot.close("all")


def test_the_notebook_of_the_papers_figures_has_each_figure_and_no_outputs() -> None:
    notebook = json.loads((FOLDER.parent / "learning" / "paper_figures.ipynb").read_text("utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
    heads = [cell["source"][0] for cell in notebook["cells"] if cell["cell_type"] == "markdown"]
    assert [head.split(":")[0] for head in heads[1:]] == [f"## Figure {n}" for n in range(1, 12)]
