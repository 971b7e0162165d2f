"""Beside FMPy: a chain of three first-order FMUs has the same bits, step by step."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import pytest
from fmpy import fmi1, fmi2
from fmpy.fmi1 import FMU1Slave
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.master.master import Master

STEPS, H = 20, 0.01


def lag() -> Model:
    m = Model("lag")
    u = m.input("u", unit="1")
    T = m.parameter("T", 0.5, unit="s")
    y = m.state("x", unit="1")
    m.der(y, (u - y) / T)
    m.output("y", y, unit="1")
    return m


PATHS = "abc"


def callbacks(version: int) -> Any:
    """FMPy's own go through one logger for all instances, which another test may have freed."""
    name, types = f"fmi{version}Callback", {1: fmi1, 2: fmi2}[version]
    own = getattr(types, f"{name}Functions")()
    own.logger = getattr(types, f"{name}LoggerTYPE")(lambda *words: None)
    own.allocateMemory = getattr(types, f"{name}AllocateMemoryTYPE")(fmpy.calloc)
    own.freeMemory = getattr(types, f"{name}FreeMemoryTYPE")(fmpy.free)
    return own


def by_fmpy(fmu: Path, version: int) -> list[list[float]]:
    """Read all, set all, step all: what a Jacobi master does, through FMPy's calls alone."""
    described = fmpy.read_model_description(str(fmu))
    u, y = ([v.valueReference for v in described.modelVariables if v.name == n] for n in "uy")
    folder = fmpy.extract(str(fmu))
    kind: Any = {1: FMU1Slave, 2: FMU2Slave, 3: FMU3Slave}[version]
    fmus = []
    for path in PATHS:
        f = kind(guid=described.guid, unzipDirectory=folder, instanceName=path,
                 modelIdentifier=described.coSimulation.modelIdentifier)  # fmt: skip
        if version == 1:
            f.instantiate(functions=callbacks(1))
        elif version == 2:
            f.instantiate(callbacks=callbacks(2))
            f.setupExperiment(startTime=0.0)
        else:
            f.instantiate()
        fmus.append(f)
    get, put = ("getFloat64", "setFloat64") if version == 3 else ("getReal", "setReal")
    getattr(fmus[0], put)(u, [1.0])
    if version == 1:
        for f in fmus:
            f.initialize()
    else:
        for f in fmus:
            f.enterInitializationMode()
        for f in fmus:
            f.exitInitializationMode()
    seen = []
    for k in range(STEPS):
        values = [getattr(f, get)(y) for f in fmus]
        for f, value in zip(fmus[1:], values, strict=False):
            getattr(f, put)(u, value)
        for f in fmus:
            f.doStep(k * H, H)
        seen.append([getattr(f, get)(y)[0] for f in fmus])
    for f in fmus:
        f.terminate()
        f.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)
    return seen


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_chain_of_three_fmus_has_the_bits_of_fmpy(
    version: int, c_fmu: Callable[..., Path], wired: Any
) -> None:
    # FMPy binds every function of FMI 3.0, which the hand-written FMU of that version has not.
    fmu = build_fmu(lag(), fmi=3) if version == 3 else c_fmu(version)
    makers = {p: lambda path: instantiate_fmu(fmu, path) for p in PATHS}
    seen = []
    with Master(*wired(makers, ["a.y -> b.u", "b.y -> c.u"], start={"a": {"u": 1.0}})) as master:
        master.initialize()
        for _ in range(STEPS):
            master.step()
            seen.append([master.get(p, "y") for p in PATHS])
    assert seen[-1][-1] > 0.0
    assert seen == by_fmpy(fmu, version)
