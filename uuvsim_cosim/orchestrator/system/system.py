"""System: components, connections and start values as one value, which is always valid."""

from __future__ import annotations

import numbers
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import isfinite
from pathlib import Path

from uuvsim_cosim.errors import Problem, SystemInvalid, UuvsimError
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.importer.variables_fmi2 import fold
from uuvsim_cosim.lazy import by_name
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.system.elements import (
    Algorithm,
    Connection,
    Element,
    Exposed,
    Loops,
    Mismatches,
    Solver,
    StepGroup,
    Structure,
)
from uuvsim_cosim.orchestrator.system.formats import write_structure
from uuvsim_cosim.orchestrator.system.resolve import anchored, nested_structure, remarks_of
from uuvsim_cosim.orchestrator.system.slot import Slot, fitted, slot_at
from uuvsim_cosim.orchestrator.system.validation import (
    Checked,
    as_step,
    check,
    problem_of,
    with_connection,
    with_element,
    with_start,
)
from uuvsim_cosim.orchestrator.system.variable_step import VariableStep, variable_step_of_text
from uuvsim_cosim.orchestrator.system.wiring import Wire
from uuvsim_cosim.orchestrator.values.endpoints import find_element, resolve_endpoint
from uuvsim_cosim.orchestrator.values.transformation import table_of
from uuvsim_cosim.orchestrator.values.values import Misfit, flat

__all__ = ["System"]

_NUMBERED = re.compile(r"^(?P<stem>.*?)\{(?P<k>\d+)\}")  # of a peer (see `System._with_peers`)


