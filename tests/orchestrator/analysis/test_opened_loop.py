"""Opened loops against closed forms, against the closed system's poles, and their refusals."""

from __future__ import annotations

import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.analysis.opened_loop import OpenedLoop, opened_loops
from uuvsim_cosim.orchestrator.analysis.system_map import SystemMap
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system import resolve
from uuvsim_cosim.orchestrator.system.sources import ModelSource

T = 0.1


def law(gain: float = 2.0) -> Model:
    """Proportional law, sampled at each tick."""
    m = Model("law")
    y = m.input("y", unit="m")
    clock = m.clock("sample", str(T))
    held = m.discrete("held", unit="N")
    m.update(clock, held, -gain * y)
    m.output("u", held, unit="N", discrete=True)
    return m


def tank() -> Model:
    """Integrator."""
    m = Model("tank")
    u = m.input("u", unit="N")
    x = m.state("x", unit="m")
    m.der(x, u)
    m.output("y", x, unit="m")
    return m


def slow() -> Model:
    """Counter that ticks every tenth time."""
    m = Model("slow")
    clock = m.clock("sample", "1")
    z = m.discrete("z", unit="1")
    m.update(clock, z, z + 1)
    m.output("count", z, unit="1", discrete=True)
    return m


def motors() -> Model:
    """Two integrators behind a command with a dead band of 0.25, and one that ignores its command.

    The first is in the middle of its dead band, the second one moves.
    """
    m = Model("motors")
    u = m.input("u", 3, unit="1", min=-1, max=1)
    x = m.state("x", (0.1, 0.8, 0.0), unit="m")
    beyond = [ca.if_else(ca.fabs(v) > 0.25, v, 0.0) for v in (u[0], u[1])]
    m.der(x, ca.vertcat(*beyond, 0.0))
    clock = m.clock("sample", str(T))
    held = m.discrete("held", (0.0, 0.0, 0.0), unit="1")
    m.update(clock, held, -x)
    m.output("y", held, unit="1", discrete=True)
    return m


def steep(start: float, band: float = 0.25) -> Model:
    """An integrator with a dead band and a slope beyond it that is unstable for the period."""
    m = Model("steep")
    u = m.input("u", unit="1", min=-1, max=1)
    x = m.state("x", start, unit="m")
    slope = 3.0 / float(T)
    m.der(x, slope * (ca.fmax(u - band, 0.0) + ca.fmin(u + band, 0.0)))
    clock = m.clock("sample", str(T))
    held = m.discrete("held", -start, unit="1")
    m.update(clock, held, -x)
    m.output("y", held, unit="1", discrete=True)
    return m


class PartSource(ModelSource):
    """A declaration of this file: ``part:law?2``."""

    def declaration(self) -> Model:
        name, _, gain = self.text.removeprefix("part:").partition("?")
        if name == "steep":
            return steep(*map(float, gain.split("&")))
        if gain:
            return law(float(gain))
        return {"law": law, "tank": tank, "slow": slow, "motors": motors}[name]()


@pytest.fixture(autouse=True)
def parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(resolve._factories, "part", lambda text, base: PartSource(text))


def system_of(gain: float = 2.0) -> uuv.System:
    return (
        uuv.System("loop", str(T))
        .add("law", f"part:law?{gain}")
        .add("tank", "part:tank")
        .connect("tank.y", "law.y")
        .connect("law.u", "tank.u")
    )


def loop_of(gain: float = 2.0, slow: bool = False) -> OpenedLoop:
    system = system_of(gain)
    (loop,) = uuv.analyse(system.add("slow", "part:slow") if slow else system, "law.u", 0.5)
    return loop


def closed_form(omega: np.ndarray, gain: float) -> np.ndarray:
    """Integrator over a held step, x+ = x + T u, and a law that sees y of the step before."""
    z = np.exp(1j * omega * T)
    return gain * T / (z - 1) / z


def test_the_response_is_that_of_the_closed_form() -> None:
    omega = np.geomspace(0.01, 0.99 * np.pi / T, 50)
    assert loop_of().response(omega) == pytest.approx(closed_form(omega, 2.0), rel=1e-9)


def test_a_slow_clock_outside_the_loop_changes_nothing() -> None:
    """The system then repeats after ten ticks; the fundamental is the same transfer function."""
    omega = np.geomspace(0.01, 0.99 * np.pi / T, 50)
    plain, with_slow = loop_of(), loop_of(slow=True)
    assert (plain.period, with_slow.period) == (1, 10)
    assert with_slow.response(omega) == pytest.approx(plain.response(omega), rel=1e-9)
    assert np.exp(with_slow.closed_poles) == pytest.approx(np.exp(plain.closed_poles), abs=1e-9)
    assert with_slow.margins.phase == pytest.approx(plain.margins.phase, rel=1e-6)


def test_at_the_gain_margin_a_pole_is_on_the_unit_circle() -> None:
    margins = loop_of().margins
    at_the_margin = loop_of(gain=2.0 * margins.gain_up)
    assert at_the_margin.closed_poles.real.max() == pytest.approx(0.0, abs=1e-8)
    assert loop_of(gain=1.9 * margins.gain_up).stable
    assert not loop_of(gain=2.1 * margins.gain_up).stable


