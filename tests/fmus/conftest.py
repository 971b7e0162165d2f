"""Tiny declarations, exported, and driven call by call through FMPy."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.read_description import read_description
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.intrinsics.table import table1

Fmi = Literal[2, 3]


@pytest.fixture(autouse=True, scope="session")
def callbacks_of_fmpy_live_on() -> Iterator[None]:
    """Keep each logger that FMPy is given until the session ends.

    FMPy's proxy keeps the last logger's address for the whole process and calls it for each later
    FMU of FMI 1.0 and 2.0, also after the logger is gone and its memory has another use.
    """
    from fmpy import logging

    kept: list[Any] = []
    add = logging.addLoggerProxy

    def kept_and_added(pointer: Any) -> None:
        kept.append(pointer._obj)
        add(pointer)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(logging, "addLoggerProxy", kept_and_added)
        yield


def lag() -> Model:
    m = Model("lag", "A first-order lag:  dx/dt = (k u - x) / T.")
    u = m.input("u", unit="1", min=-1, max=1, description="command")
    k = m.parameter("k", 2.0, unit="N", description="gain")
    T = m.parameter("T", 0.5, unit="s", min=1e-3, tunable=False)
    x_0 = m.parameter("x_0", 1.0, unit="N", tunable=False)
    x = m.state("x", x_0, unit="N")
    m.der(x, (k * u - x) / T)
    m.output("y", x, unit="N")
    m.output("z", x + k * u, unit="N")
    return m


def linear() -> Model:
    m = Model("linear", "Three states and a matrix:  dx/dt = A x + B u.")
    u = m.input("u", 2, unit="N")
    A = m.parameter("A", [[-1.0, 2, 0], [0, -1, 0.5], [0, 0, -2]], unit="Hz")
    B = m.parameter("B", [[1.0, 0], [0, 1], [1, 1]], unit="Hz")
    x = m.state("x", m.parameter("x_0", [1.0, 2, 3], unit="N"), 3, unit="N")
    m.der(x, A @ x + B @ u)
    m.output("y", ca.vertcat(x[0] * u[1], ca.sin(x[2]) * u[0] ** 2, 3 * u[0]), unit="N")
    m.output("large", x[0] > 1, unit="1", type="Boolean")
    return m


def noisy() -> Model:
    m = Model("noisy", "A sampled reading with noise, a counter, and a switch.")
    u = m.input("u", unit="m")
    on = m.input("on", unit="1", type="Boolean", start=True)
    sigma = m.parameter("sigma", 0.1, unit="m")
    clock = m.clock("sample", "0.1")
    w = m.normal(clock, 2)
    r, n = m.discrete("r", 0.0, unit="m"), m.discrete("n", 0.0, unit="1")
    m.update(clock, r, u + sigma * (w[0] + w[1]))
    m.update(clock, n, n + 1)
    m.output("reading", r, unit="m", discrete=True)
    m.output("count", n, unit="1", type="Int32")
    m.output("valid", ca.logic_and(on, n > 0), unit="1", type="Boolean")
    return m


def root() -> Model:
    m = Model("root", "A square root, which is no number for a negative input.")
    u = m.input("u", 2, unit="1", start=1.0)
    m.output("y", ca.sqrt(u), unit="1")
    return m


def supplied() -> Model:
    m = Model("supplied", "A force from a table of voltages, which holds its edges.")
    u = m.input("u", unit="V", start=14.0, min=12, max=16, soft_min=True)
    m.output("y", table1((12.0, 16.0), (20.0, 40.0))(u), unit="N")
    return m


MODELS: dict[str, Callable[[], Model]] = {
    f.__name__: f for f in (lag, linear, noisy, root, supplied)
}


class Driven:
    """One instance of an exported FMU; names instead of value references, FMI 2 and 3 alike."""

    def __init__(self, path: Path, fmi: Fmi, folder: Path, messages: list[str]) -> None:
        from fmpy.model_description import read_model_description
        from fmpy.simulation import instantiate_fmu

        self.fmi, self.messages = fmi, messages
        self.variables = read_description(path).variables
        self.description = read_model_description(str(folder), validate=False)
        self.x = instantiate_fmu(
            str(folder),
            self.description,
            "CoSimulation",
            logger=lambda *a: messages.append(
                a[-1].decode() if isinstance(a[-1], bytes) else str(a[-1])
            ),
        )

    def type_of(self, v: Variable) -> str:
        real = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}
        return real[v.type] if self.fmi == 2 else v.type

    def get(self, name: str) -> np.ndarray:
        v = self.variables[name]
        get = getattr(self.x, "get" + self.type_of(v))
        flat = get(list(v.value_references), *([v.size] if self.fmi == 3 else []))
        return np.array(flat).reshape(v.shape)

    def set(self, name: str, value: Any) -> None:
        v = self.variables[name]
        set_values = getattr(self.x, "set" + self.type_of(v))
        set_values(list(v.value_references), np.ravel(value).tolist())

    def enter(self, start_time: float = 0.0, stop_time: float | None = None) -> None:
        if self.fmi == 2:
            self.x.setupExperiment(startTime=start_time, stopTime=stop_time)
            self.x.enterInitializationMode()
        else:
            self.x.enterInitializationMode(startTime=start_time, stopTime=stop_time)

    def start(self, start_time: float = 0.0, stop_time: float | None = None) -> Driven:
        self.enter(start_time, stop_time)
        self.x.exitInitializationMode()
        return self

    def step(self, t: float, h: float) -> None:
        self.x.doStep(currentCommunicationPoint=t, communicationStepSize=h)

    def save(self) -> Any:
        return self.x.getFMUstate() if self.fmi == 2 else self.x.getFMUState()

    def restore(self, state: Any) -> None:
        (self.x.setFMUstate if self.fmi == 2 else self.x.setFMUState)(state)

    def serialize(self, state: Any) -> bytes:
        f = self.x.serializeFMUstate if self.fmi == 2 else self.x.serializeFMUState
        return bytes(f(state))

    def deserialize(self, data: bytes) -> Any:
        f = self.x.deSerializeFMUstate if self.fmi == 2 else self.x.deserializeFMUState
        return f(data)

    def derivative(self, unknowns: list[str], knowns: list[str], seed: list[float]) -> np.ndarray:
        u, k = (
            [r for n in names for r in self.variables[n].value_references]
            for names in (unknowns, knowns)
        )
        if self.fmi == 2:
            return np.array(self.x.getDirectionalDerivative(u, k, seed))
        from ctypes import c_double, c_uint32

        n = sum(self.variables[name].size for name in unknowns)
        result = (c_double * n)()
        self.x.fmi3GetDirectionalDerivative(
            self.x.component,
            (c_uint32 * len(u))(*u),
            len(u),
            (c_uint32 * len(k))(*k),
            len(k),
            (c_double * len(seed))(*seed),
            len(seed),
            result,
            n,
        )
        return np.array(result)


@pytest.fixture(scope="session")
def declared() -> dict[str, Callable[[], Model]]:
    return MODELS


@pytest.fixture(scope="session")
def exported() -> Iterator[Callable[[str, Fmi], tuple[Path, Path]]]:
    """Return the .fmu of a declaration, and the folder it is unpacked in."""
    done: dict[tuple[str, Fmi], tuple[Path, Path]] = {}
    with tempfile.TemporaryDirectory() as scratch:

        def export(name: str, fmi: Fmi) -> tuple[Path, Path]:
            if (name, fmi) not in done:
                path = build_fmu(MODELS[name](), fmi=fmi)
                folder = Path(scratch) / f"{name}{fmi}"
                with zipfile.ZipFile(path) as archive:
                    archive.extractall(folder)
                done[name, fmi] = (path, folder)
            return done[name, fmi]

        yield export


@pytest.fixture
def instance(
    exported: Callable[[str, Fmi], tuple[Path, Path]],
) -> Iterator[Callable[[str, Fmi], Driven]]:
    """Return instances of exported FMUs, which are freed at the end."""
    live: list[Driven] = []

    def make(name: str, fmi: Fmi) -> Driven:
        path, folder = exported(name, fmi)
        live.append(Driven(path, fmi, folder, []))
        return live[-1]

    yield make
    for driven in live:
        driven.x.freeInstance()
