"""Faults of signals: what others see of an output."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Group


def counter() -> Model:
    """A clock that counts its ticks from 1, as a number, an integer and a Boolean."""
    m = Model("counter")
    tick = m.clock("tick", "0.01")
    n = m.discrete("n", 0.0, unit="1")
    m.update(tick, n, n + 1)
    m.output("y", n, unit="m")
    m.output("k", n, unit="1", type="Int32")
    m.output("odd", n - 2 * ((n / 2) // 1) > 0, unit="1", type="Boolean")
    return m


def echo() -> Model:
    m = Model("echo")
    m.output("z", m.input("u", unit="m"), unit="m")
    return m


@pytest.fixture
def pair(wired: Any) -> Any:
    made: list[Master] = []

    def begin(groups: Any = ()) -> Master:
        makers: dict[str, Callable[[str], Any]] = {
            "a": lambda p: Native(counter(), p), "b": lambda p: Native(echo(), p),
        }  # fmt: skip
        record = [("a", "y"), ("a", "k"), ("a", "odd"), ("b", "z")]
        w = wired(makers, ["a.y -> b.u"], groups=groups)
        master = Master(*w, observers=[Nobody()], record=record)
        made.append(master)
        master.initialize()
        return master

    yield begin
    for master in made:
        master.free()


class Nobody:
    """An observer that looks away: so that all outputs are read."""

    def begin(self, plan: Any, columns: Any) -> None: ...

    def observe(self, chunk: Any) -> None: ...

    def end(self) -> None: ...


def seen(master: Master, n: int, name: str = "y") -> list[Any]:
    values = []
    for _ in range(n):
        master.step()
        values.append(master.get("a", name))
    return values


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("override", 7.5, [7.5, 7.5, 7.5, 7.5]),
        ("bias", 0.5, [3.5, 4.5, 5.5, 6.5]),
        ("scale", -2.0, [-6.0, -8.0, -10.0, -12.0]),
        ("freeze", 0.0, [2.0, 2.0, 2.0, 2.0]),
        ("delay", 0.02, [2.0, 2.0, 3.0, 4.0]),
        ("drop", 1.0, [2.0, 2.0, 2.0, 2.0]),
        ("drop", 0.0, [3.0, 4.0, 5.0, 6.0]),
    ],
)
def test_what_others_see_is_faulty_until_it_is_repaired(
    kind: Any, value: float, expected: list[float], pair: Any
) -> None:
    master = pair()
    master.step(2)
    number = master.faults.add(Fault("a.y", kind, value))
    assert seen(master, 4) == expected
    assert master.get("b", "z") == ([2.0, *expected])[-2]  # a step later
    master.faults.clear(number)
    assert seen(master, 2) == [7.0, 8.0]
    assert master.faults.active == {}


def test_whole_numbers_and_booleans_can_be_faulty(pair: Any) -> None:
    master = pair()
    master.faults.add(Fault("a.k", "bias", 10))
    master.faults.add(Fault("a.odd", "override", 1))
    assert seen(master, 2, "k") == [11, 12]
    assert seen(master, 2, "odd") == [True, True]


def test_faults_of_one_signal_follow_one_another(pair: Any) -> None:
    master = pair()
    master.faults.add(Fault("a.y", "scale", 10.0))
    master.faults.add(Fault("a.y", "bias", 1.0))
    assert seen(master, 2) == [11.0, 21.0]


def test_some_samples_are_dropped_and_the_same_ones_again(pair: Any) -> None:
    first = pair()
    first.faults.add(Fault("a.y", "drop", 0.5))
    values = seen(first, 400)
    fresh = sum(value == k + 1 for k, value in enumerate(values))
    assert 150 < fresh < 250
    second = pair()
    second.faults.add(Fault("a.y", "drop", 0.5))
    assert seen(second, 400) == values


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_a_reader_in_a_gauss_seidel_group_sees_the_fault_too(algorithm: Any, pair: Any) -> None:
    master = pair([Group(algorithm, (0, 1))])
    master.faults.add(Fault("a.y", "override", 3.0))
    master.step(2)
    assert master.get("b", "z") == 3.0


@pytest.mark.parametrize("kind", ["delay", "drop", "freeze"])
def test_a_snapshot_holds_the_faults(kind: Any, pair: Any, tmp_path: Path) -> None:
    master = pair()
    master.step(3)
    master.faults.add(Fault("a.y", kind, 0.03 if kind == "delay" else 0.5))
    master.step(5)
    snapshot = master.snapshot()
    master.save_snapshot(tmp_path / "s.zip")
    expected = seen(master, 8)
    master.faults.clear()
    master.step(4)
    master.restore(snapshot)
    assert seen(master, 8) == expected
    master.faults.clear()
    master.load_snapshot(tmp_path / "s.zip")
    assert seen(master, 8) == expected
    master.reset()
    assert master.faults.active == {}


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (Fault("a.x", "freeze"), "one of y, k, odd"),
        (Fault("c.y", "freeze"), "a, b|one of"),
        (Fault("b.u", "freeze"), "no output"),
        (Fault("a.y", "biass", 1.0), "expected one such as bias"),  # type: ignore[arg-type]
        (Fault("a.y", "delay", 0.015), "whole number of the component's steps of 0.01 s"),
        (Fault("a.y", "drop", 1.5), r"a probability in \[0, 1\]"),
        (Fault("a.y", "bias", float("nan")), "what is added"),
        (Fault("a.k", "override", 0.5), "the value that others see"),
    ],
)
def test_a_wrong_fault_is_refused_with_what_would_be_right(
    fault: Fault, message: str, pair: Any
) -> None:
    with pytest.raises(InputInvalid, match=message):
        pair().faults.add(fault)
