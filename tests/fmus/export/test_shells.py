"""What both FMI shells promise, called through FMPy."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from uuvsim_cosim.fmus.codegen.lowering import lower
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import compile_fmu
from uuvsim_cosim.models.declaration.model import Model

Make = Callable[[str, int], Any]
both = pytest.mark.parametrize("fmi", [2, 3])


def native(model: Model, library: Path | None = None) -> Native:
    c = Native(model, "native", library)
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    return c


@both
@pytest.mark.parametrize("name", ["lag", "linear", "noisy"])
def test_fmu_and_native_component_agree_to_the_last_bit(
    instance: Make, declared: dict[str, Callable[[], Model]], name: str, fmi: int
) -> None:
    fmu = instance(name, fmi).start()
    other = native(declared[name]())
    variables = other.description.variables
    for k in range(50):
        u = np.sin(0.1 * k + np.arange(variables["u"].size)).reshape(variables["u"].shape)
        fmu.set("u", u)
        other.set(variables["u"], u)
        fmu.step(k * 0.03, 0.03)
        other.do_step(k * 0.03, 0.03)
        for v in other.description.of("output", "local"):
            assert np.array_equal(fmu.get(v.name), other.get(v)), (v.name, k)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here; zig alone is promised")
@pytest.mark.parametrize("name", ["lag", "linear", "noisy"])
def test_gcc_and_zig_agree_to_the_last_bit(
    declared: dict[str, Callable[[], Model]], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = declared[name]()
    libraries = []
    for cc in ("", "gcc"):
        monkeypatch.setenv("CC", cc)
        libraries.append(compile_fmu(lower(model)))
    assert libraries[0] != libraries[1]
    components = [native(model, library) for library in libraries]
    u = model.variables["u"]
    for k in range(50):
        value = np.cos(0.1 * k + np.arange(u.size)).reshape(u.shape)
        for c in components:
            c.set(c.description.variables["u"], value)
            c.do_step(k * 0.03, 0.03)
        for v in components[0].description.of("output", "local"):
            assert np.array_equal(components[0].get(v), components[1].get(v)), (v.name, k)


@both
def test_calls_in_a_wrong_state_name_the_function_and_the_state(instance: Make, fmi: int) -> None:
    x = instance("lag", fmi)
    with pytest.raises(FMICallException):
        x.step(0.0, 0.1)
    assert x.messages == [
        f"fmi{fmi}DoStep is not allowed in state Instantiated; expected Step Mode"
    ]


@both
def test_a_value_out_of_its_bounds_is_refused_with_name_value_and_bounds(
    instance: Make, fmi: int
) -> None:
    x = instance("lag", fmi).start()
    with pytest.raises(FMICallException):
        x.set("u", 1.5)
    assert '"u" = 1.5; expected a value in [-1, 1]' in x.messages[-1]
    assert x.get("u") == 0.0


@both
def test_the_first_value_below_a_soft_minimum_is_reported_and_used(
    instance: Make, fmi: int
) -> None:
    x = instance("supplied", fmi)
    x.set("u", 0.0)  # replaced before anything is computed
    x.enter()
    x.set("u", 0.0)
    x.set("u", 13.0)
    x.x.exitInitializationMode()
    assert x.messages == []
    x.step(0.0, 0.5)
    x.set("u", 11.5)
    assert '"u" = 11.5 at t = 0.5 s; expected a value in [12, 16]' in x.messages[-1]
    x.set("u", 10.0)
    x.step(0.5, 0.5)
    assert (len(x.messages), x.get("u"), x.get("y")) == (1, 10.0, 20.0)
    with pytest.raises(FMICallException):
        x.set("u", 16.5)
    assert '"u" = 16.5; expected a value in [12, 16]' in x.messages[-1]


@both
def test_initialization_that_ends_below_a_soft_minimum_is_reported(
    instance: Make, fmi: int
) -> None:
    x = instance("supplied", fmi)
    x.set("u", 0.0)
    x.start()
    assert '"u" = 0 at t = 0 s; expected a value in [12, 16]' in x.messages[0]


@both
def test_a_value_that_is_not_finite_is_refused(instance: Make, fmi: int) -> None:
    x = instance("linear", fmi).start()
    with pytest.raises(FMICallException):
        x.set("u", [1.0, np.nan])
    assert '"u[2]"' in x.messages[-1]
    assert "finite" in x.messages[-1]
    assert np.array_equal(x.get("u"), [0.0, 0.0])  # all or nothing


@both
def test_fixed_parameters_are_settable_only_before_initialization_ends(
    instance: Make, fmi: int
) -> None:
    x = instance("lag", fmi)
    x.set("x_0", 3.0)
    x.enter()
    x.set("x_0", 5.0)
    x.x.exitInitializationMode()
    assert x.get("y") == 5.0
    with pytest.raises(FMICallException):
        x.set("x_0", 6.0)
    assert '"x_0"' in x.messages[-1]


@both
def test_tunable_parameters_act_between_steps(instance: Make, fmi: int) -> None:
    x = instance("lag", fmi).start()
    x.set("u", 1.0)
    x.set("k", 7.0)
    x.step(0.0, 100.0)
    assert x.get("y") == pytest.approx(7.0)


@both
def test_outputs_and_states_cannot_be_set(instance: Make, fmi: int) -> None:
    x = instance("lag", fmi)
    for name, kind in (("y", "an output"), ("x", "a local")):
        with pytest.raises(FMICallException):
            x.set(name, 1.0)
        assert f'"{name}" is {kind}' in x.messages[-1]


@both
def test_unknown_and_wrongly_typed_references_are_named(instance: Make, fmi: int) -> None:
    x = instance("noisy", fmi).start()
    get = x.x.getReal if fmi == 2 else x.x.getFloat64
    with pytest.raises(FMICallException):
        get([99999])
    assert "value reference 99999 is unknown" in x.messages[-1]
    with pytest.raises(FMICallException):
        get([x.variables["valid"].value_references[0]])
    assert 'the Boolean variable "valid"; expected a Float64' in x.messages[-1]


@both
@pytest.mark.parametrize("h", [-0.1, np.nan, np.inf])
def test_a_wrong_step_size_is_refused(instance: Make, fmi: int, h: float) -> None:
    x = instance("lag", fmi).start()
    with pytest.raises(FMICallException):
        x.step(0.0, h)
    assert "communicationStepSize" in x.messages[-1]
    x.step(0.0, 0.1)


@both
def test_a_step_from_another_time_is_refused(instance: Make, fmi: int) -> None:
    x = instance("lag", fmi).start()
    x.step(0.0, 0.1)
    with pytest.raises(FMICallException):
        x.step(0.5, 0.1)
    assert "expected 0.1" in x.messages[-1]


@both
def test_a_step_beyond_the_stop_time_is_refused(instance: Make, fmi: int) -> None:
    x = instance("lag", fmi).start(stop_time=0.2)
    x.step(0.0, 0.2)
    with pytest.raises(FMICallException):
        x.step(0.2, 0.1)
    assert "stopTime" in x.messages[-1]


@both
def test_nan_in_a_step_is_an_error_that_names_the_variable(instance: Make, fmi: int) -> None:
    x = instance("root", fmi).start()
    good = x.save()
    x.set("u", [1.0, -1.0])
    with pytest.raises(FMICallException):
        x.step(0.0, 0.1)
    assert '"y[2]" became' in x.messages[-1]
    assert "t = 0.1 s" in x.messages[-1]
    with pytest.raises(FMICallException):
        x.step(0.1, 0.1)
    x.restore(good)
    x.step(0.0, 0.1)


@both
def test_a_state_repeats_a_run_to_the_last_bit_random_counters_included(
    instance: Make, fmi: int
) -> None:
    x = instance("noisy", fmi).start()
    for k in range(7):
        x.step(k * 0.1, 0.1)
    data = x.serialize(x.save())

    def run(y: Any) -> list[float]:
        values = []
        for k in range(7, 20):
            y.step(k * 0.1, 0.1)
            values.append(float(y.get("reading")))
        return values

    first = run(x)
    other = instance("noisy", fmi)
    other.restore(other.deserialize(data))
    assert run(other) == first
    assert len(set(first)) == len(first)
    assert other.get("count") == 20


@both
def test_a_snapshot_taken_in_initialization_mode_goes_back_to_it(instance: Make, fmi: int) -> None:
    x = instance("noisy", fmi)
    x.enter()
    state = x.save()
    x.x.exitInitializationMode()
    x.step(0.0, 1.0)
    x.restore(state)
    x.set("seed", [1, 2])
    x.x.exitInitializationMode()
    x.step(0.0, 1.0)
    assert x.get("count") == 10


@both
def test_states_of_others_and_damaged_ones_are_refused(instance: Make, fmi: int) -> None:
    lag, noisy = instance("lag", fmi), instance("noisy", fmi)
    data = lag.serialize(lag.save())
    damaged = data[:-9] + bytes([data[-9] ^ 1]) + data[-8:]
    for x, wrong, words in (
        (noisy, data, "bytes; expected"),
        (lag, data[:-1], "bytes; expected"),
        (lag, damaged, "damaged"),
        (lag, b"x" * len(data), "not a state"),
    ):
        for y in (lag, noisy):
            y.messages.clear()
        with pytest.raises(FMICallException):
            x.deserialize(wrong)
        # FMPy gives all messages of FMI 2 to the logger that came last.
        assert words in str(lag.messages + noisy.messages)


@both
def test_reset_goes_back_to_start_values(instance: Make, fmi: int) -> None:
    x = instance("lag", fmi)
    x.set("k", 9.0)
    x.start()
    x.set("u", 1.0)
    x.step(0.0, 1.0)
    x.x.reset()
    assert [float(x.get(n)) for n in ("u", "k")] == [0.0, 2.0]
    x.start()
    assert x.get("y") == 1.0


@both
def test_a_hundred_instances_do_not_see_each_other(instance: Make, fmi: int) -> None:
    xs = [instance("lag", fmi) for _ in range(100)]
    for i, x in enumerate(xs):
        x.set("x_0", float(i))
        x.start()
    for x in xs:
        x.step(0.0, 0.1)
    values = [float(x.get("y")) for x in xs]
    assert values == pytest.approx(np.arange(100) * np.exp(-0.2), abs=1e-6)


@both
def test_a_late_start_time_skips_earlier_samples(instance: Make, fmi: int) -> None:
    x = instance("noisy", fmi).start(start_time=100.05)
    x.step(100.05, 0.1)
    assert x.get("count") == 1


@both
def test_directional_derivatives_are_those_of_the_equations(instance: Make, fmi: int) -> None:
    x = instance("linear", fmi).start()
    u = np.array([0.3, -0.7])
    x.set("u", u)
    state = x.get("x")
    expected = np.array([[0, state[0]], [2 * u[0] * np.sin(state[2]), 0], [3, 0]])
    for seed in ([1.0, 0.0], [0.0, 1.0], [0.4, -2.0]):
        found = x.derivative(["y"], ["u"], seed)
        assert found == pytest.approx(expected @ np.array(seed), abs=1e-14)


@both
def test_derivatives_to_states_and_parameters_are_refused_by_name(instance: Make, fmi: int) -> None:
    x = instance("lag", fmi).start()
    with pytest.raises(FMICallException):
        x.derivative(["y"], ["k"], [1.0])
    assert '"k" is not a known; expected an input' in x.messages[-1]


@both
def test_a_wrong_token_is_refused(
    exported: Callable[[str, int], tuple[Path, Path]], fmi: int
) -> None:
    from fmpy.model_description import read_model_description
    from fmpy.simulation import instantiate_fmu

    _, folder = exported("lag", fmi)
    description = read_model_description(str(folder), validate=False)
    description.guid = "another"
    messages: list[Any] = []
    with pytest.raises(Exception, match="nstantiate"):
        instantiate_fmu(
            str(folder), description, "CoSimulation", logger=lambda *a: messages.append(a[-1])
        )
    assert 'token "another"' in str(messages[-1])


@pytest.mark.skipif(os.name != "posix", reason="RTLD_GLOBAL is a matter of ELF")
def test_two_components_loaded_globally_are_not_mixed_up(
    exported: Callable[[str, int], tuple[Path, Path]],
) -> None:
    import ctypes

    names = ("lag", "noisy")
    libraries = [
        ctypes.CDLL(str(next(exported(n, 3)[1].glob("binaries/*/*"))), mode=ctypes.RTLD_GLOBAL)
        for n in names
    ]
    found = []
    for library in libraries:
        library.uuv_get_component.restype = ctypes.POINTER(ctypes.c_char_p)
        found.append(library.uuv_get_component()[0].decode())
    assert tuple(found) == names
