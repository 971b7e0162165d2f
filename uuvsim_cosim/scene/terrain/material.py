"""Nature of the seabed at each node: that of the nearest place where a chart states it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.scene.chart.codes import NATURES
from uuvsim_cosim.scene.chart.read import Chart
from uuvsim_cosim.scene.terrain.grid import Grid

__all__ = ["materials_of"]

_REACH = 2000.0  # m; farther from any statement the nature is unknown


def materials_of(
    chart: Chart, grid: Grid, land: NDArray[np.bool_], unknown: NDArray[np.bool_]
) -> tuple[NDArray[np.uint8] | None, tuple[str, ...]]:
    """Return each node's index into the names, and the names; (None, ()) if nothing is charted.

    If the chart lists several natures, the first is used: it is the most important one.
    """
    codes = [next((c for c in named if c in NATURES), 0) for named in chart.natures]
    stated = [(s, c) for s, c in zip(chart.nature, codes, strict=True) if c]
    if not stated:
        return None, ()
    from scipy.ndimage import distance_transform_edt

    numbers = sorted({c for _, c in stated})
    names = ("unknown", *(NATURES[n] for n in numbers))
    index = {n: k + 1 for k, n in enumerate(numbers)}
    flat = [(s, c) for s, c in stated if s.geom_type in ("Polygon", "MultiPolygon")]
    thin = [(s, c) for s, c in stated if s.geom_type not in ("Polygon", "MultiPolygon")]
    burnt = np.full(grid.shape, -1, np.int32)
    for group, touched in ((flat, False), (thin, True)):
        found = grid.burn([s for s, _ in group], [index[c] for _, c in group], touched=touched)
        burnt = np.where(found > 0, found, burnt)
    if not (burnt > 0).any():
        return None, ()
    distance, at = distance_transform_edt(burnt <= 0, sampling=grid.spacing, return_indices=True)
    material = np.where(distance <= _REACH, burnt[tuple(at)], 0)
    material[land | unknown] = 0
    return material.astype(np.uint8), names
