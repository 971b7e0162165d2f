"""Inputs of a system over time: files, step, chirp, PRBS; free inputs and signals."""

import math
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.scenarios.scenario import Change, Scenario
from uuvsim_cosim.orchestrator.scenarios.waveforms import waveform
from uuvsim_cosim.orchestrator.system.system import System

PARTS = '''
class Source:
    """Gives a constant."""
    inputs = {}
    outputs = {"y": (2, "m/s")}
    def initialize(self, t):
        return {"y": [1.0, 2.0]}
    def step(self, t, dt, u):
        return {"y": [1.0, 2.0]}

class Echo:
    """Shows during a step what its inputs are."""
    inputs = {"u": (2, "m/s"), "free": (2, "m/s"), "n": "1"}
    outputs = {"seen": (2, "m/s"), "free_seen": (2, "m/s")}
    def step(self, t, dt, u):
        return {"seen": u["u"], "free_seen": u["free"]}
'''


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> System:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "parts.py").write_text(PARTS)
    return (
        System("s", "0.1", base=tmp_path)
        .add("source", "parts.py:Source")
        .add("echo", "parts.py:Echo")
        .connect("source.y", "echo.u")
    )


def column(folder: str, signal: str, element: int) -> list[float]:
    return [float(x) for x in read_signals(folder)[signal][:, element - 1]]


def test_a_free_input_holds_the_value_of_each_communication_point(system: System) -> None:
    Path("in.csv").write_text("time,echo.free[2]\n0.1,0\n0.3,4\n")
    run(system, until=0.5, out="r", inputs=["in.csv"])
    # The step from 0.2 to 0.3 s uses the value at 0.2 s, and is seen at 0.3 s.
    assert column("r", "echo.free_seen", 2) == pytest.approx([0, 0, 0, 2, 4, 4])
    assert column("r", "echo.free_seen", 1) == [0.0] * 6


def test_what_is_added_to_a_signal_is_seen_by_all_at_its_time(system: System) -> None:
    run(system, until=0.5, out="r", inputs=["+source.y[1]:step,value=10,at=0.2,until=0.4"])
    assert column("r", "source.y", 1) == pytest.approx([1, 1, 11, 11, 1, 1])
    assert column("r", "source.y", 2) == pytest.approx([2] * 6)
    assert column("r", "echo.seen", 1)[1:] == pytest.approx([1, 1, 11, 11, 1])


def test_a_connected_input_is_added_to_by_the_signal_that_feeds_it(system: System) -> None:
    run(system, until=0.3, out="r", inputs=["+echo.u[2]:step,value=0.5,at=0.1"])
    assert column("r", "source.y", 2) == pytest.approx([2, 2.5, 2.5, 2.5])


def test_a_plus_adds_to_the_start_value_of_a_free_input(system: System) -> None:
    changed = system.set("echo.free", [7.0, 7.0])
    run(changed, until=0.3, out="r", inputs=["+echo.free[1]:step,value=1,at=0.1"])
    assert column("r", "echo.free_seen", 1)[1:] == pytest.approx([7, 8, 8])


def test_what_was_applied_is_kept_and_gives_the_same_bits_again(system: System) -> None:
    given = ["+source.y[1]:chirp,amplitude=0.3,from=0.5,to=2,until=1",
             "echo.free[1]:prbs,amplitude=0.1,hold=0.2,order=3"]  # fmt: skip
    run(system, until=1.0, out="a", inputs=given)
    run(system, until=1.0, out="b", inputs=["a/inputs.csv"])
    a, b = read_signals("a"), read_signals("b")
    for name in a:
        assert np.array_equal(a[name], b[name]), name


def test_the_run_says_what_holds_between_and_outside_the_rows(system: System) -> None:
    Path("in.csv").write_text("time,echo.free[1],+source.y[1]\n0,0,0\n1,4,1\n")
    notes = run(system, until=0.2, out="r", inputs=["in.csv"]).notes
    assert any("echo.free[1] in m/s: in.csv, linear between its rows" in n for n in notes)
    assert any("+source.y[1]" in n and "from the end of the first step on" in n for n in notes)


