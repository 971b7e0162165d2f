from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.read_description import read_fmu

CFmu = Callable[..., Path]
NAN, ERROR, DISCARD, FATAL = 1, 2, 4, 5


@pytest.fixture
def fmu(first_order_fmi2: Path) -> Iterator[Fmu2]:
    component = Fmu2(read_fmu(first_order_fmi2), "plant")
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


def test_the_protocol_is_that_of_a_component(fmu: Fmu2) -> None:
    component: Component = fmu
    assert component.path == "plant"


def test_stepping_follows_the_equation(fmu: Fmu2) -> None:
    put(fmu, T=2.0, k=3.0)
    initialize(fmu)
    y = 0.0
    for k in range(10):
        put(fmu, u=k * 0.5)
        fmu.do_step(k * 0.1, 0.1)
        y += 0.1 * (3.0 * k * 0.5 - y) / 2.0
        assert read(fmu, "y") == y
    assert read(fmu, "steps") == 10


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("k", -0.1),
        ("fault", 3),
        ("mode", 2),
        ("on", False),
        ("label", "Tauchgerät"),
        ("v", np.array([1.0, 2.0, 3.0])),
        ("m", np.array([[1.5, 2.5], [3.5, 4.5]])),
    ],
)
def test_what_is_set_is_read_back(fmu: Fmu2, name: str, value: Any) -> None:
    put(fmu, **{name: value})
    np.testing.assert_array_equal(read(fmu, name), value)
    assert type(read(fmu, name)) is type(value)


def test_a_group_is_read_and_written_element_by_element(fmu: Fmu2) -> None:
    put(fmu, v=[1.0, 2.0, 3.0])
    initialize(fmu)
    np.testing.assert_array_equal(read(fmu, "w"), [2.0, 4.0, 6.0])


def test_what_is_read_does_not_change_later(fmu: Fmu2) -> None:
    before = read(fmu, "v")
    put(fmu, v=[1.0, 2.0, 3.0])
    np.testing.assert_array_equal(before, np.zeros(3))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("v", 1.0, r"plant\.v: shape \(\); expected \(3,\)"),
        ("v", [1.0, 2.0], r"shape \(2,\); expected \(3,\)"),
        ("k", [1.0], r"plant\.k: shape \(1,\); expected \(\)"),
        ("k", "fast", "plant.k: 'fast'; expected a number that fits Float64"),
        ("fault", 1.5, "plant.fault: 1.5; expected a number that fits Int32"),
        ("fault", 2**31, "expected a number that fits Int32"),
        ("on", 2, "plant.on: 2; expected true or false"),
        ("label", 3, "plant.label: 3; expected text"),
        ("v", [1.0, [2.0], 3.0], "plant.v: .* expected a number"),
    ],
)
def test_a_value_of_wrong_shape_or_type_is_refused(
    fmu: Fmu2, name: str, value: Any, message: str
) -> None:
    with pytest.raises(FmuError, match=message):
        put(fmu, **{name: value})


def test_a_refusal_carries_the_words_of_the_fmu(fmu: Fmu2) -> None:
    with pytest.raises(
        FmuError, match=r"plant: fmi2SetReal returned error: T = -1 is not positive"
    ):
        put(fmu, T=-1.0)


def test_messages_are_formatted_in_c_and_kept(fmu: Fmu2) -> None:
    assert fmu.messages == [("ok", "1 instance of 100 %")]


def test_a_failed_step_names_component_time_and_message(fmu: Fmu2) -> None:
    put(fmu, fault=ERROR, fault_time=0.2)
    initialize(fmu)
    fmu.do_step(0.0, 0.1)
    fmu.do_step(0.1, 0.1)
    with pytest.raises(ComponentFailed) as raised:
        fmu.do_step(0.2, 0.1)
    assert (raised.value.path, raised.value.time) == ("plant", 0.2)
    assert raised.value.reason == ("fmi2DoStep returned error: step 2 at 0.200 s: too hot, y is y")
    assert fmu.messages[-1] == ("error", "step 2 at 0.200 s: too hot, y is y")


def test_messages_are_logged_under_the_path_of_the_component(
    fmu: Fmu2, caplog: pytest.LogCaptureFixture
) -> None:
    put(fmu, fault=ERROR)
    initialize(fmu)
    with pytest.raises(ComponentFailed):
        fmu.do_step(0.0, 0.1)
    (record,) = caplog.records
    assert (record.name, record.levelname) == ("uuvsim_cosim.plant", "ERROR")
    assert record.getMessage() == "[logStatusError] step 0 at 0.000 s: too hot, y is y"