@dataclass(frozen=True)
class System(Structure):
    """Components, their connections and start values; every edit returns a new system.

    `name` and `description` are texts. `tick` is the base step [s], exact. A run goes from
    `start_time` to `stop_time` [s] by default. The methods edit the components (`elements`), the
    `connections`, the `groups` that step together and the `exposed` connectors. `loops` is the
    policy for algebraic loops (see `with_loops`), `mismatches` that for parts of another vehicle
    (see `with_mismatches`), `variable_step` a step that follows the coupling (see
    `with_variable_step`), `events` whether FMUs use Event Mode (see `with_events`), `base` the
    folder of relative files of sources, and `remarks` are about the file from which the system was
    read. A path such as ``port.motor`` leads to the component ``motor`` of the nested system
    ``port``.

    Methods raise SystemInvalid, with every problem, if the result would not be valid.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> system = (
    ...     uuv.System("bench", tick="0.01")
    ...     .add("battery", "model:battery", start={"soc_0": 0.5})  # half full
    ...     .add("motor", "model:thruster_t200")
    ...     .connect("battery.voltage", "motor.voltage")
    ...     .connect("motor.current", "battery.current")
    ...     .set("motor.u", 0.5)  # command, in [-1, 1]
    ... )
    >>> list(system.components), system.base_step
    (['battery', 'motor'], Fraction(1, 100))
    >>> list(system.remove("battery").components)
    ['motor']

    Example: replace a controller.

    >>> hold = uuv.load("bluerov2_hold")
    >>> [connector.name for connector in hold.slot("controller").connectors]
    ['eta_d', 'nu_d', 'eta', 'nu', 'tau_d']
    >>> changed = hold.replace("controller", "model:sliding_mode")
    >>> changed.components["controller"].source, changed.notes
    ('model:sliding_mode', ())

    Example: nest a system in another.

    >>> pod = uuv.System("pod").add("motor", "model:thruster_t200")
    >>> pod = pod.expose("voltage", "motor.voltage").expose("thrust", "motor.thrust")
    >>> list(pod.interface().variables)
    ['voltage', 'thrust']
    >>> rig = uuv.System("rig").add("port", pod).set("port.motor.u", 0.5)
    >>> rig.nested("port").components["motor"].start
    {'u': 0.5}
    >>> rig.describe("port.motor").name, rig.nested_or_none("starboard")
    ('thruster_t200', None)
    """

    checked: Checked = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the system, and store its parts in their normal form (see `validation`)."""
        try:
            object.__setattr__(self, "tick", as_step(self.tick, self.name))
        except UuvsimError as error:
            raise SystemInvalid([problem_of(self.name, error)]) from None
        checked = check(self)
        if checked.problems:
            raise SystemInvalid(checked.problems)
        # The dataclass is frozen, so that no later change can make a system invalid.
        object.__setattr__(self, "elements", checked.elements)
        object.__setattr__(self, "connections", tuple(w.connection for w in checked.wires))
        object.__setattr__(self, "exposed", checked.exposed)
        object.__setattr__(self, "checked", checked)

    # ---- building -------------------------------------------------------------------------

    def add(
        self,
        path: str,
        source: str | System,
        start: Mapping[str, object] | None = None,
        rate: Fraction | str | float | None = None,
        description: str = "",
    ) -> System:
        """Add a component, or a nested system, at a new `path`.

        `source` is an FMU (``hull.fmu``), a declaration (``model:battery``), a Python class
        (``my.py:MyController``), a table of values over time (``current.csv``), or a system.
        `start` are start values by name; `rate` is the communication step [s], by default the
        tick; `description` is a text.
        """
        inner = self._inside(path)
        if inner is not None:
            name, rest = inner
            return self._edited(name, self.nested(name).add(rest, source, start, rate, description))
        if path in self.checked.descriptions:
            raise SystemInvalid([Problem(path, "a second component of this name", "a new name")])
        if isinstance(source, str):
            source = anchored(source, self.base)
        try:
            step = None if rate is None else as_step(rate, path)
        except UuvsimError as error:
            raise SystemInvalid([problem_of(path, error)]) from None
        nested = self._as_nested(source) if start else None
        if start and nested is not None:
            for name, value in start.items():
                nested = nested.set(name, value)
            source, start = nested, None
        element = Element(path, source, dict(start or {}), step, description)
        checked = with_element(self, self.checked, element)
        if checked is not None:
            return self._known(checked)
        return replace(self, elements=(*self.elements, element))

    def connect(
        self,
        source: str,
        target: str,
        *,
        factor: float = 1.0,
        offset: float = 0.0,
        convert: bool = True,
        table: Mapping[bool, bool] | Mapping[int, int] | Mapping[str, str] | None = None,
    ) -> System:
        """Connect the output `source` to the input `target`.

        Each is a whole variable ``a.y``, one element ``a.y[3]``, counted from 1, or a slice
        ``a.y[1:3]``, its end included. The target gets `factor` · value + `offset`, after the
        conversion into its unit if `convert`; or, with `table`, the entry for the value, which is a
        Boolean, an integer or the name of an enumeration's item.
        """
        pairs = () if table is None else table_of(table, f"{source} to {target}")
        for name, value in (("factor", factor), ("offset", offset)):
            if not (isinstance(value, numbers.Real) and isfinite(value)):
                place = f"{source} -> {target}"
                raise SystemInvalid([Problem(place, f"{name} {value!r}", "a finite number")])
        connection = Connection(source, target, float(factor), float(offset), convert, pairs)
        checked = with_connection(self.checked, connection)
        if checked is not None:
            new = checked.wires[len(self.checked.wires) :]
            return self._known(checked, self.connections + tuple(w.connection for w in new))
        return replace(self, connections=(*self.connections, connection))

    def disconnect(self, target: str) -> System:
        """Remove the connections to the input `target`, ``a.u``, or to elements of it, ``a.u[1]``.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> system = uuv.load("bluerov2_hold").disconnect("hull.tau")
        >>> any(connection.target == "hull.tau" for connection in system.connections)
        False
        """
        try:
            point = resolve_endpoint(target, self.checked.descriptions)
        except Misfit as misfit:
            raise SystemInvalid([misfit.at(target)]) from None
        kept: list[Connection] = []
        found = False
        for wire in self.checked.wires:
            end = wire.target
            same = (end.element, end.variable.name) == (point.element, point.variable.name)
            if not same or not set(wire.target.elements) & set(point.elements):
                kept.append(wire.connection)
                continue
            found = True
            pairs = zip(wire.source.texts(), wire.target.texts(), wire.target.elements, strict=True)
            kept += [
                replace(wire.connection, source=a, target=b)
                for a, b, i in pairs
                if i not in point.elements
            ]
        if not found:
            raise SystemInvalid([Problem(target, "not connected", "a connected input")])
        return replace(self, connections=tuple(kept))

    def set(self, path: str, value: object) -> System:
        """Set the start value of the variable at `path`, such as ``hull.m`` or ``hull.eta_0[3]``.

        `value` is in the variable's unit, or a text with a unit: ``"2 km/h"``.
        """
        inner = self._inside(path)
        if inner is not None:
            name, rest = inner
            nested = self.nested(name)
            for item in nested.exposed:
                if item.name in (rest, rest.partition("[")[0]):
                    rest = item.path + rest.removeprefix(item.name)
            return self._edited(name, nested.set(rest, value))
        if "." not in path:
            parameters = [
                f"{name}.{v.name}"
                for name, d in self.checked.descriptions.items()
                for v in d.of("parameter", "structuralParameter")
            ]
            expected = expected_names(path, parameters, "COMPONENT.VARIABLE")
            raise SystemInvalid([Problem(path, "no component and variable", expected)])
        name, key = self._split(path)
        checked = with_start(self, self.checked, name, key, value)
        if checked is not None:
            return self._known(checked)
        element = self._element(name)
        return self._with(replace(element, start={**element.start, key: value}))

    def group(
        self,
        members: Iterable[str],
        algorithm: Algorithm = "gauss-seidel",
        *,
        solver: Solver = "newton",
        tolerance: float = 1e-10,
        limit: int = 100,
    ) -> System:
        """Step the components `members` together by another `algorithm` than Jacobi.

        "gauss-seidel": in this order, each with the new outputs of those before. "iterated": the
        step is repeated until inputs and outputs at its end agree, by the `solver`, within the
        `tolerance` (of a residual, relative to 1 + |input|), in at most `limit` iterations.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> system = uuv.System("bench").add("battery", "model:battery").add("t", "model:thruster")
        >>> system.group(["battery", "t"]).groups[0].algorithm
        'gauss-seidel'
        """
        group = StepGroup(tuple(members), algorithm, solver, tolerance, limit)
        return replace(self, groups=(*self.groups, group))

    def with_loops(self, policy: Loops) -> System:
        """Return the system with another `policy` for algebraic loops that no group solves.

        "iterate": they are iterated at each communication point; a loop whose members cannot be
        iterated is refused. "refuse": all are refused. "delay": each connection delays by a step.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> uuv.load("bluerov2_hold").with_loops("refuse").loops
        'refuse'
        """
        return replace(self, loops=policy)

    def with_mismatches(self, policy: Mismatches) -> System:
        """Return the system with another `policy` for parts that are made for another vehicle.

        "refuse": a system with a hull on other thrusters, an allocation for other places, or gains
        for another inertia is refused before it runs. "warn": each is a warning instead.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> mixed = uuv.load("bluerov2_hold").replace("hull", "model:remus100")
        >>> mixed.with_mismatches("warn").mismatches
        'warn'
        """
        return replace(self, mismatches=policy)

    def with_events(self, on: bool = True) -> System:
        """Return the system with events across FMUs, or without them.

        `on`: FMUs of FMI 3.0 for Co-Simulation that have Event Mode use it. Those that are
        connected to each other exchange their values at the instant of an event, also inside a
        step.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> uuv.load("bluerov2_hold").with_events().events
        True
        """
        return replace(self, events=on)

    def with_variable_step(self, step: VariableStep | str | None) -> System:
        """Return the system with a communication step of variable length; None: a fixed one.

        `step` is a `VariableStep`, or its settings as text (lengths in s), which may give the
        system another tick (``tick=1e-6``). The components without a communication step of their
        own follow it, in whole ticks.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> hold = uuv.load("bluerov2_hold")
        >>> varied = hold.with_variable_step("smallest=0.01 largest=0.1 relative=1e-3")
        >>> varied.variable_step.largest
        Fraction(1, 10)
        """
        tick = self.tick
        if isinstance(step, str):
            step, own = variable_step_of_text(step, self.variable_step)
            tick = own or tick
        return replace(self, tick=tick, variable_step=step)

    def expose(self, name: str, path: str) -> System:
        """Make the inner connector at `path` a connector `name` of the system.

        Another system that nests this one connects it by this name.
        """
        return replace(self, exposed=(*self.exposed, Exposed(name, path)))

    def replace(
        self,
        path: str,
        source: str | System,
        map: Mapping[str, str] | str | Path | None = None,
        rate: Fraction | str | float | None = None,
        start: Mapping[str, object] | None = None,
    ) -> System:
        """Replace the component at `path` by another, `source`, that fits its slot.

        `map` maps names of the slot to names of the replacement (``{"tau_d": "Out1"}``,
        ``{"tau_d[3]": "Out3"}``), or is an .ssm file. The slot's step is kept unless `rate` [s] is
        given, and so are start values of variables that the replacement has too; `start` are
        others. An input that the slot does not have is connected to the signal that the replacement
        names for it, if the system has that signal.
        """
        return self._fitted(path, source, map, rate, start)._with_peers(path)

    def _fitted(
        self,
        path: str,
        source: str | System,
        map: Mapping[str, str] | str | Path | None,
        rate: Fraction | str | float | None,
        start: Mapping[str, object] | None,
    ) -> System:
        """Replace a component, in a nested system too, without its peers."""
        inner = self._inside(path)
        if inner is not None:
            name, rest = inner
            return self._edited(name, self.nested(name)._fitted(rest, source, map, rate, start))
        self._split(f"{path}.")
        if isinstance(source, str):
            source = anchored(source, self.base)
        descriptions, wires = self.checked.descriptions, self.checked.wires
        return fitted(self, path, source, map, rate, start, descriptions=descriptions, wires=wires)

    def _with_peers(self, path: str) -> System:
        """Connect the unconnected inputs of the component at `path` to their peers.

        A component may name the signals that feed its inputs in the systems that it was made for,
        by a path from the top: ``target.position``. In ``tracker_{1}.hull.eta``, ``{1}`` stands for
        the first number, counted from 1, that is not the number of the component's own
        ``tracker_2``. If the system does not have such a signal, a remark says so.
        """
        owner, dot, _ = path.partition(".")
        nested = self.nested_or_none(owner) if dot else None
        if nested is None and path not in self.checked.descriptions:
            return self
        fed = {(w.target.element, w.target.variable.name) for w in self._wires_at(path)}
        element = path.rpartition(".")[2]
        system = self
        for name, pattern in self.describe(path).peers.items():
            if (element, name) in fed:
                continue
            peer = pattern
            if (m := _NUMBERED.match(pattern)) is not None:
                own = re.match(re.escape(m["stem"]) + r"(\d+)", path)
                k = int(m["k"])
                k += own is not None and int(own[1]) <= k
                peer = f"{m['stem']}{k}{pattern[m.end() :]}"
            try:
                source, wider = system._offered(peer)
                target, wider = wider._offered(f"{path}.{name}")
                system = wider.connect(source, target)
            except SystemInvalid:
                remark = f"{path}.{name}: it is not connected, because {peer} is not in this system"
                system = replace(system, remarks=(*system.remarks, remark))
        return system

    def write(self, path: str | Path) -> None:
        """Write the system to the file `path` as .ssd, without loss.

        Files of sources are named relative to its folder.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> hold = uuv.load("bluerov2_hold")
        >>> hold.write("hold.ssd")
        >>> uuv.load("hold.ssd") == hold
        True
        """
        write_structure(self, Path(path))

    def remove(self, name: str) -> System:
        """Remove the component `name` with its connections."""
        self._split(f"{name}.")
        wires = self.checked.wires
        members = [replace(g, members=tuple(m for m in g.members if m != name))
                   for g in self.groups]  # fmt: skip
        return replace(
            self,
            elements=tuple(e for e in self.elements if e.name != name),
            connections=tuple(
                w.connection for w in wires if name not in (w.source.element, w.target.element)
            ),
            groups=tuple(g for g in members if g.members),
            exposed=tuple(x for x in self.exposed if not x.path.startswith(f"{name}.")),
        )

    # ---- reading --------------------------------------------------------------------------

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on assumptions: units that descriptions do not name, values that were dropped."""
        inner: list[str] = []
        for element in self.elements:
            nested = self._nested(element)
            inner += [f"{element.name}.{n}" for n in nested.notes] if nested else []
            if isinstance(element.source, str):
                found = remarks_of(element.source, self.base)
                inner += [f"{element.name}: {remark}" for remark in found]
            if nested and nested.loops not in ("iterate", self.loops):
                inner.append(
                    f"{element.name}: its loop policy {nested.loops!r} is ignored; that of "
                    f"the outer system, {self.loops!r}, applies"
                )
        return (*self.remarks, *self.checked.notes, *inner)

    def describe(self, path: str) -> Description:
        """Describe the component at a `path`: its variables with units, start values and limits."""
        inner = self._inside(path)
        if inner is not None:
            return self.nested(inner[0]).describe(inner[1])
        self._split(f"{path}.")
        return self.checked.descriptions[path]

    def nested(self, name: str) -> System:
        """Return the nested system at a `name`; raises SystemInvalid if there is none."""
        found = self.nested_or_none(name)
        if found is None:
            raise SystemInvalid([Problem(name, "not a nested system", "a nested system")])
        return found

    def nested_or_none(self, name: str) -> System | None:
        """Return the nested system at a `name`; None if it is a component, or nothing."""
        return self._nested(self._element(name)) if name in self.checked.descriptions else None

    def slot(self, path: str) -> Slot:
        """Return the connectors that a replacement of the component at `path` must have."""
        description = self.describe(path)
        inner = self._inside(path)
        if inner is not None:
            return replace(self.nested(inner[0]).slot(inner[1]), path=path)
        return slot_at(self, path, description, self.checked.wires)

    def interface(self) -> Description:
        """Describe the system as a component: its exposed connectors."""
        descriptions = self.checked.descriptions
        variables: dict[str, Variable] = {}
        for item in self.exposed:
            point = resolve_endpoint(item.path, descriptions)
            start = self._element(point.element).start.get(point.variable.name)
            v = replace(point.variable, name=item.name, dependencies=None)
            v = replace(v, start=start) if start is not None else v
            if not point.whole:
                i = point.elements[0]
                start = None if v.start is None else flat(v.start)[i]
                unit = v.unit_of_element(i)
                v = replace(v, shape=(), start=start, unit=unit, element_units=())
            variables.setdefault(item.name, v)
        units = {n: u for d in descriptions.values() for n, u in d.units.items()}
        folded = fold(list(variables.values()))
        return Description(self.name, "native", folded, description=self.description, units=units)

    # ---- inside ---------------------------------------------------------------------------

    def _repr_svg_(self) -> str:
        """Return the block diagram, for notebooks."""
        return str(by_name("view.notebook.displays:system_svg")(self))

    def _split(self, path: str) -> tuple[str, str]:
        """Split ``component.rest``; raises SystemInvalid if there is no such component."""
        try:
            return find_element(path, self.checked.descriptions)
        except Misfit as misfit:
            raise SystemInvalid([misfit.at(path.removesuffix("."))]) from None

    def _inside(self, path: str) -> tuple[str, str] | None:
        """Split a path that leads into a nested system."""
        parts = path.split(".")
        names = [".".join(parts[:n]) for n in range(1, len(parts))]
        found = [n for n in names if n in self.checked.descriptions]
        for name in sorted(found, key=self.checked.descriptions.index):
            if self._nested(self._element(name)) is not None:
                return name, path[len(name) + 1 :]
        return None

    def _known(self, checked: Checked, connections: tuple[Connection, ...] | None = None) -> System:
        """Return the system with parts that are checked already."""
        result = object.__new__(System)
        result.__dict__.update(
            {**self.__dict__, "checked": checked, "elements": checked.elements},
            connections=self.connections if connections is None else connections,
        )
        return result

    def _element(self, name: str) -> Element:
        return self.elements[self.checked.descriptions.index(name)]

    def _nested(self, element: Element) -> System | None:
        return self._as_nested(element.source)

    def _as_nested(self, source: str | Structure) -> System | None:
        nested = nested_structure(source, self.base)
        assert nested is None or isinstance(nested, System)
        return nested

    def _wires_at(self, path: str) -> tuple[Wire, ...]:
        """Return the wires of the innermost system in which the component at a path is."""
        owner, dot, rest = path.partition(".")
        nested = self.nested_or_none(owner) if dot else None
        return self.checked.wires if nested is None else nested._wires_at(rest)

    def _offered(self, path: str) -> tuple[str, System]:
        """Return the system's connector for an inner one, and the system in which it is exposed."""
        owner, _, rest = path.partition(".")
        nested = self.nested_or_none(owner)
        if nested is None:
            return path, self
        for item in nested.exposed:
            if item.path == rest:
                return f"{owner}.{item.name}", self
        inner, nested = nested._offered(rest)
        used = {item.name for item in nested.exposed}
        name = rest.replace(".", "_")
        while name in used:
            name += "_"
        return f"{owner}.{name}", self._edited(owner, nested.expose(name, inner))

    def _edited(self, name: str, nested: System) -> System:
        return self._with(replace(self._element(name), source=nested))

    def _with(self, element: Element) -> System:
        elements = tuple(element if e.name == element.name else e for e in self.elements)
        return replace(self, elements=elements)
