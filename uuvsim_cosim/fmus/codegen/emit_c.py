"""Generation of C functions on W-lane values from CasADi functions, instruction by instruction."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, wraps
from typing import Any, Concatenate, ParamSpec

import casadi as ca

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.fmus.codegen.branches import Block, Node, flat, nodes_of, scheduled
from uuvsim_cosim.fmus.codegen.network_data import HEADER, network_call, network_data, network_of
from uuvsim_cosim.fmus.codegen.optimiser_code import optimiser_call
from uuvsim_cosim.fmus.codegen.table_data import table_call, table_data
from uuvsim_cosim.models.intrinsics.network import NETWORKS
from uuvsim_cosim.models.intrinsics.optimiser import OPTIMISERS
from uuvsim_cosim.models.intrinsics.table import TABLES

__all__ = ["emit_function", "emit_networks", "emit_tables", "emit_update", "literal"]

# CasADi operation -> function of fmus/runtime/math/uuv_math.h; arithmetic is written as operators.
INFIX = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
NAMES = (
    "neg exp log pow constpow sqrt sq twice sin cos tan asin acos atan lt le eq ne not and or "
    "floor ceil fmod fabs sign copysign if_else_zero fmin fmax inv sinh cosh tanh asinh acosh "
    "atanh atan2 log1p expm1 hypot remainder"
)
NAMED = {getattr(ca, f"OP_{name.upper()}"): f"uuv_{name}" for name in NAMES.split()}


def literal(value: float) -> str:
    """Return a double as C text that reads back to the same bits."""
    if math.isnan(value):
        return '__builtin_nan("")'
    if math.isinf(value):
        return "-__builtin_inf()" if value < 0 else "__builtin_inf()"
    return repr(float(value))


P = ParamSpec("P")


@dataclass(frozen=True)
class _Same:
    """A key for a function: functions with equal contents have equal instructions."""

    contents: str
    f: Any = field(compare=False)


def _cached(write: Callable[Concatenate[Any, P], str]) -> Callable[Concatenate[Any, P], str]:
    """Keep the texts of a function: masters, kernels and FMUs need the same ones.

    The contents include the names of called functions; the name of a table or network includes a
    hash of its data.
    """

    @lru_cache(maxsize=1024)
    def written(same: _Same, *more: P.args, **options: P.kwargs) -> str:
        return write(same.f, *more, **options)

    @wraps(write)
    def cached(f: Any, /, *more: P.args, **options: P.kwargs) -> str:
        same = _Same(content_hash([f.name(), f.serialize()]), f)
        return written(same, *more, **options)  # type: ignore[arg-type]

    return cached


@_cached
def emit_function(
    f: Any, signature: str, targets: tuple[str, ...], *, branches: bool = True
) -> str:
    """Return the C text of `f`: its inputs are the C arrays in `targets` before the last one.

    ``targets`` names the arrays of f's inputs, then the array for its output. Branches that no lane
    takes are skipped (see `branches`), except in a right-hand side: kernels move its computations
    from constant values out of it. Without `branches`, which take long to find in a large function,
    nothing is skipped.
    """
    *sources, result = targets
    nodes = nodes_of(f)
    items = scheduled(nodes) if branches and f.name() != "rhs" else flat(nodes)
    text = _Text(f, nodes, sources, result)
    lines = [*(f"(void){s};" for s in targets), *text.lines(items)]
    lines += text.stores if f.name() == "rhs" else _looped(text.stores)
    body = "\n    ".join(lines)
    return f"static void {signature} {{\n    {body}\n}}\n"


_COPY = re.compile(r"^(\w+)\[(\d+)\] = ([\w.]+)(?:\[(\d+)\])?;$")
_LONG = 32  # consecutive copies that become a loop: thousands of lines take long to compile


def _looped(stores: Sequence[str]) -> Iterator[str]:
    """Yield stores; those to consecutive elements, from consecutive ones or one value, as loops."""
    read = [_COPY.match(store) for store in stores]
    k = 0
    while k < len(stores):
        m, n = read[k], 1
        while m and k + n < len(stores) and (o := read[k + n]):
            source = m[4] and str(int(m[4]) + n)
            if (o[1], int(o[2]), o[3], o[4]) != (m[1], int(m[2]) + n, m[3], source):
                break
            n += 1
        if m and n >= _LONG:
            source = m[3] if m[4] is None else f"{m[3]}[{m[4]} + i]"
            yield f"for (int i = 0; i < {n}; i++) {m[1]}[{m[2]} + i] = {source};"
        else:
            yield from stores[k : k + n]
        k += n


@_cached
def emit_update(f: Any, signature: str, first: int) -> str:
    """Return the C text of an update in place:  ``(V *b, const V *draws, uuv_mask due)``.

    The new values of the cells of `b` from `first` on are written in the lanes of `due`, after all
    have been computed. Cells that keep their value are not written. Cells that only one branch
    changes are not written if no lane takes this branch.
    """
    nodes = nodes_of(f)
    items = scheduled(nodes)
    text = _Text(f, nodes, ["b", "draws"], "b")
    # The largest block whose results are only stored can be computed last.
    read = {i for n in nodes if not _stores(n) for i, _ in n.inputs}
    blocks = [b for b in items if isinstance(b, Block) and read.isdisjoint(b.selections)]
    last = max(blocks, key=lambda b: len(b.selections), default=None)
    before = [*text.lines([i for i in items if i is not last])]
    stored = [(first + f.instruction_output(n.k)[1], n.inputs[0]) for n in nodes if _stores(n)]
    once = Counter(source for _, source in stored)
    late = set() if last is None else set(last.selections)
    within: list[tuple[int, tuple[int, int]]] = []
    after: list[str] = []
    images: list[tuple[int, str, int]] = []  # cell, array and place of a value of an image
    for cell, source in stored:
        node = nodes[source[0]]
        own = f"b[{cell}]"
        if last is not None and node.k in late:
            keeps = len(node.inputs) == 3 and text.value[node.inputs[2]] == own
            if keeps and once[source] == 1:
                within.append((cell, node.inputs[1]))
                last.selections.remove(node.k)
                continue
            after.append(f"{own} = uuv_select(due, t{node.k}, {own});")
        elif text.value[source] != own and (image := _IMAGE.match(text.value[source])):
            images.append((cell, image[1], int(image[2])))
        elif text.value[source] != own:
            before.append(f"const V s{cell} = {text.value[source]};")
            after.append(f"{own} = uuv_select(due, s{cell}, {own});")
    after += _copied(images)
    if last is not None:
        *lines, end = text.lines([last])
        lines += [f"    const V s{cell} = {text.value[source]};" for cell, source in within]
        lines.append(
            f"    const uuv_mask taken = due & uuv_mask_true({text.value[last.condition]});"
        )
        lines += [f"    b[{cell}] = uuv_select(taken, s{cell}, b[{cell}]);" for cell, _ in within]
        before += [*lines, end]
    body = "\n    ".join(["(void)b;", "(void)draws;", "(void)due;", *before, *after])
    return f"static void {signature} {{\n    {body}\n}}\n"


_IMAGE = re.compile(r"(y\d+)\[(\d+)\]$")  # values of a sonar's image stay in an array


def _copied(images: Sequence[tuple[int, str, int]]) -> Iterator[str]:
    """Yield loops that copy values of images to cells, where both follow each other."""
    k = 0
    while k < len(images):
        cell, array, place = images[k]
        n = 1
        while k + n < len(images) and images[k + n] == (cell + n, array, place + n):
            n += 1
        own, value = f"b[{cell} + i]", f"{array}[{place} + i]"
        yield f"for (int i = 0; i < {n}; i++) {own} = uuv_select(due, {value}, {own});"
        k += n


def _stores(node: Node) -> bool:
    return node.op == ca.OP_OUTPUT


class _Text:
    """The lines of C that compute the instructions of a function."""

    def __init__(self, f: Any, nodes: list[Node], sources: list[str], result: str) -> None:
        self.f, self.nodes, self.sources, self.result = f, nodes, sources, result
        self.value: dict[tuple[int, int], str] = {}  # C expressions of computed results
        self.stores: list[str] = []
        self.calls: Any = None

    def lines(self, items: Sequence[int | Block]) -> Iterator[str]:
        """Yield the lines of instructions and blocks, in this order."""
        for item in items:
            if not isinstance(item, Block):
                yield from self._instruction(item)
                continue
            # The values of the `else` branch, then a block for lanes in which the condition holds.
            for k in item.selections:
                otherwise = self._arguments(k)[2:] or ["uuv_const(0.0)"]
                yield f"V t{k} = {otherwise[0]};"
            yield f"if (uuv_any(uuv_mask_true({self.value[item.condition]}))) {{"
            yield from (f"    {line}" for line in self.lines(item.body))
            for k in item.selections:
                c, a = self._arguments(k)[:2]
                yield f"    t{k} = uuv_if_else({c}, {a}, t{k});"
                self.value[k, 0] = f"t{k}"
            yield "}"

    def _arguments(self, k: int) -> list[str]:
        return [self.value.get(source, "") for source in self.nodes[k].inputs]

    def _instruction(self, k: int) -> Iterator[str]:
        f, op = self.f, self.nodes[k].op
        if op == ca.OP_INPUT:
            i = f.instruction_input(k)
            self.value[k, 0] = f"{self.sources[i[0]]}[{i[1]}]"
        elif op == ca.OP_OUTPUT:
            place = f.instruction_output(k)[1]
            self.stores.append(f"{self.result}[{place}] = {self._arguments(k)[0]};")
        elif op == ca.OP_CALL:
            self.calls = f.instructions_sx() if self.calls is None else self.calls
            called = self.calls[k].which_function()
            name = called.name()
            if network_of(name) in NETWORKS or name in OPTIMISERS:
                call = optimiser_call if name in OPTIMISERS else network_call
                line, *texts = call(k, name, self._arguments(k))
                yield line
                self.value.update({(k, place): text for place, text in enumerate(texts)})
                return
            texts = _call(called, self._arguments(k))
            for place, text in enumerate(texts):
                yield f"const V t{k}_{place} = {text};"
                self.value[k, place] = f"t{k}_{place}"
        else:
            yield f"const V t{k} = {self._operation(k, op)};"
            self.value[k, 0] = f"t{k}"

    def _operation(self, k: int, op: int) -> str:
        a = self._arguments(k)
        if self.nodes[k].selects:
            return f"uuv_if_else{'_zero' if len(a) == 2 else ''}({', '.join(a)})"
        if op == ca.OP_CONST:
            return f"uuv_const({literal(self.f.instruction_constant(k))})"
        if op == ca.OP_ASSIGN:
            return a[0]
        if op in INFIX:
            return f"{a[0]} {INFIX[op]} {a[1]}"
        if op in NAMED:
            return f"{NAMED[op]}({', '.join(a)})"
        raise UuvsimError(f"{self.f.name()}: CasADi operation {op} has no lowering to C")


def _call(f: Any, a: list[str]) -> list[str]:
    """Lower a call of a table, or of its partial, forward or adjoint derivative."""
    name = f.name()
    if name in TABLES:
        return [table_call(name, "", a)]
    for suffix in ("_dx", "_dy", "_d"):
        if name.endswith(suffix) and name[: -len(suffix)] in TABLES:
            return [table_call(name[: -len(suffix)], suffix, a)]
    for prefix in ("adj1_wrap_", "fwd1_wrap_"):
        wrapped = name.removeprefix(prefix)
        if wrapped != name and wrapped in TABLES:
            n = TABLES[wrapped].n_in
            suffixes = ("_d",) if n == 1 else ("_dx", "_dy")
            slopes = [table_call(wrapped, s, a[:n]) for s in suffixes]
            if prefix == "adj1_wrap_":
                return [f"{slope} * {a[-1]}" for slope in slopes]
            seeds = zip(slopes, a[-n:], strict=True)
            return [" + ".join(f"{slope} * {seed}" for slope, seed in seeds if seed)]
    raise UuvsimError(f"{name}: this function is called in equations, but is no known intrinsic")


def emit_tables(functions: list[Any]) -> str:
    """Return the data of every table that the functions call, in the order of their names."""
    names = {g.name() for f in functions for g in f.find_functions()}
    return "".join(table_data(name) for name in sorted(names & set(TABLES)))


def emit_networks(functions: list[Any]) -> str:
    """Return the data of every network that the functions call, in the order of their names."""
    called = (g.name() for f in functions for g in f.find_functions())
    names = {network_of(name) for name in called} & set(NETWORKS)
    return "".join([HEADER if names else "", *map(network_data, sorted(names))])
