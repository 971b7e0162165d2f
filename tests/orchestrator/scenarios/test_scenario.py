"""Scenarios: events at their times, from our files and from libcosim's."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.scenarios.played import Played
from uuvsim_cosim.orchestrator.scenarios.scenario import (
    Change,
    Manipulation,
    Scenario,
    SignalFault,
    changes_text,
    read_scenario,
)
from uuvsim_cosim.orchestrator.system.system import System

PART = '''
class Ramp:
    """Counts seconds."""
    inputs = {"u": "m"}
    outputs = {"y": "s", "v": "m"}
    def step(self, t, dt, u):
        return {"y": t + dt, "v": u["u"]}
'''


@pytest.fixture
def system(tmp_path: Path) -> System:
    (tmp_path / "part.py").write_text(PART)
    return System("ramp", "0.1", base=tmp_path).add("a", "part.py:Ramp")


def test_a_fault_is_seen_at_the_communication_points_from_at_to_until(
    system: System, tmp_path: Path
) -> None:
    scenario = Scenario("s", (SignalFault(0.5, Fault("a.y", "override", -1.0), 0.8),))
    run(system, until=1.0, out=tmp_path / "r", scenario=scenario)
    signals = read_signals(tmp_path / "r")
    expected = [0, 0.1, 0.2, 0.3, 0.4, -1, -1, -1, 0.8, 0.9, 1.0]
    assert signals["a.y"] == pytest.approx(np.array(expected), abs=1e-12)


def test_a_change_holds_from_its_time_on(system: System, tmp_path: Path) -> None:
    scenario = Scenario("s", (Change(0.4, "a.u", "20 cm"), Change(0.7, "a.u", 3)))
    run(system, until=1.0, out=tmp_path / "r", scenario=scenario)
    v = read_signals(tmp_path / "r")["a.v"]
    assert v == pytest.approx(np.array([0.0] * 5 + [0.2] * 3 + [3.0] * 3))


def test_a_change_of_elements_leaves_the_others(tmp_path: Path) -> None:
    part = (
        'class Pair:\n    inputs = {"u": (3, "m")}\n    outputs = {"y": (3, "m")}\n'
        '    def step(self, t, dt, u):\n        return {"y": u["u"]}\n'
    )
    (tmp_path / "part.py").write_text(part)
    system = System("pair", "0.1", base=tmp_path).add("a", "part.py:Pair", {"u": [1, 2, 3]})
    changes = (Change(0.1, "a.u[2]", 0.5), Change(0.2, "a.u[1:2]", [8, 9]))
    run(system, until=0.4, out=tmp_path / "r", scenario=Scenario("s", changes))
    assert np.array_equal(
        read_signals(tmp_path / "r")["a.y"][2:], [[1, 0.5, 3], [8, 9, 3], [8, 9, 3]]
    )
    for name, value in (("a.u[4]", 1), ("a.u[1:2]", [1, 2, 3]), ("a.u[1]", "1 m")):
        with pytest.raises(InputInvalid, match=r"a\.u\["):
            run(
                system,
                until=0.1,
                out=tmp_path / "s",
                scenario=Scenario("s", (Change(0.0, name, value),)),
            )


def test_the_shipped_scenario_is_read_and_fits_its_system(tmp_path: Path) -> None:
    import uuvsim_cosim as uuv

    path = content("orchestrator", "scenarios", "dvl_dropout.yaml")
    scenario = read_scenario(path)
    assert len(scenario.events) == 4
    done = run(uuv.load("bluerov2_survey"), until=0.1, out=tmp_path / "r", scenario=path,
               backend="native")  # fmt: skip
    assert done.steps == 10


def test_changes_as_text_are_read_alike_with_and_without_the_yaml_library(tmp_path: Path) -> None:
    changes = (
        Change(0.0, "a.u", 1e-300), Change(0.25, "a.b", True), Change(1.0, "a.s", "0.3 m/s"),
        Change(1.0, "a.v", [[1.5, -2.0], [0.1 + 0.2, 3]]),
    )  # fmt: skip
    alone, mixed = tmp_path / "alone.yaml", tmp_path / "mixed.yaml"
    alone.write_text(changes_text(changes[:1], begins=True) + changes_text(changes[1:]))
    mixed.write_text(f"{alone.read_text()}- {{at: 2, signal: a.y, fault: freeze}}\n")
    assert read_scenario(alone).events == changes
    assert read_scenario(mixed).events == (*changes, SignalFault(2.0, Fault("a.y", "freeze", 0.0)))


def libcosim(tmp_path: Path, *events: dict[str, Any], **others: Any) -> Path:
    file = tmp_path / "s.json"
    file.write_text(json.dumps({"events": list(events), **others}))
    return file


def test_libcosims_json_is_read(tmp_path: Path) -> None:
    file = libcosim(
        tmp_path,
        {"time": 1.0, "variable": "y", "action": "override", "value": 2.0},
        {"time": 3.0, "variable": "y", "action": "bias", "value": 0.5},
        {"time": 4.0, "variable": "y", "action": "reset"},
        {"time": 5.0, "model": "b", "variable": "z", "action": "bias", "value": 1.0},
        defaults={"model": "a"},
        end=9.0,
    )
    assert read_scenario(file).end == 9.0
    assert read_scenario(file).events == (
        Manipulation(1.0, "a.y", "override", 2.0, 3.0),
        Manipulation(3.0, "a.y", "bias", 0.5, 4.0),
        Manipulation(5.0, "b.z", "bias", 1.0, math.inf),
    )


def test_libcosims_override_of_an_output_is_its_fault(system: System, tmp_path: Path) -> None:
    file = libcosim(
        tmp_path,
        {"time": 0.5, "model": "a", "variable": "y", "action": "override", "value": -1},
        {"time": 0.8, "model": "a", "variable": "y", "action": "reset"},
    )
    run(system, until=1.0, out=tmp_path / "r", scenario=file)
    expected = [0, 0.1, 0.2, 0.3, 0.4, -1, -1, -1, 0.8, 0.9, 1.0]
    assert read_signals(tmp_path / "r")["a.y"] == pytest.approx(np.array(expected), abs=1e-12)


def test_libcosims_override_of_an_unconnected_input_lasts_until_its_reset(
    system: System, tmp_path: Path
) -> None:
    file = libcosim(
        tmp_path,
        {"time": 0.4, "model": "a", "variable": "u", "action": "override", "value": 2},
        {"time": 0.7, "model": "a", "variable": "u", "action": "override", "value": 3},
        {"time": 0.9, "model": "a", "variable": "u", "action": "reset"},
    )
    run(system, until=1.0, out=tmp_path / "r", scenario=file)
    v = read_signals(tmp_path / "r")["a.v"]
    assert v == pytest.approx(np.array([0.0] * 5 + [2.0] * 3 + [3.0] * 2 + [0.0]))


def test_libcosims_override_of_a_connected_input_is_a_fault_of_what_feeds_it(
    system: System, tmp_path: Path
) -> None:
    chain = system.add("b", "part.py:Ramp").connect("a.v", "b.u")
    event = {"time": 0.5, "model": "b", "variable": "u", "action": "override", "value": 7}
    run(chain, until=1.0, out=tmp_path / "r", scenario=libcosim(tmp_path, event))
    signals = read_signals(tmp_path / "r")
    assert signals["a.v"][5:].tolist() == [7.0] * 6
    assert signals["b.v"][6:].tolist() == [7.0] * 5


def test_libcosims_override_of_an_input_whose_source_feeds_others_is_refused(
    system: System, tmp_path: Path
) -> None:
    fan = system.add("b", "part.py:Ramp").add("c", "part.py:Ramp")
    fan = fan.connect("a.v", "b.u").connect("a.v", "c.u")
    event = {"time": 0.5, "model": "b", "variable": "u", "action": "override", "value": 7}
    with pytest.raises(
        InputInvalid, match=r"b\.u: is connected to a\.v, which is connected to c\.u as well"
    ):
        run(fan, until=1.0, out=tmp_path / "r", scenario=libcosim(tmp_path, event))


def test_libcosims_bias_of_an_unconnected_input_adds_to_the_value_that_it_has(
    system: System, tmp_path: Path
) -> None:
    events = (
        {"time": 0.4, "model": "a", "variable": "u", "action": "bias", "value": 7},
        {"time": 0.7, "model": "a", "variable": "u", "action": "reset"},
    )
    file = libcosim(tmp_path, *events)
    run(system.set("a.u", 1.5), until=1.0, out=tmp_path / "r", scenario=file)
    v = read_signals(tmp_path / "r")["a.v"][1:]
    assert v == pytest.approx(np.array([1.5] * 4 + [8.5] * 3 + [1.5] * 3))


def test_libcosims_override_of_a_parameter_lasts_until_its_reset(tmp_path: Path) -> None:
    import uuvsim_cosim as uuv

    scenario = Scenario("s", (Manipulation(0.02, "guidance.speed", "override", 0.3, until=0.04),))
    system = uuv.load("bluerov2_survey")
    with Master(flatten(system, 0), prepare(flatten(system, 0), "native")) as master:
        master.initialize()
        begin = master.get("guidance", "speed")
        played = Played(master, scenario)
        seen = []
        for _ in range(5):
            played.step()
            seen.append(master.get("guidance", "speed"))
    assert seen == [begin, begin, 0.3, 0.3, begin]


def test_a_run_without_an_end_ends_with_its_scenario(system: System, tmp_path: Path) -> None:
    file = libcosim(tmp_path, end=0.6)
    assert run(system, out=tmp_path / "r", scenario=file).steps == 6
    assert run(system, until=0.3, out=tmp_path / "q", scenario=file).steps == 3


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ({"time": "soon", "model": "a", "variable": "y", "action": "reset"}, "time 'soon'"),
        ({"time": 1, "model": "a", "variable": "y", "action": "bias"}, "value None"),
        ({"time": 1, "model": "a", "variable": "y", "action": "jam"}, "action 'jam'"),
        ({"time": 1}, "event 1 without model"),
    ],
)
def test_a_broken_event_of_libcosim_is_refused(
    event: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputInvalid, match=message):
        read_scenario(libcosim(tmp_path, event))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("events:\n- {at: -1, set: a.u, value: 1}\n", r":2: events.0.at: .*seconds, 0 or more"),
        (
            'events:\n- {"at": -1, "set": "a.u", "value": 1}\n',
            r":2: events.0.at: .*seconds, 0 or m",
        ),
        ('events:\n- {"at": 1, "set": 3, "value": 1}\n', r":2: events.0.set: .*component.variable"),
        ('events:\n- {"at": 1, "set": "a.u"}\n', ":2: event 1: set without value"),
        ('events:\n- {"at": 1, "set": "a.u", "val', r":2: .*expected YAML"),
        ("events:\n- {at: 1, set: a.u}\n", ":2: event 1: set without value"),
        ("events:\n- {at: 1, signal: a.y}\n", ":2: event 1: at, signal; expected"),
        ("events:\n- {at: 1, signal: a.y, fault: bais, value: 1}\n", ":2: .*override, bias"),
        ("events:\n- {at: 1, signal: a.y, fault: bias}\n", "value None; expected a number"),
        ("events: 3\n", "a list of events"),
        ("event: []\n", "events"),
        ("events: [\n", "expected YAML"),
    ],
)
def test_a_broken_file_is_refused_with_its_lines(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    file.write_text(text)
    with pytest.raises(InputInvalid, match=message):
        read_scenario(file)


@pytest.mark.parametrize(
    ("event", "message"),
    [
        (Change(0.1, "a.w", 1.0), "event 1: .*a"),
        (Change(0.1, "a.u", "3 kg"), "event 1: .*kg"),
        (Change(0.1, "a.y", 1.0), "expected an input or a tunable parameter"),
        (SignalFault(0.1, Fault("a.z", "freeze")), r"event 1: a\.z"),
        (SignalFault(0.5, Fault("a.y", "freeze"), 0.5), "not after at 0.5 s"),
    ],
)
def test_what_does_not_fit_the_system_is_told_before_anything_runs(
    event: Change | SignalFault, message: str, system: System, tmp_path: Path
) -> None:
    with pytest.raises(InputInvalid, match=message):
        run(system, until=1.0, out=tmp_path / "r", scenario=Scenario("s", (event,)))
    assert not (tmp_path / "r").exists()
