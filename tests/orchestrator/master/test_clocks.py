"""Clocks of FMI 3.0: exact instants, ticks through FMUs, and clocked variables."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

import uuvsim_cosim as uuv
from tests.conftest import FOREIGN, Uuvsim, foreign_fmu
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, SystemInvalid
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.conformance_run import judge

Build = Callable[..., str]
SOURCE = FOREIGN / "clocks" / "clocks_fmi3.c"
CONSTANT = 'intervalVariability="constant" intervalDecimal="0.1"'


@pytest.fixture(scope="session")
def clockwork(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Build the FMU with clocks: k with other attributes, with edits, and with a fault."""
    folder = tmp_path_factory.mktemp("clocks")

    def build(k: str = CONSTANT, *, fault: int = 0, edits: Iterable[tuple[str, str]] = ()) -> str:
        edits = [(CONSTANT, k), *edits]
        return str(foreign_fmu("clocks", folder, edits=edits, fault=fault, source=SOURCE))

    return build


def interval(seconds: str, variability: str = "constant") -> str:
    return f'intervalVariability="{variability}" intervalDecimal="{seconds}"'


def played(system: uuv.System, until: float, *wanted: str) -> tuple[dict[str, Any], list[Any]]:
    """Run a system with events; return outputs at the end, and the events."""
    plan = flatten(system.with_events())
    live = [(n.split(".")[0], n.split(".")[1]) for n in wanted]
    with Master(plan, prepare(plan), live=live) as master:
        master.initialize()
        master.run_until(until)
        return {n: master.get(*n.split(".")) for n in wanted}, master.events


def instants(events: Iterable[Any], component: str, clock: str) -> list[tuple[int, float]]:
    return [
        (e.tick, e.offset)
        for e in events
        if (e.component, e.cause) == (component, f"clock {clock}")
    ]


# ---- time-based clocks ------------------------------------------------------------------------


@pytest.mark.parametrize(("tick", "period"), [("0.1", "0.1"), ("0.01", "0.1"), ("1", "0.1")])
def test_a_periodic_clock_ticks_at_whole_multiples_of_its_interval(
    tick: str, period: str, clockwork: Build
) -> None:
    """A tick at the run's end belongs to the step that would start there."""
    system = uuv.System("one", tick).add("a", clockwork(interval(period)))
    found, events = played(system, 2, "a.ticks", "a.at")
    assert found["a.ticks"] == 20
    every = instants(events, "a", "k")
    h = Fraction(tick)
    exact = [divmod(k * Fraction(period), h) for k in range(20)]
    assert every == [(int(n), float(rest)) for n, rest in exact]
    assert found["a.at"] == pytest.approx(1.9, abs=1e-12)


def test_a_period_that_no_tick_divides_has_exact_offsets_after_many_ticks(clockwork: Build) -> None:
    counter = 'intervalVariability="constant" supportsFraction="true" resolution="7"'
    k = f'{counter} intervalDecimal="0.142857" intervalCounter="1" shiftCounter="2"'
    found, events = played(uuv.System("one", "0.05").add("a", clockwork(k)), 50, "a.ticks")
    exact = [divmod(Fraction(n + 2, 7), Fraction(1, 20)) for n in range(348)]
    assert instants(events, "a", "k") == [(int(n), float(rest)) for n, rest in exact]
    assert found["a.ticks"] == 348


def test_a_shift_delays_the_first_tick(clockwork: Build) -> None:
    k = interval("0.1") + ' shiftDecimal="0.25"'
    _, events = played(uuv.System("one", "0.1").add("a", clockwork(k)), 0.6)
    assert instants(events, "a", "k") == [(2, 0.05), (3, 0.05), (4, 0.05), (5, 0.05)]


