"""One engine steps a chain of first-order FMUs: its CPU time and its last values, as a JSON line.

Run by peers.py in a process of its own, so that no engine disturbs, or ends, another.
"""

from __future__ import annotations

import copy
import ctypes
import itertools
import json
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

H = 0.01  # [s]
Result = tuple[float, list[float]]  # CPU seconds of stepping, last y of each FMU


def plain(fmu: Path, n: int, steps: int, record: bool) -> Result:
    import fmpy
    import numpy as np

    from uuvsim_cosim.fmus.codegen.toolchain import compile_shared

    class Row(ctypes.Structure):
        _fields_ = (
            *((name, ctypes.c_void_p) for name in ("instance", "do_step", "get", "set")),
            ("u", ctypes.c_uint32),
            ("y", ctypes.c_uint32),
        )

    source = Path(__file__).with_name("peers_loop.c")
    headers = Path(fmpy.__file__).parent / "c-code"
    library = ctypes.CDLL(str(compile_shared([source], name="peers_loop", include=[headers])))
    components = _instances(fmu, n)
    rows = []
    for c in components:
        f, v = c.binding(), c.description.variables
        addresses = (f.functions[name] for name in ("DoStep", "GetReal", "SetReal"))
        references = (v[x].value_references[0] for x in "uy")
        rows.append(Row(f.instance, *addresses, *references))
    y = (ctypes.c_double * n)()
    kept = np.zeros((steps + 1, n)) if record else None
    table = (Row * n)(*rows)
    begin = time.process_time()
    bad = library.chain_loop(
        table, n, ctypes.c_int64(steps), ctypes.c_double(H), y,
        None if kept is None else ctypes.c_void_p(kept.ctypes.data),
    )  # fmt: skip
    took = time.process_time() - begin
    assert not bad
    for c in components:
        c.free()
    return took, list(y)


def _instances(fmu: Path, n: int) -> list[Any]:
    from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

    components = [instantiate_fmu(fmu, f"lag_{i}") for i in range(n)]
    for i, c in enumerate(components):
        if i == 0:
            c.set(c.description.variables["u"], 1.0)
        c.enter_initialization_mode(0.0, None)
        c.exit_initialization_mode()
    return components


def uuvsim(fmu: Path, n: int, steps: int, record: bool) -> Result:
    from uuvsim_cosim.orchestrator.master.master import Master
    from uuvsim_cosim.orchestrator.master.prepared import prepare
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.recording.recorder import Recorder
    from uuvsim_cosim.orchestrator.system.system import System

    system = System("chain", "0.01")
    for i in range(n):
        system = system.add(f"lag_{i}", str(fmu))
    for i in range(n - 1):
        system = system.connect(f"lag_{i}.y", f"lag_{i + 1}.u")
    plan = flatten(system.set("lag_0.u", 1.0))
    with tempfile.TemporaryDirectory() as folder:
        observers = [Recorder(folder)] if record else []
        with Master(plan, prepare(plan), observers=observers) as master:
            master.initialize()
            begin = time.process_time()
            master.step(steps)
            took = time.process_time() - begin
            return took, [master.get(f"lag_{i}", "y") for i in range(n)]


def fmpy(fmu: Path, n: int, steps: int, record: bool) -> Result:
    import fmpy
    import numpy as np
    from fmpy.fmi2 import FMU2Slave

    described = fmpy.read_model_description(str(fmu))
    reference = {v.name: v.valueReference for v in described.modelVariables}
    folder = fmpy.extract(str(fmu))
    slaves = []
    for i in range(n):
        slave = FMU2Slave(
            guid=described.guid, unzipDirectory=folder, instanceName=f"lag_{i}",
            modelIdentifier=described.coSimulation.modelIdentifier,
        )  # fmt: skip
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        if i == 0:
            slave.setReal([reference["u"]], [1.0])
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slaves.append(slave)
    u, y = [reference["u"]], [reference["y"]]
    rows = np.zeros((steps + 1, n)) if record else None
    begin = time.process_time()
    for k in range(steps):
        values = [slave.getReal(y) for slave in slaves]
        if rows is not None:
            rows[k] = [v[0] for v in values]
        for slave, value in zip(slaves[1:], values[:-1], strict=True):
            slave.setReal(u, value)
        for slave in slaves:
            slave.doStep(currentCommunicationPoint=k * H, communicationStepSize=H)
    took = time.process_time() - begin
    last = [slave.getReal(y)[0] for slave in slaves]
    for slave in slaves:
        slave.terminate()
        slave.freeInstance()
    return took, last


