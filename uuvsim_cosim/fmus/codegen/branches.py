"""Blocks of instructions that only one branch of `if_else` needs, to skip them if possible.

`if_else(c, a, b)` computes both a and b. The instructions that only `a` needs, in all selections by
the same c, are moved to a block after "if c holds in any lane". Results stay the same to the last
bit. Blocks nest. A block that is too small for a jump is dissolved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

__all__ = ["Block", "Node", "flat", "nodes_of", "scheduled"]

Depth = dict[tuple[int, int], int]
ROOT = -1
WORTH = 20  # operations of a block for which a jump saves more than it costs
FREE = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
DEAR = {ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_EXP, ca.OP_LOG, ca.OP_POW, ca.OP_ATAN, ca.OP_ATAN2,
        ca.OP_ASIN, ca.OP_ACOS, ca.OP_TANH, ca.OP_CALL}  # fmt: skip


@dataclass
class Node:
    """An instruction, with the sources of its inputs; a selection's are (condition, a, b)."""

    k: int
    op: int
    inputs: list[tuple[int, int]]  # (instruction, index of its result)
    selects: bool = False


@dataclass
class Block:
    """Selections by one condition, and the instructions for them only, in computing order."""

    condition: tuple[int, int]
    selections: list[int]
    body: list[int | Block] = field(default_factory=list)


def nodes_of(f: Any) -> list[Node]:
    """List the instructions of an SX function; a selection is one instruction instead of four."""
    holds: dict[int, tuple[int, int]] = {}
    nodes: list[Node] = []
    for k in range(f.n_instructions()):
        op, sources = f.instruction_id(k), f.instruction_input(k)
        if op in (ca.OP_INPUT, ca.OP_CONST):
            sources = []
        nodes.append(Node(k, op, [holds.get(i, (-1, 0)) for i in sources]))
        if op != ca.OP_OUTPUT:
            for place, o in enumerate(f.instruction_output(k)):
                holds[o] = (k, place)
    for node in nodes:  # (c ? a : 0) + (not c ? b : 0)  becomes  c ? a : b
        node.selects = node.op == ca.OP_IF_ELSE_ZERO
        if node.op != ca.OP_ADD:
            continue
        first, second = (nodes[i] for i, _ in node.inputs)
        if not first.op == second.op == ca.OP_IF_ELSE_ZERO:
            continue
        c, d = first.inputs[0], second.inputs[0]
        if any(nodes[i].op == ca.OP_NOT and nodes[i].inputs[0] == e
               for (i, _), e in ((d, c), (c, d))):  # fmt: skip
            node.inputs = [c, first.inputs[1], second.inputs[1]]
            node.selects = True
    return nodes


def flat(nodes: list[Node]) -> list[int | Block]:
    """Return all instructions that results need, in their original order."""
    return [k for k, used in enumerate(_used(nodes)) if used]


def scheduled(nodes: list[Node]) -> list[int | Block]:
    """Return the instructions that results need, in computing order, with blocks of branches."""
    used = _used(nodes)
    grouped = _groups(nodes, used)
    while grouped:
        region, parent = _regions(nodes, used, grouped)
        own: Counter[int | None] = Counter()  # cost of each block without the blocks inside it
        for n in nodes:
            if n.op not in FREE:
                own[region[n.k]] += 20 if n.op in DEAR else 1
        cost = dict.fromkeys(grouped, 0)  # of each block with the blocks inside it
        for g in grouped:
            around = g
            while around != ROOT:
                cost[around] += own[g]
                around = parent[around]
        small = [g for g in grouped if cost[g] < WORTH]
        if not small:
            items, stuck = _ordered(nodes, used, grouped, region, parent)
            if stuck is None:
                return items
            small = [stuck]
        for g in small:
            del grouped[g]
    return flat(nodes)


def _used(nodes: list[Node]) -> list[bool]:
    used = [n.op == ca.OP_OUTPUT for n in nodes]
    for n in reversed(nodes):
        if used[n.k]:
            for i, _ in n.inputs:
                used[i] = used[i] or i >= 0
    return used


def _groups(nodes: list[Node], used: list[bool]) -> dict[int, list[int]]:
    """Group selections by condition, and by the number of those of the same condition before."""
    behind: list[Depth] = []
    groups: dict[tuple[tuple[int, int], int], list[int]] = {}
    for n in nodes:
        depth = _deepest([behind[i] for i, _ in n.inputs if i >= 0])
        if n.selects and used[n.k]:
            c = n.inputs[0]
            groups.setdefault((c, depth.get(c, 0)), []).append(n.k)
            depth = {**depth, c: depth.get(c, 0) + 1}
        behind.append(depth)
    return dict(enumerate(groups.values()))