def test_intervals_of_a_countdown_clock_begin_at_its_ticks(clockwork: Build) -> None:
    """Intervals of 0.03, 0.06, 0.09 s: ticks at 0.03 n (n + 1) / 2."""
    system = uuv.System("one", "0.1").add("a", clockwork(), {"wait": 0.03})
    found, events = played(system, 1, "a.counted")
    times = [e.time for e in events if e.cause == "clock c"]
    assert times == pytest.approx([0.03 * n * (n + 1) / 2 for n in range(1, 8)], abs=1e-12)
    assert found["a.counted"] == 7


@pytest.mark.parametrize("variability", ["fixed", "tunable"])
def test_an_interval_of_the_fmu_is_asked_for_in_initialization(
    variability: str, clockwork: Build
) -> None:
    fmu = clockwork(f'intervalVariability="{variability}"')
    values = {"interval": 0.25, "shift": 0.125}
    _, events = played(uuv.System("one", "0.25").add("a", fmu, values), 1)
    assert instants(events, "a", "k") == [(0, 0.125), (1, 0.125), (2, 0.125), (3, 0.125)]


def test_the_interval_of_the_description_is_reported_to_the_fmu(clockwork: Build) -> None:
    system = uuv.System("one", "0.1").add("a", clockwork(interval("0.3", "fixed")))
    assert played(system, 1, "a.interval")[0]["a.interval"] == 0.3


def test_a_tunable_interval_counts_from_the_last_tick(clockwork: Build) -> None:
    """Ticks at 0, 0.25, 0.5; from 0.6 s on the interval is 0.125 s: 0.625, 0.75, 0.875."""
    fmu = clockwork('intervalVariability="tunable"')
    plan = flatten(uuv.System("one", "0.1").add("a", fmu, {"interval": 0.25}).with_events())
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.run_until("0.6")
        master.set("a", "interval", 0.125)
        master.run_until(1)
        times = [e.time for e in master.events if e.cause == "clock k"]
    assert times == pytest.approx([0, 0.25, 0.5, 0.625, 0.75, 0.875], abs=1e-12)


def test_a_changing_clock_is_asked_after_each_tick(clockwork: Build) -> None:
    fmu = clockwork('intervalVariability="changing"')
    _, events = played(uuv.System("one", "0.1").add("a", fmu, {"interval": 0.15}), 0.7)
    times = [e.time for e in events if e.cause == "clock k"]
    assert times == pytest.approx([0.15, 0.3, 0.45, 0.6], abs=1e-12)


# ---- ticks through FMUs -----------------------------------------------------------------------


def chain(clockwork: Build, n: int, order: Iterable[int], **values: Any) -> uuv.System:
    """Return a sender p0 and n - 1 echoes, each of which passes on its input plus one."""
    system = uuv.System("chain", "0.1")
    for i in order:
        own = {"every": 3, **values} if i == 0 else {"every": 0, "echo": True}
        system = system.add(f"p{i}", clockwork(), own)
    for i in range(n - 1):
        system = system.connect(f"p{i}.out", f"p{i + 1}.in").connect(f"p{i}.y", f"p{i + 1}.u")
    return system


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 2, 1, 0], [2, 0, 3, 1]])
def test_a_tick_goes_through_a_chain_in_one_instant(order: list[int], clockwork: Build) -> None:
    """p0 sends its time at every third tick: 0.2, 0.5 and 0.8 s; each echo adds one."""
    names = [f"p{i}.{n}" for i in range(1, 4) for n in ("got", "sum")]
    found, events = played(chain(clockwork, 4, order), 1, *names)
    for i in range(1, 4):
        assert found[f"p{i}.got"] == 3
        assert found[f"p{i}.sum"] == pytest.approx(1.5 + 3 * (i - 1), abs=1e-12)
        assert instants(events, f"p{i}", "in") == [(2, 0.0), (5, 0.0), (8, 0.0)]


def test_a_time_based_clock_activates_a_triggered_one_of_another_fmu(clockwork: Build) -> None:
    system = uuv.System("two", "0.25").add("a", clockwork(interval("0.1")))
    system = system.add("b", clockwork(), {"every": 0}).connect("a.k", "b.in")
    found, events = played(system, 1, "b.got")
    assert found["b.got"] == 10
    assert instants(events, "b", "in") == instants(events, "a", "k")


