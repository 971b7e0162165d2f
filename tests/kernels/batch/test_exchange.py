"""Variables of a batch as rows: their bits are those of `Batch.get`, for every number of lanes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels.batch.exchange import Exchange


def system() -> uuv.System:
    return (
        uuv.System("vehicle", "0.01")
        .add("hull", "model:sphere")
        .add("compass", "model:compass")
        .connect("hull.eta", "compass.eta")
    )


NAMES = ("hull.eta", "compass.seed", "hull.tau")


@pytest.mark.parametrize("n", [1, 8, 19, 300])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_rows_are_those_of_get(n: int, dtype: Any) -> None:
    kernel = uuv.fuse(system(), dtype=dtype)
    batch = kernel.batch(n, seeds=5)
    batch.set("hull.tau", np.random.default_rng(1).uniform(-9, 9, (n, 6)))
    batch.step(20)
    rows = Exchange(kernel, n, [batch.view(name) for name in NAMES]).read()
    wanted = np.concatenate([batch.get(name).astype(float).T for name in NAMES])
    assert rows.tobytes() == wanted.tobytes()
    batch.close()


@pytest.mark.parametrize("n", [3, 16, 19])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_rows_that_are_written_are_the_inputs(n: int, dtype: Any) -> None:
    kernel = uuv.fuse(system(), dtype=dtype)
    batch = kernel.batch(n)
    view = batch.view("hull.tau")
    view[...] = 7.0
    given = np.random.default_rng(2).uniform(-9, 9, (2, n))
    Exchange(kernel, n, [view[:, 4:5], view[:, 0:1]]).write(given)
    wanted = np.full((n, 6), 7.0)
    wanted[:, [4, 0]] = given.T
    assert (batch.get("hull.tau") == wanted.astype(dtype)).all()
    assert (view.swapaxes(0, 1).reshape(6, -1)[:, n:] == 7.0).all()  # lanes without an environment
    batch.close()


def test_a_step_returns_whether_an_environment_has_failed() -> None:
    batch = uuv.fuse(system()).batch(20)
    assert batch.advance(1) is False
    batch.set("hull.tau", np.full(6, 1e308), np.arange(20) == 13)
    assert batch.advance(3) is True
    assert batch.advance(1) is True
    assert np.flatnonzero(batch.failed).tolist() == [13]
    batch.reset()
    assert batch.advance(1) is False
    batch.close()
