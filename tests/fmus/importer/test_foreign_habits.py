"""FMUs of others that do what FMI 2.0 does not ask: they must run all the same."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import pytest

from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.system import System

HABITS = ("-DHABITS_OF_20SIM", "-DHABITS_OF_FMI4CPP")


def final(system: System) -> float:
    with Master(flatten(system), lambda p: resolve(p.source).instantiate(p.path)) as master:
        master.initialize()
        master.step(20)
        return float(master.get("a", "y"))


@pytest.mark.parametrize("habit", HABITS)
def test_the_master_runs_an_fmu_with_this_habit(c_fmu: Callable[..., Path], habit: str) -> None:
    found = []
    for fmu in (c_fmu(2), c_fmu(2, flags=[habit])):
        system = System("s", Fraction(1, 100)).add("a", str(fmu), start={"k": 3.0, "u": 1.0})
        found.append(final(system))
    assert found[0] == found[1] > 0.1


@pytest.mark.parametrize("habit", HABITS)
def test_an_fmu_with_this_habit_runs_alone(c_fmu: Callable[..., Path], habit: str) -> None:
    fmu = instantiate_fmu(c_fmu(2, flags=[habit]), "a")
    v = fmu.description.variables
    fmu.set(v["k"], 3.0)
    fmu.enter_initialization_mode(0.0, None)
    assert fmu.get(v["k"]) == 3.0
    fmu.exit_initialization_mode()
    fmu.set(v["u"], 1.0)
    fmu.do_step(0.0, 0.1)
    assert fmu.get(v["y"]) > 0.0
    fmu.free()


def test_an_iterated_group_runs_an_fmu_that_loses_parameters(c_fmu: Callable[..., Path]) -> None:
    found = []
    for fmu in (c_fmu(2), c_fmu(2, flags=[HABITS[0]])):
        system = System("s", Fraction(1, 100)).add("a", str(fmu), start={"k": 3.0})
        system = system.add("b", str(fmu)).set("b.y", 1.0)
        system = system.connect("a.y", "b.u").connect("b.y", "a.u").group(["a", "b"], "iterated")
        found.append(final(system))
    assert found[0] == found[1] > 0.1
