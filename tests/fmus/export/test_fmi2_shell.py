"""What only the FMI 2.0 shell does: element references, the variadic logger, every function."""

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


def test_every_function_of_the_header_is_exported(
    exported: Callable[[str, int], tuple[Path, Path]],
) -> None:
    text = (fmi_headers() / "fmi2Functions.h").read_text()
    functions = set(re.findall(r"FMI2_Export \w+\s+(\w+);", text))
    library = ctypes.CDLL(str(next(exported("lag", 2)[1].glob("binaries/*/*"))))
    assert len(functions) == 44
    assert [f for f in functions if not hasattr(library, f)] == []


@pytest.mark.parametrize(
    ("function", "arguments"),
    [("fmi2CancelStep", ()), ("fmi2GetStatus", (0, ctypes.byref(ctypes.c_int())))],
)
def test_what_is_not_supported_says_so(
    instance: Make, function: str, arguments: tuple[Any, ...]
) -> None:
    x = instance("lag", 2)
    with pytest.raises(FMICallException):
        getattr(x.x, function)(x.x.component, *arguments)
    assert x.messages == [f"{function} is not supported"]


def test_debug_logging_of_no_category_is_accepted(instance: Make) -> None:
    x = instance("lag", 2)
    x.x.fmi2SetDebugLogging(x.x.component, 1, 0, None)  # C may pass no array for no category
    assert x.messages == []


def test_an_element_has_the_reference_of_its_array_plus_its_index(instance: Make) -> None:
    x = instance("linear", 2)
    references = x.variables["A"].value_references
    assert references == tuple(range(references[0], references[0] + 9))
    x.x.setReal([references[5]], [0.25])
    assert x.get("A")[1, 2] == 0.25


def test_integers_and_booleans_are_set_and_read(instance: Make) -> None:
    x = instance("noisy", 2)
    x.set("seed", [-3, 4])
    assert np.array_equal(x.get("seed"), [-3, 4])
    x.start()
    x.step(0.0, 0.5)
    assert x.get("valid")
    x.set("on", False)
    x.step(0.5, 0.5)
    assert not x.get("valid")


def test_a_percent_sign_in_a_message_is_no_format(instance: Make) -> None:
    x = instance("lag", 2)
    with pytest.raises(FMICallException):
        x.x.setDebugLogging(True, ["100%s %n"])
    assert '"100%s %n" is unknown' in x.messages[-1]


def test_the_last_successful_time_is_known(instance: Make) -> None:
    from fmpy.fmi2 import fmi2LastSuccessfulTime

    x = instance("lag", 2).start()
    x.step(0.0, 0.25)
    assert x.x.getRealStatus(fmi2LastSuccessfulTime) == 0.25
