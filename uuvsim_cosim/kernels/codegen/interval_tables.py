"""C of a linear table on lanes by its intervals, for derivatives and tables of many rows.

A table's argument falls into one of equal buckets. Each bucket stores the first interval that
begins in it; a few corrections then find the same interval as bisection. Differences and slopes
are rounded here in the same way as in the runtime, so that float64 results have the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from uuvsim_cosim.models.intrinsics.table import Table

__all__ = ["interval_text", "numbers_text"]

_MOST_BUCKETS = 8192
_MODES = {"_d": "BY_X", "_dx": "BY_X", "_dy": "BY_Y"}  # by the suffix of a call


def interval_text(table: Table, dtype: np.dtype, calls: set[str]) -> Iterator[str]:
    """Yield the functions `calls` of a table ("at", "at_dx"), and the records that they read.

    An interval has one record: its first knot, and for each pair of rows the values and slopes.
    """
    x = np.array(table.x)
    name, n, ny = table.name, len(x), max(1, len(table.y))
    values = np.array(table.values).reshape(ny, n)
    slopes = np.hstack([np.diff(values) / np.diff(x), np.full((ny, 1), -0.0)])
    rows = min(ny, 2)
    records = np.zeros((max(1, ny - 1), n, 8))
    records[:, :, 0] = x
    for row in range(rows):
        last = ny - rows + row + 1
        records[:, :, 1 + 2 * row] = values[row:last]
        records[:, :, 2 + 2 * row] = slopes[row:last]
    yield from _grid(f"{name}_grid_x", x, dtype)
    yield (
        f"static const uuv_real {name}_records[] __attribute__((aligned(64))) = "
        f"{{{numbers_text(records.ravel(), dtype)}}};"
    )
    if table.y:
        yield from _grid(f"{name}_grid_y", np.array(table.y), dtype)
    arguments = ("x", "y") if table.y else ("x",)
    for call in sorted(calls):
        grids = ", ".join(f"&{name}_grid_{a}" for a in arguments)
        yield f"static inline V {name}_{call}({', '.join(f'V {a}' for a in arguments)}) {{"
        yield (
            f"    return uuv_lane_record{len(arguments)}({', '.join(arguments)}, {grids}, "
            f"{name}_records, UUV_{_MODES.get(call.removeprefix('at'), 'VALUE')});"
        )
        yield "}"


def _grid(name: str, knots: np.ndarray, dtype: np.dtype) -> Iterator[str]:
    x = knots.astype(dtype)
    scale, begin, corrections = _buckets(x)
    following = np.append(x[1:-1], [np.nan, np.nan])  # C treats the last knot separately
    buckets = np.array([(i, following[i]) for i in begin])
    yield f"static const uuv_real {name}_next[] = {{{numbers_text(following, dtype)}}};"
    yield f"static const uuv_real {name}_knots[] = {{{numbers_text(x, dtype)}}};"
    held = numbers_text(buckets.ravel(), dtype)
    yield f"static const uuv_lane_bucket {name}_buckets[] = {{{held}}};"
    yield (
        f"static const uuv_lane_grid {name} = {{{numbers_text([x[0], x[-1], scale], dtype)}, "
        f"{len(x)}, {len(begin)}, {corrections}, {name}_buckets, {name}_next, {name}_knots}};"
    )


def _buckets(x: np.ndarray) -> tuple[float, list[int], int]:
    """Return buckets per unit, the last knot before each bucket, and the most knots in one."""
    best: tuple[float, list[int], int] | None = None
    count = 1 if len(x) == 2 else len(x)
    while True:
        scale = x.dtype.type(count) / (x[-1] - x[0])
        # The same operations as in C, which are monotone: no x of a bucket is below its knots.
        bucket = np.minimum(((x - x[0]) * scale).astype(int), count - 1)[:-1]
        each = np.arange(count)
        begin = np.maximum(0, np.searchsorted(bucket, each) - 1)
        end = np.maximum(0, np.searchsorted(bucket, each, side="right") - 1)
        corrections = int((end - begin).max())
        if best is None or corrections < best[2]:
            best = scale, begin.tolist(), corrections
        if corrections <= 1 or 2 * count > _MOST_BUCKETS:
            return best
        count *= 2


def numbers_text(values: Sequence[float] | np.ndarray, dtype: np.dtype) -> str:
    """Write numbers of a type so that C reads the same bits."""
    suffix = "f" if dtype == np.float32 else ""

    def text(v: float) -> str:
        return '__builtin_nan("")' if np.isnan(v) else repr(float(v)) + suffix

    return ", ".join(text(dtype.type(v)) for v in values)
