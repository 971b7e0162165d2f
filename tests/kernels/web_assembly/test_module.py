"""A system in WebAssembly is the master, bit for bit, and its hash shows it."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.kernels.web_assembly.module import web_assembly
from uuvsim_cosim.kernels.web_assembly.node import run_in_node
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan

NEEDS_NODE = pytest.mark.skipif(shutil.which("node") is None, reason="no node on this machine")
STEPS = 400


class Kept:
    """All rows of a run, and which of their columns are whole numbers."""

    def __init__(self) -> None:
        self.parts: list[np.ndarray] = []

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        self.names = [c.name for c in columns]
        self.whole = [c.variable.type not in ("Float64", "Float32") for c in columns]

    def observe(self, chunk: Chunk) -> None:
        n = len(self.names)
        self.parts.append(np.column_stack([chunk.values(i).astype(float) for i in range(n)]))

    def end(self) -> None: ...


def mastered(system: uuv.System, steps: int, seed: int = 0) -> tuple[np.ndarray, list[bool]]:
    """Return all outputs of native components that the master steps."""
    kept, plan = Kept(), flatten(system, seed=seed)
    with Master(plan, prepare(plan), observers=[kept]) as master:
        master.initialize()
        master.step(steps)
    return np.concatenate(kept.parts), kept.whole


def tiny() -> uuv.System:
    """Return a hull in a random current, with a sampled compass and a slower component."""
    return (
        uuv.System("tiny", tick="0.01")
        .add("current", "model:current_gauss_markov", rate="0.05")
        .add("hull", "model:sphere", start={"eta_0": [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]})
        .add("compass", "model:compass", rate="0.02")
        .connect("current.v_c", "hull.v_c")
        .connect("hull.eta", "compass.eta")
    )


@NEEDS_NODE
@pytest.mark.parametrize("seed", [0, 7])
def test_a_system_in_node_has_the_master_s_bits_for_every_output(seed: int) -> None:
    system = uuv.load("bluerov2_survey")
    rows, whole = mastered(system, STEPS, seed)
    found = run_in_node(web_assembly(system), STEPS, seed=seed)
    assert found.failure == ""
    assert found.rows.shape == rows.shape == (STEPS + 1, 182)
    np.testing.assert_array_equal(found.rows.view(np.uint64), rows.view(np.uint64))
    assert found.hash == output_hash(rows, whole)
    assert found.imports == ()  # no library, no clock, no file


@NEEDS_NODE
def test_a_component_with_a_longer_step_has_the_same_hash() -> None:
    rows, whole = mastered(tiny(), STEPS)
    assert run_in_node(web_assembly(tiny()), STEPS, record=False).hash == output_hash(rows, whole)


@NEEDS_NODE
def test_another_parameter_is_another_hash_and_the_master_agrees() -> None:
    kp = [60.0, 60.0, 80.0, 14.0, 14.0, 6.0]
    system = uuv.load("bluerov2_hold")
    compiled = web_assembly(system)
    with_kp = system.set("controller.Kp", kp)
    rows, whole = mastered(with_kp, STEPS)
    found = run_in_node(compiled, STEPS, start={"controller.Kp": kp}, record=False)
    assert found.hash == output_hash(rows, whole)
    assert found.hash != run_in_node(compiled, STEPS, record=False).hash


@NEEDS_NODE
def test_node_names_the_value_that_is_no_longer_finite() -> None:
    compiled = web_assembly(uuv.System("tank").add("hull", "model:sphere"))
    found = run_in_node(compiled, 100, start={"hull.tau": [1e300, 0, 0, 0, 0, 0]})
    assert "is not finite at t = " in found.failure
    assert found.failure.startswith("hull.")
    assert len(found.rows) == found.steps + 1 < 101


def test_each_changed_bit_changes_the_hash() -> None:
    rows = np.random.default_rng(0).normal(size=(5, 3))
    whole = [False, False, False]
    seen = {output_hash(rows, whole)}
    for point, column, bit in np.ndindex(5, 3, 64):
        changed = rows.copy()
        changed.view(np.uint64)[point, column] ^= np.uint64(1) << np.uint64(bit)
        seen.add(output_hash(changed, whole))
    assert len(seen) == 1 + 5 * 3 * 64


def test_two_changed_signs_do_not_cancel_and_whole_numbers_have_no_minus_zero() -> None:
    rows = np.zeros((3, 2))
    signed = rows.copy()
    signed[1:, 0] = -0.0
    assert output_hash(signed, [False, False]) != output_hash(rows, [False, False])
    assert output_hash(signed, [True, False]) == output_hash(rows, [True, False])


def test_foreign_fmus_and_python_components_are_refused_by_name(
    first_order_fmi3: Path, tmp_path: Path
) -> None:
    law = tmp_path / "law.py"
    law.write_text(
        "class Law:\n    inputs = {}\n    outputs = {'u': '1'}\n\n"
        "    def step(self, t, dt, u):\n        return {'u': 0.0}\n"
    )
    system = (
        uuv.System("mixed", tick="0.01")
        .add("filter", str(first_order_fmi3))
        .add("law", f"{law}:Law")
        .add("hull", "model:sphere")
    )
    with pytest.raises(SystemInvalid) as caught:
        web_assembly(system)
    text = str(caught.value)
    assert "filter: an FMU" in text
    assert "law: a Python component" in text
    assert "in WebAssembly" in text
    assert "hull:" not in text
    assert "kernel" not in text
