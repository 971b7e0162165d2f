"""Components of this package are read and written in place: with the bits of calls by FMI."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.system.system import System


def by_fmi(plan: Plan) -> Callable[[PlannedComponent], Component]:
    """Prepare FMUs that the loop calls by FMI's functions alone, as those of others."""
    make = prepare(plan)

    def instantiate(planned: PlannedComponent) -> Component:
        component = make(planned)
        whole = component.binding()
        kept = {k: f for k, f in whole.functions.items() if k not in ("FindValues", "DoSteps")}
        component.binding = lambda: replace(whole, functions=kept)  # type: ignore[method-assign]
        return component

    return instantiate


@pytest.fixture(scope="module")
def plan() -> Plan:
    return flatten(load("bluerov2_hold"), seed=3)


def history(plan: Plan, make: Callable[[PlannedComponent], Component]) -> list[np.ndarray]:
    """Return all outputs after steps with faults, changed parameters, a snapshot and a reset."""
    found = []
    with Master(plan, make, live=[("hull", "eta")]) as master:
        master.initialize()

        def look() -> None:
            for path, c in ((c.path, c) for c in master.components):
                found.extend(np.ravel(master.get(path, v.name)) for v in c.description.of("output"))

        master.step(7)
        look()
        number = master.faults.add(Fault("thruster_3.thrust", "scale", 0.5))
        master.step(5)
        look()
        kept = master.snapshot()
        master.faults.clear(number)
        master.set("controller", "Kp", [60, 60, 80, 14, 14, 6])
        master.step(5)
        look()
        master.restore(kept)
        master.step(1)
        look()
        master.reset(seed=4)
        master.step(9)
        look()
        found.append(np.array([[r.residual, r.time] for r in master.residuals]))
    return found


def test_the_bits_are_those_of_calls_by_fmi(plan: Plan) -> None:
    in_place, called = history(plan, prepare(plan)), history(plan, by_fmi(plan))
    native = history(plan, prepare(plan, "native"))
    for a, b, c in zip(in_place, called, native, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)


def test_the_bits_are_those_of_a_kernel(plan: Plan) -> None:
    with (
        Master(plan, prepare(plan)) as master,
        fuse(load("bluerov2_hold"), lanes=1, baseline=True).batch(1, seeds=3) as batch,
    ):
        master.initialize()
        master.step(50)
        batch.step(50)
        for name in ("eta", "nu"):
            np.testing.assert_array_equal(master.get("hull", name), batch.get(f"hull.{name}")[0])


@pytest.mark.parametrize("fault", [("bias", 2.0), ("override", float("1e308"))])
def test_an_input_outside_its_bounds_is_refused_by_the_component(
    plan: Plan, fault: tuple[str, float]
) -> None:
    messages = []
    for make in (prepare(plan), by_fmi(plan)):
        with Master(plan, make) as master:
            master.initialize()
            master.step(3)
            master.faults.add(Fault("allocation.u[4]", *fault))
            with pytest.raises(ComponentFailed, match=r"\"u\" = .*; expected a value in") as failed:
                master.step(3)
            messages.append((str(failed.value), master.tick))
    assert messages[0] == messages[1]
    assert "thruster_4" in messages[0][0]


def test_a_slower_component_leaves_the_others_in_place() -> None:
    system = System("bench", "0.01").add("slow", "model:thruster_t200")
    system = system.replace("slow", "model:thruster_t200", rate="0.02")
    for k in range(3):
        system = system.add(f"fast_{k}", "model:thruster_t200", {"u": 0.2 * k})
    plan = flatten(system)
    thrusts = []
    for make in (prepare(plan), by_fmi(plan)):
        with Master(plan, make) as master:
            master.initialize()
            master.step(5)
            thrusts.append([master.get(c.path, "thrust") for c in master.components])
    assert thrusts[0] == thrusts[1]
