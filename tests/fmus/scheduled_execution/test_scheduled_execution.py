"""Scheduled Execution FMUs: model partitions at the ticks of their clocks, alone and in systems."""

from __future__ import annotations

import csv
from collections.abc import Callable
from itertools import accumulate
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.conftest import foreign_fmu
from uuvsim_cosim.errors import ComponentFailed, FmuError, SystemInvalid, UuvsimError
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.sandbox.sandbox import instantiate_sandboxed
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten

HERE = Path(__file__).parent
COUNTS = ("n_fast", "n_slow", "n_shrink", "n_late", "n_asked", "seen")
Tasks = Callable[..., Path]


@pytest.fixture(scope="session")
def tasks(tmp_path_factory: pytest.TempPathFactory) -> Tasks:
    """Build the tasks: with a fault, and with an edited description."""
    folder = tmp_path_factory.mktemp("tasks")

    def build(fault: int = 0, edit: tuple[str, str] | None = None) -> Path:
        edits = [edit] if edit else []
        return foreign_fmu("tasks", folder, edits=edits, fault=fault, source=HERE / "tasks_fmi3.c")

    return build


def begun(fmu: Path, *, isolate: bool = False) -> Component:
    x = instantiate_fmu(fmu, "tasks", isolate=isolate)
    x.enter_initialization_mode(0.0, None)
    x.exit_initialization_mode()
    return x


def read(x: Component, *names: str) -> list[object]:
    return [x.get(x.description.variables[n]) for n in names or (*COUNTS, "sum", "at")]


def step(x: Component, n: int, h: float, first: int = 0) -> None:
    for k in range(first, first + n):
        x.do_step(k * h, h)


def test_partitions_are_active_at_the_instants_of_their_clocks(
    tasks: Tasks, tmp_path: Path
) -> None:
    """Each call is in the trace, with the value reference of its clock and its time."""
    system = uuv.System("s", "0.2").add("tasks", str(tasks()))
    uuv.run(system, until=1, out=tmp_path / "run", trace_fmi=tmp_path / "calls.csv")
    rows = csv.DictReader((tmp_path / "calls.csv").read_text().splitlines())
    active = [r for r in rows if r["function"] == "fmi3ActivateModelPartition"]
    calls = [r["arguments"].split() for r in active if r["status"]]
    assert len(active) == len(calls) + 5, "those that call back"
    found = {r: [float(t) for ref, t in calls if ref == r] for r in "12345"}
    fast = [(2 * k + 1) / 20 for k in range(10)]
    assert found["1"] == fast
    assert found["2"] == [0.05, 0.35, 0.65, 0.95]
    assert found["3"] == pytest.approx(list(accumulate([0.1, 0.2, 0.3])), abs=1e-15)
    assert found["4"] == [0.37, 0.77]
    assert found["5"] == []
    times = [float(t) for _, t in calls]
    assert times == sorted(times)


@pytest.mark.parametrize(("n", "h"), [(40, 0.025), (4, 0.25), (3, 1 / 3), (1, 1.0)])
def test_the_step_does_not_change_what_the_partitions_do(n: int, h: float, tasks: Tasks) -> None:
    x = begun(tasks())
    x.set(x.description.variables["u"], 2.0)
    step(x, n, h)
    assert read(x) == [10, 4, 3, 2, 0, 10, 20.0, 0.95]
    x.free()


def test_the_smallest_priority_is_first_at_one_instant(tasks: Tasks) -> None:
    """Clocks fast and slow tick at 0.05 s; slow copies the number of fast ticks."""
    x = begun(tasks())
    step(x, 1, 0.1)
    assert read(x, "seen") == [1]
    x.free()
    late = begun(tasks(edit=('priority="0"', 'priority="9"')))
    step(late, 1, 0.1)
    assert read(late, "seen") == [0]
    late.free()


def test_a_tick_at_a_communication_point_belongs_to_the_step_that_starts_there(
    tasks: Tasks,
) -> None:
    x = begun(tasks())
    step(x, 1, 0.05)
    assert read(x, "n_fast", "fast") == [0, False]
    step(x, 1, 0.05, first=1)
    assert read(x, "n_fast", "fast", "shrink") == [1, True, False]
    step(x, 1, 0.05, first=2)
    assert read(x, "n_fast", "fast", "shrink") == [1, False, True]
    x.free()


def test_a_triggered_clock_ticks_at_the_start_of_each_step_in_which_it_is_true(
    tasks: Tasks,
) -> None:
    x = begun(tasks())
    x.set(x.description.variables["asked"], True)
    step(x, 2, 0.04)
    x.set(x.description.variables["asked"], False)
    step(x, 3, 0.04, first=2)
    assert read(x, "n_asked", "asked") == [2, False]
    x.free()


