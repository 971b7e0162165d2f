"""The C of tables on lanes: an interval is found by a bucket, and what it holds is one record.

A table's argument falls into one of equal buckets; each knows the first interval that begins in
it, and few corrections find the right one: the same interval that bisection finds. Differences
and slopes are rounded here as the runtime rounds them, so that float64 results have its bits.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from uuvsim_cosim.models.table import TABLES, Table

__all__ = ["tables_in_lanes"]

_CALL1 = re.compile(r"uuv_table1(_d)?\(([^\s,]+), (\w+)_x, \w+, \d+\)")
_CALL2 = re.compile(r"uuv_table2(_dx|_dy)?\(([^\s,]+), ([^\s,]+), (\w+)_x, \d+, \w+, \d+, \w+\)")
_MOST_BUCKETS = 8192


def tables_in_lanes(text: str, dtype: np.dtype) -> tuple[str, str]:
    """Give the text of the tables that `text` calls, and `text` with the calls to them."""
    calls = [*_CALL1.finditer(text), *_CALL2.finditer(text)]
    names = {m[m.re.groups] for m in calls}
    tables = "".join(_table(TABLES[name], dtype) for name in sorted(names))
    text = _CALL1.sub(r"\3_at\1(\2)", text)
    return tables, _CALL2.sub(r"\4_at\1(\2, \3)", text)


def _table(table: Table, dtype: np.dtype) -> str:
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
    lines = [
        *_grid(f"{name}_grid_x", x, dtype),
        f"static const uuv_real {name}_records[] __attribute__((aligned(64))) = "
        f"{{{_numbers(records.ravel(), dtype)}}};",
    ]
    if table.y:
        lines += _grid(f"{name}_grid_y", np.array(table.y), dtype)
    bent = ""
    if dtype == np.float32 and rows == ny and _buckets(x.astype(dtype))[2] <= 1:
        bent = f"{name}_bent"
        numbers = _numbers(_bent(x.astype(dtype), x, values, slopes).ravel(), dtype)
        lines.append(
            f"static const uuv_real {bent}[] __attribute__((aligned(64))) = {{{numbers}}};"
        )
    arguments = ("x", "y") if table.y else ("x",)
    suffixes = ("", "_dx", "_dy") if table.y else ("", "_d")
    for suffix, what in zip(suffixes, ("VALUE", "BY_X", "BY_Y"), strict=False):
        grids = ", ".join(f"&{name}_grid_{a}" for a in arguments)
        if bent and not suffix:
            y, grid_y = ("y", f"&{name}_grid_y") if table.y else ("uuv_const(0)", "0")
            lines += [
                f"static inline V {name}_at({', '.join(f'V {a}' for a in arguments)}) {{",
                f"    return uuv_lane_bent(x, {y}, &{name}_grid_x, {grid_y}, {bent});",
                "}",
            ]
            continue
        declared = ", ".join(f"V {a}" for a in arguments)
        lines += [
            f"static inline V {name}_at{suffix}({declared}) {{",
            f"    return uuv_lane_record{len(arguments)}({', '.join(arguments)}, {grids}, "
            f"{name}_records, UUV_{what});",
            "}",
        ]
    return "\n".join(lines) + "\n"


def _bent(rounded: np.ndarray, x: np.ndarray, values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Give for each bucket its knot, and for each row the value there and the slopes around it.

    A bucket without a knot takes the last one before it.
    """
    _, begin, _ = _buckets(rounded)
    bucket = _bucket_of(rounded, len(begin))
    records = np.zeros((len(begin), 8))
    for k, i in enumerate(begin):
        inside = i + 1 < len(x) - 1 and bucket[i + 1] == k
        knot = i + 1 if inside else i
        records[k, 0] = rounded[knot]
        for row in range(len(values)):
            before = slopes[row, i]
            numbers = values[row, knot], before, slopes[row, knot]
            records[k, 1 + 3 * row : 4 + 3 * row] = numbers
    return records


def _bucket_of(x: np.ndarray, count: int) -> np.ndarray:
    """Give the bucket of every knot, by the same operations as in C."""
    scale = x.dtype.type(count) / (x[-1] - x[0])
    return np.asarray(np.minimum(((x - x[0]) * scale).astype(int), count - 1))


def _grid(name: str, knots: np.ndarray, dtype: np.dtype) -> Iterator[str]:
    x = knots.astype(dtype)
    scale, begin, corrections = _buckets(x)
    following = np.append(x[1:-1], [np.nan, np.nan])  # the last knot is found apart
    buckets = np.array([(i, following[i]) for i in begin])
    yield f"static const uuv_real {name}_next[] = {{{_numbers(following, dtype)}}};"
    yield f"static const uuv_real {name}_knots[] = {{{_numbers(x, dtype)}}};"
    yield f"static const uuv_lane_bucket {name}_buckets[] = {{{_numbers(buckets.ravel(), dtype)}}};"
    yield (
        f"static const uuv_lane_grid {name} = {{{_numbers([x[0], x[-1], scale], dtype)}, "
        f"{len(x)}, {len(begin)}, {corrections}, {name}_buckets, {name}_next, {name}_knots}};"
    )


def _buckets(x: np.ndarray) -> tuple[Any, list[int], int]:
    """Give buckets a unit, the last knot before each bucket, and how many knots one holds."""
    best: tuple[Any, list[int], int] | None = None
    count = 1 if len(x) == 2 else len(x)
    while True:
        scale = x.dtype.type(count) / (x[-1] - x[0])
        # The same operations as in C, which are monotone: no x of a bucket is below its knots.
        bucket = _bucket_of(x, count)[:-1]
        each = np.arange(count)
        begin = np.maximum(0, np.searchsorted(bucket, each) - 1)
        end = np.maximum(0, np.searchsorted(bucket, each, side="right") - 1)
        corrections = int((end - begin).max())
        if best is None or corrections < best[2]:
            best = scale, begin.tolist(), corrections
        if corrections <= 1 or 2 * count > _MOST_BUCKETS:
            return best
        count *= 2


def _numbers(values: Sequence[Any] | np.ndarray, dtype: np.dtype) -> str:
    suffix = "f" if dtype == np.float32 else ""

    def text(v: Any) -> str:
        return '__builtin_nan("")' if np.isnan(v) else repr(float(v)) + suffix

    return ", ".join(text(dtype.type(v)) for v in values)
