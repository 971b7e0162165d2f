from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.read_description import read_fmu

CFmu = Callable[..., Path]


@pytest.fixture
def fmu(first_order_fmi3: Path) -> Iterator[Fmu3]:
    component = Fmu3(read_fmu(first_order_fmi3), "plant")
    yield component
    component.free()


def initialize(component: Component) -> None:
    component.enter_initialization_mode(0.0, 10.0)
    component.exit_initialization_mode()


def put(component: Component, **values: Any) -> None:
    for name, value in values.items():
        component.set(component.description.variables[name], value)


def read(component: Component, name: str) -> Any:
    return component.get(component.description.variables[name])


def test_stepping_follows_the_equation(fmu: Fmu3) -> None:
    component: Component = fmu
    put(component, T=2.0, k=3.0)
    initialize(component)
    y = 0.0
    for k in range(10):
        put(component, u=k * 0.5)
        component.do_step(k * 0.1, 0.1)
        y += 0.1 * (3.0 * k * 0.5 - y) / 2.0
        assert read(component, "y") == y


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("float32", 0.5),
        ("int8", -128),
        ("uint8", 255),
        ("int16", -32768),
        ("uint16", 65535),
        ("int32", np.array([-(2**31), 2**31 - 1], dtype=np.int32)),
        ("uint32", 2**32 - 1),
        ("int64", -(2**63)),
        ("uint64", 2**64 - 1),
        ("boolean", True),
        ("string", np.array(["Tauchgerät", ""], dtype=object)),
        ("binary", b"\x00\xff\x00"),
    ],
)
def test_every_type_passes_through_the_fmu(fmu: Fmu3, kind: str, value: Any) -> None:
    initialize(fmu)
    put(fmu, **{f"{kind}_in": value})
    fmu.do_step(0.0, 0.1)
    for end in ("in", "out"):
        echo = read(fmu, f"{kind}_{end}")
        np.testing.assert_array_equal(echo, value)
        assert type(echo) is type(value)


@pytest.mark.parametrize(
    ("name", "value"),
    [("int8_in", 128), ("uint8_in", -1), ("uint64_in", 2**64), ("int64_in", 0.5)],
)
def test_a_number_that_does_not_fit_its_type_is_refused(fmu: Fmu3, name: str, value: Any) -> None:
    with pytest.raises(FmuError, match=f"plant.{name}: .* expected a number that fits"):
        put(fmu, **{name: value})


def test_arrays_pass_in_one_call_row_by_row(fmu: Fmu3) -> None:
    put(fmu, v=[1.0, 2.0, 3.0], m=[[5.0, 6.0], [7.0, 8.0]])
    np.testing.assert_array_equal(read(fmu, "w"), [2.0, 4.0, 6.0])
    np.testing.assert_array_equal(read(fmu, "m"), [[5.0, 6.0], [7.0, 8.0]])


def test_a_structural_parameter_keeps_its_start_value(fmu: Fmu3) -> None:
    with pytest.raises(FmuError, match=r"plant.n: a structural parameter keeps .* value 2"):
        put(fmu, n=3)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (2, "t = 0.2 s: fmi3DoStep returned error: too hot"),
        (4, "fmi3DoStep returned discard"),
        (5, "fmi3DoStep returned fatal"),
        (7, "asks to end the simulation"),
        (8, "t = 0.25 s: fmi3DoStep returned early"),
    ],
)
def test_a_failed_step_names_component_time_and_reason(fmu: Fmu3, fault: int, message: str) -> None:
    put(fmu, fault=fault, fault_time=0.2)
    initialize(fmu)
    fmu.do_step(0.0, 0.1)
    fmu.do_step(0.1, 0.1)
    with pytest.raises(ComponentFailed, match=f"'plant' failed at .*{message}"):
        fmu.do_step(0.2, 0.1)
    fmu.free()
    fmu.free()


def test_states_restore_serialize_and_move(first_order_fmi3: Path, fmu: Fmu3) -> None:
    initialize(fmu)
    put(fmu, u=1.0)
    state = fmu.get_fmu_state()
    fmu.do_step(0.0, 0.1)
    y = read(fmu, "y")
    fmu.set_fmu_state(state)
    assert read(fmu, "y") == 0.0
    other = Fmu3(read_fmu(first_order_fmi3), "other")
    other.set_fmu_state(other.deserialize_fmu_state(fmu.serialize_fmu_state(state)))
    other.do_step(0.0, 0.1)
    assert read(other, "y") == y
    other.free()


def test_reset_restores_the_start_values(fmu: Fmu3) -> None:
    put(fmu, k=7.0)
    initialize(fmu)
    fmu.reset()
    assert read(fmu, "k") == 1.0
    initialize(fmu)
    fmu.do_step(0.0, 0.1)


def test_directional_derivatives_are_those_of_the_equations(fmu: Fmu3) -> None:
    w, v = (fmu.description.variables[n] for n in ("w", "v"))
    np.testing.assert_array_equal(
        fmu.directional_derivative([w], [v], [1.0, 0.0, -2.0]), [2.0, 0.0, -4.0]
    )


def test_functions_that_are_not_needed_may_be_missing(c_fmu: CFmu) -> None:
    fmu = Fmu3(read_fmu(c_fmu(3, flags=["-DBARE"])), "plant")
    initialize(fmu)
    put(fmu, u=1.0)
    fmu.do_step(0.0, 0.1)
    assert read(fmu, "y") == 0.2
    assert "GetInt32" not in fmu.binding().functions
    fmu.free()


def test_the_binding_gives_the_addresses_of_what_is_there(fmu: Fmu3) -> None:
    binding = fmu.binding()
    assert binding.kind is BindingKind.FMI3
    assert {"DoStep", "GetFloat64", "SetFloat64", "SetBinary"} <= set(binding.functions)
    assert "GetClock" not in binding.functions


def test_a_failed_instantiation_says_why(c_fmu: CFmu) -> None:
    path = c_fmu(3, edits=[('Token="{first-order}"', 'Token="{other}"')])
    with pytest.raises(FmuError, match="could not be instantiated: the token is wrong"):
        Fmu3(read_fmu(path), "plant")


def test_an_fmu_by_pythonfmu3_runs_and_its_words_are_kept(pythonfmu3_lag: Path) -> None:
    fmu = Fmu3(read_fmu(pythonfmu3_lag), "lag")
    initialize(fmu)
    put(fmu, u=1.0)
    fmu.do_step(0.0, 0.1)
    assert read(fmu, "y") == 0.2
    assert fmu.messages[-1] == ("warning", "y is 0.200")
    fmu.terminate()
    fmu.free()


def test_controllers_by_two_tools_agree(
    pythonfmu2_controller: Path, pythonfmu3_controller: Path
) -> None:
    from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

    torques = []
    for path in (pythonfmu2_controller, pythonfmu3_controller):
        controller = instantiate_fmu(path, "controller")
        put(controller, Kp=2.0, Ki=0.1)
        initialize(controller)
        put(controller, eta_d=[1.0, 2.0, 3.0, 0.1, 0.2, 3.0], eta=[0.5, 0.0, 0.0, 0.0, 0.0, -3.0])
        controller.do_step(0.0, 0.1)
        controller.do_step(0.1, 0.1)
        torques.append(read(controller, "tau_d"))
        controller.free()
    np.testing.assert_allclose(torques[0], torques[1], rtol=1e-12)
