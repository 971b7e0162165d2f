"""A system as  dx/dt = f(x, u),  y = h(x, u)  in CasADi, with names, units and frames.

Components that have no clock are composed without communication delays: an input is the output that
is connected to it, at the same instant. If a component samples, the result is the map
x_{k+1} = f(x_k, u_k) over the shortest time after which all clocks tick again, with the delays of
communication, and draws of noise are 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.operating_point import Coordinates, place_of
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.models.declaration.model import Declared, Model
from uuvsim_cosim.orchestrator.analysis.system_map import SystemMap
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Dynamics", "Element", "model_dynamics", "system_dynamics"]

Array = NDArray[np.float64]
TIME = "time"  # the name of the state that is added where equations depend on time


@dataclass(frozen=True)
class Element:
    """One number of a state, an input or an output: its name, unit, frame and meaning.

    `frame` is "n" (NED), "b" (FRD), or "" if the component does not state one.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> surge = uuv.dynamics("remus100").states[6]
    >>> surge.name, surge.unit, surge.frame
    ('nu[1]', 'm/s', 'b')
    """

    name: str
    unit: str
    frame: str
    description: str


@dataclass(frozen=True)
class Dynamics:
    """Equations of a system: `f` and `h` are functions of x (n, 1) and u (m, 1), in SI and rad.

    If `period` is 0, ``f(x, u)`` is dx/dt; otherwise it is x after `period` seconds. ``h(x, u)``
    is y. `x_0` and `u_0` are the start values. `delays` [s] are those of the inputs in the
    co-simulation, which `f` in continuous time does not have. The attitude of a hull is
    (phi, theta, psi) in continuous time, so that theta must stay away from ±90 degrees. Where
    equations depend on time, the last state is "time" [s].

    Example:

    >>> import uuvsim_cosim as uuv
    >>> hull = uuv.dynamics("remus100")
    >>> [s.name for s in hull.states][5:8], hull.inputs[0].unit
    (['eta[6]', 'nu[1]', 'nu[2]'], 'N')
    >>> x = hull.x_0.copy()
    >>> x[6] = 1.5  # m/s
    >>> f"{float(hull.f(x, hull.u_0)[6]):.3f} m/s2"  # drag alone
    '-0.116 m/s2'
    """

    name: str
    f: ca.Function
    h: ca.Function
    states: Sequence[Element]
    inputs: Sequence[Element]
    outputs: Sequence[Element]
    x_0: Array
    u_0: Array
    period: float = 0.0
    delays: Sequence[float] = ()

    def index(self, name: str) -> list[int]:
        """Return the places of a state, of an input or of an output, whole or by element.

        Raises InputInvalid with similar names.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> uuv.dynamics("remus100").index("nu")
        [6, 7, 8, 9, 10, 11]
        """
        for elements in (self.states, self.inputs, self.outputs):
            known = [e.name for e in elements]
            if any(k == name or k.startswith(f"{name}[") for k in known):
                return place_of("signal", name, known, self.name)
        known = [e.name for e in (*self.states, *self.inputs, *self.outputs)]
        return place_of("signal", name, known, self.name)  # raises, with all names


def model_dynamics(model: Model, parameters: Mapping[str, ArrayLike] | None = None) -> Dynamics:
    """Return the equations of one declaration."""
    t = ca.SX.sym(TIME)
    if model.clocks:
        raise InputInvalid(
            f"dynamics: {model.name} samples", "a system that contains it, or a continuous model"
        )
    c = Coordinates(model, parameters, t)
    x, u, rates, y = c.symbols
    return _continuous(model.name, t, (x, u, rates, y), _elements(c), c.x_0, c.u_0)


def system_dynamics(system: System) -> Dynamics:
    """Return the equations of a system of declarations; see `Dynamics`."""
    m = SystemMap(flatten(system), "dynamics")
    if any(part.model.clocks for part in m.parts):
        return _sampled(system.name, m)
    t = ca.SX.sym(TIME)
    coordinates = []
    for part in m.parts:
        own = part.model.of_kind("parameter")
        ends = np.cumsum([v.size for v in own])
        pieces = np.split(part.p, ends[:-1]) if own else []
        given = {v.name: piece for v, piece in zip(own, pieces, strict=True)}
        coordinates.append(Coordinates(part.model, given, t))
    x, rates, y = (ca.vertcat(*(c.symbols[k] for c in coordinates)) for k in (0, 2, 3))
    fed = ca.vertcat(*(c.symbols[1] for c in coordinates))  # all inputs
    first_u = np.cumsum([0, *(c.symbols[1].numel() for c in coordinates)])
    first_y = np.cumsum([0, *(c.symbols[3].numel() for c in coordinates)])
    free = ca.SX.sym("u", len(m.free))
    values = ca.vertcat(*(ca.SX(ca.DM(part.u_0)) for part in m.parts if len(part.u_0)))
    for n, (i, e) in enumerate(m.free):
        values[first_u[i] + e] = free[n]
    outputs = y
    for _ in range(len(m.parts) + 1):  # each pass goes one component further along a chain
        for link in m.links:
            source = link.source - m.parts[link.owner].y_at + first_y[link.owner]
            value = link.factor * outputs[int(source)] + link.offset
            values[int(first_u[link.target] + link.element)] = value
        outputs = ca.substitute(y, fed, values)
        if not ca.depends_on(ca.vertcat(values, outputs), fed):
            break
    else:
        raise InputInvalid(
            f"dynamics: {system.name}",
            "outputs depend on each other at the same instant",
            "no algebraic loop: break it with a component that has a state",
        )
    rates = ca.substitute(rates, fed, values)
    prefixed = [
        tuple(_named(f"{part.path}.", e) for e in _elements(c))
        for part, c in zip(m.parts, coordinates, strict=True)
    ]
    states, inputs, named_outputs = ([e for p in prefixed for e in p[k]] for k in range(3))
    free_inputs = [inputs[int(first_u[i]) + e] for i, e in m.free]
    x_0 = np.concatenate([c.x_0 for c in coordinates])
    u_0 = np.array([m.parts[i].u_0[e] for i, e in m.free])
    symbols = (x, free, rates, outputs)
    elements = (states, free_inputs, named_outputs)
    delays = [float(m.plan.tick) * (0.5 + m.hops(i)) for i, _ in m.free]
    return _continuous(system.name, t, symbols, elements, x_0, u_0, delays)


def _continuous(
    name: str,
    t: ca.SX,
    symbols: tuple[ca.SX, ca.SX, ca.SX, ca.SX],
    elements: Sequence[Sequence[Element]],
    x_0: Array,
    u_0: Array,
    delays: Sequence[float] = (),
) -> Dynamics:
    x, u, rates, y = symbols
    states, inputs, outputs = elements
    if ca.depends_on(ca.vertcat(rates, y), t):
        x, rates, x_0 = ca.vertcat(x, t), ca.vertcat(rates, 1.0), np.append(x_0, 0.0)
        states = [*states, Element(TIME, "s", "", "time")]
    names = (["x", "u"], ["dx"])
    return Dynamics(
        name,
        ca.Function("f", [x, u], [ca.densify(rates)], *names),
        ca.Function("h", [x, u], [ca.densify(y)], ["x", "u"], ["y"]),
        tuple(states),
        tuple(inputs),
        tuple(outputs),
        x_0,
        u_0,
        delays=tuple(delays) or (0.0,) * len(inputs),
    )


def _sampled(name: str, m: SystemMap) -> Dynamics:
    """Return the map over one period; its states are those of the map over a tick."""
    steps = [m.step(k) for k in range(m.period)]
    timed = any(f.jac_sparsity(0, 0).nnz() for f in steps)
    x, u = ca.MX.sym("x", m.size + timed), ca.MX.sym("u", len(m.free))
    begin = x[m.size] if timed else ca.MX(0.0)
    after = x[: m.size]
    for k, step in enumerate(steps):
        after = step(begin + float(k * m.plan.tick), after, u)
    period = float(m.period * m.plan.tick)
    y = x[[m.names.index(n) for n in m.outputs]]
    x_0, u_0 = m.start()
    states = [_element(m, n) for n in m.names]
    if timed:
        after, x_0 = ca.vertcat(after, begin + period), np.append(x_0, 0.0)
        states.append(Element(TIME, "s", "", "time"))
    return Dynamics(
        name,
        ca.Function("f", [x, u], [after], ["x", "u"], ["x_next"]),
        ca.Function("h", [x, u], [y], ["x", "u"], ["y"]),
        tuple(states),
        tuple(_element(m, n) for n in m.inputs),
        tuple(_element(m, n) for n in m.outputs),
        x_0,
        u_0,
        period,
    )


def _element(m: SystemMap, name: str) -> Element:
    plain = name.removesuffix(" at the end of the step")
    part = next(
        p for p in sorted(m.parts, key=lambda p: -len(p.path)) if plain.startswith(f"{p.path}.")
    )
    own, indices = split_element_name(plain.removeprefix(f"{part.path}."))
    variable = part.model.variables[own]
    flat = int(np.ravel_multi_index([i - 1 for i in indices], variable.shape)) if indices else 0
    return _of_variable(name, variable, flat)


def _elements(c: Coordinates) -> tuple[list[Element], list[Element], list[Element]]:
    """Return the elements of states, inputs and outputs, by their names in `Coordinates`."""
    model = c.model
    kinds = [
        [
            _of_variable(f"{v.name}{_at(v, i)}", v, i)
            for v in model.of_kind(kind)
            for i in range(v.size)
        ]
        for kind in ("state", "input", "output")
    ]
    names = (c.states, c.inputs, c.outputs)
    if c.hull:  # eta and nu stand for position, quaternion and velocity
        outputs = {e.name: e for e in kinds[2]}
        kinds[0] = [*(outputs[n] for n in c.states[:12]), *kinds[0][13:]]
    states, inputs, outputs_ = (
        [Element(n, e.unit, e.frame, e.description) for n, e in zip(own, kind, strict=True)]
        for own, kind in zip(names, kinds, strict=True)
    )
    return states, inputs, outputs_


def _at(v: Declared, element: int) -> str:
    return f"[{element + 1}]" if v.shape else ""


def _of_variable(name: str, v: Declared, element: int) -> Element:
    unit = v.units[element] if v.units else v.unit
    text = v.description
    frame = "n" if "NED" in text or "N E D" in text else "b" if " in b" in f" {text}" else ""
    if not frame and v.name in ("nu", "nu_b", "nu_r", "tau"):
        frame = "b"
    return Element(name, unit, frame, text)


def _named(prefix: str, elements: Sequence[Element]) -> list[Element]:
    return [Element(f"{prefix}{e.name}", e.unit, e.frame, e.description) for e in elements]
