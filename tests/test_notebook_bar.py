"""Long work shows a bar in a notebook, and nothing elsewhere."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

import uuvsim_cosim as uuv
from uuvsim_cosim import notebook_bar
from uuvsim_cosim.notebook_bar import shown

CELL = """
import uuvsim_cosim as uuv
from uuvsim_cosim import notebook_bar
from IPython.display import DisplayHandle
notebook_bar.DELAY = notebook_bar.PERIOD = 0
texts = []
update = DisplayHandle.update
DisplayHandle.update = lambda self, content: (texts.append(content.data), update(self, content))
uuv.run("bluerov2_hold", until=5, out="run", backend="native"{more})
print("after")
print(texts[-2:])
"""


def executed(folder: Path, more: str) -> list[Any]:
    """Execute a notebook of one cell in a folder, and return the cell's outputs."""
    notebook = nbformat.v4.new_notebook(  # type: ignore[no-untyped-call]
        cells=[nbformat.v4.new_code_cell(CELL.format(more=more))]  # type: ignore[no-untyped-call]
    )
    folder.mkdir()
    NotebookClient(
        notebook, timeout=None, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()
    return list(notebook.cells[0].outputs)


def test_a_run_in_a_notebook_has_a_bar_that_disappears_and_records_the_same_bits(
    tmp_path: Path,
) -> None:
    bar, text = executed(tmp_path / "shown", "")
    assert bar.output_type == "display_data"
    assert bar.data["text/html"] == ""
    assert text.text.startswith("after\n")
    assert re.search(r"simulating: [\d.]+ of 5 s", text.text)
    quiet = executed(tmp_path / "quiet", ", progress=False")
    assert [output.output_type for output in quiet] == ["stream"]
    plain = uuv.run("bluerov2_hold", until=5, out=tmp_path / "plain", backend="native")
    expected = uuv.read_signals(plain.folder)
    for folder in ("shown", "quiet"):
        recorded = uuv.read_signals(tmp_path / folder / "run")
        assert list(recorded) == list(expected)
        assert all((recorded[name] == expected[name]).all() for name in expected)


def kernel(monkeypatch: pytest.MonkeyPatch, **attributes: object) -> list[str]:
    """Put a shell of IPython in place; the list that is returned receives what is displayed."""
    seen: list[str] = []
    handle = SimpleNamespace(update=seen.append)

    def display(content: str, display_id: bool) -> Any:
        assert display_id
        seen.append(content)
        return handle

    ipython = SimpleNamespace(get_ipython=lambda: SimpleNamespace(**attributes))
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    fake = SimpleNamespace(HTML=str, display=display)
    monkeypatch.setattr(notebook_bar, "import_module", lambda name: fake)
    return seen


def test_outside_of_a_notebook_nothing_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    with shown(None) as report:
        assert report is None
    kernel(monkeypatch)  # the terminal's IPython has no kernel
    with shown(None) as report:
        assert report is None


def test_a_function_or_false_replaces_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = kernel(monkeypatch, kernel=object())
    told: list[tuple[str, float, float]] = []
    with shown(lambda *event: told.append(event)) as report:
        assert report is not None
        report("running", 1, 2)
    with shown(False) as report:
        assert report is None
    assert told == [("running", 1, 2)]
    assert not seen


def test_work_that_ends_at_once_leaves_no_output(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = kernel(monkeypatch, kernel=object())
    with shown(None) as report:
        assert report is not None
        report("simulating", 1, 2)
    assert not seen


def test_the_bar_counts_and_disappears_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = kernel(monkeypatch, kernel=object())
    monkeypatch.setattr(notebook_bar, "DELAY", 0)
    monkeypatch.setattr(notebook_bar, "PERIOD", 0)

    def fails() -> None:
        with shown(None) as report:
            assert report is not None
            report("building", 0, 3)
            report("running", 1, 24)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails()
    assert seen == [
        "<progress></progress> building",
        '<progress value="1" max="24"></progress> running: 1 of 24 runs',
        "",
    ]