def libcosimpy(fmu: Path, n: int, steps: int, record: bool) -> Result:
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    parts = "".join(
        f'<Simulator name="lag_{i}" source="{fmu.name}" stepSize="{H}">'
        + ('<InitialValues><InitialValue variable="u"><Real value="1.0"/></InitialValue>'
           "</InitialValues>" if i == 0 else "") + "</Simulator>"
        for i in range(n)
    )  # fmt: skip
    hops = "".join(
        f'<VariableConnection><Variable simulator="lag_{i}" name="y"/>'
        f'<Variable simulator="lag_{i + 1}" name="u"/></VariableConnection>'
        for i in range(n - 1)
    )
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / fmu.name).write_bytes(fmu.read_bytes())
        (Path(folder) / "OspSystemStructure.xml").write_text(
            '<?xml version="1.0" encoding="utf-8"?><OspSystemStructure '
            'xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">'
            f"<StartTime>0.0</StartTime><BaseStepSize>{H}</BaseStepSize><Algorithm>fixedStep"
            f"</Algorithm><Simulators>{parts}</Simulators><Connections>{hops}</Connections>"
            "</OspSystemStructure>"
        )
        execution = CosimExecution.from_osp_config_file(osp_path=folder)
        names = [f"lag_{i}" for i in range(n)]
        slaves = [execution.slave_index_from_instance_name(name) for name in names]
        variables = execution.slave_variables(slave_index=slaves[0])
        y = next(v.reference for v in variables if v.name == b"y")
        last = CosimObserver.create_last_value()
        execution.add_observer(observer=last)
        if record:
            series = CosimObserver.create_time_series(buffer_size=steps + 1)
            execution.add_observer(observer=series)
            for slave in slaves:
                assert series.start_time_series(slave, y, CosimVariableType.REAL)
        begin = time.process_time()
        execution.step(step_count=steps)
        took = time.process_time() - begin
        return took, [last.last_real_values(s, [y])[0] for s in slaves]


def ecospy(fmu: Path, n: int, steps: int, record: bool) -> Result:
    _preload_tbb()
    from ecospy import EcosSimulation, EcosSimulationStructure

    with tempfile.TemporaryDirectory() as folder:
        structure = EcosSimulationStructure()
        for i in range(n):
            structure.add_model(f"lag_{i}", str(fmu))
        for i in range(n - 1):
            structure.make_real_connection(f"lag_{i}::y", f"lag_{i + 1}::u")
        structure.add_parameter_set("initialValues", {"lag_0::u": 1.0})
        simulation = EcosSimulation(structure=structure, step_size=H)
        if record:
            names = [f"lag_{i}::y" for i in range(n)]
            simulation.add_csv_writer(str(Path(folder) / "y.csv"), identifiers=names)
        simulation.init(parameter_set="initialValues")
        begin = time.process_time()
        simulation.step(steps)
        took = time.process_time() - begin
        last = [simulation.get_real(f"lag_{i}::y") for i in range(n)]
        simulation.terminate()
        return took, last


def _preload_tbb() -> None:
    """Ecos' library needs oneTBB, which PyPI has as `tbb`."""
    for folder in (Path(sys.prefix) / "lib", Path(sys.base_prefix) / "lib"):
        for file in sorted(folder.glob("libtbb.so.12")):
            ctypes.CDLL(str(file), mode=ctypes.RTLD_GLOBAL)


def toolbox(fmu: Path, n: int, steps: int, record: bool) -> Result:
    from fmu_manipulation_toolbox.assembly import Assembly

    if record:
        raise NotImplementedError("its container records outside of the steps")
    with tempfile.TemporaryDirectory() as folder:
        names = [f"lag_{i}.fmu" for i in range(n)]
        for name in names:
            (Path(folder) / name).write_bytes(fmu.read_bytes())
        described = {
            "name": "container.fmu", "fmu": names, "step_size": H, "auto_link": False,
            "auto_input": False, "auto_output": False, "mt": False,
            "link": [[a, "y", b, "u"] for a, b in itertools.pairwise(names)],
            "input": [["u", names[0], "u"]],
            "output": [[name, "y", f"y_{i}"] for i, name in enumerate(names)],
        }  # fmt: skip
        file = Path(folder) / "container.json"
        file.write_text(json.dumps(described))
        assembly = Assembly(str(file), default_step_size=H, fmu_directory=Path(folder))
        assembly.make_fmu(fmi_version=2)
        return _container(Path(folder) / "container.fmu", n, steps)


