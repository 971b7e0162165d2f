"""Cells in parts: many environments have the bits of environments whose blocks are whole."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.kernels.batch import batch as batches
from uuvsim_cosim.kernels.batch.batch import Batch
from uuvsim_cosim.kernels.batch.parts import cells_of_parts
from uuvsim_cosim.kernels.kernel import Kernel

N = 43  # six blocks, of which the last is not full


def slower() -> uuv.System:
    """Return the survey with components that have longer communication steps."""
    system = uuv.load("bluerov2_survey")
    for path, rate in {"navigation": "0.1", "hull": "0.02", "thruster_3": "0.04"}.items():
        source = system.components[path].source
        assert isinstance(source, str)
        system = system.replace(path, source, rate=rate)
    return system


SYSTEMS: dict[str, Callable[[], uuv.System]] = {
    "hold": lambda: uuv.load("bluerov2_hold"),
    "slower": slower,
    "survey": lambda: uuv.load("bluerov2_survey"),
    "tracking": lambda: uuv.load("target_tracking"),
}


@cache
def kernel(name: str, dtype: str = "float64") -> Kernel:
    return uuv.fuse(SYSTEMS[name](), dtype=dtype)


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Batch, Batch]]:
    """Make a batch with cells in parts, and one with whole blocks."""

    def make(of: Kernel, threads: int = 1) -> tuple[Batch, Batch]:
        made = []
        for limit in (0, 1 << 60):
            monkeypatch.setattr(batches, "_SMALL", limit)
            made.append(of.batch(N, threads=threads))
        assert made[0]._parts is not None
        assert made[1]._parts is None
        return made[0], made[1]

    return make


def same(a: Batch, b: Batch) -> None:
    """Compare every bit of all environments; the cells of parts are joined."""
    fused, ours, theirs = a.kernel.fused, a.cells, b.cells
    differ = np.flatnonzero((ours.view(np.uint32) != theirs.view(np.uint32)).any(axis=(0, 2)))
    assert not [fused.name_of(int(cell)) for cell in differ if cell >= fused.members[0].cell]
    assert not len(differ)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("name", "dtype"),
    [*((name, "float64") for name in SYSTEMS), ("hold", "float32"), ("survey", "float32")],
)
def test_resets_at_different_times_have_the_bits_of_whole_blocks(
    both: Callable[..., tuple[Batch, Batch]], name: str, dtype: str, threads: int
) -> None:
    a, b = both(kernel(name, dtype), threads)
    for batch in (a, b):
        batch.step(7)
        batch.reset(np.arange(N) % 5 == 1, seeds=11)
        for _ in range(3):
            batch.step()
        batch.reset(np.arange(N) > 30)
        batch.step(25)
        for _ in range(3):  # no longer step begins or ends in these
            batch.step()
    np.testing.assert_array_equal(a.tick, b.tick)
    for variable in a.variables:
        np.testing.assert_array_equal(a.get(variable), b.get(variable), variable)
    same(a, b)


def sets_a_parameter(batch: Batch) -> None:
    batch.set("controller.Kp", np.linspace(50, 60, N)[:, None] * np.ones(6))


def sets_an_equal_input(batch: Batch) -> None:
    batch.set("hull.v_c", [0.1, 0.2, 0.0])


def sets_inputs_that_differ(batch: Batch) -> None:
    batch.set("hull.v_c", np.linspace(0, 0.3, 3 * N).reshape(N, 3))


def sets_some_inputs(batch: Batch) -> None:
    batch.set("hull.v_c", [0.1, 0.2, 0.0], np.arange(N) % 3 == 2)


def sets_an_equal_input_then_resets_some(batch: Batch) -> None:
    batch.set("hull.v_c", [0.1, 0.2, 0.0])
    batch.reset(np.arange(N) % 3 == 0)


def starts_with_other_inputs(batch: Batch) -> None:
    batch.reset(start={"hull.v_c": np.linspace(0, 0.3, 3 * N).reshape(N, 3)})


def starts_some_with_another_input(batch: Batch) -> None:
    batch.reset(np.arange(N) > 20, start={"hull.v_c": [0.1, 0.0, 0.0]})


def writes_an_input_in_memory(batch: Batch) -> None:
    batch.view("hull.v_c")[1:3, 0, :4] = 0.2


@pytest.mark.parametrize(
    "change",
    [
        sets_a_parameter,
        sets_an_equal_input,
        sets_inputs_that_differ,
        sets_some_inputs,
        sets_an_equal_input_then_resets_some,
        starts_with_other_inputs,
        starts_some_with_another_input,
        writes_an_input_in_memory,
    ],
)
def test_after_every_change_the_bits_are_those_of_whole_blocks(
    both: Callable[..., tuple[Batch, Batch]], change: Callable[[Batch], None]
) -> None:
    a, b = both(kernel("hold"))
    for batch in (a, b):
        batch.step(3)
        change(batch)
        batch.step(1)
        batch.step(4)
        batch.reset(np.arange(N) % 4 == 0)
        batch.step(2)
    assert np.ptp(a.get("hull.eta"), axis=0).max() > 0  # the environments differ
    same(a, b)


def test_a_lane_that_fails_is_reported_as_in_whole_blocks(
    both: Callable[..., tuple[Batch, Batch]],
) -> None:
    a, b = both(kernel("hold"))
    messages = []
    for batch in (a, b):
        batch.step(2)
        batch.view("hull.v_c")[2, 0, 3] = np.nan
        with pytest.raises(ComponentFailed) as failed:
            batch.step(3)
        assert np.flatnonzero(batch.failed).tolist() == [19]
        messages.append(str(failed.value))
        batch.reset(batch.failed)
        assert not batch.failed.any()
    assert messages[0] == messages[1]


def test_no_step_changes_nothing(both: Callable[..., tuple[Batch, Batch]]) -> None:
    a, b = both(kernel("hold"))
    for batch in (a, b):
        sets_inputs_that_differ(batch)
        batch.step(2)
        batch.step(0)
    same(a, b)


@pytest.mark.parametrize("limit", [0, 1 << 60])
def test_variables_that_are_not_read_cannot_be_got(
    monkeypatch: pytest.MonkeyPatch, limit: int
) -> None:
    monkeypatch.setattr(batches, "_SMALL", limit)
    batch = kernel("hold").batch(N, reads=["hull.eta", "wrench.tau"])
    whole = kernel("hold").batch(N)
    for made in (batch, whole):
        made.step(9)
    for name in ("hull.eta", "wrench.tau", "controller.Kp"):
        np.testing.assert_array_equal(batch.get(name), whole.get(name))
    with pytest.raises(InputInvalid, match=r"hull\.nu.*`reads`"):
        batch.get("hull.nu")
    with pytest.raises(InputInvalid, match=r"hull\.nu.*`reads`"):
        batch.view("hull.nu")


def test_a_name_in_reads_is_checked() -> None:
    with pytest.raises(InputInvalid, match=r"hull\.et"):
        kernel("hold").batch(2, reads=["hull.et"])


def test_only_seeds_of_the_parameters_pass_through_memory() -> None:
    fused = kernel("survey").fused
    parts = cells_of_parts(fused)
    cells = [cell for part in parts for cell in part]
    assert len(cells) == len(set(cells))
    found = set()
    for m in fused.members:
        for v in m.layout.values:
            if v.kind in ("parameter", "derived") and m.cell + v.offset in cells:
                found.add(v.name)
    assert found == {"seed"}


def test_outputs_that_nobody_reads_do_not_pass_through_memory() -> None:
    fused = kernel("hold").fused
    carried, given, kept = cells_of_parts(fused, ["hull.nu_dot"])
    assert len(kept) == 6
    assert 2 * len(carried) + len(given) < 0.25 * 2 * fused.n_cells
