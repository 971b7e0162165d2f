"""Values of a right-hand side that are held over a step: they are computed once, not four times.

A step of Runge-Kutta evaluates the right-hand side at four places. What depends on inputs,
parameters and discrete states alone is the same at all of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from uuvsim_cosim.fmus.codegen.equations import Layout

__all__ = ["moves", "split"]


def moves(layout: Layout) -> Callable[[int], bool]:
    """Return whether a place of the block changes within a step, as a function of the place."""
    first = layout.offset["state"]
    states = range(first, first + layout.count["state"])
    return lambda place: place == 0 or place in states or not states


# The values of a network or field (fmus/codegen/network_data.py) are not of type V: not held.
_LINE = re.compile(
    r"const (?P<type>V|(?:network|field)_\w+_values) (?P<name>t\w+) = (?P<value>.*);$"
)
_STORE = re.compile(r"dx\[\d+\] = (?P<value>.*);$")
_VALUE = re.compile(r"\bt\d+(?:_\d+)?\b")
_QUOTIENT = re.compile(r"const V (?P<name>t\d+) = (?P<dividend>\S+) / (?P<divisor>\S+);$")
_TABLE = re.compile(
    r"^ {4}const V (?P<name>t\w+) = (?P<value>uuv_(?:uniform|buckets)\d\((?:b\[\d+\], )+&\w+\));$",
    re.MULTILINE,
)
_OF_STEP = "outputs_of_step(const V *b, const V *w, V *out)"
_CELL = re.compile(r"\bb\[(\d+)\]")


def split(
    text: str, varies: Callable[[int], bool], *, invert: bool = False, outputs: str = ""
) -> tuple[str, int]:
    """Split the emitted ``rhs(b, dx)`` into ``held(b, w)`` and ``rhs(b, w, dx)``.

    `varies` returns whether a cell changes within a step. Operations are not changed, and so
    neither are the bits of results. With `invert`, for float32, a quotient becomes a product with
    the inverse, which is held if its divisor is. Tables that the emitted ``outputs(b, out)`` reads
    at held cells are read with them: the text also has ``outputs_of_step(b, w, out)``. Return the
    text of all these functions, and the number of values in `w`.
    """
    lines = [line.strip() for line in text.splitlines()]
    if invert:  # a quotient's line becomes an inverse and a product
        quotients = [(line, _QUOTIENT.match(line)) for line in lines]
        lines = []
        for line, m in quotients:
            if m is None:
                lines.append(line)
                continue
            lines.append(f"const V {m['name']}_0 = uuv_inv({m['divisor']});")
            lines.append(f"const V {m['name']} = {m['dividend']} * {m['name']}_0;")
    values = [m for m in map(_LINE.match, lines) if m]
    stores = [m for m in map(_STORE.match, lines) if m]
    moving: set[str] = set()
    constant = {m["name"] for m in values if m["value"].startswith("uuv_const(")}
    for m in values:
        cells = (int(i) for i in _CELL.findall(m["value"]))
        moved = any(map(varies, cells)) or moving.intersection(_VALUE.findall(m["value"]))
        if moved or m["type"] != "V":
            moving.add(m["name"])
    readers = [m["value"] for m in values if m["name"] in moving] + [m["value"] for m in stores]
    read = dict.fromkeys(name for value in readers for name in _VALUE.findall(value))
    kept = [name for name in read if name not in moving and name not in constant]
    needed = {name for name in read if name in constant}
    read_here, after = _held_tables(outputs, varies, len(kept))
    held = [
        *(f"const V {m['name']} = {m['value']};" for m in values if m["name"] not in moving),
        *(f"const V o{m['name']} = {m['value']};" for m in read_here),
        *(f"w[{j}] = {name};" for j, name in enumerate(kept)),
        *(f"w[{j}] = o{m['name']};" for j, m in enumerate(read_here, len(kept))),
    ]
    rest = [
        *(f"const V {name} = w[{j}];" for j, name in enumerate(kept)),
        *(m[0] for m in values if m["name"] in moving or m["name"] in needed),
        *(m[0] for m in stores),
    ]
    both = [
        *_function("held(const V *b, V *w)", ["b", "w"], held if kept or read_here else []),
        *_function("rhs(const V *b, const V *w, V *dx)", ["b", "w", "dx"], rest),
    ]
    return "\n".join([*both, after]), len(kept) + len(read_here)


def _held_tables(
    outputs: str, varies: Callable[[int], bool], first: int
) -> tuple[list[re.Match[str]], str]:
    """Return the reads of tables at held cells, and the outputs that use w[first], … instead."""
    found = [
        m
        for m in _TABLE.finditer(outputs)
        if not any(varies(int(i)) for i in _CELL.findall(m["value"]))
    ]
    text = outputs.replace("outputs(const V *b, V *out)", _OF_STEP).replace(
        "(void)b;", "(void)b;\n    (void)w;", 1
    )
    for j, m in enumerate(found, first):
        text = text.replace(m[0], f"    const V {m['name']} = w[{j}];")
    return found, text


def _function(signature: str, arguments: list[str], lines: list[str]) -> Iterator[str]:
    yield f"static void {signature} {{"
    yield from (f"    (void){name};" for name in arguments)
    yield from (f"    {line}" for line in lines)
    yield "}"
