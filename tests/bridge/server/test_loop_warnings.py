"""What a server says of algebraic loops: at the beginning, to clients, and of the whole run."""

import pytest

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.orchestrator.system.system import System

ME = Client("me", "local")


def looped() -> System:
    """A sum that feeds itself: u = 1 - 6 y, y = u."""
    s = System("loop", "0.1").add("a", "function:sum?inputs=1")
    return s.connect("a.y", "a.u", factor=-6.0, offset=1.0)


def test_a_server_names_a_delayed_loop_and_at_the_end_its_residual() -> None:
    with Conductor(looped().with_loops("delay")) as conductor:
        begun = conductor.warnings
        assert len(begun) == 2
        assert "delayed by a step" in begun[0]
        assert "its estimated gain is -6" in begun[1]
        assert conductor.describe()["warnings"] == list(begun)
        conductor.run(ME, until=10.0)
        assert "the loop may diverge" in conductor.describe()["warnings"][-1]
    assert conductor.warnings[:2] == begun
    assert "its coupling residual is" in conductor.warnings[2]


def test_a_server_has_nothing_to_say_of_an_iterated_loop() -> None:
    with Conductor(looped()) as conductor:
        conductor.run(ME, until=1.0)
        assert float(conductor.get(ME, ["a.y"])["a.y"]) == pytest.approx(1 / 7)
        assert conductor.describe()["warnings"] == []
