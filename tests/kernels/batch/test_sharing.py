"""Parameters that are equal in all lanes are read once, and never when they may differ."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels.batch.batch import Batch

N = 19  # three blocks, of which the last is not full


@pytest.fixture(scope="module")
def kernel() -> Any:
    return uuv.fuse(uuv.load("bluerov2_hold"))


def own(batch: Batch) -> set[str]:
    """Return the components whose parameters each environment reads itself."""
    fused = batch.kernel.fused
    return {m.path for m in fused.members if batch._sharing._own[m.cell]}


def sets(batch: Batch) -> None:
    batch.set("controller.Kp", np.linspace(50, 60, N)[:, None] * np.ones(6))


def sets_some(batch: Batch) -> None:
    batch.set("controller.Kp", np.full(6, 70.0), np.arange(N) % 3 == 0)


def sets_all_then_resets_some(batch: Batch) -> None:
    batch.set("controller.Kp", np.full(6, 70.0))
    assert own(batch) == set()
    batch.reset(np.arange(N) % 3 == 0)


def starts(batch: Batch) -> None:
    batch.reset(start={"controller.Kp": np.linspace(50, 60, N)[:, None] * np.ones(6)})


def starts_some(batch: Batch) -> None:
    batch.reset(np.arange(N) < 2, start={"controller.Kp": np.full(6, 70.0)})


def differs_by_the_sign_of_zero(batch: Batch) -> None:
    values = np.zeros((N, 6))
    values[-1] = -0.0
    batch.reset(start={"controller.Kp": values})


@pytest.mark.parametrize(
    "change",
    [sets, sets_some, sets_all_then_resets_some, starts, starts_some, differs_by_the_sign_of_zero],
)
def test_after_every_change_the_bits_are_those_of_environments_that_share_nothing(
    kernel: Any, change: Callable[[Batch], None]
) -> None:
    batches = [kernel.batch(N), kernel.batch(N)]
    for batch in batches:
        batch.step(3)
        change(batch)
    assert own(batches[0]) == {"controller"}
    batches[1].cells  # noqa: B018  (reading it ends the sharing)
    for batch in batches:
        batch.step(1)
        batch.step(4)
    assert batches[0]._memory.cells.tobytes() == batches[1]._memory.cells.tobytes()


def test_a_reset_of_all_to_equal_values_shares_again(kernel: Any) -> None:
    batch = kernel.batch(N)
    assert own(batch) == set()
    starts(batch)
    sets(batch)
    batch.reset(start={"controller.Kp": np.full(6, 60.0)})
    assert own(batch) == set()


def test_equal_values_given_to_some_do_not_end_the_sharing(kernel: Any) -> None:
    batch = kernel.batch(N)
    value = batch.get("controller.Kp")[0]
    batch.reset(np.arange(N) < 4, start={"controller.Kp": value})
    assert own(batch) == set()


def test_each_environment_has_draws_of_its_own_seed() -> None:
    kernel = uuv.fuse(uuv.load("bluerov2_survey"))
    batch = kernel.batch(N)
    batch.step(20)
    assert own(batch) == set()
    assert len(np.unique(batch.get("compass.psi"))) == N


def test_cells_that_a_caller_may_write_end_the_sharing(kernel: Any) -> None:
    batch = kernel.batch(N)
    member = kernel.fused.members[kernel.fused.index["controller"]]
    at = member.cell + member.layout.offset_of("Kp")
    batch.cells[-1, at : at + 6] = 10.0  # the last block alone
    batch.step(5)
    tau = batch.get("controller.tau_d")[:, 2]
    assert tau[0] != tau[-1]
