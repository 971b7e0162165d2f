"""Steps of a fused kernel a second, as a ratio to the master natively in the same run.

A complete step is one communication step (0.01 s) of the whole system: the survey has current,
sensors with noise, navigation filter, guidance, controller, allocation, battery, eight thrusters
and hull. "hull, thrusters" is the vehicle alone under random commands. Medians of CPU time on one
core, of wall time on more.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.orchestrator.flatten import flatten
from uuvsim_cosim.orchestrator.master import Master
from uuvsim_cosim.orchestrator.prepared import prepare


def vehicle() -> uuv.System:
    """Hull, wrench and eight thrusters; their commands are free."""
    system = uuv.System("vehicle", "0.01").add("hull", "model:bluerov2_heavy")
    system = system.add("wrench", "model:wrench").connect("wrench.tau", "hull.tau")
    for i in range(1, 9):
        name = f"thruster_{i}"
        system = (
            system.add(name, "model:thruster_t200")
            .connect("hull.nu_r", f"{name}.nu_r")
            .connect(f"{name}.thrust", f"wrench.thrust[{i}]")
        )
    return system


def processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((s.partition(": ")[2] for s in lines if s.startswith("model name")), "unknown")


def median(call: Callable[[], object], clock: Callable[[], float], repeats: int) -> float:
    call()
    times = []
    for _ in range(repeats):
        begin = clock()
        call()
        times.append(clock() - begin)
    return statistics.median(times)


def measure(name: str, system: uuv.System, options: argparse.Namespace) -> None:
    plan = flatten(system)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        n = 5000
        native = n / median(lambda: master.step(n), time.process_time, options.repeats)
    begin = time.perf_counter()
    kernel = fuse(system, lanes=options.lanes, baseline=options.baseline)
    built = time.perf_counter() - begin
    memory = 8 * (kernel.fused.n_cells + kernel.fused.n_start)
    print(
        f"{name}: master {native:,.0f} steps/s; kernel ready in {built:.1f} s, {memory} bytes each"
    )
    rng = np.random.default_rng(1)
    for threads in options.threads:
        clock = time.process_time if threads == 1 else time.perf_counter
        for per_call in (1, options.steps):
            with kernel.batch(options.envs, threads=threads) as batch:
                if name.startswith("hull"):
                    for i in range(1, 9):
                        u = rng.uniform(-0.6, 0.6, options.envs)
                        batch.set(f"thruster_{i}.u", u)
                batch.step(50)
                calls = options.steps // per_call

                def run(batch: object = batch, calls: int = calls, m: int = per_call) -> None:
                    for _ in range(calls):
                        batch.step(m)  # type: ignore[attr-defined]

                rate = calls * per_call * options.envs / median(run, clock, options.repeats)
            print(
                f"  {threads} core(s), {per_call:3d} step(s) a call: {rate:12,.0f} steps/s, "
                f"{rate / native:5.1f} times the master"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", type=int, default=1024)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--lanes", type=int, default=8)
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--baseline", action="store_true", help="not for this processor alone")
    options = parser.parse_args()
    print(f"{processor()}; {options.envs} environments, {options.lanes} lanes, float64")
    measure("survey, complete", uuv.load("bluerov2_survey"), options)
    measure("hold, complete", uuv.load("bluerov2_hold"), options)
    measure("hull, thrusters", vehicle(), options)


if __name__ == "__main__":
    main()
