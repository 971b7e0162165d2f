"""An exception that a signal raises in a callback always ends the step."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.orchestrator.master.callback import Callbacks
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

COUNT = """
class Count:
    inputs = {}
    outputs = {"n": "1"}
    parameters = {"first": (0.0, "1")}
    n = 0

    def step(self, t, dt, u):
        self.n += 1
        return {"n": float(self.n)}
"""


class Signal:
    """Raises once at the first line of a callback, as a signal does that arrives in C code."""

    def __init__(self, method: str, patch: pytest.MonkeyPatch) -> None:
        real = getattr(Callbacks, method)
        self.arrived = False

        def interrupted(callbacks: Callbacks, *arguments: Any) -> None:
            if self.arrived:
                self.arrived = False
                raise KeyboardInterrupt("a signal")
            real(callbacks, *arguments)

        patch.setattr(Callbacks, method, interrupted)


@pytest.fixture
def counting(tmp_path: Path) -> System:
    (tmp_path / "count.py").write_text(COUNT)
    return System("s", "0.1", base=tmp_path).add("count", "count.py:Count")


def initialized(system: System) -> Master:
    plan = flatten(system)
    master = Master(plan, prepare(plan, "native"))
    master.initialize()
    return master


@pytest.mark.parametrize(("method", "tick"), [("_do_step", 3), ("_get", 4)])
def test_an_exception_before_the_try_of_a_callback_ends_the_step(
    counting: System,
    method: str,
    tick: int,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    signal = Signal(method, monkeypatch)
    with initialized(counting) as master:
        master.step(3)
        signal.arrived = True
        with pytest.raises(KeyboardInterrupt, match="a signal"):
            master.step(5)
        assert master.tick == tick
        assert not signal.arrived
    assert capfd.readouterr().err == ""


def test_an_escaped_exception_that_another_hook_takes_still_ends_the_step(
    counting: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    signal = Signal("_do_step", monkeypatch)
    with initialized(counting) as master:
        monkeypatch.setattr(sys, "unraisablehook", lambda unraisable: None)
        signal.arrived = True
        with pytest.raises(KeyboardInterrupt):
            master.step(5)
        assert master.tick == 0


def test_other_escaped_exceptions_reach_the_hook_that_was_there(
    counting: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(sys, "unraisablehook", seen.append)

    class Careless:
        def __del__(self) -> None:
            raise ValueError("lost")

    with initialized(counting):
        Careless()
    assert [str(u.exc_value) for u in seen] == ["lost"]