def test_an_output_clock_triggers_the_clock_of_another_fmu(tasks: Tasks, tmp_path: Path) -> None:
    """Clock done ticks with each third tick of fast, at 0.25 s, 0.55 s and 0.85 s."""
    system = (
        uuv.System("pair", "0.1")
        .add("a", str(tasks()))
        .add("b", str(tasks()))
        .connect("a.done", "b.asked")
        .connect("a.sum", "b.u")
        .set("a.u", 1.0)
    )
    run = uuv.run(system, until=1.2, out=tmp_path / "run")
    signals = run.signals()
    ticked = [round(float(t), 9) for t in signals.time[signals["a.done"].astype(bool)]]
    assert ticked == [0.3, 0.6, 0.9, 1.2]
    assert signals["b.n_asked"].tolist() == [0] * 4 + [1] * 3 + [2] * 3 + [3] * 3
    own = [uuv.run(system, until=1.2, out=tmp_path / n, isolate=i).signals()["b.sum"].tolist()
           for n, i in (("here", []), ("apart", ["a", "b"]))]  # fmt: skip
    assert own[0] == own[1]
    assert own[0][-1] > 0


def test_a_snapshot_contains_the_clocks(tasks: Tasks) -> None:
    plan = flatten(uuv.System("s", "0.1").add("x", str(tasks()), {"u": 3.0}))
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.run_until(0.4)
        kept, found = master.snapshot(), []
        for _ in range(2):
            master.run_until(1.0)
            found.append([master.get("x", n) for n in (*COUNTS, "sum", "at")])
            master.restore(kept)
        assert found[0] == found[1] == [10, 4, 3, 2, 0, 10, 30.0, 0.95]
        master.reset()
        master.run_until(1.0)
        assert [master.get("x", n) for n in (*COUNTS, "sum", "at")] == found[0]


def test_a_state_outlives_its_instance_as_bytes(tasks: Tasks) -> None:
    x, y = begun(tasks()), instantiate_fmu(tasks(), "other")
    x.set(x.description.variables["asked"], True)
    step(x, 4, 0.1)
    y.set_fmu_state(y.deserialize_fmu_state(x.serialize_fmu_state(x.get_fmu_state())))
    for one in (x, y):
        step(one, 6, 0.1, first=4)
    assert read(x) == read(y) == [10, 4, 3, 2, 10, 10, 0.0, 0.95]
    with pytest.raises(FmuError, match="no serialised state"):
        y.deserialize_fmu_state(b"abc")
    x.free(), y.free()


def test_a_tunable_interval_counts_from_the_step_that_follows_its_change(tasks: Tasks) -> None:
    """Clock slow ticks at 0.05 s and 0.35 s; then every 0.5 s from 0.4 s."""
    x = begun(tasks())
    step(x, 4, 0.1)
    x.set(x.description.variables["period"], 0.5)
    step(x, 16, 0.1, first=4)
    assert read(x, "n_slow") == [2 + 3]
    x.free()


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (1, "at t = 0 s: clock slow has an interval of 0 s; expected more than 0"),
        (2, "at t = 0.37 s: clock late ticks a second time at this instant"),
        (3, "at t = 0.05 s: the partition of clock fast ended with preemption locked 1 times"),
        (4, "at t = 0 s: clock slow has no interval"),
        (5, r"at t = 0.05 s: fmi3ActivateModelPartition returned error"),
        (6, "at t = 0.37.* s: more than 10000 ticks in a communication step of 1 s"),
    ],
)
def test_clocks_that_are_wrong_are_named(fault: int, expected: str, tasks: Tasks) -> None:
    with pytest.raises(ComponentFailed, match=f"'tasks' failed {expected}"):
        begun(tasks(fault)).do_step(0.0, 1.0)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (' priority="4"', "", "clock 'slow': no priority"),
        ('intervalCounter="2"', 'intervalCounter="0"', "variable 'fast': an interval of 0 s"),
        ('shiftCounter="1"', 'shiftCounter="-1"', "variable 'fast': shiftCounter '-1'"),
        ('"tunable" priority', '"constant" priority', "variable 'slow': a constant clock"),
        ('"changing"', '"sometimes"', "variable 'shrink': intervalVariability 'sometimes'"),
        ('priority="3"', 'priority="low"', "variable 'shrink': priority 'low'"),
    ],
)
def test_a_description_that_is_wrong_is_refused(
    old: str, new: str, expected: str, tasks: Tasks
) -> None:
    with pytest.raises(FmuError, match=expected):
        instantiate_fmu(tasks(edit=(old, new)), "tasks")


def test_kernels_and_web_assembly_refuse_it_by_name(tasks: Tasks) -> None:
    with pytest.raises(SystemInvalid, match=r"tasks: .*FMU"):
        fuse(uuv.System("s", "0.1").add("tasks", str(tasks())))
    with pytest.raises(UuvsimError, match="Scheduled Execution"):
        instantiate_sandboxed(read_fmu(tasks()), "tasks")