def test_a_size_is_converted_to_the_unit_of_the_variable(system: System) -> None:
    run(system, until=0.2, out="r", inputs=["echo.free[1]:step,value=3.6 km/h"])
    assert column("r", "echo.free_seen", 1)[1:] == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("echo.u[1]:step,value=1", r"is connected to source.y\[1\]; expected \+echo.u\[1\]"),
        ("echo.seen[1]:step,value=1", r"is an output; expected \+echo.seen\[1\]"),
        ("echo.fre[1]:step,value=1", "free"),
        ("ech.free[1]:step,value=1", "echo"),
        ("echo.free[1]:step,value=1 kg", "'kg'"),
        ("echo.free[1]:step,value=x", "'x'"),
        ("echo.free[1]:step,value=1,size=2", "size=2"),
        ("echo.free[1]:step,value=1,value=2", "value=2"),
        ("echo.free[1]:sinus,amplitude=1", "step, chirp, prbs"),
        ("echo.free[1]:chirp,amplitude=1,from=0,to=1", "without until"),
        ("echo.free[1]:chirp,amplitude=1,from=0,to=1 m,until=9", "is in m"),
        ("echo.free[1]:step,value=1,at=3,until=2", "0 <= at < until"),
        ("echo.free[1]:prbs,amplitude=1,hold=0", "hold > 0"),
        ("echo.free[1]:prbs,amplitude=1,hold=1,order=40", "order from 2 to 20"),
        ("none.csv", "none.csv: cannot be read"),
        ("bad.csv", "unknown name 'echo.fre"),
        ("echo.free[1]", r"\[\+\]component.variable"),
    ],
)
def test_an_input_that_cannot_be_is_refused_and_leaves_nothing(
    system: System, text: str, said: str
) -> None:
    Path("bad.csv").write_text("time,echo.fre[1]\n0,0\n")
    with pytest.raises(InputInvalid, match=said):
        run(system, until=0.5, out="r", inputs=[text])
    assert not Path("r").exists()


@pytest.mark.parametrize("backend", ["native", "fmu"])
def test_a_value_beyond_the_range_of_a_free_input_is_refused_before_the_run(
    backend: Literal["native", "fmu"], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    system = System("s", "0.01").add("thruster", "model:thruster_t200")
    Path("volts.csv").write_text("time,thruster.voltage\n0,16\n1,16.8\n2,18\n3,30\n4,5\n")
    for text, said in (
        ("volts.csv", r"volts.csv, row 3 \(t = 2 s\): thruster.voltage: 18 V is out of range, and "
         r"2 more rows; expected a value in \[12, 16.8\] V"),
        ("thruster.voltage:step,value=30", r"thruster.voltage: 30 V is out of range"),
        ("thruster.voltage:step,value=14,until=2", r"thruster.voltage: 0 V is out of range"),
        ("thruster.u:prbs,amplitude=2,hold=1", r"thruster.u: 2 is out of range; .* \[-1, 1\]"),
    ):  # fmt: skip
        with pytest.raises(InputInvalid, match=said):
            run(system, until=0.5, out="r", inputs=[text], backend=backend)
    assert not Path("r").exists()


def test_an_input_is_given_once(system: System) -> None:
    twice = ["echo.free[1]:step,value=1", "echo.free:step,value=2"]
    with pytest.raises(InputInvalid, match=r"echo.free\[1\]: is given twice"):
        run(system, until=0.5, out="r", inputs=twice)


def test_an_input_that_a_scenario_sets_too_is_refused(system: System) -> None:
    both = Scenario("x", (Change(0.1, "echo.free", [1.0, 1.0]),))
    with pytest.raises(InputInvalid, match=r"the scenario sets echo\.free"):
        run(system, until=0.5, out="r", inputs=["echo.free:step,value=1"], scenario=both)


# ---- waveforms ----------------------------------------------------------------------------------


def test_a_chirp_has_the_frequency_of_its_time() -> None:
    w = waveform("chirp,amplitude=1,from=1,to=3,at=2,until=6", "x")
    t = np.linspace(0, 4, 100_001)
    s = np.array([w.of(2 + x) for x in t[:-1]])
    phase = 2 * math.pi * (t + t**2 / 4)  # the integral of 1 + t / 2
    assert s == pytest.approx(np.sin(phase[:-1]), abs=1e-12)
    assert w.of(1.99) == w.of(6.0) == 0.0


def test_a_prbs_is_a_maximum_length_sequence() -> None:
    w = waveform("prbs,amplitude=1,hold=0.5,order=5", "x")
    s = np.array([w.of(0.25 + 0.5 * k) for k in range(31)])
    assert set(s) == {-1.0, 1.0}
    assert abs(s.sum()) == 1.0  # one more of one kind
    # The periodic autocorrelation is 31 at 0 and -1 elsewhere.
    assert [float(s @ np.roll(s, k)) for k in range(31)] == [31.0] + [-1.0] * 30
    assert [w.of(15.5 + 0.25 + 0.5 * k) for k in range(31)] == list(s)


def test_a_prbs_changes_at_the_communication_point_itself() -> None:
    w = waveform("prbs,amplitude=1,hold=0.3,order=7,at=0.1", "x")
    exact = [w.of(0.1 + 0.3 * k + 0.15) for k in range(127)]
    assert [w.of(float(f"{0.1 + 0.3 * k:.10g}")) for k in range(127)] == exact


def test_times_and_frequencies_of_a_waveform_carry_units() -> None:
    a = waveform("chirp,amplitude=1,from=6 rpm,to=0.2 Hz,at=100ms,until=1 min", "x")
    b = waveform("chirp,amplitude=1,from=0.1,to=0.2,at=0.1,until=60", "x")
    assert [a.of(t) for t in (5.0, 30.0)] == [b.of(t) for t in (5.0, 30.0)]
