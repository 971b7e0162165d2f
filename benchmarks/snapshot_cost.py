"""Snapshot, restore and reset in memory, as ratios to a memcpy of the same bytes, and to FMPy.

A system of twelve native components (hull, wrench, allocation, controller, eight thrusters), and
the same as FMUs. FMPy gets and sets the state of one FMU; the same FMU alone stands beside.
Medians of wall time.
"""

from __future__ import annotations

import argparse
import ctypes
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import uuvsim_cosim as uuv
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten


def twelve() -> uuv.System:
    system = (
        uuv.System("twelve", "0.01")
        .add("hull", "model:bluerov2_heavy")
        .add("controller", "model:controller?vehicle=bluerov2_heavy")
        .add("allocation", "model:allocation?vehicle=bluerov2_heavy")
        .add("wrench", "model:wrench")
        .connect("wrench.tau", "hull.tau")
        .connect("hull.eta", "controller.eta")
        .connect("hull.nu", "controller.nu")
        .connect("controller.tau_d", "allocation.tau_d")
    )
    for i in range(1, 9):
        name = f"thruster_{i}"
        system = (
            system.add(name, "model:thruster_t200")
            .connect(f"allocation.u[{i}]", f"{name}.u")
            .connect("hull.nu_r", f"{name}.nu_r")
            .connect(f"{name}.thrust", f"wrench.thrust[{i}]")
        )
    return system


def microseconds(call: Callable[[], Any], repeats: int) -> float:
    call()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return 1e6 * statistics.median(times)


def of_master(plan: Any, backend: Any, repeats: int) -> tuple[float, float, float, int]:
    with Master(plan, prepare(plan, backend)) as master:
        master.initialize()
        master.step(50)
        kept = master.snapshot()
        return (
            microseconds(master.snapshot, repeats),
            microseconds(lambda: master.restore(kept), repeats),
            microseconds(lambda: master.reset(seed=3), max(1, repeats // 10)),
            len(kept.image or b""),
        )


def of_fmpy(fmu: Path, repeats: int) -> tuple[float, float]:
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    described = fmpy.read_model_description(str(fmu))
    slave = FMU2Slave(
        guid=described.guid, unzipDirectory=fmpy.extract(str(fmu)), instanceName="fmu",
        modelIdentifier=described.coSimulation.modelIdentifier,
    )  # fmt: skip
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()

    def get() -> None:
        slave.freeFMUState(slave.getFMUState())

    kept = slave.getFMUState()
    result = microseconds(get, repeats), microseconds(lambda: slave.setFMUState(kept), repeats)
    slave.freeFMUState(kept)
    slave.terminate()
    slave.freeInstance()
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=2000)
    repeats = parser.parse_args().repeats
    plan = flatten(twelve())
    native = of_master(plan, "native", repeats)
    size = native[3]
    a, b = ctypes.create_string_buffer(size), ctypes.create_string_buffer(size)
    copy = microseconds(lambda: ctypes.memmove(a, b, size), repeats)
    fmus = of_master(plan, "fmu", max(10, repeats // 10))
    fmu = build_fmu(declare("thruster_t200"), fmi=2)
    alone = flatten(uuv.System("one", "0.01").add("thruster", str(fmu)))
    ours = of_master(alone, "fmu", repeats)
    theirs = of_fmpy(fmu, repeats)
    print(f"{'[us]':38s} snapshot  restore    reset")
    rows = (
        (f"{len(plan.components)} native components, {size} bytes", *native[:3]),
        (f"the same {len(plan.components)} as FMUs", *fmus[:3]),
        ("one FMU, a system of its own", *ours[:3]),
        ("the same FMU by FMPy, without slots", *theirs),
    )
    for name, *values in rows:
        print(f"{name:38s} {' '.join(f'{x:8.2f}' for x in values)}")
    print(f"{f'memcpy of {size} bytes by ctypes':38s} {copy:8.2f}")
    print(f"ratio to memcpy: snapshot {native[0] / copy:.1f}, restore {native[1] / copy:.1f}")
    print(f"ratio to FMPy: snapshot {ours[0] / theirs[0]:.2f}, restore {ours[1] / theirs[1]:.2f}")


if __name__ == "__main__":
    main()
