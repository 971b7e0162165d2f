"""Hash of the bits of all outputs at all communication points, as `fmus/page/uuv_page.h` has it.

Each element of an output has a sum of its mixed bits over the points; the hash folds the sums in
the order of the elements. A changed bit of one value changes the hash.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["output_hash"]

_STEP, _MIX = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9)


def output_hash(rows: NDArray[np.float64], whole: Sequence[bool]) -> str:
    """Return 16 hexadecimal digits for the `rows` (points, elements) of outputs.

    `whole` says which elements are whole numbers, stored as float64.

    Example:

    >>> import numpy as np
    >>> output_hash(np.array([[0.0, 1.0], [0.5, 1.0]]), [False, True])
    '69fcf8bb2cfeedd9'
    """
    points = np.array(rows, float)
    points[:, np.asarray(whole, bool)] += 0.0  # no -0 among whole numbers
    sums = np.zeros(points.shape[1], np.uint64)
    with np.errstate(over="ignore"):
        for row in _mixed(np.ascontiguousarray(points).view(np.uint64)):
            sums = sums * _STEP + row
        found = np.array([len(sums)], np.uint64)
        for part in sums:
            found = _mixed(found * _STEP + part)
    return f"{int(found[0]):016x}"


def _mixed(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    w: NDArray[np.uint64] = (words ^ words >> np.uint64(32)) * _MIX
    return w ^ w >> np.uint64(29)
