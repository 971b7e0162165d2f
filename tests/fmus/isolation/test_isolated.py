from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import (
    instantiate_fmu,
    instantiate_here,
    needs_own_process,
)
from uuvsim_cosim.fmus.isolation import isolated
from uuvsim_cosim.fmus.isolation.isolated import Isolated

CFmu = Callable[..., Path]
ABORT, HANG = 3, 6


def run(component: Component, **values: Any) -> Any:
    variables = component.description.variables
    for name, value in values.items():
        component.set(variables[name], value)
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    for k in range(3):
        component.do_step(k * 0.1, 0.1)
    return component.get(variables["y"])


@pytest.mark.parametrize("version", [1, 2, 3])
def test_an_isolated_component_gives_the_same_bits(version: int, c_fmu: CFmu) -> None:
    results = []
    for isolate in (False, True):
        component = instantiate_fmu(c_fmu(version), "plant", isolate=isolate)
        assert isinstance(component, Isolated) == isolate
        results.append(run(component, u=1.0, k=0.3))
        component.terminate()
        component.free()
        component.free()
    assert results[0] == results[1]


def test_a_crash_is_an_error_that_names_component_and_time(first_order_fmi2: Path) -> None:
    component = instantiate_fmu(first_order_fmi2, "plant", isolate=True)
    with pytest.raises(ComponentFailed, match=r"'plant' failed at t = 0.2 s: its process died"):
        run(component, fault=ABORT, fault_time=0.2)
    with pytest.raises(FmuError, match="after its process died"):
        component.reset()
    component.terminate()
    component.free()


def test_a_hang_is_ended_by_the_watchdog(first_order_fmi3: Path) -> None:
    component = instantiate_fmu(first_order_fmi3, "plant", isolate=True, watchdog=2.0)
    with pytest.raises(ComponentFailed, match=r"did not answer within 2\.0 s"):
        run(component, fault=HANG, fault_time=0.0)


def test_errors_of_the_fmu_cross_the_border(first_order_fmi2: Path) -> None:
    component = instantiate_fmu(first_order_fmi2, "plant", isolate=True)
    with pytest.raises(FmuError, match="T = -1 is not positive"):
        component.set(component.description.variables["T"], -1.0)
    with pytest.raises(ComponentFailed, match="too hot") as raised:
        run(component, fault=2, fault_time=0.1)
    assert raised.value.time == 0.1
    assert isinstance(component, Isolated)
    assert ("error", "step 1 at 0.100 s: too hot, y is y") in component.messages
    component.free()


def test_states_cross_the_border(first_order_fmi3: Path) -> None:
    component = instantiate_fmu(first_order_fmi3, "plant", isolate=True)
    y = component.description.variables["y"]
    run(component, u=1.0)
    state = component.get_fmu_state()
    before = component.get(y)
    component.do_step(0.3, 0.1)
    component.set_fmu_state(component.deserialize_fmu_state(component.serialize_fmu_state(state)))
    assert component.get(y) == before
    w, v = (component.description.variables[n] for n in ("w", "v"))
    np.testing.assert_array_equal(component.directional_derivative([w], [v], np.ones(3)), [2] * 3)
    component.free()


@pytest.mark.parametrize("shared", [True, False])
def test_the_stepping_loop_is_told_to_share_memory_or_to_call_python(
    shared: bool, first_order_fmi3: Path
) -> None:
    archive = read_fmu(first_order_fmi3)
    component = Isolated(
        "plant", archive.description, instantiate_here, (archive, "plant"), shared=shared
    )
    there = shared and hasattr(os, "memfd_create")
    assert component.binding().kind is (BindingKind.SHARED if there else BindingKind.CALLBACK)
    component.free()


def test_an_fmu_that_cannot_be_instantiated_says_why_and_leaves_no_process(c_fmu: CFmu) -> None:
    path = c_fmu(2, edits=[('guid="{first-order}"', 'guid="{other}"')])
    with pytest.raises(FmuError, match=r"guid \{other\} is wrong"):
        instantiate_fmu(path, "plant", isolate=True)


def test_the_second_instance_of_a_once_per_process_fmu_gets_its_own(c_fmu: CFmu) -> None:
    flag = "canBeInstantiatedOnlyOncePerProcess"
    path = c_fmu(2, edits=[(f'{flag}="false"', f'{flag}="true"')])
    components = [instantiate_fmu(path, name) for name in ("first", "second", "third")]
    assert [type(c) for c in components] == [Fmu2, Isolated, Isolated]
    assert len({run(c, u=1.0) for c in components}) == 1
    for c in components:
        c.free()


def test_python_fmus_whose_modules_share_a_name_do_not_share_a_process(
    pythonfmu2_lag: Path, tmp_path: Path
) -> None:
    import shutil
    from dataclasses import replace

    archive = read_fmu(pythonfmu2_lag)
    instantiate_fmu(archive, "lag").free()
    assert not needs_own_process(archive)
    other = tmp_path / "other"
    shutil.copytree(archive.folder, other)
    assert needs_own_process(replace(archive, folder=other))


@pytest.mark.parametrize("after", [False, True])
def test_after_an_interrupted_call_no_call_reads_its_answer(
    first_order_fmi3: Path, monkeypatch: pytest.MonkeyPatch, after: bool
) -> None:
    component = instantiate_fmu(first_order_fmi3, "plant", isolate=True)
    y = component.description.variables["y"]
    run(component, u=1.0)
    load = isolated.load_answer

    def interrupted(pipe: Any) -> Any:
        if after:
            load(pipe)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(isolated, "load_answer", interrupted)
        with pytest.raises(KeyboardInterrupt):
            component.do_step(0.3, 0.1)
    with pytest.raises(FmuError, match="was interrupted; expected a new instance"):
        component.get(y)
    component.free()


MADE = """
from pathlib import Path
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

def broken(*_):
    raise ZeroDivisionError("by zero")

def make(file, path, method):
    component = instantiate_fmu(read_fmu(Path(file)), path)
    setattr(component, method, broken)
    return component
"""


@pytest.mark.parametrize(
    ("method", "error"),
    [("do_step", ComponentFailed), ("exit_initialization_mode", FmuError)],
)
def test_an_error_of_any_kind_in_the_child_is_told_here(
    method: str, error: type[Exception], first_order_fmi3: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    (tmp_path / "made_broken.py").write_text(MADE)
    monkeypatch.syspath_prepend(str(tmp_path))
    import made_broken  # type: ignore[import-not-found]

    description = read_fmu(first_order_fmi3).description
    arguments = (str(first_order_fmi3), "plant", method)
    component = Isolated("plant", description, made_broken.make, arguments)
    with pytest.raises(error, match="ZeroDivisionError: by zero") as raised:
        run(component)
    if isinstance(raised.value, ComponentFailed):
        assert (raised.value.path, raised.value.time) == ("plant", 0.0)
    component.free()
