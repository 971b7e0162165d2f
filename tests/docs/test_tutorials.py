"""The tutorials are notebooks that run as a reader runs them, and print what their text says.

The metadata of a code cell say what the test expects:

- `shows`: regular expressions that are found, in this order, in what the cell prints;
- `status`: the exit status of the cell's shell command, which is 0 without it.

Python has the libraries that the text names, see `extras`.
"""

from __future__ import annotations

import os
import re
import sys
import sysconfig
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbformat import NotebookNode

sys.path.insert(0, str(Path(__file__).parent))

from extras import write_site

FOLDER = Path(__file__).parents[2] / "docs" / "tutorials"
NOTEBOOKS = sorted(p.name for p in FOLDER.glob("*.ipynb"))
COMMAND = re.compile(r"^!.*$", re.M)
LINK = re.compile(r"\]\(([^)#\s]+)[^)]*\)")


def cells(name: str, kind: str) -> list[NotebookNode]:
    notebook = nbformat.read(FOLDER / name, as_version=4)
    return [cell for cell in notebook.cells if cell.cell_type == kind]


def printed(cell: NotebookNode) -> str:
    kinds = ("text/plain", "text/html")
    return "\n".join(
        x.get("text") or "\n".join(x.get("data", {}).get(kind, "") for kind in kinds)
        for x in cell.outputs
    )


def assert_shown(cell: NotebookNode) -> None:
    """Check what a cell that has run prints, and that Python warned of nothing."""
    text, at = printed(cell), 0
    for expected in cell.metadata.get("shows", ()):
        found = re.compile(expected, re.M).search(text, at)
        assert found, f"{expected!r} is not (or not there) in the output of\n{cell.source}\n{text}"
        at = found.end()
    assert not re.search(r"^\S+: \w*Warning: ", text, re.M), text


def test_there_are_tutorials() -> None:
    assert {"run.ipynb", "swap.ipynb"} <= set(NOTEBOOKS)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_tutorial_is_stored_without_outputs_and_is_in_the_list(name: str) -> None:
    code = cells(name, "code")
    assert code
    assert not any(cell.outputs or cell.execution_count for cell in code)
    index = (FOLDER / "index.md").read_text(encoding="utf-8")
    assert f"({name})" in index
    assert f"\n{name.removesuffix('.ipynb')}\n" in index


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_tutorial_begins_with_its_end_and_ends_with_the_next_step(name: str) -> None:
    first, *_, last = (cell.source for cell in cells(name, "markdown"))
    assert first.startswith("# ")
    assert "At the end" in " ".join(first.split())
    assert re.search(r"takes about \d+ minutes|takes about an hour", " ".join(first.split()))
    assert "## Where to go next\n" in last


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_links_of_a_tutorial_lead_to_files_that_exist(name: str) -> None:
    for cell in cells(name, "markdown"):
        for link in LINK.findall(cell.source):
            assert "://" in link or (FOLDER / link).exists(), link


@pytest.mark.slow
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_tutorial_runs_and_prints_what_its_text_says(name: str, tmp_path: Path) -> None:
    notebook = nbformat.read(FOLDER / name, as_version=4)
    site, work = tmp_path / "site", tmp_path / "work"
    site.mkdir()
    work.mkdir()
    text = "\n".join(cell.source for cell in notebook.cells)
    write_site(site, f"{text}\npip install ipykernel")  # Jupyter brings it
    environment = {
        **os.environ,
        "PATH": f"{sysconfig.get_path('scripts')}{os.pathsep}{os.environ.get('PATH', '')}",
        "PYTHONPATH": f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}".rstrip(os.pathsep),
        "IPYTHONDIR": str(tmp_path / "ipython"),
    }
    client = NotebookClient(notebook, timeout=None, resources={"metadata": {"path": str(work)}})
    with client.setup_kernel(env=environment):
        for number, cell in enumerate(notebook.cells):
            if cell.cell_type != "code":
                continue
            status = cell.metadata.get("status", 0)
            check = f"assert _exit_code == {status}, _exit_code"
            if not cell.source.startswith("%%"):
                cell.source = COMMAND.sub(lambda found: f"{found[0]}\n{check}", cell.source)  # noqa: B023
            client.execute_cell(cell, number)
            assert_shown(cell)
