"""Branches from one snapshot, and resets that go through Initialization Mode in C."""

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import FmuError, InputInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare

CHAIN = ["a.y -> b.u", "b.y -> c.u", "c.y -> d.u"]


@pytest.fixture
def natives(wired: Any, native: Any) -> Any:
    start = {"a": {"u": 1.0}, "b": {"k": 2.0}}
    return wired(dict.fromkeys("abcd", native), CHAIN, start=start, step_ticks={"c": 3})


def ends(master: Master) -> list[float]:
    return [master.get(p, "y") for p in "abcd"]


def branch(master: Master, kept: Any, u: float) -> list[list[float]]:
    master.restore(kept)
    master.set("a", "u", u)
    seen = []
    for _ in range(7):
        master.step()
        seen.append(ends(master))
    return seen


def test_two_branches_of_a_snapshot_differ_only_by_what_was_done(natives: Any) -> None:
    with Master(*natives) as master:
        master.initialize()
        master.step(10)
        kept = master.snapshot()
        same = branch(master, kept, 1.0)
        other = branch(master, kept, -3.0)
        assert other[0][1:] == same[0][1:]  # only a has seen the input after one step
        assert other[-1] != same[-1]
        assert branch(master, kept, 1.0) == same
        assert branch(master, kept, -3.0) == other
    with Master(*natives) as undisturbed:
        undisturbed.initialize()
        undisturbed.step(17)
        assert ends(undisturbed) == same[-1]


def test_a_snapshot_of_a_native_system_continues_in_another_master(natives: Any) -> None:
    with Master(*natives) as first, Master(*natives) as second:
        first.initialize()
        second.initialize()
        first.step(10)
        second.restore(first.snapshot())
        first.step(5)
        second.step(5)
        assert ends(second) == ends(first)


def test_a_snapshot_does_not_change_with_the_run(natives: Any) -> None:
    with Master(*natives) as master:
        master.initialize()
        kept = master.snapshot()
        image = bytes(kept.image or b"")
        master.step(5)
        assert kept.image == image != master.snapshot().image
        with pytest.raises(AttributeError):
            kept.image = b""  # type: ignore[misc]


def test_a_snapshot_holds_faults_and_what_they_keep(natives: Any) -> None:
    with Master(*natives) as master:
        master.initialize()
        master.faults.add(Fault("a.y", "delay", 0.03))
        master.step(5)
        kept = master.snapshot()
        master.step(8)
        first = ends(master)
        master.faults.clear()
        master.step(2)
        master.restore(kept)
        assert [f.kind for f in master.faults.active.values()] == ["delay"]
        master.step(8)
        assert ends(master) == first


def test_a_snapshot_with_other_recorded_variables_is_refused(natives: Any, watcher: Any) -> None:
    with Master(*natives) as first, Master(*natives, observers=[watcher]) as second:
        first.initialize()
        second.initialize()
        with pytest.raises(InputInvalid, match="other variables were recorded or live"):
            second.restore(first.snapshot())


# ---- reset: C sets the inputs, as Python did at the first initialization ---------------------


def gain(name: str = "gain") -> Model:
    m = Model(name)
    u = m.input("u", unit="1", min=-4.0, max=4.0)
    g = m.parameter("g", 1.0, unit="1")
    x = m.state("x", g, unit="1")
    m.der(x, u - x)
    m.output("y", g * u + x, unit="1")
    return m


def fed(wired: Any, others: Any = (), **more: Any) -> Any:
    makers = {p: lambda path: Native(gain(), path) for p in "abc"} | dict(others)
    # Listed against the flow, and with a conversion: the order comes from the feedthrough.
    links = ["b.y -> c.u", "a.y -> b.u"]
    return wired(makers, links, conversions={links[1]: (0.5, 0.25)}, **more)


@pytest.mark.parametrize("beside", [False, True])
def test_a_reset_gives_the_bits_of_a_new_master(wired: Any, python: Any, beside: bool) -> None:
    """Beside a component in Python, values do not flow in C."""
    others = {"p": python} if beside else {}
    start = {"a": {"u": 0.3, "g": 1.7}, "b": {"g": -0.2}}
    with Master(*fed(wired, others, start=start)) as fresh:
        fresh.initialize()
        zero = [fresh.get(p, "y") for p in "abc"]
        fresh.step(5)
        wanted = [fresh.get(p, "y") for p in "abc"]
    with Master(*fed(wired, others)) as master:
        master.initialize()
        master.step(9)
        for _ in range(2):
            master.reset(start=start)
            assert [master.get(p, "y") for p in "abc"] == zero
            master.step(5)
            assert [master.get(p, "y") for p in "abc"] == wanted


def test_a_reset_refuses_what_initialize_refuses(wired: Any) -> None:
    start = {"a": {"g": 1.0, "u": 4.0}, "b": {"g": 9.0}}
    with Master(*fed(wired, start=start)) as master, pytest.raises(FmuError, match=r"c\.u: value"):
        master.initialize()
    with Master(*fed(wired)) as master:
        master.initialize()
        with pytest.raises(FmuError, match=r"c\.u: value"):
            master.reset(start=start)


@pytest.mark.parametrize("backend", ["native", "fmu"])
def test_a_shipped_system_is_reset_to_the_bits_of_a_new_seed(backend: Any) -> None:
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.running.library import load

    def run(plan: Any, seeds: list[int | None]) -> list[Any]:
        with Master(plan, prepare(plan, backend)) as master:
            master.initialize()
            for seed in seeds:
                master.step(20)
                master.reset(seed)
            master.step(30)
            names = [(c.path, v.name) for c in plan.components for v in c.description.of("output")]
            return [np.asarray(master.get(*n)).tolist() for n in names]

    survey = load("bluerov2_survey")
    assert run(flatten(survey, 5), []) == run(flatten(survey, 0), [3, 5])
