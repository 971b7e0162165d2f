"""Events across FMUs of FMI 3.0: Event Mode, early return, and one instant for all."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import foreign_fmu
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, SystemInvalid
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load

G = 9.81
A = {"h": 1.0, "e": 0.8}
B = {"h": 3.0, "e": 0.8, "kick": 1.0}
Bounce = Callable[..., Path]


@pytest.fixture(scope="session")
def bounce(tmp_path_factory: pytest.TempPathFactory) -> Bounce:
    """Build the bouncing ball: with a fault, and with an edited description."""
    folder = tmp_path_factory.mktemp("bounce")

    def build(fault: int = 0, edit: tuple[str, str] | None = None) -> Path:
        edits = [edit] if edit else []
        return foreign_fmu("bounce", folder, edits=edits, fault=fault)

    return build


def two(a: Path, b: Path, tick: str = "0.1", rate: str | None = None) -> uuv.System:
    """Two balls: the speed of b gets a kick whenever a bounces."""
    return (
        uuv.System("balls", tick=tick)
        .add("a", str(a), A)
        .add("b", str(b), B, rate)
        .connect("a.hits", "b.hit")
    )


class Ball:
    """The exact flight of a ball between its events."""

    def __init__(self, *, h: float, e: float, kick: float = 0.0) -> None:
        self.h, self.v, self.e, self.kick = h, 0.0, e, kick
        self.bounces: list[float] = []

    def lands_in(self) -> float:
        return (self.v + sqrt(self.v**2 + 2 * G * self.h)) / G

    def fly(self, s: float) -> None:
        self.h, self.v = self.h + self.v * s - G * s * s / 2, self.v - G * s


def exact(until: float, a: Ball, b: Ball, *, mutual: bool = False) -> None:
    """Let two balls fly: b reacts to the bounces of a, and if `mutual`, a to those of b."""
    t = 0.0
    while True:
        first = a if a.lands_in() <= b.lands_in() else b
        s = min(first.lands_in(), until - t)
        a.fly(s), b.fly(s)
        t += s
        if t >= until:
            return
        first.h, first.v = 0.0, -first.e * first.v
        first.bounces.append(t)
        if first is a:
            b.v += b.kick
        elif mutual:
            a.v += a.kick


def ends(system: uuv.System, until: float) -> tuple[Any, list[Any]]:
    """Return height and speed of both balls at the end, and the events."""
    plan = flatten(system)
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.run_until(until)
        return [master.get(c, n) for c in "ab" for n in "hv"], master.events


def test_a_ball_reacts_to_the_bounce_of_another_at_its_instant(bounce: Bounce) -> None:
    a, b = Ball(**A), Ball(**B)
    exact(2.0, a, b)
    system = two(bounce(), bounce())
    late, none = ends(system, 2.0)
    assert abs(late[2] - b.h) > 1e-2
    assert none == []
    here, events = ends(system.with_events(), 2.0)
    assert here == pytest.approx([a.h, a.v, b.h, b.v], abs=1e-12)
    for name, ball in (("a", a), ("b", b)):
        times = [e.time for e in events if e.component == name]
        assert times == pytest.approx(ball.bounces, abs=1e-12)
    assert all(0.0 <= e.offset < 0.1 and e.cause == "reported" for e in events)


@pytest.mark.parametrize("tick", ["0.1", "0.7", "1/1000"])
def test_two_balls_that_react_to_each_other_follow_the_closed_form(
    tick: str, bounce: Bounce
) -> None:
    a, b = Ball(**A, kick=0.5), Ball(**B)
    exact(2.1, a, b, mutual=True)
    system = two(bounce(), bounce(), tick).set("a.kick", 0.5).connect("b.hits", "a.hit")
    state, events = ends(system.with_events(), 2.1)
    assert state == pytest.approx([a.h, a.v, b.h, b.v], abs=1e-11)
    assert len(events) == len(a.bounces) + len(b.bounces)
    late, _ = ends(system, 2.1)
    assert late != pytest.approx(state, abs=1e-5)


def test_an_fmu_that_cannot_restore_its_state_may_be_the_one_that_returns_early(
    bounce: Bounce,
) -> None:
    """Only b goes further than the instant at which a returns, until b lands itself."""
    fixed = bounce(edit=('canGetAndSetFMUState="true"', 'canGetAndSetFMUState="false"'))
    a, b = Ball(**A), Ball(h=50.0, e=0.8, kick=1.0)
    exact(2.0, a, b)
    system = two(fixed, bounce()).set("b.h", 50.0).with_events()
    assert ends(system, 2.0)[0] == pytest.approx([a.h, a.v, b.h, b.v], abs=1e-11)
    expected = "'a' failed at t = 0.4 s: it returned early at t = 0.4515.* b, which has events"
    with pytest.raises(ComponentFailed, match=expected):
        ends(two(bounce(), fixed).with_events(), 2.0)


def test_others_see_values_at_communication_points_only(bounce: Bounce, tmp_path: Path) -> None:
    """The count of a Python component is that of the communication point before."""
    module = tmp_path / "seen.py"
    module.write_text(
        "class Seen:\n"
        "    inputs = {'hits': '1'}\n    outputs = {'y': '1'}\n    times = []\n"
        "    def step(self, t, dt, u):\n"
        "        self.times.append(t)\n        return {'y': u['hits']}\n"
    )
    system = two(bounce(), bounce()).add("seen", f"{module}:Seen").connect("a.hits", "seen.hits")
    run = uuv.run(system.with_events(), until=2.0, out=tmp_path / "run")
    signals = run.signals()
    hits = signals["a.hits"]
    assert hits[-1] == len([e for e in run.events or () if e.component == "a"]) > 1
    assert np.array_equal(signals["seen.y"][1:], hits[:-1])


def test_the_run_folder_has_the_events(bounce: Bounce, tmp_path: Path) -> None:
    run = uuv.run(two(bounce(), bounce()).with_events(), until=2.0, out=tmp_path / "run")
    rows = list(csv.DictReader((run.folder / "events.csv").read_text().splitlines()))
    assert [(r["component"], int(r["tick"]), float(r["offset"])) for r in rows] == [
        (e.component, e.tick, e.offset) for e in run.events or ()
    ]
    about = json.loads((run.folder / "run.json").read_text())
    assert about["events"] == {c: sum(r["component"] == c for r in rows) for c in ("a", "b")}
    assert load(run.folder / "system.ssd").events
    plain = uuv.run(two(bounce(), bounce()), until=0.1, out=tmp_path / "plain")
    assert plain.events is None
    assert not (plain.folder / "events.csv").exists()


def test_a_snapshot_repeats_events_to_the_bit(bounce: Bounce) -> None:
    system = two(bounce(), bounce()).set("a.kick", 0.5).connect("b.hits", "a.hit")
    plan = flatten(system.with_events())
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.run_until(0.5)
        kept, found = master.snapshot(), []
        for _ in range(2):
            begin = len(master.events)
            master.run_until(2.0)
            found.append((master.get("b", "h"), master.get("a", "v"), master.events[begin:]))
            master.restore(kept)
        assert found[0] == found[1]
        master.reset()
        master.events.clear()
        master.run_until(2.0)
        assert master.get("b", "h") == found[0][0]


def test_an_unconnected_discrete_input_is_set_in_event_mode(bounce: Bounce) -> None:
    plan = flatten(two(bounce(), bounce()).with_events())
    with Master(plan, prepare(plan), held=[("a", "hit")]) as master:
        master.initialize()
        master.set("a", "hit", 1)
        master.run_until(0.3)
        assert master.get("a", "v") == pytest.approx(-G * 0.3)  # its kick is 0 m/s


def test_a_system_without_event_mode_has_the_same_bits_and_a_warning() -> None:
    states, hold = [], uuv.load("bluerov2_hold")
    for system in (hold, hold.with_events()):
        plan = flatten(system)
        with Master(plan, prepare(plan, "native")) as master:
            master.initialize()
            master.run_until(2.0)
            states.append(master.get("hull", "eta").tobytes())
    assert states[0] == states[1]
    assert any("events: no component" in w for w in plan.warnings)


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (1, "event iteration of a, b at t = 0.4515.* needs another round"),
        (2, "fmi3DoStep returned early without progress, at t = 0.451"),
        (3, r"event iteration of a, b at t = 0.4515.* input b.hit changes each time"),
    ],
)
def test_events_that_do_not_end_are_named(fault: int, expected: str, bounce: Bounce) -> None:
    with pytest.raises(ComponentFailed, match=expected):
        ends(two(bounce(fault), bounce()).with_events(), 2.0)


def test_combinations_that_have_no_events_are_refused(bounce: Bounce, tmp_path: Path) -> None:
    system = two(bounce(), bounce()).with_events()
    with pytest.raises(InputInvalid, match="events: a: uses Event Mode together with --isolate"):
        uuv.run(system, until=1.0, isolate=["a"], out=tmp_path / "run")
    with pytest.raises(InputInvalid, match="events: a: uses Event Mode together with --trace-fmi"):
        uuv.run(system, until=1.0, trace_fmi=tmp_path / "calls.csv", out=tmp_path / "run")
    with pytest.raises(SystemInvalid, match="events: together with a variable communication step"):
        flatten(system.with_variable_step("smallest=0.1 largest=0.2"))
    with pytest.raises(SystemInvalid, match="events: a: it has Event Mode, and steps in a Gauss"):
        flatten(system.group(["a", "b"], "gauss-seidel"))
    with pytest.raises(SystemInvalid, match="a: an FMU that uses Event Mode"):
        fuse(system)
    plan = flatten(system)
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        with pytest.raises(InputInvalid, match="exchanged at the instant of an event"):
            master.faults.add(Fault("a.hits", "freeze"))


def test_an_fmu_with_a_fixed_step_is_stepped_without_event_mode(bounce: Bounce) -> None:
    name = "canHandleVariableCommunicationStepSize"
    fixed = bounce(edit=(f'{name}="true"', f'{name}="false"'))
    plan = flatten(two(fixed, bounce()).with_events())
    assert plan.events == ((1,),)
    assert any("a has Event Mode, but cannot handle" in w for w in plan.warnings)
    slower = flatten(two(bounce(), bounce(), rate="0.2").with_events())
    assert slower.events == ((0,), (1,))
    assert any("a.hits -> b.hit joins components with unequal" in w for w in slower.warnings)


def test_a_discrete_input_that_changes_at_a_communication_point_is_an_event(bounce: Bounce) -> None:
    """With a longer step than a, b sees the bounce at 0.45 s at its next point, 0.6 s."""
    system = two(bounce(), bounce(), rate="0.2").set("b.h", 50.0).with_events()
    state, events = ends(system, 0.8)
    assert state[3] == pytest.approx(1.0 - 0.8 * G, abs=1e-12)
    assert [(e.time, e.cause) for e in events if e.component == "b"] == [(0.6, "input")]