def _deepest(depths: list[Depth]) -> Depth:
    """Return the maximum for each condition; most instructions share the mapping of an input."""
    found = max(depths, key=len, default={})
    for other in depths:
        if other is not found and any(found.get(c, 0) < d for c, d in other.items()):
            found = {c: max(found.get(c, 0), other.get(c, 0)) for c in {**found, **other}}
    return found


def _regions(
    nodes: list[Node], used: list[bool], groups: dict[int, list[int]]
) -> tuple[list[int | None], dict[int, int]]:
    """Return the block of each instruction, and the block around each block.

    An instruction is in the innermost block that contains all its uses; a block, in the innermost
    one that contains all its selections. Both depend on each other: they are iterated.
    """
    group_of = {k: g for g, members in groups.items() for k in members}
    parent: dict[int, int] = {}

    def path(g: int) -> list[int]:
        out = [g]
        while g != ROOT:
            g = parent.get(g, ROOT)
            out.append(g)
        return out

    def common(a: int | None, b: int) -> int:
        if a is None or a == b:
            return b
        if ROOT in (a, b):
            return ROOT
        above = set(path(a))
        return next(g for g in path(b) if g in above)

    needed = [
        (n.k, n.op == ca.OP_OUTPUT, n.inputs, group_of.get(n.k))
        for n in reversed(nodes)
        if used[n.k]
    ]
    while True:
        region: list[int | None] = [None] * len(nodes)
        around: dict[int, int | None] = {}
        for k, stored, inputs, g in needed:
            here = region[k]
            if stored:
                here = region[k] = ROOT
            if g is not None:
                assert here is not None
                here = around[g] = common(around.get(g), here)
            if here is None:
                continue
            for place, (i, _) in enumerate(inputs):
                if i >= 0:
                    into = g if g is not None and place == 1 else here
                    now = region[i]
                    if now != into:
                        region[i] = into if now is None else common(now, into)
        found = {g: (ROOT if a is None else a) for g, a in around.items()}
        if found == parent:
            for g, members in groups.items():
                for k in members:
                    region[k] = found[g]
            return region, parent
        parent = found


def _ordered(
    nodes: list[Node],
    used: list[bool],
    groups: dict[int, list[int]],
    region: list[int | None],
    parent: dict[int, int],
) -> tuple[list[int | Block], int | None]:
    """Return a computing order in which each instruction follows its inputs.

    It is close to the original one. The second value is a block that depends on itself, and
    therefore cannot be a block, else None.
    """
    group_of = {k: g for g, selections in groups.items() for k in selections}
    done = [not u for u in used]
    begun: set[int] = set()
    members: dict[int, list[int]] = {g: [] for g in [ROOT, *groups]}
    outside: dict[int, set[int]] = {g: set() for g in groups}  # instructions that a block reads
    for n in nodes:
        where = region[n.k]
        if not used[n.k]:
            continue
        if where is not None:
            members[where].append(n.k)
        inside = {*_around(region[n.k], parent)}
        own = group_of.get(n.k)
        for g in inside if own is None else inside | {own}:
            outside[g].update(
                i for i, _ in n.inputs if i >= 0 and g not in _around(region[i], parent)
            )
    stuck: int | None = None

    def need(k: int, where: int, items: list[int | Block]) -> None:
        """Append all instructions in region `where` that instruction k needs, then k."""
        nonlocal stuck
        found: set[int] = set()
        todo = [k]
        while todo:
            for i, _ in nodes[todo.pop()].inputs:
                if i >= 0 and not done[i] and i not in found and region[i] == where:
                    found.add(i)
                    todo.append(i)
        for j in [*sorted(found), k]:
            if done[j] or stuck is not None:
                continue
            g = group_of.get(j)
            if g is None:
                done[j] = True
                items.append(j)
                continue
            if g in begun:
                stuck = g
                continue
            begun.add(g)
            for i in sorted(outside[g]):
                if not done[i] and region[i] == where:
                    need(i, where, items)
            block = Block(nodes[groups[g][0]].inputs[0], groups[g])
            for i in members[g]:
                need(i, g, block.body)
            for i in groups[g]:
                done[i] = True
            items.append(block)

    items: list[int | Block] = []
    for k in members[ROOT]:
        need(k, ROOT, items)
    return items, stuck


def _around(block: int | None, parent: dict[int, int]) -> Iterator[int]:
    """Yield a block, and the blocks around it."""
    while block is not None and block != ROOT:
        yield block
        block = parent[block]