def test_phase_and_delay_margin_are_those_of_the_crossover() -> None:
    margins = loop_of().margins
    L = closed_form(np.array([margins.crossover]), 2.0)[0]
    assert abs(L) == pytest.approx(1.0, rel=1e-8)
    assert margins.phase == pytest.approx(np.angle(-L), rel=1e-8)
    assert margins.delay == pytest.approx(margins.phase / margins.crossover)
    grid = np.geomspace(1e-3, np.pi / T, 100_000)
    assert margins.modulus == pytest.approx(np.abs(1 + closed_form(grid, 2.0)).min(), rel=1e-6)


def test_the_step_response_of_the_closed_loop_is_that_of_its_recursion() -> None:
    t, y = loop_of().step(3.0)
    x, u, seen = 0.0, 0.0, []
    for _ in t:  # the law sees x of the point before; its output is seen one point later
        seen.append(-u)
        x, u = x + T * (u + 1.0), -2.0 * x
    assert y == pytest.approx(np.array(seen), abs=1e-12)
    assert y[-1] == pytest.approx(1.0, abs=0.01)


def test_an_input_and_the_output_that_feeds_it_open_the_same_loop() -> None:
    system = system_of()
    omega = np.array([0.1, 1.0, 5.0])
    responses = [uuv.analyse(system, s, 0.0)[0].response(omega)
                 for s in ("law.u", "tank.u", "law.y", "tank.y")]  # fmt: skip
    for other in responses[1:]:
        assert other == pytest.approx(responses[0], rel=1e-9)


def test_the_closed_loops_poles_are_those_of_the_linear_system() -> None:
    """Of the hold: opened and closed again, each pole is one of `uuv.linearize`."""
    linear = np.log(uuv.linearize("bluerov2_hold", 20.0).poles().astype(complex) + 1e-300) / 0.02
    for loop in uuv.analyse("bluerov2_hold", "controller.tau_d", 20.0)[:2]:
        slow = loop.closed_poles[loop.closed_poles.real > -5]
        assert len(slow) > 3
        for pole in slow:
            assert np.abs(linear - pole).min() < 1e-6 * max(abs(pole), 1.0)


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        ("controller.tau", "there is no such signal.*did you mean controller.tau_d"),
        ("hull.nu_dot", "is not connected"),
        ("controller.tau_d[7]", "there is no such signal"),
    ],
)
def test_a_signal_that_cannot_be_opened_is_named(signal: str, words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        uuv.analyse("bluerov2_hold", signal, 0.0)


def test_a_signal_without_a_loop_is_refused() -> None:
    system = (
        uuv.System("chain", str(T))
        .add("law", "part:law")
        .add("tank", "part:tank")
        .connect("law.u", "tank.u")
    )
    with pytest.raises(InputInvalid, match="is in no loop"):
        opened_loops(system, "law.u", 0.0)
    with pytest.raises(InputInvalid, match="at = -1"):
        opened_loops(system, "law.u", -1.0)


def test_elements_without_a_loop_are_left_out_with_their_reason() -> None:
    system = uuv.System("two", str(T)).add("motors", "part:motors").connect("motors.y", "motors.u")
    loops, without = opened_loops(system, "motors.y", 0.2)
    assert [loop.signal for loop in loops] == ["motors.y[2]"]
    assert without["motors.y[3]"] == "it is in no loop"
    assert re.match(
        r"no gain after 0\.2 s: motors\.x\[1\] does not change with motors\.y\[1\] = -0\.1 "
        r"between -0\.25 and 0\.25, as in a dead band\. .*--at",
        without["motors.y[1]"],
    )
    with pytest.raises(InputInvalid, match=r"motors\.y\[1\]: no gain after 0\.2 s"):
        opened_loops(system, "motors.y[1]", 0.2)


@pytest.mark.parametrize(
    ("part", "beside"), [("steep?0.26", True), ("steep?0.8", False), ("steep?0.26&0", False)]
)
def test_an_unstable_loop_next_to_a_dead_band_names_the_band_and_a_better_point(
    part: str, beside: bool
) -> None:
    system = uuv.System("one", str(T)).add("motor", f"part:{part}").connect("motor.y", "motor.u")
    ((loop,), _) = opened_loops(system, "motor.y", 0.0)
    assert not loop.stable
    assert bool(loop.remark) is beside
    if beside:
        assert re.match(
            r"after 0 s, motor\.y = -0\.26, and motor has a dead band between -0\.25 and 0\.25: .*"
            r"gain there is not that of the design\. Choose a working point with load: a current",
            loop.remark,
        )


def test_the_axes_at_rest_of_a_vehicle_with_t200_are_left_out_of_its_analysis() -> None:
    loops, without = opened_loops(uuv.system_of("bluerov2"), "controller.tau_d", 20.0)
    assert [loop.signal[-2] for loop in loops] == ["3", "4"]
    assert "thruster_1.shaft does not change with allocation.u[1]" in without["controller.tau_d[6]"]
    assert "between -0.07 and 0.07" in without["controller.tau_d[6]"]
    assert "nor do thruster_2, thruster_3, thruster_4" in without["controller.tau_d[6]"]
    assert without["controller.tau_d[5]"] == "it is in no loop"


def test_a_connection_through_a_table_is_refused() -> None:
    plan = flatten(system_of())
    first, *others = plan.transfers
    mapped = replace(plan, transfers=(replace(first, table=((0.0, 1.0),)), *others))
    with pytest.raises(InputInvalid, match=r"law\.y is fed through a table"):
        SystemMap(mapped, "analyse")
