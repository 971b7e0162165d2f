"""All ways to run a system have one hash; a way that differs is named with its first value."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from tests.kernels.web_assembly.test_module import NEEDS_NODE, tiny
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels.verification import ways
from uuvsim_cosim.kernels.verification.emulated import emulator
from uuvsim_cosim.kernels.verification.verify import Difference, _texts, verify
from uuvsim_cosim.kernels.verification.ways import Rows, Way
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

LAW = """
class Law:
    inputs = {}
    outputs = {"u": "1"}

    def step(self, t, dt, u):
        return {"u": 0.5 * t}
"""


@NEEDS_NODE
def test_all_ways_of_a_system_with_clocks_and_draws_have_one_hash() -> None:
    found = verify(tiny(), 60, seed=3)
    assert found.difference is None
    assert {o.hash for o in found.outcomes} == {found.hash}
    names = {(o.way, o.compiler) for o in found.outcomes}
    assert ("WebAssembly in node", "zig") in names
    assert ("isolated FMUs", "zig") in names
    assert ("FMUs as WebAssembly in wasmtime", "zig") in names
    assert (("aarch64 in qemu", "zig") in names) == (emulator() is not None)
    assert ("kernel of 8 lanes, 16 threads", "zig") in names
    assert found.not_covered == ()
    assert verify(tiny(), 60, seed=4).hash != found.hash


def test_the_first_value_that_differs_is_named_with_its_time_and_both_ways(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    outputs = ways.outputs_of(flatten(tiny()))
    column = next(i for i, o in enumerate(outputs) if o.name == "hull.eta[3]")

    def rows(*changes: int) -> Rows:
        made = np.ones((11, len(outputs)))
        for tick in changes:
            made[tick, column:] = np.nextafter(1.0, 2.0)
        return made

    made = [
        Way("first", "zig", lambda *a: rows()),
        Way("late", "zig", lambda *a: rows(9)),
        Way("early", "gcc", lambda *a: rows(5, 6)),
    ]
    monkeypatch.setattr("uuvsim_cosim.kernels.verification.verify.ways_of", lambda **_: made)
    found = verify(tiny(), 10)
    assert found.hash is None
    assert found.difference == Difference(
        "hull.eta[3]", 0.05, "first (zig)", "early (gcc)", 1.0, np.nextafter(1.0, 2.0)
    )


def test_a_way_that_ends_early_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    count = len(ways.outputs_of(flatten(tiny())))
    made = [
        Way("first", "zig", lambda *a: np.ones((11, count))),
        Way("short", "zig", lambda *a: np.ones((7, count))),
    ]
    monkeypatch.setattr("uuvsim_cosim.kernels.verification.verify.ways_of", lambda **_: made)
    found = verify(tiny(), 10)
    assert found.hash is None
    assert found.difference is not None
    assert found.difference.time == 0.07


def test_foreign_fmus_and_python_components_are_reported_as_not_covered(
    first_order_fmi3: Path, tmp_path: Path
) -> None:
    (tmp_path / "law.py").write_text(LAW)
    system = (
        uuv.System("mixed", tick="0.01")
        .add("filter", str(first_order_fmi3))
        .add("law", f"{tmp_path / 'law.py'}:Law")
        .add("hull", "model:sphere")
    )
    found = verify(system, 5)
    assert found.hash is not None
    text = "\n".join(found.not_covered)
    assert "filter: an FMU, not of a declaration" in text
    assert "law: a Python component" in text
    assert "one FMU of the system, kernel and WebAssembly: filter: an FMU" in text
    assert "hull" not in text
    assert not {o.way for o in found.outcomes} & {"WebAssembly in node", "one FMU 2.0"}


@NEEDS_NODE
@pytest.mark.parametrize("name", ["bluerov2_hold", "bluerov2_survey"])
def test_the_page_of_the_docs_has_the_hash_of_a_shipped_system(name: str) -> None:
    page = (Path(__file__).parents[3] / "docs/systems/live_page.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| {name} \| (\d+) \| 0 \| (\w+) \|", page, re.M)
    system, steps = uuv.load(name), int(row[0])
    ways_here = ways.ways_of(fused=True, node=True, emulator=emulator() is not None)
    every = [w for w in ways_here if w.compiler == "zig"]
    for way in [w for w in every if w.name != "isolated FMUs" and "FMU 3" not in w.name]:
        rows = way.run(system, steps, 0)
        outputs = ways.outputs_of(flatten(system, seed=0))
        assert output_hash(rows, [o.whole for o in outputs]) == row[1], way.name


def test_ways_that_this_machine_has_not_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    verify_module = "uuvsim_cosim.kernels.verification.verify"
    for name in ("node", "emulator", "find_spec"):
        monkeypatch.setattr(f"{verify_module}.{name}", lambda *_: None)
    few = ways.ways_of(fused=False, node=False)[:1]
    monkeypatch.setattr(f"{verify_module}.ways_of", lambda **_: few)
    missing = verify(tiny(), 2).missing
    assert "node, for WebAssembly" in missing
    assert "wasmtime, for FMUs as WebAssembly" in missing
    assert "qemu-aarch64, for aarch64" in missing


def test_no_steps_are_refused() -> None:
    with pytest.raises(InputInvalid, match="steps: 0; expected 1 or more"):
        verify(tiny(), 0)


def test_more_rows_than_the_memory_holds_are_refused_before_the_first_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("uuvsim_cosim.fmus.resources.available_memory", lambda: 10**9)
    with pytest.raises(InputInvalid, match=r"steps: 10,000,000 steps of .* times fewer steps"):
        verify(tiny(), 10_000_000)


def test_outputs_that_are_texts_are_reported_as_not_compared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plan = flatten(tiny())
    hull = next(c for c in plan.components if c.path == "hull")
    text = replace(hull.description.variables["eta"], name="note", type="String", shape=())
    described = replace(hull.description, variables={**hull.description.variables, "note": text})
    noted = [replace(c, description=described) if c is hull else c for c in plan.components]
    assert _texts(replace(plan, components=tuple(noted))) == [
        "hull.note: a String, which is not compared"
    ]


def test_the_command_writes_a_table_and_its_status_is_1_if_two_ways_differ(
    uuvsim: Uuvsim, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_ssd(tiny(), tmp_path / "tiny.ssd")
    few = [w for w in ways.ways_of(fused=True, node=False) if w.name == "native components"]
    module = "uuvsim_cosim.kernels.verification.verify.ways_of"
    monkeypatch.setattr(module, lambda **_: few[:1])
    status, text, _ = uuvsim("verify", "tiny.ssd", "--steps", "20", "-o", "hashes.csv")
    assert status == 0
    header, row = (tmp_path / "hashes.csv").read_text().splitlines()
    assert header == "system,steps,seed,hash,covered"
    assert row.split(",")[3] in text
    status, _, _ = uuvsim("verify", "tiny.ssd", "--steps", "20", "-o", "hashes.md")
    assert status == 0
    assert (tmp_path / "hashes.md").read_text() == (
        "| system | steps | seed | hash | covered |\n|---|---|---|---|---|\n"
        f"| {' | '.join(row.split(','))} |\n"
    )
    wrong = Way("wrong", "gcc", lambda system, steps, seed: few[0].run(system, steps, seed) + 1.0)
    monkeypatch.setattr(module, lambda **_: [few[0], wrong])
    status, text, _ = uuvsim("verify", "tiny.ssd", "--steps", "20")
    assert status == 1
    assert "differs first, at t = 0 s" in text
    assert "in native components (zig)" in text
    assert "in wrong (gcc)" in text
