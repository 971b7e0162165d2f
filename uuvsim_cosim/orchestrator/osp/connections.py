"""Connections of an OspSystemStructure.xml: variables, variable groups, functions, power bonds.

A linear transformation is a factor and an offset of its connections. A sum is a component. It is
stepped in a group with the simulator that it feeds, just before that, so that it adds no delay. If
a sum feeds several simulators, each of them gets its own component.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.osp.variable_groups import VariableGroup, pairs
from uuvsim_cosim.orchestrator.osp.xml import Reading, children
from uuvsim_cosim.orchestrator.system.elements import Connection, Element, StepGroup
from uuvsim_cosim.orchestrator.system.sources import sum_source
from uuvsim_cosim.orchestrator.system.variable_step import PowerBond
from uuvsim_cosim.orchestrator.values.endpoints import find_variable
from uuvsim_cosim.orchestrator.values.values import Misfit
from uuvsim_cosim.orchestrator.values.xml_values import local_name

__all__ = ["Connections"]

_KINDS = ("VariableConnection", "SignalConnection", "VariableGroupConnection",
          "SignalGroupConnection")  # fmt: skip
_INPUT = re.compile(r"in\[(\d+)\](?:\[(\d+)\])?$")
_OUTPUT = re.compile(r"out(?:\[(\d+)\])?$")


@dataclass(frozen=True)
class _Function:
    """A linear transformation (one input), or a sum of vectors."""

    name: str
    tag: str
    inputs: int = 1
    dimension: int = 1
    factor: float = 1.0
    offset: float = 0.0

    def place(self) -> str:
        return f"<{self.tag} name={self.name!r}>"


class Connections:
    """The connections of the file, and the sums that they need."""

    def __init__(
        self,
        root: Xml,
        reading: Reading,
        simulators: Mapping[str, Element],
        described: Mapping[str, Description],
        groups: Mapping[str, tuple[VariableGroup, ...]],
    ) -> None:
        self.reading, self.simulators = reading, simulators
        self.described, self.groups = described, groups
        self.connections: list[Connection] = []
        self.sums: list[Element] = []
        self.power_bonds: tuple[PowerBond, ...] = ()
        self._before: dict[str, list[str]] = {}  # simulator: the sums that feed it
        self.functions = self._functions(root)
        self._into: dict[str, dict[int, str]] = {}  # function: endpoints by flat input
        self._out: dict[str, list[tuple[int, str]]] = {}  # function: (element, endpoint)
        bonds: dict[str, list[Xml]] = {}
        joined: dict[str, list[Connection]] = {}
        for item in (i for section in children(root, "Connections") for i in children(section)):
            if not reading.known(local_name(item), list(_KINDS), "<Connections>", "connection"):
                continue
            before = len(self.connections)
            self._read(item)
            if item.get("powerBond") is not None:
                bonds.setdefault(item.get("powerBond", ""), []).append(item)
                joined.setdefault(item.get("powerBond", ""), []).extend(self.connections[before:])
        for name, parts in bonds.items():
            place = f"power bond {name!r}"  # its connections are transferred as any others
            if all(local_name(p) == "VariableGroupConnection" for p in parts):
                continue
            if len(parts) != 2:
                reading.wrong(place, f"{len(parts)} connections", "two, one in each direction")
            for part in parts:
                given = sorted(v.get("causality", "") for v in children(part, "Variable"))
                if given not in ([], ["", ""], ["input", "output"]):
                    read = f"causalities {' and '.join(repr(g) for g in given)}"
                    reading.wrong(place, read, "one 'input' and one 'output', or neither")
        self.power_bonds = tuple(self._bonds(joined))
        for function in self.functions.values():
            self._apply(function)

    def _bonds(self, joined: Mapping[str, list[Connection]]) -> Iterator[PowerBond]:
        """Yield the bonds whose two connections go to and from the same two simulators.

        The causalities that the file states are not used: the product of the two variables of a
        side is the same in either order.
        """
        for name, connections in joined.items():
            if len(connections) != 2:
                if connections:
                    self.reading.wrong(
                        f"power bond {name!r}",
                        f"{len(connections)} connected variables",
                        "two, one in each direction",
                    )
                continue
            one, back = connections
            if self._owner(one.source) != self._owner(back.target) or self._owner(
                back.source
            ) != self._owner(one.target):
                self.reading.wrong(
                    f"power bond {name!r}",
                    f"{one.source} to {one.target}, and {back.source} to {back.target}",
                    "one connection from each of two simulators to the other",
                )
                continue
            yield PowerBond(name, (back.target, one.source), (one.target, back.source))

    def step_groups(self) -> Iterator[StepGroup]:
        """Return the groups that let a sum step just before the simulator that it feeds."""
        for simulator, sums in self._before.items():
            yield StepGroup((*sums, simulator), "gauss-seidel")

    # ---- functions ----------------------------------------------------------------------------

    def _functions(self, root: Xml) -> dict[str, _Function]:
        """Read the functions, by name."""
        found: dict[str, _Function] = {}
        for item in (i for s in children(root, "Functions") for i in children(s)):
            tag = local_name(item)
            known = ["LinearTransformation", "Sum", "VectorSum"]
            if not self.reading.known(tag, known, "<Functions>", "function"):
                continue
            name = self.reading.required(item, "name", f"<{tag}>", "the name of the function")
            place = _Function(name, tag).place()
            if name in found or name in self.simulators:
                self.reading.wrong(place, f"a second {name!r}", "a name of its own")
            number, count = self.reading.number, self.reading.count
            if tag == "LinearTransformation":
                factor = number(item.get("factor"), place, "factor", 1.0)
                offset = number(item.get("offset"), place, "offset", 0.0)
                found[name] = _Function(name, tag, factor=factor, offset=offset)
            else:
                inputs = count(item, "inputCount", place)
                dimension = count(item, "dimension", place) if tag == "VectorSum" else 1
                found[name] = _Function(name, tag, inputs, dimension)
        return found

    def _apply(self, function: _Function) -> None:
        """Add a function's connections, and its sums; all its signals have been read."""
        into = self._into.get(function.name, {})
        count = function.inputs * function.dimension
        missing = [i for i in range(count) if i not in into]
        if len(self.described) < len(self.simulators):
            return  # a simulator that cannot be read is reported already; this is its consequence
        if missing:
            vectors = [divmod(i, function.dimension) for i in missing[:3]]
            names = {
                "LinearTransformation": "in",
                "Sum": ", ".join(f"in[{v}]" for v, _ in vectors),
                "VectorSum": ", ".join(f"in[{v}][{e}]" for v, e in vectors),
            }[function.tag]
            more = ", …" if len(missing) > 3 else ""
            self.reading.wrong(
                function.place(), f"nothing is connected to {names}{more}",
                f"a signal connection to each of its {count} inputs",
            )  # fmt: skip
            return
        out = self._out.get(function.name, [])
        if not out:
            self.reading.wrong(
                function.place(), "its output is not connected", "a signal connection from it"
            )
        if function.tag == "LinearTransformation":
            for _, target in out:
                self.connections.append(
                    Connection(into[0], target, function.factor, function.offset, convert=False)
                )
            return
        owners = dict.fromkeys(self._owner(target) for _, target in out)
        for owner in owners:
            name = function.name if len(owners) == 1 else f"{function.name}_{owner}"
            source = sum_source(function.inputs, function.dimension)
            rate = self.simulators[owner].rate
            self.sums.append(Element(name, source, rate=rate, description=function.tag))
            self._before.setdefault(owner, []).append(name)
            for i, endpoint in into.items():
                target = f"{name}.u" if count == 1 else f"{name}.u[{i + 1}]"
                self.connections.append(Connection(endpoint, target, convert=False))
            for j, target in out:
                if self._owner(target) == owner:
                    y = f"{name}.y" if function.dimension == 1 else f"{name}.y[{j + 1}]"
                    self.connections.append(Connection(y, target, convert=False))

    def _owner(self, endpoint: str) -> str:
        return next(n for n in self.simulators if endpoint.startswith(f"{n}."))

    # ---- connections --------------------------------------------------------------------------

    def _read(self, item: Xml) -> None:
        """Add the connections of one element."""
        tag = local_name(item)
        grouped = "Group" in tag
        ends = list(children(item, "VariableGroup" if grouped else "Variable"))
        signals = list(children(item, "SignalGroup" if grouped else "Signal"))
        wanted = (1, 1) if tag.startswith("Signal") else (2, 0)
        place = f"<{tag}>"
        if (len(ends), len(signals)) != wanted:
            what = "VariableGroup" if grouped else "Variable"
            signal = " and one <Signal" + ("Group>" if grouped else ">") if wanted[1] else ""
            self.reading.wrong(
                place, f"{len(ends)} of <{what}> and {len(signals)} signals",
                f"{'one' if wanted[0] == 1 else 'two'} of <{what}>{signal}",
            )  # fmt: skip
            return
        known: list[tuple[str, str]] = []  # the simulator and the name of each end
        for end in ends:
            simulator = self.reading.required(end, "simulator", place, "the name of a simulator")
            name = self.reading.required(end, "name", place, "the name of a variable or group")
            exists = self.reading.known(simulator, list(self.simulators), place, "simulator")
            if exists and name and simulator in self.described:
                known.append((simulator, name))
        if len(known) < len(ends):
            return
        if signals:  # of a function, connected to a variable or a group
            function = self.reading.required(
                signals[0], "function", place, "the name of a function"
            )
            signal = self.reading.required(signals[0], "name", place, "in, in[0] or out")
            place = f"{place} {function}.{signal}"
            if not self.reading.known(function, list(self.functions), place, "function"):
                return
            simulator, name = known[0]
            variables: list[str] | None = [name]
            if grouped:
                group = self._group(simulator, name, place)
                variables = None if group is None else group.listed()
            if variables is not None:
                endpoints = [f"{simulator}.{v}" for v in variables]
                self._signals(self.functions[function], signal, endpoints, place)
            return
        (a, x), (b, y) = known
        place = f"<{tag}> {a}.{x} to {b}.{y}"
        if not grouped:
            self._join(f"{a}.{x}", f"{b}.{y}", place)
            return
        groups = [self._group(simulator, name, place) for simulator, name in known]
        if groups[0] is not None and groups[1] is not None:
            for v, w in pairs(groups[0], groups[1], place, self.reading):
                self._join(f"{a}.{v}", f"{b}.{w}", place)

    def _group(self, simulator: str, name: str, place: str) -> VariableGroup | None:
        groups = self.groups.get(simulator)
        if groups is None:
            model = self.described[simulator].name
            self.reading.wrong(
                place, f"{simulator!r} has no file of variable groups",
                f"{model}_OspModelDescription.xml beside its FMU or beside {self.reading.file}",
            )  # fmt: skip
            return None
        found = next((g for top in groups if (g := top.find(name))), None)
        if found is None:
            expected = expected_names(name, [g.name for g in groups], "the name of a group")
            self.reading.wrong(place, f"no variable group {name!r} in {simulator!r}", expected)
        return found

    def _causality(self, endpoint: str, place: str) -> str | None:
        owner = self._owner(endpoint)
        try:
            name = endpoint[len(owner) + 1 :]
            return find_variable(name, self.described[owner])[0].causality
        except Misfit as misfit:
            self.reading.wrong(place, misfit.read, misfit.expected)
            return None

    def _join(self, a: str, b: str, place: str) -> None:
        """Connect two endpoints, from the output to the input."""
        first, second = self._causality(a, place), self._causality(b, place)
        if None in (first, second):
            return
        if first != "output" and second == "output":
            a, b = b, a
        elif first != "output" or second == "output":
            expected = "an output and an input"
            self.reading.wrong(place, f"{a} is {first} and {b} is {second}", expected)
            return
        self.connections.append(Connection(a, b))

    def _signals(self, f: _Function, signal: str, ends: list[str], place: str) -> None:
        """Connect variables to a signal, or to all elements of a signal group."""
        is_input = signal.startswith("in")
        places: list[int] = []  # flat elements of the function's inputs, or of its output
        if f.tag == "LinearTransformation" and is_input:
            places = [0] if signal == "in" else []
        elif (match := (_INPUT if is_input else _OUTPUT).match(signal)) is not None:
            vector, element = (int(match[1]), match[2]) if is_input else (0, match[1])
            inside = range(f.dimension) if element is None else [int(element)]
            if vector < f.inputs and max(inside) < f.dimension:
                places = [vector * f.dimension + i for i in inside]
        if len(places) != len(ends) or not places:
            dim = f"{f.dimension} variables each" if f.tag == "VectorSum" else "one variable each"
            inputs = "in" if f.tag == "LinearTransformation" else f"in[0] to in[{f.inputs - 1}]"
            read = f"{len(ends)} variable{'s' * (len(ends) != 1)} at signal {signal!r}"
            self.reading.wrong(place, read, f"{inputs} or out, {dim}")
            return
        for i, endpoint in zip(places, ends, strict=True):
            causality = self._causality(endpoint, place)
            wanted = "output" if is_input else "input"
            if causality is None:
                continue
            if causality != wanted:
                self.reading.wrong(place, f"{endpoint} is {causality}", f"an {wanted}")
            elif not is_input:
                self._out.setdefault(f.name, []).append((i, endpoint))
            elif i in self._into.setdefault(f.name, {}):
                self.reading.wrong(place, "a second connection to this signal", "one")
            else:
                self._into[f.name][i] = endpoint
