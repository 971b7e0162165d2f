"""Opened loops against closed forms, against the closed system's poles, and their refusals."""

from __future__ import annotations

from dataclasses import replace

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


class PartSource(ModelSource):
    """A declaration of this file: ``part:law?2``."""

    def declaration(self) -> Model:
        name, _, gain = self.text.removeprefix("part:").partition("?")
        return law(float(gain)) if gain else {"law": law, "tank": tank, "slow": slow}[name]()


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


def test_a_connection_through_a_table_is_refused() -> None:
    plan = flatten(system_of())
    first, *others = plan.transfers
    mapped = replace(plan, transfers=(replace(first, table=((0.0, 1.0),)), *others))
    with pytest.raises(InputInvalid, match=r"law\.y is fed through a table"):
        SystemMap(mapped, "analyse")
