"""The figures that the pages on importing, identifying and differentiating a vehicle print."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from reader import DOCS, Reader, blocks


def run(page: str) -> str:
    """Run the blocks of a page in the current folder; return all that its commands print."""
    said = ""
    with Reader(DOCS / f"{page}.md") as reader:
        for block in blocks(DOCS / f"{page}.md"):
            reader.reads(block)
            said += reader.output if block.language == "bash" else ""
    return said


@pytest.mark.slow
def test_the_page_on_identification_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    said = run("vehicles/identification")
    fitted = {row.split()[0]: row.split()[1] for row in said.splitlines() if row[:5] == "hull."}
    assert float(fitted["hull.D_q_11"]) == pytest.approx(25, rel=1e-3)
    assert float(fitted["hull.M_A_11"]) == pytest.approx(7, rel=1e-3)


def test_the_page_on_importing_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    said = run("vehicles/import_a_vehicle")
    # The figures of the page's comparison are those of its own hull.stl.
    page = (DOCS / "vehicles" / "import_a_vehicle.md").read_text(encoding="utf-8")
    for name, printed in (("D_q_11", 45.5), ("D_q_66", 0.238), ("M_A_33", 37.8)):
        assert f"`{name}` | {printed}" in page
        assert first(said, name) == pytest.approx(printed, rel=5e-3)


def first(said: str, name: str) -> float:
    return next(float(r.split()[1]) for r in said.splitlines() if r.startswith(f"{name} "))


def test_the_page_on_derivatives_runs() -> None:
    page = DOCS / "components" / "derivatives.md"
    with_torch, without = (b for b in blocks(page) if b.language == "python")
    namespace: dict[str, Any] = {}
    exec(with_torch.text, namespace)
    exec(without.text, namespace)
    gradients, changes = namespace["gradients"], namespace["changes"]
    assert gradients["hull.nu_0"].shape == (3, 6)
    # One number for all environments has one gradient; jvp and vjp are of one matrix.
    assert np.shape(gradients["hull.m"]) == ()
    along = namespace["along"]["hull.nu_0"]
    assert changes["hull.eta"].sum() == pytest.approx((gradients["hull.nu_0"] * along).sum())
