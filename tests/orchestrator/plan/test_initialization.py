"""Initialization Mode: order of direct feedthrough, and algebraic loops."""

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import FmuError, LoopNotConverged
from uuvsim_cosim.fmus.component import Binding, BindingKind
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.initial_loop import _Loop, _offsets


class Static:
    """y = f(u), at once, as a component; `derivative` is dy/du where it is provided."""

    def __init__(
        self,
        path: str,
        f: Callable[[float], float],
        derivative: Callable[[float], float] | None = None,
        *,
        declared: bool = True,
    ) -> None:
        self.path = path
        self._f, self._derivative = f, derivative
        self._u = 0.0
        y = Variable(
            "y", "Float64", "output", "continuous", dependencies=("u",) if declared else None
        )
        u = Variable("u", "Float64", "input", "continuous", start=0.0)
        self.description = Description(
            "static",
            "python",
            {"u": u, "y": y},
            provides_directional_derivatives=derivative is not None,
        )

    def get(self, variable: Variable) -> float:
        return self._u if variable.name == "u" else self._f(self._u)

    def set(self, variable: Variable, value: float) -> None:
        self._u = float(value)

    def directional_derivative(self, unknowns: Any, knowns: Any, seed: Any) -> Any:
        if self._derivative is None:
            raise FmuError("none")
        return np.array([self._derivative(self._u) * seed[0]])

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None: ...

    def exit_initialization_mode(self) -> None: ...

    def do_step(self, current_communication_point: float, step_size: float) -> None: ...

    def reset(self) -> None: ...

    def terminate(self) -> None: ...

    def free(self) -> None: ...

    def binding(self) -> Binding:
        return Binding(BindingKind.CALLBACK, 0, {})


def line(g: float, own: bool, declared: bool = True) -> Callable[[str], Static]:
    def make(path: str) -> Static:
        derivative = (lambda u: g) if own else None
        return Static(path, lambda u: g * u + 1.0, derivative, declared=declared)

    return make


LOOP = ["a.y -> b.u", "b.y -> a.u"]


@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize(("g_a", "g_b", "expected"), [(0.5, 0.5, 2.0), (2.0, -3.0, 3 / 7)])
def test_a_linear_loop_is_solved(
    g_a: float, g_b: float, expected: float, own: bool, wired: Any
) -> None:
    with Master(*wired({"a": line(g_a, own), "b": line(g_b, own)}, LOOP)) as master:
        master.initialize()
        assert master.get("a", "y") == pytest.approx(expected, abs=2e-16 * 4)
        assert master.get("b", "y") == pytest.approx(g_b * expected + 1.0, abs=1e-15)


@pytest.mark.parametrize("own", [True, False])
def test_a_nonlinear_loop_is_solved(own: bool, wired: Any) -> None:
    def cos(path: str) -> Static:
        return Static(path, np.cos, (lambda u: -np.sin(u)) if own else None)

    with Master(*wired({"a": cos}, ["a.y -> a.u"])) as master:
        master.initialize()
        assert master.get("a", "y") == pytest.approx(0.7390851332151607, abs=1e-15)


def test_a_loop_without_solution_names_its_hops(wired: Any) -> None:
    square = {"a": lambda p: Static(p, lambda u: u * u + 1.0)}
    with (
        Master(*wired(square, ["a.y -> a.u"])) as master,
        pytest.raises(LoopNotConverged, match=r"a\.y -> a\.u.*residual .* iterations"),
    ):
        master.initialize()


def test_a_loop_through_an_undeclared_hop_is_iterated_with_a_warning(
    wired: Any, caplog: pytest.LogCaptureFixture
) -> None:
    makers = {"a": line(0.5, False, declared=False), "b": line(0.5, False)}
    with caplog.at_level(logging.WARNING), Master(*wired(makers, LOOP)) as master:
        master.initialize()
        assert master.get("a", "y") == pytest.approx(2.0, abs=1e-15)
    assert "a.u -> a.y" in caplog.text


def test_values_go_through_a_chain_of_feedthrough_whatever_its_order(wired: Any) -> None:
    makers = {"c": line(3.0, True), "b": line(2.0, True), "a": line(0.0, True)}
    with Master(*wired(makers, ["a.y -> b.u", "b.y -> c.u"])) as master:
        master.initialize()
        assert master.get("c", "y") == 3.0 * (2.0 * 1.0 + 1.0) + 1.0


def test_derivatives_of_vectors_lie_one_behind_the_other() -> None:
    variables = [
        Variable(name, "Float64", "input", "continuous", shape=shape)
        for name, shape in (("a", (2, 3)), ("b", ()), ("c", (4,)))
    ]
    assert _offsets(variables) == {"a": 0, "b": 6, "c": 7}


def test_a_singular_loop_takes_the_smallest_newton_step(monkeypatch: pytest.MonkeyPatch) -> None:
    jacobian = np.array([[1.0, 1.0], [2.0, 2.0]])
    monkeypatch.setattr(_Loop, "_jacobian", lambda *_: jacobian)
    step = object.__new__(_Loop)._newton_step(np.zeros(2), np.array([2.0, 4.0]))
    np.testing.assert_allclose(step, [-1.0, -1.0], rtol=1e-12)  # J step = -r


def test_a_loop_with_a_conversion_is_solved_in_the_inputs_units(wired: Any) -> None:
    w = wired({"a": line(0.5, True), "b": line(0.5, True)}, LOOP,
              conversions={LOOP[0]: (2.0, 0.0)})  # fmt: skip
    with Master(*w) as master:
        master.initialize()  # a = b / 2 + 1, b = a + 1
        assert master.get("a", "y") == pytest.approx(3.0, abs=1e-15)
        assert master.get("b", "y") == pytest.approx(4.0, abs=1e-15)
