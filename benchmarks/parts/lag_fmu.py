"""The FMU of the benchmarks: the smallest first-order lag, written in C (lag_fmi2.c)."""

from __future__ import annotations

import zipfile
from pathlib import Path

from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, host

__all__ = ["lag_fmu"]

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="lag" guid="{lag}"
  description="dy/dt = (u - y) / T by Euler's method">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"
    canGetAndSetFMUstate="true" canSerializeFMUstate="true"/>
  <DefaultExperiment stepSize="0.01"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input" variability="continuous">
      <Real start="0"/>
    </ScalarVariable>
    <ScalarVariable name="y" valueReference="1" causality="output" variability="continuous"
      initial="exact">
      <Real start="0"/>
    </ScalarVariable>
    <ScalarVariable name="T" valueReference="2" causality="parameter" variability="fixed">
      <Real start="0.5"/>
    </ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="2" dependencies=""/></Outputs>
  </ModelStructure>
</fmiModelDescription>
"""


def lag_fmu(folder: Path) -> Path:
    """Build the FMU for this machine into a folder."""
    import fmpy

    headers = Path(fmpy.__file__).parent / "c-code"
    source = Path(__file__).with_name("lag_fmi2.c")
    library = compile_shared([source], name="lag_fmi2", include=[headers])
    path = folder / "lag.fmu"
    with zipfile.ZipFile(path, "w") as fmu:
        fmu.writestr("modelDescription.xml", DESCRIPTION)
        fmu.writestr(f"binaries/{host().fmi2}/lag{host().suffix}", library.read_bytes())
    return path
