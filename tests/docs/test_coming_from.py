"""The page for users of other tools: what it tells them to write here runs, row by row."""

from __future__ import annotations

import contextlib
import io
import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.cli import status_of

PAGE = Path(__file__).parents[2] / "docs" / "coming_from.md"
ROW = re.compile(r"^\| (?P<theirs>.+?) \| `(?P<ours>[^`]+)` \|$", re.M)
SCENARIO = {
    "description": "one override",
    "events": [{"time": 0.2, "model": "a", "variable": "y", "action": "override", "value": 0.5}],
    "end": 1.0,
}


def rows() -> list[str]:
    return [found["ours"] for found in ROW.finditer(PAGE.read_text(encoding="utf-8"))]


def test_every_row_has_something_to_run() -> None:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    table = [x for x in lines if x.startswith("| ") and not x.endswith("| here |")]
    assert len(rows()) == len(table) >= 40


def test_the_page_runs_from_top_to_bottom(
    first_order_fmi2: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(first_order_fmi2, "a.fmu")
    shutil.copy(first_order_fmi2, "b.fmu")
    Path("u.csv").write_text("time,u\n0,0\n1,1\n")
    Path("scenario.json").write_text(json.dumps(SCENARIO))
    namespace: dict[str, Any] = {"Path": Path}
    for text in rows():
        with contextlib.redirect_stdout(io.StringIO()):
            if text.startswith("uuvsim "):
                assert status_of(shlex.split(text)[1:]) == 0, text
            else:
                exec(compile(text, text, "exec"), namespace)
    assert Path("calls.csv").read_text().count("fmi2DoStep") == 10
    assert namespace["done"].steps == 10
    assert Path("packed.mat").is_file()
    assert Path("model.svg").is_file()
