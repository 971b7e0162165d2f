"""Made-up components, so that systems can be tried without FMUs: sources `fake:<name>`."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.units import parse_unit
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.plan.algebraic_loops import apply_loop_policy
from uuvsim_cosim.orchestrator.plan.initialization import initialization_order
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent, Transfer
from uuvsim_cosim.orchestrator.plan.seeds import component_seed
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.system import resolve
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System


def var(name: str, causality: Any, shape: tuple[int, ...] = (), **more: Any) -> Variable:
    more.setdefault("type", "Float64")
    more.setdefault("unit", "1" if more["type"] == "Float64" else None)
    more.setdefault("variability", "tunable" if causality == "parameter" else "continuous")
    return Variable(name, causality=causality, shape=shape, **more)


def description(name: str, *variables: Variable, kind: Any = "native") -> Description:
    units = {v.unit: parse_unit(v.unit) for v in variables if v.unit}
    return Description(name, kind, {v.name: v for v in variables}, units=units)


def control(*extra: Variable, **tau: Any) -> list[Variable]:
    return [
        var("eta_d", "input", (6,)),
        var("eta", "input", (6,)),
        var("tau_d", "output", (6,), dependencies=("eta_d", "eta"), **{"unit": "N", **tau}),
        *extra,
    ]


FAKES: dict[str, Description] = {
    d.name: d
    for d in [
        description(
            "hull",
            var("tau", "input", (6,), unit="N"),
            var("v_c", "input", (3,), unit="m/s"),
            var("eta", "output", (6,), dependencies=()),
            var("nu_dot", "output", (6,), unit="m/s2", dependencies=("tau",)),
            var("mass", "parameter", unit="kg", start=10.0, min=0.1, max=100.0),
            var("eta_0", "parameter", (6,), start=(0.0,) * 6),
            var("J", "parameter", (2, 2), unit="kg.m2", start=((1.0, 0.0), (0.0, 1.0))),
        ),
        description(
            "guidance",
            var("eta", "input", (6,)),
            var("eta_d", "output", (6,), dependencies=()),
            var("speed", "parameter", unit="m/s", start=0.5, min=0.0),
        ),
        description(
            "controller",
            *control(
                var("Kp", "parameter", unit="N/m", start=100.0, min=0.0),
                var("tau_max", "parameter", (6,), unit="N", start=(50.0,) * 6),
                var("enabled", "parameter", type="Boolean", start=True),
                var("order", "parameter", type="Int32", start=1),
                var("log", "parameter", type="String", start="off"),
            ),
        ),
        description(
            "allocation",
            var("tau_d", "input", (6,), unit="N"),
            var("u", "output", (4,), dependencies=("tau_d",)),
        ),
        description(
            "thruster",
            var("u", "input", min=-1.0, max=1.0),
            var("thrust", "output", unit="N", dependencies=()),
        ),
        description(
            "wrench",
            var("thrust", "input", (4,), unit="N"),
            var("tau", "output", (6,), unit="N", dependencies=("thrust",)),
        ),
        description(
            "current",
            var("v_c", "output", (3,), unit="km/h", dependencies=()),
            var("speed", "parameter", unit="m/s", start=0.2, min=0.0, max=3.0),
            var("seed", "parameter", (2,), type="Int32", variability="fixed", start=(0, 0)),
        ),
        description(
            "filter",
            var("y", "output", unit="m", dependencies=("u",)),
            var("u", "input", unit="m"),
            var("silent", "output", unit="m"),
        ),
        # What other tools make: scalars with names of their own, units left out or wrong.
        description(
            "foreign",
            *(var(f"In{i}", "input", unit=None) for i in range(1, 13)),
            *(var(f"Out{i}", "output", unit=None) for i in range(1, 7)),
            var("Kp", "parameter", unit="kN/m", start=1.0),
            var("gain", "parameter", start=1.0),
            kind="FMI 2.0",
        ),
        description("unitless", *control(unit=None), kind="FMI 3.0"),
        description("wrong_unit", *control(unit="m/s"), kind="FMI 3.0"),
        description("other_unit", *control(unit="kN"), kind="FMI 3.0"),
        description("half", var("eta", "input", (6,)), var("tau", "output", (3,), unit="N")),
        description("controller2", *control(), kind="FMI 2.0"),
        description(
            "gearbox",
            var("mode", "input", type="Enumeration", unit=None, items=(("slow", 1), ("fast", 2))),
            var(
                "state",
                "output",
                type="Enumeration",
                unit=None,
                items=(("off", 0), ("on", 5)),
                dependencies=(),
            ),
            var(
                "gear",
                "parameter",
                type="Enumeration",
                unit=None,
                start=1,
                items=(("slow", 1), ("fast", 2)),
            ),
            var("on", "parameter", type="Boolean", unit=None, start=False),
            var("teeth", "parameter", type="Int32", unit=None, start=9),
        ),
    ]
}


@dataclass(frozen=True)
class FakeSource:
    text: str
    kind: str = "fake"

    def describe(self) -> Description:
        name = self.text.removeprefix("fake:")
        if name not in FAKES:
            raise InputInvalid(f"no fake {name!r}; expected one of {', '.join(FAKES)}")
        return FAKES[name]

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        raise NotImplementedError


@pytest.fixture(autouse=True)
def fake_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resolve, "_factories", {})

    def factory(source: str, base: Path) -> FakeSource:
        return FakeSource(source)

    resolve.register("fake", factory)


@pytest.fixture
def vehicle() -> System:
    """Hull, four thrusters, controller and the like, all connected."""
    s = System("vehicle", tick="0.01", description="a small one")
    for name in ("hull", "current", "guidance", "controller", "allocation", "wrench"):
        s = s.add(name, f"fake:{name}")
    for i in range(1, 5):
        s = s.add(f"thruster_{i}", "fake:thruster")
        s = s.connect(f"allocation.u[{i}]", f"thruster_{i}.u")
        s = s.connect(f"thruster_{i}.thrust", f"wrench.thrust[{i}]")
    return (
        s.connect("hull.eta", "guidance.eta")
        .connect("hull.eta", "controller.eta")
        .connect("guidance.eta_d", "controller.eta_d")
        .connect("controller.tau_d", "allocation.tau_d")
        .connect("wrench.tau", "hull.tau")
        .connect("current.v_c", "hull.v_c")
    )


@pytest.fixture
def fake_description() -> Callable[..., Description]:
    return description


@pytest.fixture
def fake_variable() -> Callable[..., Variable]:
    return var


# ---- plans by hand, for the master: paths to live components, and "a.y -> b.u[2]" -------------

Make = Callable[[str], Component]


@dataclass(frozen=True)
class Wired:
    """A plan, and what makes its components; ``Master(*wired)`` runs it."""

    plan: Plan
    makers: dict[str, Make]

    def instantiate(self, planned: PlannedComponent) -> Component:
        return self.makers[planned.path](planned.path)

    def __iter__(self) -> Iterator[Any]:
        return iter((self.plan, self.instantiate))


def _end(text: str, variables: dict[str, Any]) -> tuple[str, Variable, tuple[int, ...]]:
    path, _, name = text.strip().rpartition(".")
    name, _, index = name.partition("[")
    variable = variables[path].variables[name]
    elements = (int(index[:-1]) - 1,) if index else tuple(range(variable.size))
    return path, variable, elements


def wire(
    makers: dict[str, Make],
    connections: Sequence[str] = (),
    *,
    tick: str = "1/100",
    groups: Sequence[Group] = (),
    step_ticks: dict[str, int] | None = None,
    start: dict[str, dict[str, Any]] | None = None,
    seed: int = 0,
    conversions: dict[str, tuple[float, float]] | None = None,
) -> Wired:
    paths = list(makers)
    described = {}
    for path, make in makers.items():
        component = make(path)
        described[path] = component.description
        component.free()
    components = tuple(
        PlannedComponent(
            path=p,
            source=p,
            description=described[p],
            start=(start or {}).get(p, {}),
            seed=component_seed(seed, p),
            step_ticks=(step_ticks or {}).get(p, 1),
        )
        for p in paths
    )
    transfers = []
    for connection in connections:
        a, _, b = connection.partition(" -> ")
        (source, out, these), (target, into, those) = _end(a, described), _end(b, described)
        factor, offset = (conversions or {}).get(connection, (1.0, 0.0))
        transfers.append(
            Transfer(
                paths.index(source), out, these, paths.index(target), into, those, factor, offset
            )
        )
    order = initialization_order(components, transfers)
    every = (*groups,) or (Group("jacobi", tuple(range(len(paths)))),)
    plan = Plan(Fraction(tick), components, tuple(transfers), every, order)
    return Wired(apply_loop_policy(plan, frozenset()), makers)


@pytest.fixture
def wired() -> Callable[..., Wired]:
    return wire


@pytest.fixture
def fmi3(first_order_fmi3: Path) -> Make:
    return lambda path: instantiate_fmu(first_order_fmi3, path)


@pytest.fixture
def fmi2(first_order_fmi2: Path) -> Make:
    return lambda path: instantiate_fmu(first_order_fmi2, path)


def _lag() -> Model:
    m = Model("lag")
    u = m.input("u", unit="cm")
    k, T = m.parameter("k", 1.0, unit="1"), m.parameter("T", 0.5, unit="s")
    y = m.state("x", unit="cm")
    m.der(y, (k * u - y) / T)
    m.output("y", y, unit="cm")
    return m


@pytest.fixture
def native() -> Make:
    return lambda path: Native(_lag(), path)


class _Lag:
    """The FMUs' equation in Python: dy/dt = (k u - y) / T by Euler."""

    inputs = {"u": "cm", "v": (3, "1")}  # noqa: RUF012
    outputs = {"y": "cm", "w": (3, "1")}  # noqa: RUF012
    parameters = {"k": (1.0, "1"), "T": (0.5, "s")}  # noqa: RUF012
    k: float
    T: float

    def __init__(self) -> None:
        self.y = 0.0

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        self.y += dt * (self.k * u["u"] - self.y) / self.T
        return {"y": self.y, "w": 2 * u["v"]}


@pytest.fixture
def python() -> Make:
    return lambda path: PythonComponent(_Lag, path)


class Watcher:
    """An observer that keeps all it sees."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.ticks: list[int] = []
        self.time: list[float] = []
        self.values: dict[str, list[Any]] = {}
        self.ended = 0

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        self.names = [c.name for c in columns]
        self.values = {n: [] for n in self.names}

    def observe(self, chunk: Chunk) -> None:
        self.ticks += chunk.ticks.tolist()
        self.time += chunk.time.tolist()
        for i, name in enumerate(self.names):
            self.values[name] += chunk.values(i).tolist()

    def end(self) -> None:
        self.ended += 1


@pytest.fixture
def watcher() -> Watcher:
    return Watcher()
