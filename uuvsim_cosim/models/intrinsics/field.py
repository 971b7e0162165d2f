"""Fields on a grid as intrinsics: several values of one place and time, linear between the nodes.

As a network (network.py), a field is a CasADi Callback that is called and never inlined, named by
the hash of its contents; an emitter finds its nodes in `NETWORKS`. Nodes are float32; places,
weights and sums are float64, in the order of fmus/runtime/intrinsics/uuv_field.h, so that both
give the same bits. Along a `held` axis the value beyond an end is that at the end; beyond the
ends of any other axis it is NaN, which a master refuses by name.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.intrinsics.network import registered

__all__ = ["AXES", "Field", "field"]

AXES = 4  # UUV_FIELD_AXES


@dataclass(frozen=True, eq=False)
class Field:
    """Nodes [axis 0][axis 1][axis 2][axis 3][value] over four grids, each of one node or more."""

    name: str
    axes: tuple[tuple[float, ...], ...]
    held: tuple[bool, ...]
    nodes: NDArray[np.float32]

    @property
    def n_in(self) -> int:
        """Return the number of arguments."""
        return AXES

    @property
    def n_out(self) -> int:
        """Return the number of values."""
        return int(self.nodes.shape[-1])

    def __call__(self, x: NDArray[Any]) -> NDArray[np.float64]:
        """Return the values (n_out,) at x (4,), to the bits of the C."""
        found: NDArray[np.float64] = self._reduced(
            [self._weight(i, float(v)) for i, v in enumerate(x)], -1
        )
        return found

    def jacobian(self, x: NDArray[Any]) -> NDArray[np.float64]:
        """Return d values / d x, of shape (n_out, 4)."""
        at = [self._weight(i, float(v)) for i, v in enumerate(x)]
        columns = [self._reduced(at, i) / at[i][2] if at[i][3] else np.zeros(self.n_out)
                   for i in range(AXES)]  # fmt: skip
        return np.column_stack(columns)

    def _weight(self, i: int, at: float) -> tuple[int, float, float, bool]:
        """Return the node below, the share of the one above, their distance, and if it varies."""
        grid = self.axes[i]
        outside = not grid[0] <= at <= grid[-1]
        if outside and (isnan(at) or not self.held[i]):
            return 0, nan, 1.0, True
        if len(grid) == 1:
            return 0, 0.0, 1.0, False
        k = min(max(bisect_right(grid, at) - 1, 0), len(grid) - 2)
        width = grid[k + 1] - grid[k]
        share = (min(max(at, grid[0]), grid[-1]) - grid[k]) / width
        return k, share, width, not outside

    def _reduced(self, at: Sequence[tuple[int, float, float, bool]], slope: int) -> Any:
        """Return the value between 16 nodes, or along axis `slope` the difference of its ends."""
        low = [w[0] for w in at]
        high = [min(k + 1, len(g) - 1) for k, g in zip(low, self.axes, strict=True)]
        block = self.nodes[np.ix_(*zip(low, high, strict=True))].astype(np.float64)
        for i in reversed(range(AXES)):
            a, b = block[..., 0, :], block[..., 1, :]
            block = b - a + 0.0 * at[i][1] if i == slope else a + at[i][1] * (b - a)
        return block


def field(
    axes: Sequence[Sequence[float]], nodes: NDArray[Any], held: Sequence[bool]
) -> Callable[[ca.SX], ca.SX]:
    """Return a field over four rising grids as a function of an SX (4,) with values (n_out,).

    `nodes` is of shape (len(axes[0]), …, len(axes[3]), n_out), all finite. Raises
    ParameterInvalid.
    """
    grids = tuple(tuple(map(float, grid)) for grid in axes)
    for i, grid in enumerate(grids):
        if not grid or not np.all(np.isfinite(grid)) or not np.all(np.diff(grid) > 0):
            raise ParameterInvalid("field", f"grid {i} = {grid[:4]} …", "rising numbers")
    kept = np.ascontiguousarray(nodes, np.float32)
    expected = tuple(map(len, grids))
    if len(grids) != AXES or kept.shape[:-1] != expected or not np.all(np.isfinite(kept)):
        raise ParameterInvalid("field", f"nodes {kept.shape}", f"{expected} and values, finite")
    digest = hashlib.sha256(f"field {expected} {tuple(held)}".encode())
    for grid in grids:
        digest.update(np.array(grid).astype("<f8").tobytes())
    digest.update(kept.astype("<f4").tobytes())
    return registered(Field(f"field_{digest.hexdigest()[:12]}", grids, tuple(held), kept))
