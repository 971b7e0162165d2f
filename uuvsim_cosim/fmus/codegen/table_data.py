"""A table in C: its numbers, and the call of the function that reads them (uuv_table.h)."""

from __future__ import annotations

from collections.abc import Iterable

from uuvsim_cosim.models.intrinsics.breakpoints import buckets
from uuvsim_cosim.models.intrinsics.table import TABLES
from uuvsim_cosim.models.intrinsics.uniform_grids import uniform_grid

__all__ = ["table_call", "table_data"]


def table_call(name: str, suffix: str, a: list[str]) -> str:
    """Return the call of a table, or of its derivative `suffix`, at the arguments `a`."""
    table = TABLES[name]
    n, at = table.n_in, ", ".join(a)
    if not suffix and uniform_grid(table):
        return f"uuv_uniform{n}({at}, &{name}_uniform)"
    if not suffix and buckets(table):
        return f"uuv_buckets{n}({at}, &{name}_buckets)"
    nx = len(table.x)
    if n == 1:
        return f"uuv_table1{suffix}({at}, {name}_x, {name}_values, {nx})"
    ny = len(table.y)
    return f"uuv_table2{suffix}({at}, {name}_x, {nx}, {name}_y, {ny}, {name}_values)"


def table_data(name: str) -> str:
    """Return the data of a table, and of its faster form for uniform grids or breakpoints."""
    table = TABLES[name]
    arrays = {"x": table.x, "values": table.values}
    if table.n_in == 2:
        arrays["y"] = table.y
    text = [
        f"static const double {name}_{part}[] = {{{_numbers(values)}}};\n"
        for part, values in arrays.items()
    ]
    e, b = uniform_grid(table), buckets(table)
    if e is not None:
        for i, row in enumerate(e.rows):
            text.append(f"static const uuv_line {name}_lines_{i}[] = {{{_structs(row)}}};\n")
        numbers = _numbers((e.first, e.last, e.scale, e.start, e.per_unit, e.low, e.high))
        lines = ", ".join(f"{name}_lines_{i}" for i in range(len(e.rows)))
        text.append(f"static const uuv_uniform {name}_uniform = {{{numbers}, {{{lines}}}}};\n")
    elif b is not None:
        for i, (row, at) in enumerate(zip(b.rows, b.at, strict=True)):
            places = ", ".join(str(int(k)) for k in at)
            text += [
                f"static const uuv_breakpoint {name}_breakpoints_{i}[] = {{{_structs(row)}}};\n",
                f"static const unsigned short {name}_at_{i}[] = {{{places}}};\n",
            ]
        numbers = _numbers((b.first, b.last, b.scale, b.low, b.high))
        ats, rows = (
            ", ".join(f"{name}_{what}_{i}" for i in range(len(b.rows)))
            for what in ("at", "breakpoints")
        )
        text.append(
            f"static const uuv_buckets {name}_buckets = {{{numbers}, {{{ats}}}, {{{rows}}}}};\n"
        )
    return "".join(text)


def _structs(rows: Iterable[Iterable[float]]) -> str:
    return ", ".join(f"{{{_numbers(row)}}}" for row in rows)


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(repr(float(v)) for v in values)