def test_clocked_inputs_sample_and_clocked_outputs_hold(clockwork: Build) -> None:
    """b.w takes a.x, the time, at ticks of b.k: the sum of 0, 0.25, 0.5 and 0.75."""
    system = uuv.System("two", "0.1").add("a", clockwork(), {"every": 0})
    system = system.add("b", clockwork(interval("0.25")), {"every": 0}).connect("a.x", "b.w")
    plan = flatten(system.with_events())
    assert "clocks: a.x -> b.w: the value is sampled at ticks of k" in plan.warnings
    assert played(system, 1, "b.w_sum")[0]["b.w_sum"] == pytest.approx(1.5, abs=1e-12)


def test_ticks_are_those_of_a_run_whose_states_are_restored(clockwork: Build) -> None:
    """A snapshot between ticks keeps what each clock waits for."""
    system = chain(clockwork, 2, [0, 1], wait=0.03)
    plan = flatten(system.with_events())
    with Master(plan, prepare(plan), live=[("p1", "sum")]) as master:
        master.initialize()
        master.run_until("0.4")
        kept, found = master.snapshot(), []
        for _ in range(2):
            begin = len(master.events)
            master.run_until(1)
            found.append((master.get("p1", "sum"), master.events[begin:]))
            master.restore(kept)
        assert found[0] == found[1]
        master.reset()
        master.events.clear()
        master.run_until(1)
        assert master.events[-len(found[0][1]) :] == found[0][1]


def test_the_run_folder_lists_ticks_and_reads_connections_of_clocks(
    clockwork: Build, tmp_path: Path
) -> None:
    run = uuv.run(chain(clockwork, 2, [0, 1]).with_events(), until=1, out=tmp_path / "run")
    assert "p1,8,0.0,0.8,clock in" in (run.folder / "events.csv").read_text().splitlines()
    again = uuv.run(run.folder / "system.ssd", until=1, out=tmp_path / "again")
    assert again.events == run.events
    assert "p0.k" not in run.signals()


def test_a_step_that_is_repeated_for_an_event_keeps_the_ticks(
    clockwork: Build, source_fmu: Any, tmp_path: Path
) -> None:
    """A ball lands at 0.4515 s in the middle of a step; a clock ticks 0.07 s before and after."""
    ball = str(foreign_fmu("bounce", tmp_path))
    k = interval("0.07")
    system = uuv.System("two", "1").add("ball", ball).add("a", clockwork(k), {"every": 0})
    found, events = played(system.connect("ball.h", "a.w"), 1, "a.w_sum", "a.ticks")
    times = [e.time for e in events if e.cause == "clock k"]
    assert times == pytest.approx([0.07 * n for n in range(15)], abs=1e-15)
    landed = (2.0 / 9.81) ** 0.5
    assert next(e.time for e in events if e.component == "ball") == pytest.approx(landed)

    def height(t: float) -> float:
        s = t - landed
        return 1 - 9.81 * t * t / 2 if s < 0 else 0.8 * 9.81 * landed * s - 9.81 * s * s / 2

    assert found["a.ticks"] == 15
    assert found["a.w_sum"] == pytest.approx(sum(map(height, times)), abs=1e-12)


# ---- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "values", "expected"),
    [
        (1, {}, r"event iteration of a at t = 0.1 s does not end: .* clock out ticks each time"),
        (2, {"wait": 0.05}, r"interval of clock c is -0.15 s at t = 0.15 s; expected 0 s or more"),
        (3, {}, r"event iteration of a at t = 0 s does not end: .* clock c ticks each time"),
    ],
)
def test_clocks_that_do_not_end_or_go_back_are_named(
    fault: int, values: dict[str, Any], expected: str, clockwork: Build
) -> None:
    system = uuv.System("one", "0.1").add("a", clockwork(fault=fault), {"every": 0, **values})
    with pytest.raises(ComponentFailed, match=expected):
        played(system, 1)


