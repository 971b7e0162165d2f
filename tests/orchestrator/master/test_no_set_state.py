"""What FMUs are told of states that are kept: `noSetFMUStatePriorToCurrentPoint` of each step."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.model_exchange.calls import Calls2, Calls3
from uuvsim_cosim.fmus.tracing.trace import Trace, instantiate_traced
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Group

Makes = Callable[[str], Any]
WAYS = ("in lockstep", "Gauss-Seidel", "isolated", "traced")


@pytest.fixture(params=[2, 3])
def telling(request: pytest.FixtureRequest, c_fmu: Callable[..., Path]) -> Path:
    """An FMU whose y is the argument of its last step."""
    return c_fmu(request.param, flags=["-DSHOWS_NO_RETURN"])


@pytest.fixture(params=WAYS)
def master(request: pytest.FixtureRequest, telling: Path, wired: Any, tmp_path: Path) -> Any:
    way = request.param
    groups = [Group("gauss-seidel", (0,))] if way == "Gauss-Seidel" else []
    with Trace(tmp_path / "calls.csv") as trace:

        def make(path: str) -> Any:
            if way == "traced":
                return instantiate_traced(read_fmu(telling), path, trace)
            return instantiate_fmu(telling, path, isolate=way == "isolated")

        with Master(*wired({"a": make}, groups=groups)) as made:
            made.initialize()
            yield made


def test_steps_may_be_undone_from_the_first_snapshot_on(master: Any) -> None:
    master.step(2)
    assert master.get("a", "y") == 1.0
    snapshot = master.snapshot()
    master.step()
    assert master.get("a", "y") == 0.0
    master.restore(snapshot)
    master.step()
    assert master.get("a", "y") == 0.0


def test_a_reset_begins_another_run_and_needs_no_earlier_state(master: Any) -> None:
    master.step(2)
    master.reset()
    master.step()
    assert master.get("a", "y") == 1.0


def test_a_state_read_from_a_file_may_be_restored_again(master: Any, tmp_path: Path) -> None:
    master.step()
    master.save_snapshot(tmp_path / "kept.snapshot")
    master.load_snapshot(tmp_path / "kept.snapshot")
    master.step()
    assert master.get("a", "y") == 0.0


@pytest.mark.parametrize("isolate", [False, True])
def test_an_iterated_group_keeps_states(telling: Path, wired: Any, isolate: bool) -> None:
    make: Makes = lambda path: instantiate_fmu(telling, path, isolate=isolate)  # noqa: E731
    groups = [Group("iterated", (0, 1))]
    with Master(*wired({"a": make, "b": make}, ["a.y -> b.u"], groups=groups)) as made:
        made.initialize()
        made.step()
        assert (made.get("a", "y"), made.get("b", "y")) == (0.0, 0.0)


class Recording:
    """An FMU whose calls are recorded."""

    def __init__(self, never_goes_back: bool) -> None:
        self.never_goes_back = never_goes_back
        self.archive = self
        self.n_states = self.n_event_indicators = 0
        self.calls: list[tuple[Any, ...]] = []

    def call(self, name: str, *arguments: Any) -> None:
        self.calls.append((name, arguments[0]))


@pytest.mark.parametrize("calls", [Calls2, Calls3])
@pytest.mark.parametrize("never", [True, False])
def test_a_model_exchange_fmu_is_told_the_same(calls: Any, never: bool) -> None:
    fmu = Recording(never)
    calls(fmu).completed_integrator_step()
    assert ("CompletedIntegratorStep", never) in fmu.calls
