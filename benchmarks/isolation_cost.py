"""What a process of its own costs: an exchange with a component, in this process and beside it.

The same exported FMI 3.0 FMU is stepped by the master in this process, in another through shared
memory, in a third such process that is a sandbox, as WebAssembly in this process, as a component of
FMI-LS-WASM through Python, and in another process through pipes, in turn. One exchange is set,
do_step and get. Medians of wall time and of CPU time (this process's and the child's). Target:
under 10 µs of wall time through shared memory while both cores are free; `--busy` shows what it is
when none is. The start is that of a process, or an instance, until its component is made.
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
from unittest.mock import patch

from parts.lag_model import lag

from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_here
from uuvsim_cosim.fmus.isolation.confinement import rules_of
from uuvsim_cosim.fmus.isolation.grants import Grants
from uuvsim_cosim.fmus.isolation.isolated import Isolated
from uuvsim_cosim.fmus.sandbox import sandbox
from uuvsim_cosim.fmus.sandbox.sandbox import instantiate_sandboxed
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent

WAYS = ("in process", "shared memory", "sandbox", "WebAssembly", "component", "pipes")
SLOW = WAYS[4:]


def made(archive: FmuArchive, way: str) -> Component:
    if way == WAYS[0]:
        return instantiate_here(archive, "lag")
    if way == "WebAssembly":
        return instantiate_sandboxed(archive, "lag", watchdog=30.0)
    if way == "component":  # as one of another tool, without C's functions
        with patch.object(sandbox, "_MARK", b"no module has this"):
            return instantiate_sandboxed(archive, "lag", watchdog=30.0)
    rules = rules_of(Grants(), archive.folder) if way == "sandbox" else None
    arguments = (archive, "lag")
    return Isolated(
        "lag", archive.description, instantiate_here, arguments,
        watchdog=30.0, shared=way != "pipes", rules=rules,
    )  # fmt: skip


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
                n = steps // 20 if way in SLOW else steps
                begin, begin_cpu = time.perf_counter(), clocks[way]()
                master.step(n)
                if repeat:
                    wall[way].append((time.perf_counter() - begin) / n)
                    cpu[way].append((clocks[way]() - begin_cpu) / n)
    return {way: (statistics.median(wall[way]), statistics.median(cpu[way])) for way in WAYS}


def starts(archive: FmuArchive, repeats: int) -> dict[str, tuple[float, float]]:
    """Return the (wall, CPU) seconds of a start, by way."""
    found: dict[str, list[tuple[float, float]]] = {way: [] for way in WAYS[1:4]}
    for _ in range(repeats):
        for way, times in found.items():
            begin, before = time.perf_counter(), time.process_time()
            component = made(archive, way)
            wall = time.perf_counter() - begin
            cpu = time.process_time() - before
            if isinstance(component, Isolated):
                cpu += time.clock_gettime(~(component.process or 0) << 3 | 2)
            times.append((wall, cpu))
            component.free()
    medians = {
        way: [statistics.median(column) for column in zip(*times, strict=True)]
        for way, times in found.items()
    }
    return {way: (wall, cpu) for way, (wall, cpu) in medians.items()}


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
    archive = read_fmu(Path(build_fmu(lag(), fmi=3, platforms=["host", "wasm32"])))
    got = measure(archive, options.steps, options.repeats)
    started = starts(archive, options.repeats)
    for other in others if options.busy else ():
        other.terminate()
    print(f"one exchange, medians of {options.repeats}{load}")
    print("               wall [µs]  CPU [µs]  wall ratio to shared memory")
    for way, (wall, cpu) in got.items():
        print(f"{way:13s}  {1e6 * wall:9.2f}  {1e6 * cpu:8.2f}  {wall / got[WAYS[1]][0]:9.3f}")
    print("one start      wall [ms]  CPU [ms]")
    for way, (wall, cpu) in started.items():
        print(f"{way:13s}  {1e3 * wall:9.1f}  {1e3 * cpu:8.1f}")


if __name__ == "__main__":
    main()
