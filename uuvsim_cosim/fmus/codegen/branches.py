"""Blocks of instructions that only one branch of `if_else` needs, to skip them if possible.

`if_else(c, a, b)` computes both a and b. The instructions that only `a` needs, in all selections by
the same c, are moved to a block after "if c holds in any lane". Results stay the same to the last
bit. Blocks nest. A block that is too small for a jump is dissolved.
"""

from __future__ import annotations

from collections import Counter
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
    for node in nodes:
        _become_selection(nodes, node)
    return nodes


def _become_selection(nodes: list[Node], node: Node) -> None:
    """Change  (c ? a : 0) + (not c ? b : 0)  to  c ? a : b."""
    if node.op == ca.OP_IF_ELSE_ZERO:
        node.selects = True
        return
    if node.op != ca.OP_ADD:
        return
    first, second = (nodes[i] for i, _ in node.inputs)
    if not first.op == second.op == ca.OP_IF_ELSE_ZERO:
        return
    c, d = first.inputs[0], second.inputs[0]
    if _negates(nodes, d, c) or _negates(nodes, c, d):
        node.inputs = [c, first.inputs[1], second.inputs[1]]
        node.selects = True


def _negates(nodes: list[Node], c: tuple[int, int], d: tuple[int, int]) -> bool:
    return nodes[c[0]].op == ca.OP_NOT and nodes[c[0]].inputs[0] == d


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
        small = [g for g in grouped if _cost(own, parent, g) < WORTH]
        if not small:
            order = _Order(nodes, used, grouped, region, parent)
            if order.stuck is None:
                return order.items
            small = [order.stuck]
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


def _cost(own: Counter[int | None], parent: dict[int, int], block: int) -> int:
    """Return the cost of a block with the blocks inside it."""
    cost = own[block]
    for g in parent:
        seen = g
        while seen not in (ROOT, block):
            seen = parent[seen]
        if seen == block and g != block:
            cost += own[g]
    return cost


class _Order:
    """A computing order in which each instruction follows its inputs, close to the original one."""

    def __init__(
        self,
        nodes: list[Node],
        used: list[bool],
        groups: dict[int, list[int]],
        region: list[int | None],
        parent: dict[int, int],
    ) -> None:
        self.nodes, self.region, self.parent, self.groups = nodes, region, parent, groups
        self.group_of = {k: g for g, members in groups.items() for k in members}
        self.done = [not u for u in used]
        self.begun: set[int] = set()
        self.stuck: int | None = None
        self.members: dict[int, list[int]] = {g: [] for g in [ROOT, *groups]}
        for n in nodes:
            where = region[n.k]
            if used[n.k] and where is not None:
                self.members[where].append(n.k)
        self.outside = {g: sorted(self._needs(g)) for g in groups}
        self.items: list[int | Block] = []
        self._fill(ROOT, self.members[ROOT], self.items)

    def _within(self, k: int, g: int) -> bool:
        where = self.region[k]
        while where is not None and where not in (ROOT, g):
            where = self.parent[where]
        return where == g

    def _needs(self, g: int) -> set[int]:
        """Return the instructions outside of a block that are read within it."""
        needs: set[int] = set()
        for k in self.groups[g]:
            needs.update(i for i, _ in self.nodes[k].inputs if i >= 0 and not self._within(i, g))
        inside = [k for k in range(len(self.nodes)) if not self.done[k] and self._within(k, g)]
        for k in inside:
            needs.update(i for i, _ in self.nodes[k].inputs if i >= 0 and not self._within(i, g))
        return needs

    def _fill(self, where: int, members: list[int], items: list[int | Block]) -> None:
        for k in members:
            self._need(k, where, items)

    def _need(self, k: int, where: int, items: list[int | Block]) -> None:
        """Append all instructions in region `where` that instruction k needs, then k."""
        for j in [*self._missing(k, where), k]:
            if self.done[j] or self.stuck is not None:
                continue
            g = self.group_of.get(j)
            if g is None:
                self.done[j] = True
                items.append(j)
            else:
                self._block(g, where, items)

    def _missing(self, k: int, where: int) -> list[int]:
        """List the instructions in `where` that k still needs, in their original order."""
        found: set[int] = set()
        todo = [k]
        while todo:
            for i, _ in self.nodes[todo.pop()].inputs:
                if i >= 0 and not self.done[i] and i not in found and self.region[i] == where:
                    found.add(i)
                    todo.append(i)
        return sorted(found)

    def _block(self, g: int, where: int, items: list[int | Block]) -> None:
        if g in self.begun:
            self.stuck = g  # it depends on itself: it cannot be a block
            return
        self.begun.add(g)
        for i in self.outside[g]:
            if not self.done[i] and self.region[i] == where:
                self._need(i, where, items)
        members = self.groups[g]
        block = Block(self.nodes[members[0]].inputs[0], members)
        self._fill(g, self.members[g], block.body)
        for k in members:
            self.done[k] = True
        items.append(block)