def fmpy_container(fmu: Path, n: int, steps: int, record: bool) -> Result:
    import fmpy
    from fmpy.container_fmu.cli import create_container_fmu
    from fmpy.container_fmu.config import Component, Configuration, Connection
    from fmpy.model_description import (
        CoSimulation,
        DefaultExperiment,
        ModelDescription,
        ModelVariable,
        Unknown,
    )  # fmt: skip

    if record:
        raise NotImplementedError("a container records nothing itself")
    described = fmpy.read_model_description(str(fmu))
    inner = {v.name: v for v in described.modelVariables}
    components = [Component(f"lag_{i}", fmu, described) for i in range(n)]
    # Connections want FMI 3.0's word for the type.
    y, u_inside = (copy.copy(inner[name]) for name in "yu")
    y.type = u_inside.type = "Float64"
    u = ModelVariable(name="u", type="Real", causality="input", valueReference=0, start="1.0",
                      variability="continuous")  # fmt: skip
    outputs = [
        ModelVariable(name=f"y_{i}", type="Real", causality="output", valueReference=1 + i,
                      variability="continuous")
        for i in range(n)
    ]  # fmt: skip
    now = ModelVariable(name="time", type="Real", causality="independent", valueReference=0,
                        variability="continuous")  # fmt: skip
    outer = ModelDescription(
        fmiVersion="2.0", modelName="container", instantiationToken="{peers}",
        coSimulation=CoSimulation(modelIdentifier="container_fmu", fixedInternalStepSize=H),
        defaultExperiment=DefaultExperiment(stepSize=str(H)),
        modelVariables=[now, u, *outputs], outputs=[Unknown(variable=v) for v in outputs],
    )  # fmt: skip
    mappings = {id(u): [(components[0], inner["u"])]}
    mappings |= {id(v): [(c, inner["y"])] for v, c in zip(outputs, components, strict=True)}
    configuration = Configuration(
        parallelDoStep=False, modelDescription=outer, components=components,
        connections=[
            Connection(a, [y], b, [u_inside])
            for a, b in itertools.pairwise(components)
        ],
        variableMappings={v: mappings[id(v)] for v in [u, *outputs]},
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder) / "scratch"
        scratch.mkdir()
        create_container_fmu(configuration, scratch, Path(folder) / "container.fmu")
        return _container(Path(folder) / "container.fmu", n, steps)


def _container(file: Path, n: int, steps: int) -> Result:
    """Step a container as the one FMU that it is, from the loop in C."""
    import fmpy as library
    from fmpy.fmi2 import FMU2Slave

    described = library.read_model_description(str(file), validate=False)
    reference = {v.name: v.valueReference for v in described.modelVariables}
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        slave = FMU2Slave(
            guid=described.guid, unzipDirectory=folder, instanceName="container",
            modelIdentifier=described.coSimulation.modelIdentifier,
        )  # fmt: skip
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.setReal([reference["u"]], [1.0])
        slave.exitInitializationMode()
        do_step, component = slave.dll.fmi2DoStep, slave.component
        begin = time.process_time()
        for k in range(steps):
            do_step(component, k * H, H, 0)
        took = time.process_time() - begin
        last = slave.getReal([reference[f"y_{i}"] for i in range(n)])
        slave.terminate()
        slave.freeInstance()
        return took, list(last)


ENGINES: dict[str, Callable[[Path, int, int, bool], Result]] = {
    "C loop": plain,
    "uuvsim-cosim": uuvsim,
    "FMPy, its API from a loop in Python": fmpy,
    "FMPy, container FMU": fmpy_container,
    "fmu-manipulation-toolbox, container FMU": toolbox,
    "libcosimpy": libcosimpy,
    "ecospy": ecospy,
}


def main() -> None:
    engine, fmu, n, steps, record = sys.argv[1:]
    took, last = ENGINES[engine](Path(fmu), int(n), int(steps), record == "record")
    sys.stdout.flush()
    print("\n" + json.dumps({"cpu": took, "y": [x.hex() for x in last]}), flush=True)


if __name__ == "__main__":
    main()
