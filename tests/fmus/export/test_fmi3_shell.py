"""What only the FMI 3.0 shell does: arrays, adjoint derivatives, every function of the header."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from uuvsim_cosim.fmus.export.fmu_file import fmi_headers

Make = Callable[[str, int], Any]
NEVER = {"fmi3GetVersion", "fmi3FreeInstance"}


def functions() -> set[str]:
    text = (fmi_headers() / "fmi3Functions.h").read_text()
    return set(re.findall(r"^FMI3_Export \w+\s+(\w+);", text, re.M))


def test_every_function_of_the_header_is_exported(
    exported: Callable[[str, int], tuple[Path, Path]],
) -> None:
    library = ctypes.CDLL(str(next(exported("lag", 3)[1].glob("binaries/*/*"))))
    assert len(functions()) == 75
    assert [f for f in functions() if not hasattr(library, f)] == []


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        ("fmi3EnterStepMode", ()),
        ("fmi3EnterConfigurationMode", ()),
        ("fmi3EvaluateDiscreteStates", ()),
        ("fmi3GetClock", ((ctypes.c_uint32 * 1)(1), 1, (ctypes.c_bool * 1)())),
    ],
)
def test_what_is_not_supported_says_so(
    instance: Make, function: str, arguments: tuple[Any, ...]
) -> None:
    x = instance("lag", 3)
    with pytest.raises(FMICallException):
        getattr(x.x, function)(x.x.component, *arguments)
    assert x.messages == [f"{function} is not supported"]


def test_an_array_is_read_and_set_by_one_reference(instance: Make) -> None:
    x = instance("linear", 3)
    x.set("A", [[1.0, 2, 3], [4, 5, 6], [7, 8, 9]])
    assert np.array_equal(x.get("A"), [[1.0, 2, 3], [4, 5, 6], [7, 8, 9]])
    reference = x.variables["A"].value_references[0]
    with pytest.raises(FMICallException):
        x.x.getFloat64([reference + 1])
    assert "is unknown" in x.messages[-1]


def test_a_wrong_number_of_values_is_refused_with_both_numbers(instance: Make) -> None:
    x = instance("linear", 3)
    reference = x.variables["u"].value_references[0]
    for n in (1, 3):
        with pytest.raises(FMICallException):
            x.x.setFloat64([reference], [0.0] * n)
        assert x.messages[-1] == f"fmi3SetFloat64: nValues is {n}; expected 2"


def test_adjoint_and_directional_derivatives_are_transposes(instance: Make) -> None:
    x = instance("linear", 3).start()
    x.set("u", [0.3, -0.7])
    (y,), (u,) = x.variables["y"].value_references, x.variables["u"].value_references
    forward = np.column_stack([x.derivative(["y"], ["u"], s) for s in ([1.0, 0.0], [0.0, 1.0])])
    for i in range(3):
        seed, result = (ctypes.c_double * 3)(*np.eye(3)[i]), (ctypes.c_double * 2)()
        unknowns, knowns = (ctypes.c_uint32 * 1)(y), (ctypes.c_uint32 * 1)(u)
        x.x.fmi3GetAdjointDerivative(x.x.component, unknowns, 1, knowns, 1, seed, 3, result, 2)
        assert np.array_equal(result, forward[i])


def test_time_is_the_independent_variable(instance: Make) -> None:
    x = instance("lag", 3).start(start_time=2.0)
    assert x.x.getFloat64([0]) == [2.0]
    x.step(2.0, 0.5)
    assert x.x.getFloat64([0]) == [2.5]


def test_event_mode_is_refused_on_instantiation(
    exported: Callable[[str, int], tuple[Path, Path]],
) -> None:
    from fmpy.model_description import read_model_description
    from fmpy.simulation import instantiate_fmu

    folder = str(exported("lag", 3)[1])
    messages: list[Any] = []
    description = read_model_description(folder)
    with pytest.raises(Exception, match="instantiate"):
        instantiate_fmu(
            folder, description, event_mode_used=True, logger=lambda *a: messages.append(a[-1])
        )
    assert "Event Mode is not supported" in str(messages[-1])
