"""Round trip of a lockstep step through the client FMU, beside Python's client, of one server.

The server is a process of its own. Each trip sets the current of the water, makes one
communication step and reads position and velocity of the hull. The FMU is called through FMPy's
low-level calls (set, do_step, get), as FMI 2.0 and FMI 3.0; the Python client steps over Zenoh in
lockstep. The self-contained FMU of the same system, which needs no server, is printed as well.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.clients.client_fmu import build_client_fmu
from uuvsim_cosim.fmus.importer.archive import unpack
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.kernels.system_fmu.system_fmu import build_system_fmu

SYSTEM, TICK = "bluerov2_hold", 0.01
INPUTS, OUTPUTS = ("hull.v_c",), ("hull.eta", "hull.nu")


def measured(trip: Callable[[int], object], count: int) -> tuple[float, float]:
    """Return median and 99th percentile [ms]."""
    taken = np.empty(count)
    for k in range(count + 20):
        begin = time.perf_counter()
        trip(k)
        taken[k % count] = time.perf_counter() - begin
    return float(np.median(taken)) * 1e3, float(np.quantile(taken, 0.99)) * 1e3


def references(variables: Any, names: Sequence[str]) -> list[int]:
    return [r for n in names for r in variables[n.replace(".", "_")].value_references]


def through_fmpy(path: Path, fmi: int, port: int | None, count: int) -> tuple[float, float]:
    from fmpy.model_description import read_model_description
    from fmpy.simulation import instantiate_fmu

    folder = str(unpack(path))
    variables = read_fmu(path).description.variables
    x = instantiate_fmu(folder, read_model_description(folder, validate=False), "CoSimulation")
    inputs, outputs = references(variables, INPUTS), references(variables, OUTPUTS)
    if port is not None:
        at = list(variables["port"].value_references)
        (x.setInteger if fmi == 2 else x.setInt32)(at, [port])
    if fmi == 2:
        x.setupExperiment()
    x.enterInitializationMode()
    x.exitInitializationMode()

    def trip(k: int) -> object:
        values = [0.1, 1e-3 * (k % 100), 0.0]
        if fmi == 2:
            x.setReal(inputs, values)
            x.doStep(k * TICK, TICK)
            return x.getReal(outputs)
        x.setFloat64(inputs, values)
        x.doStep(k * TICK, TICK)
        return x.getFloat64(outputs, 12)

    found = measured(trip, count)
    x.terminate()
    x.freeInstance()
    return found


def through_python(port: int, count: int) -> tuple[float, float]:
    with uuv.connect(port=port, lockstep=True) as client:
        return measured(
            lambda k: client.step(1, {"hull.v_c": [0.1, 1e-3 * (k % 100), 0.0]}, outputs=OUTPUTS),
            count,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=3000)
    count = parser.parse_args().count
    system = uuv.load(SYSTEM)
    built = {fmi: build_client_fmu(system, fmi=fmi, signals=OUTPUTS) for fmi in (2, 3)}  # type: ignore[arg-type]
    alone = build_system_fmu(system, fmi=2, signals=OUTPUTS)
    command = [sys.executable, "-m", "uuvsim_cosim.cli", "serve", SYSTEM, "--paused", "--no-record"]
    ports = ["--port", "0", "--tcp-port", "0", "--http-port", "-1"]
    with subprocess.Popen([*command, *ports], stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            said = ""
            while "TCP" not in said:
                said += server.stdout.readline()
            zenoh, tcp = (
                int(re.search(pattern, said)[1])  # type: ignore[index]
                for pattern in (r"Zenoh +tcp/\S+:(\d+)", r"TCP +[\d.]+:(\d+)")
            )
            rows = {
                "Python client (Zenoh)": through_python(zenoh, count),
                "client FMU, FMI 2.0": through_fmpy(built[2], 2, tcp, count),
                "client FMU, FMI 3.0": through_fmpy(built[3], 3, tcp, count),
            }
        finally:
            server.terminate()
    rows["self-contained FMU"] = through_fmpy(alone, 2, None, count)
    base = rows["Python client (Zenoh)"][0]
    print(f"{'':24}{'p50 [ms]':>10}{'p99 [ms]':>10}{'ratio':>8}")
    for name, (p50, p99) in rows.items():
        print(f"{name:24}{p50:10.4f}{p99:10.4f}{p50 / base:8.3f}")


if __name__ == "__main__":
    main()
