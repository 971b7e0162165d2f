"""What a right-hand side computes from values held over a step is computed once a step."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

__all__ = ["split"]

_LINE = re.compile(r"const V (?P<name>t\w+) = (?P<value>.*);$")
_STORE = re.compile(r"dx\[\d+\] = (?P<value>.*);$")
_VALUE = re.compile(r"\bt\d+(?:_\d+)?\b")
_QUOTIENT = re.compile(r"const V (?P<name>t\d+) = (?P<dividend>\S+) / (?P<divisor>\S+);$")
_CELL = re.compile(r"\bb\[(\d+)\]")


def split(text: str, varies: Callable[[int], bool], *, invert: bool = False) -> tuple[str, int]:
    """Split the emitted ``rhs(b, dx)`` into ``held(b, w)`` and ``rhs(b, w, dx)``.

    `varies` says which cells change within a step. Every operation stays as it is, so the bits
    do too; with `invert`, for float32, a quotient becomes a product with the inverse, which is
    held where its divisor is. Gives the text of both functions, and how many values `w` holds.
    """
    lines = [line.strip() for line in text.splitlines()]
    if invert:
        lines = [new for line in lines for new in _inverted(line)]
    values = [m for m in map(_LINE.match, lines) if m]
    stores = [m for m in map(_STORE.match, lines) if m]
    moving: set[str] = set()
    constant = {m["name"] for m in values if m["value"].startswith("uuv_const(")}
    for m in values:
        cells = (int(i) for i in _CELL.findall(m["value"]))
        if any(map(varies, cells)) or moving.intersection(_VALUE.findall(m["value"])):
            moving.add(m["name"])
    readers = [m["value"] for m in values if m["name"] in moving] + [m["value"] for m in stores]
    read = dict.fromkeys(name for value in readers for name in _VALUE.findall(value))
    kept = [name for name in read if name not in moving and name not in constant]
    needed = {name for name in read if name in constant}
    held = [
        *(f"const V {m['name']} = {m['value']};" for m in values if m["name"] not in moving),
        *(f"w[{j}] = {name};" for j, name in enumerate(kept)),
    ]
    rest = [
        *(f"const V {name} = w[{j}];" for j, name in enumerate(kept)),
        *(m[0] for m in values if m["name"] in moving or m["name"] in needed),
        *(m[0] for m in stores),
    ]
    both = [
        *_function("held(const V *b, V *w)", ["b", "w"], held if kept else []),
        *_function("rhs(const V *b, const V *w, V *dx)", ["b", "w", "dx"], rest),
    ]
    return "\n".join(both) + "\n", len(kept)


def _inverted(line: str) -> list[str]:
    m = _QUOTIENT.match(line)
    if m is None:
        return [line]
    inverse = f"{m['name']}_0"
    return [
        f"const V {inverse} = uuv_inv({m['divisor']});",
        f"const V {m['name']} = {m['dividend']} * {inverse};",
    ]


def _function(signature: str, arguments: list[str], lines: list[str]) -> Iterator[str]:
    yield f"static void {signature} {{"
    yield from (f"    (void){name};" for name in arguments)
    yield from (f"    {line}" for line in lines)
    yield "}"
