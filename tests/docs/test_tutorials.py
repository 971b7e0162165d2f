"""Each tutorial does what it says: its blocks run in order, and show the output that it shows.

In a page, a ``bash`` block runs line by line, without a shell; a ``python`` block runs in the
namespace of the page; a block after ``<!-- file: NAME -->`` is saved as that file; a ``text``
block after ``<!-- output -->`` is output of the block before it, numbers aside and with lines
left out where ``…`` stands; ``<!-- status: 2 -->`` says that a command fails so.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(p.stem for p in (DOCS / "tutorials").glob("*.md"))
EXAMPLES = sorted(p.name for p in (DOCS / "examples").glob("*.py"))
BLOCK = re.compile(
    r"(?:^<!-- (?P<note>[^\n]*) -->\n)?^```(?P<language>\w+)\n(?P<text>.*?)^```$", re.M | re.S
)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
SCRIPTS = Path(sysconfig.get_path("scripts"))


@dataclass(frozen=True)
class Block:
    """One fenced block of a page: its language, its text, and the note before it."""

    language: str
    text: str
    note: str
    line: int


def blocks(page: str) -> Iterator[Block]:
    """Give the fenced blocks of a page in order."""
    text = (DOCS / "tutorials" / f"{page}.md").read_text(encoding="utf-8")
    for found in BLOCK.finditer(text):
        line = text.count("\n", 0, found.start("language")) + 1
        yield Block(found["language"], found["text"], found["note"] or "", line)


def command(line: str) -> list[str]:
    """Give a line's arguments; `python` and scripts are those of this interpreter."""
    name, *arguments = shlex.split(line)
    if name == "python":
        return [sys.executable, *arguments]
    script = shutil.which(name, path=f"{SCRIPTS}{os.pathsep}{Path(sys.executable).parent}")
    assert script is not None, f"{name}: not installed beside {sys.executable}"
    return [script, *arguments]


def ran(line: str, status: int) -> str:
    """Run one line in the present folder and give what it wrote."""
    done = subprocess.run(command(line), capture_output=True, text=True, check=False)
    assert done.returncode == status, f"{line}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


def executed(block: Block, page: str, namespace: dict[str, Any]) -> str:
    """Run a Python block in the page's namespace and give what it printed."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        # Blank lines before the code, so that a traceback names the page's line.
        exec(compile("\n" * block.line + block.text, f"{page}.md", "exec"), namespace)
    return printed.getvalue()


def plain(line: str) -> str:
    """Give a line without its numbers, units of size and spacing."""
    return " ".join(re.sub(r"\b[kM]?B\b", "B", NUMBER.sub("#", line)).split())


def assert_shown(expected: str, output: str, place: str) -> None:
    """Check that the lines shown appear in the output, in this order."""
    there = iter([plain(line) for line in output.splitlines()])
    for line in expected.splitlines():
        start, cut, _ = line.partition("…") if line.endswith("…") else (line, "", "")
        wanted = plain(start)
        if wanted and not any(x.startswith(wanted) if cut else x == wanted for x in there):
            pytest.fail(f"{place}: {line!r} is not (or not there) in the output:\n{output}")


@pytest.mark.parametrize("page", PAGES)
def test_a_tutorial_runs_as_it_stands(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.syspath_prepend(tmp_path)  # as in an interpreter that is started here
    namespace: dict[str, Any] = {"__name__": "__main__"}
    output = ""
    for block in blocks(page):
        place = f"{page}.md:{block.line}"
        if block.note.startswith("file: "):
            Path(block.note.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
        elif block.note == "output":
            assert_shown(block.text, output, place)
        elif block.language == "bash":
            status = int(block.note.removeprefix("status: ") or 0)
            lines = [line for line in block.text.splitlines() if line.strip()]
            output = "".join(ran(line, status) for line in lines)
        elif block.language == "python":
            output = executed(block, page, namespace)
        else:
            assert block.language == "text", f"{place}: a block of language {block.language!r}"


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        runpy.run_path(str(DOCS / "examples" / name), run_name="__main__")
    assert printed.getvalue()


def test_each_page_of_the_documentation_is_in_the_table_of_contents() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    pages = [p.relative_to(DOCS).with_suffix("") for p in DOCS.rglob("*.md")]
    missing = [
        str(p) for p in pages if p.parts[0] != "_build" and f"\n{p.as_posix()}\n" not in index
    ]
    assert [p for p in missing if p != "index"] == []
