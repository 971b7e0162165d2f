"""Writing a system to a file of SSP and reading it changes nothing that a master sees."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.running.library import available, load
from uuvsim_cosim.orchestrator.ssp.ssd import format_ssd, read_ssd, write_ssd
from uuvsim_cosim.orchestrator.ssp.ssp import write_archive
from uuvsim_cosim.orchestrator.system.system import System

Version = Literal["1.0", "2.0"]
KINDS = ("filter", "thruster", "wrench", "hull", "current", "controller", "unitless", "foreign")
STARTS: dict[str, dict[str, st.SearchStrategy[Any]]] = {
    "hull": {
        "mass": st.floats(0.1, 100.0),
        "eta_0": st.tuples(*[st.floats(-1e300, 1e300)] * 6),
        "J": st.tuples(*[st.tuples(*[st.floats(-9, 9)] * 2)] * 2),
    },
    "controller": {
        "enabled": st.booleans(),
        "order": st.integers(-(2**31), 2**31 - 1),
        "log": st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"])),
    },
    "current": {"seed": st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 2)},
    "filter": {"u": st.floats(allow_nan=False, allow_infinity=False)},
    "foreign": {"gain": st.floats(-1e9, 1e9)},
}
NUMBERS = st.floats(-1e6, 1e6).filter(bool)


def seen(value: Any) -> Any:
    """Return a plan as values that can be compared: arrays as lists, remarks left out."""
    if isinstance(value, Plan):
        value = dataclasses.replace(value, warnings=())
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if dataclasses.is_dataclass(value):
        return {f.name: seen(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {k: seen(v) for k, v in value.items()}
    return [seen(v) for v in value] if isinstance(value, list | tuple) else value


@st.composite
def systems(draw: st.DrawFn, depth: int = 1) -> System:
    """Make components of all kinds, some nested; wires, values, steps and groups at random."""
    name = draw(st.sampled_from(["s", "a system", "größer", "x.y"]))
    tick = draw(st.sampled_from(["0.01", "1/60", "0.1", "1e-4"])) if depth else "0.01"
    described = draw(st.sampled_from(["", 'd <"&">']))
    system = System(name, tick=tick, description=described, loops="delay")  # fakes cannot iterate
    for i, kind in enumerate(draw(st.lists(st.sampled_from(KINDS), min_size=1, max_size=6))):
        item = draw(st.sampled_from(["{}_{}", "{} {}", "{}.{}"])).format(kind, i)
        rate = draw(st.sampled_from([None, None, 1, 2, 7]))
        step = None if rate is None else system.base_step * rate
        system = system.add(item, f"fake:{kind}", rate=step)
        for key, values in STARTS.get(kind, {}).items():
            if draw(st.booleans()):
                system = system.set(f"{item}.{key}", draw(values))
    if depth and draw(st.booleans()):
        inner = draw(systems(depth=depth - 1))
        inner = dataclasses.replace(inner, tick=system.tick, elements=tuple(
            dataclasses.replace(e, rate=None) for e in inner.elements))  # fmt: skip
        system = system.add("inner", inner)
    return _grouped(draw, _wired(draw, system), depth)


def _wired(draw: st.DrawFn, system: System) -> System:
    """Connect some inputs to outputs of their size and unit; expose some that are left."""
    described = {n: system.describe(n) for n in system.components if n != "inner"}
    if "inner" in system.components:
        described["inner"] = system.nested("inner").interface()
    outputs = [(n, v) for n, d in described.items() for v in d.of("output")]
    exposed = 0
    for n, d in described.items():
        for v in d.of("input"):
            if v.size > 1 and outputs and draw(st.integers(0, 2)) == 0:
                system = _elements_wired(draw, system, f"{n}.{v.name}", v, outputs)
                continue
            fits = [(m, w) for m, w in outputs if w.shape == v.shape]
            if not fits or not draw(st.booleans()):
                if draw(st.integers(0, 3)) == 0:
                    system = system.expose(f"in_{exposed}", f"{n}.{v.name}")
                    exposed += 1
                continue
            m, w = draw(st.sampled_from(fits))
            plain = draw(st.booleans()) and w.unit == v.unit
            factor, offset = (1.0, 0.0) if plain else (draw(NUMBERS), draw(NUMBERS))
            system = system.connect(
                f"{m}.{w.name}", f"{n}.{v.name}", factor=factor, offset=offset, convert=plain
            )
    return system


def _elements_wired(
    draw: st.DrawFn, system: System, target: str, v: Variable, outputs: list[tuple[str, Variable]]
) -> System:
    """Connect elements of an input, each to some element of an output."""
    for i in draw(st.sets(st.integers(1, v.size))):
        m, w = draw(st.sampled_from(outputs))
        index = f"[{draw(st.integers(1, w.size))}]" if w.shape else ""
        system = system.connect(f"{m}.{w.name}{index}", f"{target}[{i}]", convert=False)
    return system


def _grouped(draw: st.DrawFn, system: System, depth: int) -> System:
    names = [n for n, e in system.components.items() if e.rate is None and n != "inner"]
    if len(names) > 1 and draw(st.booleans()):
        order = draw(st.permutations(names))
        return system.group(order[: draw(st.integers(1, len(order)))], "gauss-seidel")
    return system


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(system=systems())
def test_a_random_system_survives_its_file(
    system: System, version: Version, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / f"round_trip_{version}.ssd"
    write_ssd(system, path, version)
    again = read_ssd(path)
    assert again == system
    assert seen(flatten(again, seed=3)) == seen(flatten(system, seed=3))
    assert format_ssd(again, version, path.parent) == path.read_bytes()


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("solver", ["newton", "anderson", "fixed-point"])
def test_an_iterated_group_survives_its_file(tmp_path: Path, version: Version, solver: Any) -> None:
    system = System("s").add("a", "fake:filter").add("b", "fake:filter")
    system = system.connect("a.y", "b.u").connect("b.y", "a.u")
    system = system.group(["b", "a"], "iterated", solver=solver, tolerance=1e-3 / 3, limit=17)
    write_ssd(system, tmp_path / "x.ssd", version)
    assert read_ssd(tmp_path / "x.ssd") == system


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("name", available())
def test_a_shipped_system_survives_its_file_and_its_package(
    name: str, tmp_path: Path, version: Version
) -> None:
    system = load(name)
    write_ssd(system, tmp_path / "x.ssd", version)
    write_archive({"SystemStructure.ssd": (tmp_path / "x.ssd").read_bytes()}, tmp_path / "x.ssp")
    for again in (load(tmp_path / "x.ssd"), load(tmp_path / "x.ssp")):
        assert seen(flatten(again)) == seen(flatten(system))
