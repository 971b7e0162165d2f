"""Units of a plan: equal groups of components, such as vehicles, that share their text in C.

Work on a unit that no other unit has is written with the cells' numbers, as fast as C can be. Work
that several units have becomes one function, with the cells of the unit relative to its first one
and a table of the other cells, such as outputs of another vehicle. So the text that the compiler
reads grows with the number of different units, and not with the number of vehicles.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from uuvsim_cosim.kernels.codegen.fusible import Fused

__all__ = ["Places", "Units", "Work", "shared_text", "units_of"]

_MOST = 48  # components that are written one by one: two surveying vehicles have 42


class Places:
    """Names of cells in C: of those from `first` to before `end` by the pointer `base`.

    The others are those of the table `e`, in the order of `others`.
    """

    def __init__(self, base: str = "m", first: int = 0, end: float = float("inf")) -> None:
        self.base, self.first, self.end = base, first, end
        self.others: dict[int, int] = {}  # places in the table by cell

    def value(self, cell: int) -> str:
        """Return the value of a cell."""
        if self.first <= cell < self.end:
            return f"{self.base}[{cell - self.first}]"
        return f"m[e[{self.others.setdefault(cell, len(self.others))}]]"

    def address(self, cell: int) -> str:
        """Return the address of a cell of the unit."""
        return f"{self.base} + {cell - self.first}"


Work = tuple[int, Callable[[Places], Iterable[str]]]  # unit, and its lines of C


@dataclass(frozen=True)
class Units:
    """The unit of each component, and of each unit its first cell and the one after its last."""

    of: Sequence[int]
    cells: Sequence[tuple[int, int]]


def units_of(fused: Fused) -> Units:
    """Return the largest units of which the different ones have few components together.

    A unit is the whole system, a nested system, or one component.
    """
    paths = [m.path.split(".") for m in fused.members]
    deepest = max(map(len, paths))
    fewest: tuple[int, list[int]] | None = None
    for depth in range(deepest + 1):
        names = [p if depth == deepest else p[: min(depth, len(p) - 1)] for p in paths]
        of = [0]
        for before, name in pairwise(names):
            of.append(of[-1] + (name != before))
        kinds: list[list[tuple[int, int]]] = [[] for _ in range(of[-1] + 1)]
        for unit, m in zip(of, fused.members, strict=True):
            kinds[unit].append((m.declaration, m.rate))
        count = sum(map(len, set(map(tuple, kinds))))
        if fewest is None or count < fewest[0]:
            fewest = count, of
        if count <= _MOST:
            break
    assert fewest is not None
    ends: dict[int, tuple[int, int]] = {}
    for unit, m in zip(fewest[1], fused.members, strict=True):
        ends[unit] = (ends.get(unit, (m.cell, 0))[0], m.cell + m.size)
    return Units(fewest[1], list(ends.values()))


def shared_text(
    name: str,
    arguments: Sequence[str],
    work: Iterable[Work],
    units: Units,
    begin: Callable[[Sequence[str]], Iterable[str]] = lambda lines: (),
) -> tuple[list[str], list[str]]:
    """Return the functions `name`_0, … that equal work shares, and the lines that do the work.

    `arguments` are further arguments, such as "V *scratch"; a line may use all of them. ``begin``
    returns the lines before the lines of a function.
    """
    pieces: list[tuple[list[Work], tuple[str, ...], list[int]]] = []
    for unit, together in groupby(work, lambda w: w[0]):
        piece = list(together)
        places = Places("b", *units.cells[unit])
        lines = tuple(line for _, write in piece for line in write(places))
        pieces.append((piece, lines, [places.first, *places.others]))
    count = Counter(lines for _, lines, _ in pieces)
    number = {lines: k for k, lines in enumerate(lines for lines, n in count.items() if n > 1)}
    tables: list[list[str]] = [[] for _ in number]
    body: list[str] = []
    whole = Places()
    passed = "".join(f", {a.split()[-1].lstrip('*')}" for a in arguments)
    for lines, equal in groupby(pieces, lambda p: p[1]):
        if lines not in number:
            body += [line for piece, _, _ in equal for _, write in piece for line in write(whole)]
            continue
        k = number[lines]
        first = len(tables[k])
        tables[k] += [f"{{{', '.join(map(str, row))}}}" for _, _, row in equal]
        row = f"{name}_{k}_rows[i]"
        body.append(f"    for (uint32_t i = {first}; i < {len(tables[k])}; i++)")
        body.append(f"        {name}_{k}(m, m + {row}[0], {row} + 1{passed});")
    functions: list[str] = []
    signature = ", ".join(["V *m, V *b, const uint32_t *e", *arguments])
    for lines, k in number.items():
        columns = 1 + tables[k][0].count(",")
        functions += [
            f"static const uint32_t {name}_{k}_rows[][{columns}] = {{{', '.join(tables[k])}}};",
            "",
            f"static void {name}_{k}({signature}) {{",
            *(f"    (void){a};" for a in ("m", "b", "e", *passed.split(", ")[1:])),
            *begin(lines),
            *lines,
            "}",
            "",
        ]
    return functions, body
