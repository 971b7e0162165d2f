"""C of tables on lanes: an argument selects one record, each number of which is a vector.

A table is read in the form that its call names (see fmus/codegen/table_data.py): by the lines of a
uniform grid, by its breakpoints, or by its intervals. If a function reads two tables with the same
uniform grid at the same place, they are read together.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from uuvsim_cosim.kernels.codegen.interval_tables import interval_text, numbers_text
from uuvsim_cosim.models.intrinsics.breakpoints import Buckets, buckets
from uuvsim_cosim.models.intrinsics.table import TABLES, Table
from uuvsim_cosim.models.intrinsics.uniform_grids import UniformGrid, uniform_grid

__all__ = ["tables_in_lanes"]

_AT = r"(?P<at>[^\s,]+(?:, [^\s,]+)?)"
_CALLS = (
    re.compile(rf"uuv_table1(?P<form>_d)?\({_AT}, (?P<name>\w+)_x, \w+, \d+\)"),
    re.compile(rf"uuv_table2(?P<form>_dx|_dy)?\({_AT}, (?P<name>\w+)_x, \d+, \w+, \d+, \w+\)"),
    re.compile(rf"uuv_(?P<form>buckets|uniform)[12]\({_AT}, &(?P<name>\w+)_(?:buckets|uniform)\)"),
)
_EVEN = re.compile(
    rf"^ {{4}}const V (?P<result>\w+) = uuv_uniform2\({_AT}, &(?P<name>\w+)_uniform\);$",
    re.MULTILINE,
)


def tables_in_lanes(text: str, dtype: np.dtype) -> tuple[str, str]:
    """Return the text of the tables that `text` reads, and `text` with calls of their functions."""
    pairs: dict[str, tuple[UniformGrid, ...]] = {}
    text = "\n}\n".join(_paired(body, pairs) for body in text.split("\n}\n"))
    called: dict[str, set[str]] = {}  # functions by table, such as "at_uniform" and "at_dx"

    def replaced(m: re.Match[str]) -> str:
        call = f"at_{m['form'].strip('_')}" if m["form"] else "at"
        called.setdefault(m["name"], set()).add(call)
        return f"{m['name']}_{call}({m['at']})"

    for pattern in _CALLS:
        text = pattern.sub(replaced, text)
    lines: list[str] = []
    for name in sorted(called):
        table, calls = TABLES[name], called[name]
        e, b = uniform_grid(table), buckets(table, dtype.name)
        if e is not None and "at_uniform" in calls:
            lines += _uniform(name, (e,), dtype)
            calls = calls - {"at_uniform"}
        if b is not None and "at_buckets" in calls:
            lines += _buckets(table, b, dtype)
            calls = calls - {"at_buckets"}
        if calls:
            lines += interval_text(table, dtype, calls)
    lines += [s for name in sorted(pairs) for s in _uniform(name, pairs[name], dtype)]
    return "".join(f"{line}\n" for line in lines), text


def _paired(body: str, pairs: dict[str, tuple[UniformGrid, ...]]) -> str:
    """Read two uniform tables together if a function reads both at the same place."""
    waiting: dict[tuple[object, ...], re.Match[str]] = {}
    for m in [*_EVEN.finditer(body)]:
        e = uniform_grid(TABLES[m["name"]])
        assert e is not None
        key = (m["at"], *e.grid)
        first = waiting.pop(key, None)
        if first is None:
            waiting[key] = m
            continue
        other = uniform_grid(TABLES[first["name"]])
        assert other is not None
        name = f"{first['name']}_{m['name']}"
        pairs[name] = (other, e)
        two = f"{first['result']}_two"
        read = f"    const uuv_lane_pair {two} = {name}_at_uniform({m['at']});\n"
        body = body.replace(first[0], f"{read}    const V {first['result']} = {two}.first;")
        body = body.replace(m[0], f"    const V {m['result']} = {two}.second;")
    return body


def _uniform(name: str, together: tuple[UniformGrid, ...], dtype: np.dtype) -> Iterator[str]:
    """Yield the function of a uniform table, and a record for each line: values and slopes."""
    e = together[0]
    rows = [row for each in together for row in each.rows]
    records = np.zeros((len(rows[0]), 8))
    for i, row in enumerate(rows):
        records[:, 2 * i : 2 * i + 2] = row
    n_in = len(e.rows)
    arguments, pair = ("x", "y")[:n_in], len(together) == 2
    yield (
        f"static const uuv_real {name}_lines[] __attribute__((aligned(64))) = "
        f"{{{numbers_text(records.ravel(), dtype)}}};"
    )
    numbers = numbers_text(e.grid, dtype)
    yield f"static const uuv_lane_lines {name}_uniform = {{{numbers}, {name}_lines}};"
    result = "uuv_lane_pair" if pair else "V"
    yield f"static inline {result} {name}_at_uniform({', '.join(f'V {a}' for a in arguments)}) {{"
    call = f"uuv_lane_uniform{n_in}{'_pair' if pair else ''}"
    yield f"    return {call}({', '.join(arguments)}, &{name}_uniform);"
    yield "}"


def _buckets(table: Table, b: Buckets, dtype: np.dtype) -> Iterator[str]:
    """Yield the function of a table by its breakpoints, and a record for each bucket.

    A record has for each row the breakpoint, the value there, and both slopes.
    """
    records = np.zeros((b.count + 1, 8))
    for i, (row, at) in enumerate(zip(b.rows, b.at, strict=True)):
        records[:, 4 * i : 4 * i + 4] = row[at]
    name, arguments = table.name, ("x", "y")[: table.n_in]
    numbers = numbers_text([b.first, b.last, b.scale, b.low, b.high], dtype)
    yield (
        f"static const uuv_real {name}_breakpoints[] __attribute__((aligned(64))) = "
        f"{{{numbers_text(records.ravel(), dtype)}}};"
    )
    yield f"static const uuv_lane_breakpoints {name}_buckets = {{{numbers}, {name}_breakpoints}};"
    yield f"static inline V {name}_at_buckets({', '.join(f'V {a}' for a in arguments)}) {{"
    yield f"    return uuv_lane_buckets{table.n_in}({', '.join(arguments)}, &{name}_buckets);"
    yield "}"
