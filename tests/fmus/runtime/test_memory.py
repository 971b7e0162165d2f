"""Memory that a component's C code takes comes back."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.models.declaration.library import declare

LEAST = 64  # byte, of what is taken: one leak a round is more


class _Taken(ctypes.Structure):
    """glibc's ``mallinfo2``."""

    _fields_ = [(n, ctypes.c_size_t) for n in "arena a b hblks hblkhd c d uordblks e keep".split()]  # noqa: SIM905


def taken() -> int:
    """Return the bytes that malloc has given and not got back."""
    function = ctypes.CDLL(None).mallinfo2
    function.restype = _Taken
    now: Any = function()
    return int(now.uordblks + now.hblkhd)


def grows(once: Callable[[], object], rounds: int = 2000) -> float:
    """Return by how many bytes a round leaves more memory taken."""
    for _ in range(50):
        once()
    gc.collect()
    before = taken()
    for _ in range(rounds):
        once()
    gc.collect()
    return (taken() - before) / rounds


@pytest.fixture(scope="module")
def thruster() -> Any:
    return declare("thruster_t200")


def test_a_native_component_gives_back_its_memory(thruster: Any) -> None:
    native = Native(thruster, "t")
    assert grows(lambda: native.another("t").free()) < LEAST
    native.free()


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_gives_back_its_memory(fmi: Any, thruster: Any, tmp_path: Path) -> None:
    fmu = read_fmu(build_fmu(thruster, fmi=fmi, target=tmp_path))
    assert grows(lambda: instantiate_fmu(fmu, "t").free()) < LEAST


def test_an_fmu_that_takes_its_memory_from_us_gives_it_back(first_order_fmi2: Path) -> None:
    """By fmi2CallbackAllocateMemory and fmi2CallbackFreeMemory."""
    fmu = read_fmu(first_order_fmi2)
    assert grows(lambda: instantiate_fmu(fmu, "t").free()) < LEAST


@pytest.mark.parametrize("fmi", [2, 3])
def test_directional_derivatives_give_back_their_memory(
    fmi: Any, thruster: Any, tmp_path: Path
) -> None:
    fmu = read_fmu(build_fmu(thruster, fmi=fmi, target=tmp_path))
    component: Any = instantiate_fmu(fmu, "t")
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    variables = component.description.variables
    unknowns, knowns = [variables["thrust"]], [variables["u"]]
    assert grows(lambda: component.directional_derivative(unknowns, knowns, [1.0])) < LEAST
    component.free()
