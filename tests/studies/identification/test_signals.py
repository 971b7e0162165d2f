"""Measurements of a log on the grid of a fit: samples between grid points are used too."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.parameters import wanted_parameters
from uuvsim_cosim.studies.identification.signals import Grid, Lookup, grid_of

Array = NDArray[np.float64]
STEP = 0.04  # s


def rate(t: Array) -> Array:
    return np.asarray(0.3 * np.sin(3.0 * t) + 0.1 * np.cos(7.0 * t), dtype=np.float64)


def on_grid(period: float, first: float) -> Grid:
    """A log with forces at every grid point, and with rates r of this period [s]."""
    forces = np.round(np.arange(0.0, 8.0, STEP), 4)
    rates = np.round(np.arange(first, 7.99, period), 4)
    t = np.unique(np.concatenate([forces, rates]))
    nu = np.full((len(t), 6), np.nan)
    nu[np.searchsorted(t, rates), 5] = rate(rates)
    values = {"nu": nu, "tau": np.zeros((len(t), 6))}
    plan = flatten(System("dive").add("hull", "model:bluerov2"))
    box = GreyBox(plan, 0, wanted_parameters(plan, 0, ["D_q_66"]), exact=False)
    lookup = Lookup(Signals(t, np.arange(len(t)), values, {}), {})
    return grid_of(box, lookup, h=STEP, first=0.0, last=None)


@pytest.mark.parametrize(
    ("period", "first", "share", "error"),
    [
        (0.04, 0.02, 1.0, 6e-4),  # the gyroscope of ArduSub's log, all of them midway
        (0.1, 0.0, 0.4, 3e-3),  # its other messages, of which every second one is midway
        (0.02, 0.0, 1.0, 1e-12),  # each grid point has one, and those midway are left out
    ],
)
def test_samples_midway_between_grid_points_are_measurements(
    period: float, first: float, share: float, error: float
) -> None:
    grid = on_grid(period, first)
    r = grid.y[11]
    seen = np.isfinite(r)
    assert seen.mean() == pytest.approx(share, abs=0.02)
    inner = seen & (grid.t > 0.2) & (grid.t < 7.6)
    at = np.flatnonzero(inner)
    assert r[at] == pytest.approx(rate(grid.t[at]), abs=error)
