"""What a process of its own costs: an exchange with a component, in this process and beside it.

The same exported FMI 3.0 FMU is stepped by the master in this process, in another through shared
memory, and in another through pipes, in turn. One exchange is set, do_step and get. Medians of wall
time and of CPU time (this process's and the child's). Target: under 10 µs of wall time through
shared memory while both cores are free; `--busy` shows what it is when none is.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path

from parts.lag_model import lag

from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_here
from uuvsim_cosim.fmus.isolation.isolated import Isolated
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent

WAYS = ("in process", "shared memory", "pipes")


def made(archive: FmuArchive, way: str) -> Component:
    if way == WAYS[0]:
        return instantiate_here(archive, "lag")
    shared = way == WAYS[1]
    arguments = (archive, "lag")
    return Isolated(
        "lag", archive.description, instantiate_here, arguments, watchdog=30.0, shared=shared
    )


def ready(archive: FmuArchive, way: str) -> Master:
    description = archive.description
    part = PlannedComponent("lag", str(archive.path), description, {"u": 1.0})
    plan = Plan(Fraction(1, 100), (part,), (), (Group("jacobi", (0,)),), ((0,),))
    names = [("lag", "u")], [("lag", "y")]
    master = Master(plan, lambda _: made(archive, way), held=names[0], live=names[1])
    master.initialize()
    return master


def cpu_clock(master: Master) -> Callable[[], float]:
    """Return a clock of the CPU time of this process and the child."""
    (component,) = master.components
    child = component.process if isinstance(component, Isolated) else None
    if child is None:
        return time.process_time
    clock = ~child << 3 | 2  # Linux's number for the CPU clock of a process
    return lambda: time.process_time() + time.clock_gettime(clock)


def measure(archive: FmuArchive, steps: int, repeats: int) -> dict[str, tuple[float, float]]:
    """Return (wall, CPU) seconds of an exchange, by way."""
    wall: dict[str, list[float]] = {way: [] for way in WAYS}
    cpu: dict[str, list[float]] = {way: [] for way in WAYS}
    with ExitStack() as stack:
        masters = {way: stack.enter_context(ready(archive, way)) for way in WAYS}
        clocks = {way: cpu_clock(master) for way, master in masters.items()}
        for repeat in range(repeats + 1):  # the first is not counted
            for way, master in masters.items():
                n = steps // 20 if way == WAYS[2] else steps
                begin, begin_cpu = time.perf_counter(), clocks[way]()
                master.step(n)
                if repeat:
                    wall[way].append((time.perf_counter() - begin) / n)
                    cpu[way].append((clocks[way]() - begin_cpu) / n)
    return {way: (statistics.median(wall[way]), statistics.median(cpu[way])) for way in WAYS}


def spin() -> None:
    while True:
        pass


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--busy", action="store_true", help="keep every core busy meanwhile")
    options = parser.parse_args()
    cores = os.cpu_count() or 1
    others = [multiprocessing.Process(target=spin, daemon=True) for _ in range(cores)]
    for other in others if options.busy else ():
        other.start()
    load = f"; load {os.getloadavg()[0]:.1f} on {cores} cores" if hasattr(os, "getloadavg") else ""
    got = measure(read_fmu(Path(build_fmu(lag(), fmi=3))), options.steps, options.repeats)
    for other in others if options.busy else ():
        other.terminate()
    print(f"one exchange, medians of {options.repeats}{load}")
    print("               wall [µs]  CPU [µs]  wall ratio to shared memory")
    for way, (wall, cpu) in got.items():
        print(f"{way:13s}  {1e6 * wall:9.2f}  {1e6 * cpu:8.2f}  {wall / got[WAYS[1]][0]:9.3f}")


if __name__ == "__main__":
    main()