def test_the_message_of_a_step_from_c_is_in_its_error(fmu: Fmu2) -> None:
    put(fmu, fault=ERROR)
    initialize(fmu)
    binding = fmu.binding()
    c_do_step = ctypes.CFUNCTYPE(
        ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int
    )(binding.functions["DoStep"])
    status = c_do_step(binding.instance, 0.5, 0.1, 0)
    failed = fmu.failure("DoStep", status, 0.5)
    assert "too hot" in str(failed)
    assert failed.time == 0.5


def test_a_discarded_step_is_a_failure(fmu: Fmu2) -> None:
    put(fmu, fault=DISCARD)
    initialize(fmu)
    with pytest.raises(ComponentFailed, match="fmi2DoStep returned discard"):
        fmu.do_step(0.0, 0.1)


def test_after_a_fatal_error_nothing_is_called_and_free_is_safe(fmu: Fmu2) -> None:
    put(fmu, fault=FATAL)
    initialize(fmu)
    with pytest.raises(ComponentFailed, match="returned fatal"):
        fmu.do_step(0.0, 0.1)
    with pytest.raises(FmuError, match="used after a fatal error"):
        read(fmu, "y")
    fmu.terminate()
    fmu.free()
    fmu.free()


def test_a_failed_component_can_be_reset_and_run_again(fmu: Fmu2) -> None:
    put(fmu, fault=ERROR)
    initialize(fmu)
    with pytest.raises(ComponentFailed):
        fmu.do_step(0.0, 0.1)
    fmu.reset()
    put(fmu, u=1.0)
    initialize(fmu)
    fmu.do_step(0.0, 0.1)
    assert read(fmu, "y") == 0.2


def test_a_failed_component_is_freed_without_being_terminated(fmu: Fmu2) -> None:
    put(fmu, fault=ERROR)
    initialize(fmu)
    with pytest.raises(ComponentFailed):
        fmu.do_step(0.0, 0.1)
    fmu.terminate()
    assert [text for status, text in fmu.messages if status == "error"] == [
        "step 0 at 0.000 s: too hot, y is y"
    ]


def test_use_after_free_is_refused(fmu: Fmu2) -> None:
    fmu.free()
    with pytest.raises(FmuError, match="used after it was freed"):
        read(fmu, "y")


def test_a_restored_state_continues_to_the_same_bits(fmu: Fmu2) -> None:
    initialize(fmu)
    put(fmu, u=1.0)
    fmu.do_step(0.0, 0.1)
    state = fmu.get_fmu_state()
    runs = []
    for _ in range(2):
        fmu.set_fmu_state(state)
        for k in range(1, 5):
            fmu.do_step(k * 0.1, 0.1)
        runs.append(read(fmu, "y"))
    assert runs[0] == runs[1]


def test_a_state_of_initialization_mode_leads_back_there(fmu: Fmu2) -> None:
    fmu.enter_initialization_mode(0.0, None)
    state = fmu.get_fmu_state()
    fmu.exit_initialization_mode()
    fmu.do_step(0.0, 0.1)
    fmu.set_fmu_state(state)
    fmu.exit_initialization_mode()
    assert read(fmu, "steps") == 0


def test_a_serialized_state_moves_to_another_instance(first_order_fmi2: Path, fmu: Fmu2) -> None:
    initialize(fmu)
    put(fmu, u=1.0)
    fmu.do_step(0.0, 0.1)
    data = fmu.serialize_fmu_state(fmu.get_fmu_state())
    other = Fmu2(read_fmu(first_order_fmi2), "other")
    try:
        state = other.deserialize_fmu_state(data)
        other.set_fmu_state(state)
        other.do_step(0.1, 0.1)
        fmu.do_step(0.1, 0.1)
        assert read(other, "y") == read(fmu, "y")
        with pytest.raises(FmuError, match="state is of another instance"):
            fmu.set_fmu_state(state)
    finally:
        other.free()


def test_states_that_are_dropped_are_freed(fmu: Fmu2) -> None:
    initialize(fmu)
    for _ in range(10):
        fmu.get_fmu_state()
    assert len(fmu._states) <= 2


