"""The pages on importing, identifying and differentiating a vehicle run as they stand.

A ``bash`` block is run line by line in this process; files, output and Python blocks are as in the
tutorials.
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "models"))

from test_import_description import URDF
from test_import_mesh import binary, box
from test_tutorials import BLOCK, DOCS, Block, assert_shown, executed

from uuvsim_cosim.cli import status_of


def blocks(page: str) -> list[Block]:
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    found = []
    for f in BLOCK.finditer(text):
        line = text.count("\n", 0, f.start("language")) + 1
        found.append(Block(f["language"], f["text"], f["note"] or "", line))
    return found


def run(page: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Run the commands and the shown output of a page; gives all that was written."""
    said = output = ""
    for block in blocks(page):
        if block.note.startswith("file: "):
            Path(block.note.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
        elif block.note == "output":
            assert_shown(block.text, output, f"{page}.md:{block.line}")
        elif block.language == "bash":
            output = ""
            for line in block.text.splitlines():
                arguments = shlex.split(line, comments=True)
                assert arguments[0] == "uuvsim", line
                assert status_of(arguments[1:]) == 0, f"{line}: {capsys.readouterr().err}"
                output += capsys.readouterr().out
            said += output
    return said


def test_the_page_on_identification_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    said = run("identification", capsys)
    fitted = {row.split()[0]: row.split()[1] for row in said.splitlines() if row[:5] == "hull."}
    assert float(fitted["hull.D_q_11"]) == pytest.approx(25, rel=1e-3)
    assert float(fitted["hull.M_A_11"]) == pytest.approx(7, rel=1e-3)


def test_the_page_on_importing_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    binary(tmp_path / "hull.stl", 1000 * box(0.457, 0.338, 0.25))
    (tmp_path / "rexrov.urdf").write_text(URDF.format(more=""))
    said = run("import_a_vehicle", capsys)
    # The figures of the page's comparison are those of its own hull.stl.
    page = (DOCS / "import_a_vehicle.md").read_text(encoding="utf-8")
    for name, printed in (("D_q_11", 45.5), ("D_q_66", 0.238), ("M_A_33", 33.2)):
        assert f"`{name}` | {printed}" in page
        assert first(said, name) == pytest.approx(printed, rel=5e-3)


def first(said: str, name: str) -> float:
    return next(float(r.split()[1]) for r in said.splitlines() if r.startswith(f"{name} "))


def test_the_page_on_derivatives_runs() -> None:
    """The block with torch is an example's, which runs by itself; the rest runs on its kernel."""
    with_torch, without = (b for b in blocks("derivatives") if b.language == "python")
    example = (DOCS / "examples" / "gradient_of_commands.py").read_text(encoding="utf-8")
    assert with_torch.text.strip() in example
    built = with_torch.text.partition("\n\nstart")[0].split("\n\n", 1)
    lines = [x for x in "\n\n".join(built).splitlines() if "torch" not in x and "autograd" not in x]
    namespace: dict[str, Any] = {}
    executed(Block("python", "\n".join(lines), "", with_torch.line), "derivatives", namespace)
    executed(without, "derivatives", namespace)
    gradients, changes = namespace["gradients"], namespace["changes"]
    assert gradients["hull.nu_0"].shape == (3, 6)
    # One number for all environments has one gradient; jvp and vjp are of one matrix.
    assert np.shape(gradients["hull.m"]) == ()
    along = namespace["along"]["hull.nu_0"]
    assert changes["hull.eta"].sum() == pytest.approx((gradients["hull.nu_0"] * along).sum())
