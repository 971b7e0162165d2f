"""Native components: the generated C against closed forms and CasADi's own evaluation."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError, ParameterInvalid
from uuvsim_cosim.fmus.codegen.equations import equations
from uuvsim_cosim.fmus.codegen.lowering import lower
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.codegen.toolchain import generated_sources
from uuvsim_cosim.models.declaration.model import Model


def decay(h_max: float = 0.01) -> Model:
    """dx/dt = (u - x) / T."""
    m = Model("decay", h_max=h_max)
    u = m.input("u", unit="1", min=-1, max=1)
    T = m.parameter("T", 0.5, unit="s", min=1e-3)
    x_0 = m.parameter("x_0", 1.0, unit="1", tunable=False)
    x = m.state("x", x_0, unit="1")
    m.der(x, (u - x) / T)
    m.output("y", 2 * x + u, unit="1")
    m.output("memory", x, unit="1")
    return m


def start(model: Model, **values: float) -> Native:
    c = Native(model, "it")
    for name, value in values.items():
        c.set(c.description.variables[name], value)
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    return c


def read(c: Native, name: str) -> object:
    return c.get(c.description.variables[name])


def test_a_decay_follows_its_closed_form() -> None:
    c = start(decay())
    c.do_step(0.0, 1.0)
    assert read(c, "memory") == pytest.approx(np.exp(-2.0), abs=1e-9)


def test_the_integrator_is_of_fourth_order() -> None:
    errors = []
    for h in (0.1, 0.05):
        c = start(decay(h_max=h))
        c.do_step(0.0, 1.0)
        errors.append(abs(float(read(c, "memory")) - np.exp(-2.0)))  # type: ignore[arg-type]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)


def test_outputs_that_depend_on_inputs_directly_say_so() -> None:
    variables = start(decay()).description.variables
    assert variables["y"].dependencies == ("u",)
    assert variables["memory"].dependencies == ()


def test_a_parameter_can_be_tuned_between_steps() -> None:
    c = start(decay())
    c.set(c.description.variables["T"], 0.25)
    c.do_step(0.0, 1.0)
    assert read(c, "memory") == pytest.approx(np.exp(-4.0), abs=1e-7)


def test_a_fixed_parameter_is_refused_after_initialization() -> None:
    c = start(decay())
    with pytest.raises(FmuError, match=r"it\.x_0: is fixed"):
        c.set(c.description.variables["x_0"], 2.0)


@pytest.mark.parametrize("value", [1.5, float("nan")])
def test_a_value_out_of_its_range_is_refused_with_the_range(value: float) -> None:
    c = start(decay())
    with pytest.raises(FmuError, match=r"it\.u: value .*\[-1.*1"):
        c.set(c.description.variables["u"], value)


def test_the_forward_derivative_is_the_jacobian_times_the_seed() -> None:
    c = start(decay())
    v = c.description.variables
    assert c.directional_derivative([v["y"], v["memory"]], [v["u"]], [3.0]).tolist() == [3.0, 0.0]


def test_a_restored_state_replays_the_same_bits() -> None:
    c = start(noise())
    c.do_step(0.0, 0.1)
    state = c.get_fmu_state()
    c.do_step(0.1, 0.1)
    first = read(c, "w")
    c.set_fmu_state(state)
    c.do_step(0.1, 0.1)
    np.testing.assert_array_equal(first, read(c, "w"))


def noise() -> Model:
    m = Model("noise")
    clock = m.clock("sample", Fraction(1, 40))
    w = m.normal(clock, 3)
    held = m.discrete("held", 0.0, 3, unit="1")
    count = m.discrete("count", 0.0, unit="1")
    stamp = m.discrete("stamp", -1.0, unit="s")
    m.update(clock, held, w)
    m.update(clock, count, count + 1)
    m.update(clock, stamp, m.t)
    m.output("w", held, unit="1")
    m.output("n", count, unit="1")
    m.output("t_sample", stamp, unit="s")
    return m


def test_a_draw_depends_on_seed_and_index_alone_and_not_on_the_step() -> None:
    coarse, fine = start(noise()), start(noise())
    coarse.do_step(0.0, 0.1)
    for k in range(10):
        fine.do_step(k / 100, 0.01)
    np.testing.assert_array_equal(read(coarse, "w"), read(fine, "w"))
    assert read(coarse, "n") == read(fine, "n") == 4


def test_another_seed_draws_other_numbers() -> None:
    a, b = Native(noise(), "a"), Native(noise(), "b")
    b.set(b.description.variables["seed"], [1, 0])
    for c in (a, b):
        c.enter_initialization_mode(0.0, None)
        c.exit_initialization_mode()
        c.do_step(0.0, 0.1)
    assert not np.any(np.equal(read(a, "w"), read(b, "w")))  # type: ignore[call-overload]


def test_a_tick_on_a_communication_point_belongs_to_the_step_that_starts_there() -> None:
    c = start(noise())
    c.do_step(0.0, 0.025)
    assert (read(c, "n"), read(c, "t_sample")) == (1.0, 0.0)
    c.do_step(0.025, 0.025)
    assert (read(c, "n"), read(c, "t_sample")) == (2.0, 0.025)


def test_ticks_before_the_start_time_are_skipped() -> None:
    c = Native(noise(), "late")
    c.enter_initialization_mode(1.0, None)
    c.exit_initialization_mode()
    c.do_step(1.0, 0.01)
    assert (read(c, "n"), read(c, "t_sample")) == (1.0, 1.0)


def test_clocks_that_tick_together_update_in_the_order_of_declaration() -> None:
    m = Model("two")
    first, second = m.clock("first", "0.1"), m.clock("second", "0.05")
    a, b = m.discrete("a", 0.0, unit="1"), m.discrete("b", 0.0, unit="1")
    m.update(first, a, a + 1)
    m.update(second, b, a)
    m.output("b_out", b, unit="1")
    c = start(m)
    c.do_step(0.0, 0.01)
    assert read(c, "b_out") == 1.0


def test_a_value_that_is_not_finite_is_named() -> None:
    m = Model("bad")
    u = m.input("u", unit="1")
    m.output("y", 1 / u, unit="1")
    c = start(m)
    with pytest.raises(ComponentFailed, match=r"component 'it' failed at t = 0 s: y is not finite"):
        c.do_step(0.0, 0.1)


def test_derived_values_may_use_derived_values() -> None:
    m = Model("chain")
    p = m.parameter("p", 3.0, unit="1")
    a = m.derived("a", p * p)
    b = m.derived("b", a + 1)
    m.output("y", b, unit="1")
    assert read(start(m), "y") == 10.0


def test_a_free_symbol_is_refused_by_name() -> None:
    m = Model("free")
    m.output("y", ca.SX.sym("stray"), unit="1")
    with pytest.raises(ParameterInvalid, match="stray"):
        Native(m, "it")


def test_a_boolean_output_reads_as_boolean() -> None:
    m = Model("flag")
    u = m.input("u", 1, unit="1")
    m.output("valid", u > 0.5, unit="1", type="Boolean")
    c = start(m)
    assert read(c, "valid") is False


UNARY = [
    "neg", "exp", "log", "sqrt", "sq", "sin", "cos", "tan", "asin", "acos", "atan", "sinh",
    "cosh", "tanh", "asinh", "acosh", "atanh", "log1p", "expm1", "floor", "ceil", "fabs", "sign",
]  # fmt: skip
OPERATIONS: dict[str, Callable[..., object]] = {
    "neg": lambda x: -x,
    "sq": lambda x: x * x,
    "inv": lambda x: 1 / x,
    "twice": lambda x: x + x,
    "not": lambda x: ca.logic_not(x > 0),
    **{n: getattr(ca, n) for n in UNARY if n not in ("neg", "sq")},
    "atan2": ca.atan2,
    "pow": lambda x, y: ca.power(ca.fabs(x) + 0.1, y),
    "pow3": lambda x: x**3,
    "fmin": ca.fmin,
    "fmax": ca.fmax,
    "fmod": ca.fmod,
    "remainder": ca.remainder,
    "hypot": ca.hypot,
    "copysign": ca.copysign,
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
    "eq": lambda x, y: x == y,
    "ne": lambda x, y: x != y,
    "and": lambda x, y: ca.logic_and(x > 0, y > 0),
    "or": lambda x, y: ca.logic_or(x > 0, y > 0),
    "if_else": lambda x, y: ca.if_else(x > 0, y, -x),
}

BINARY = {
    "atan2", "pow", "fmin", "fmax", "fmod", "remainder", "hypot", "copysign", "lt", "le", "eq",
    "ne", "and", "or", "if_else",
}  # fmt: skip


def test_every_operation_agrees_with_casadi() -> None:
    """One model with all operations, over random and awkward inputs."""
    m = Model("operations")
    x, y = m.input("x", unit="1"), m.input("y", unit="1")
    names = list(OPERATIONS)
    for name in names:
        f = OPERATIONS[name]
        value = f(x, y) if name in BINARY else f(x)
        m.output(f"op_{name}", value, unit="1")
    c = start(m)
    casadi = equations(m).outputs
    layout = equations(m).layout
    rng = np.random.default_rng(1)
    points = [*rng.normal(size=(200, 2)), *rng.uniform(-20, 20, (200, 2))]
    points += [np.array(p) for p in [(0.0, 0.0), (1.0, -1.0), (-1.0, 2.0), (0.5, 0.5), (1e-9, 3.0)]]
    block = np.zeros(layout.offset["output"])
    for point in points:
        for name, value in zip("xy", point, strict=True):
            c.set(c.description.variables[name], value)
            block[layout.offset_of(name)] = value
        theirs = np.array(casadi(block)).ravel()
        ours = np.array([read(c, f"op_{n}") for n in names])
        np.testing.assert_allclose(
            ours, theirs, rtol=1e-12, atol=1e-300, equal_nan=True, err_msg=str((names, point))
        )


def test_generated_source_that_was_damaged_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path))
    lowered = lower(decay())
    path = generated_sources(lowered.files)[0]
    path.write_bytes(b"\xff junk")
    assert generated_sources(lowered.files)[0] == path
    assert path.read_text() == lowered.source