def test_states_are_refused_by_an_fmu_that_has_none(c_fmu: CFmu) -> None:
    path = c_fmu(2, edits=[('canGetAndSetFMUstate="true" canSerializeFMUstate="true"', "")])
    fmu = Fmu2(read_fmu(path), "plant")
    with pytest.raises(FmuError, match="says that it cannot copy its state"):
        fmu.get_fmu_state()
    fmu.free()


def test_directional_derivatives_are_those_of_the_equations(fmu: Fmu2) -> None:
    initialize(fmu)
    w, v = (fmu.description.variables[n] for n in ("w", "v"))
    np.testing.assert_array_equal(
        fmu.directional_derivative([w], [v], [1.0, 0.0, -2.0]), [2.0, 0.0, -4.0]
    )
    with pytest.raises(FmuError, match="a seed of 1 numbers; expected 3"):
        fmu.directional_derivative([w], [v], [1.0])


def test_functions_that_are_not_needed_may_be_missing(c_fmu: CFmu) -> None:
    fmu = Fmu2(read_fmu(c_fmu(2, flags=["-DBARE"])), "plant")
    initialize(fmu)
    put(fmu, u=1.0)
    fmu.do_step(0.0, 0.1)
    assert read(fmu, "y") == 0.2
    assert "GetInteger" not in fmu.binding().functions
    with pytest.raises(FmuError, match="does not export fmi2GetString"):
        read(fmu, "label")
    fmu.free()


def test_the_binding_gives_the_addresses_of_what_is_there(fmu: Fmu2) -> None:
    binding = fmu.binding()
    assert binding.kind is BindingKind.FMI2
    assert {"DoStep", "GetReal", "SetReal", "GetInteger", "SetBoolean"} <= set(binding.functions)
    assert all(binding.functions.values())
    assert binding.instance


def test_a_failed_instantiation_says_why(c_fmu: CFmu) -> None:
    path = c_fmu(2, edits=[('guid="{first-order}"', 'guid="{other}"')])
    with pytest.raises(FmuError, match=r"could not be instantiated: guid \{other\} is wrong"):
        Fmu2(read_fmu(path), "plant")


def test_a_missing_binary_names_those_that_there_are(c_fmu: CFmu, tmp_path: Path) -> None:
    from dataclasses import replace

    archive = read_fmu(c_fmu(2))
    (tmp_path / "binaries" / "vax").mkdir(parents=True)
    with pytest.raises(FmuError, match=r"no binary for this platform, .*; there are: vax, win64"):
        Fmu2(replace(archive, folder=tmp_path, binaries=("vax", "win64")), "plant")


def test_a_second_instance_of_a_once_per_process_fmu_is_refused(c_fmu: CFmu) -> None:
    flag = "canBeInstantiatedOnlyOncePerProcess"
    archive = read_fmu(c_fmu(2, edits=[(f'{flag}="false"', f'{flag}="true"')]))
    first = Fmu2(archive, "first")
    with pytest.raises(FmuError, match=r"second: .* only once per process; .*isolate"):
        Fmu2(archive, "second")
    first.free()
    Fmu2(archive, "second").free()


def test_an_fmu_by_pythonfmu_gives_python_up_before_the_process_exits(
    pythonfmu2_lag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import atexit

    from uuvsim_cosim.fmus.importer import fmu_library

    registered: list[Any] = []
    monkeypatch.setattr(fmu_library, "_finalized_at_exit", set())
    monkeypatch.setattr(atexit, "register", registered.append)
    for _ in range(2):
        Fmu2(read_fmu(pythonfmu2_lag), "lag").free()
    # Modules that are imported here for the first time may register functions of their own.
    names = [getattr(f, "__name__", "") for f in registered]
    assert names.count("finalizePythonInterpreter") == 1
    registered[names.index("finalizePythonInterpreter")]()
    Fmu2(read_fmu(pythonfmu2_lag), "lag").free()


def test_an_fmu_by_pythonfmu_runs_and_its_exception_is_an_error(pythonfmu2_lag: Path) -> None:
    fmu = Fmu2(read_fmu(pythonfmu2_lag), "lag")
    put(fmu, limit=0.3)
    initialize(fmu)
    put(fmu, u=1.0)
    fmu.do_step(0.0, 0.1)
    assert read(fmu, "y") == 0.2
    assert fmu.messages[-1] == ("warning", "y is 0.200")
    with pytest.raises(ComponentFailed, match="Fatal py exception"):
        fmu.do_step(0.1, 0.1)
    fmu.free()
