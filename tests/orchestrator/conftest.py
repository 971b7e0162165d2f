"""Made-up components, so that systems can be tried without FMUs: sources `fake:<name>`."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.models.units import parse_unit
from uuvsim_cosim.orchestrator import sources
from uuvsim_cosim.orchestrator.system import System


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
    ]
}


@dataclass(frozen=True)
class FakeSource:
    text: str
    kind: str = "fake"

    def describe(self) -> Description:
        name = self.text.removeprefix("fake:")
        if name not in FAKES:
            raise sources.InputInvalid(f"no fake {name!r}; expected one of {', '.join(FAKES)}")
        return FAKES[name]

    def instantiate(self, path: str, *, backend: sources.Backend = "fmu") -> Component:
        raise NotImplementedError


@pytest.fixture(autouse=True)
def fake_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "_factories", {})

    def factory(source: str, base: Path) -> FakeSource:
        return FakeSource(source)

    sources.register("fake", factory)


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
