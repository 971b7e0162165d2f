"""What `.ci/editor.py` asks of an editor's language server is also what `uuvsim lint` reports."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from uuvsim_cosim.commands.editor.file_checks import mistakes_in

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / ".ci" / "editor.py"))


@pytest.mark.parametrize("name", SCRIPT["CASES"])
def test_the_misspelt_key_of_each_file_is_reported_at_its_line(name: str, tmp_path: Path) -> None:
    text, wrong, _ = SCRIPT["CASES"][name]
    (tmp_path / name).write_text(text, encoding="utf-8")
    line = SCRIPT["place_of"](text, wrong)[0] + 1
    found = mistakes_in(tmp_path / name)
    assert found is not None
    assert {n for _, n, message in found if wrong in message} == {line}