def test_a_tunable_interval_of_zero_is_refused(clockwork: Build) -> None:
    fmu = clockwork('intervalVariability="tunable"')
    system = uuv.System("one", "0.1").add("a", fmu, {"interval": 0.0})
    with pytest.raises(FmuError, match=r"a\.k: at t = 0 s, its interval is 0 s.*more than 0 s"):
        played(system, 1)
    plan = flatten(system.set("a.interval", 0.1).with_events())
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.run_until("0.4")
        master.set("a", "interval", 0.0)
        with pytest.raises(ComponentFailed, match=r"interval of clock k is 0 s at t = 0\.4 s"):
            master.run_until(1)


@pytest.mark.parametrize(
    ("k", "expected"),
    [
        (interval("0"), "variable 'k': an interval of 0 s; expected more than 0 s"),
        (interval("-0.1", "fixed"), "variable 'k': an interval of -0.1 s"),
        ('intervalVariability="constant"', "variable 'k': a constant clock without an interval"),
        ('intervalVariability="often"', "variable 'k': intervalVariability 'often'"),
        (interval("0.1") + ' shiftDecimal="-1"', "variable 'k': a shift of -1 s"),
    ],
)
def test_a_description_with_a_wrong_clock_is_refused(
    k: str, expected: str, clockwork: Build
) -> None:
    with pytest.raises(SystemInvalid, match=expected):
        uuv.System("one", "0.1").add("a", clockwork(k))


def test_connections_that_clocks_do_not_fit_are_refused(clockwork: Build) -> None:
    two = uuv.System("two", "0.1").add("a", clockwork()).add("b", clockwork())
    for source, target, expected in (
        ("a.out", "b.k", "to the constant input clock b.k, which does not tick with another"),
        ("a.in", "b.in", "from the triggered input clock a.in"),
        ("a.k", "b.out", "to the triggered output clock b.out"),
        ("a.out", "b.w", "type Clock to type Float64"),
    ):
        with pytest.raises(SystemInvalid, match=expected):
            two.connect(source, target)
    old = 'name="w" valueReference="17" causality="input" variability="discrete" clocks="1"'
    free = clockwork(edits=[(old, old.replace(' clocks="1"', ""))])
    held = uuv.System("two", "0.1").add("a", clockwork()).add("b", free).connect("a.y", "b.w")
    with pytest.raises(SystemInvalid, match=r"a\.y -> b\.w: joins a variable of the triggered"):
        flatten(held.with_events())
    slow = uuv.System("two", "0.1").add("a", clockwork()).add("b", clockwork(), None, "0.2")
    apart = slow.connect("a.out", "b.in").with_events()
    with pytest.raises(SystemInvalid, match="do not have their events together"):
        flatten(apart)


def test_clocks_without_events_are_refused_by_name(
    clockwork: Build, tmp_path: Path, uuvsim: Uuvsim
) -> None:
    system = uuv.System("one", "0.1").add("a", clockwork())
    expected = r"clocks: a: it has clocks \(k, in, out, c\), which tick in Event Mode only"
    with pytest.raises(SystemInvalid, match=expected):
        flatten(system)
    system.write(tmp_path / "one.ssd")
    status, _, error = uuvsim("run", str(tmp_path / "one.ssd"), "--until", "1")
    assert status == 2
    assert "--events" in error
    assert "Traceback" not in error
    with pytest.raises(SystemInvalid, match="a: an FMU that uses Event Mode"):
        fuse(system.with_events())
    with pytest.raises(InputInvalid, match="events: a: uses Event Mode together with --isolate"):
        uuv.run(system.with_events(), until=1.0, isolate=["a"], out=tmp_path / "run")


def test_an_fmu_with_clocks_runs_in_the_conformance_table(clockwork: Build) -> None:
    """Its clock k ticks 100 times in 10 s, and so does the output that follows it."""
    found = judge(Path(clockwork()), "CoSimulation", 10.0)
    assert found == ("runs", "with events, to 10 s; its clocks tick 200 times, without a reference")
