"""Steps of a fused kernel a second, as a ratio to the master natively in the same run.

A complete step is one communication step (0.01 s) of the whole system: the survey has current,
sensors with noise, navigation filter, guidance, controller, allocation, battery, eight thrusters
and hull. "hull, T200" is the vehicle alone under random commands, with the bench tables of its
thrusters; "hull, first order" has thrusters of one state and quadratic thrust instead. Medians of
CPU time on one core, of wall time on more. "Operations" are those of the declarations in one
complete step of one environment: Runge-Kutta steps, outputs, each sampled update by its rate.
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
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten


def vehicle(thruster: str = "model:thruster_t200") -> uuv.System:
    """Hull, wrench and eight thrusters; their commands are free."""
    system = uuv.System("vehicle", "0.01").add("hull", "model:bluerov2_heavy")
    system = system.add("wrench", "model:wrench").connect("wrench.tau", "hull.tau")
    for i in range(1, 9):
        name = f"thruster_{i}"
        system = (
            system.add(name, thruster)
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


def operations(kernel: uuv.kernels.Kernel) -> float:
    fused, total = kernel.fused, 0.0
    for m in fused.members:
        e = fused.equations[m.source]
        pieces = sum(c.pieces for c in m.cuts)
        step = 4 * pieces * e.rhs.n_instructions() + e.outputs.n_instructions()
        total += step / (1 if m.rate < 0 else fused.periods[m.rate])
        for update, period in zip(e.updates, m.periods, strict=True):
            total += update.n_instructions() / fused.periods[period]
    return total


def measure(name: str, system: uuv.System, options: argparse.Namespace) -> None:
    plan = flatten(system)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        n = 5000
        native = n / median(lambda: master.step(n), time.process_time, options.repeats)
    print(f"{name}: master {native:,.0f} steps/s")
    for dtype in options.dtypes:
        measure_kernel(name, system, options, dtype, native)


def measure_kernel(
    name: str, system: uuv.System, options: argparse.Namespace, dtype: str, native: float
) -> None:
    begin = time.perf_counter()
    kernel = fuse(system, dtype=dtype, lanes=options.lanes, baseline=options.baseline)
    built = time.perf_counter() - begin
    memory = kernel.dtype.itemsize * (kernel.fused.n_cells + kernel.fused.n_start)
    print(
        f"  {dtype}: {kernel.lanes} lanes, ready in {built:.1f} s, {memory} bytes each, "
        f"{operations(kernel):,.0f} operations a step"
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
                f"    {threads} core(s), {per_call:3d} step(s) a call: {rate:12,.0f} steps/s, "
                f"{rate / native:5.1f} times the master"
            )


def calls(system: uuv.System) -> None:
    kernel = fuse(system)
    for n in (1, 4096):
        batch = kernel.batch(n)
        repeats = 2000 if n == 1 else 20

        def cost(call: Callable[[], object], repeats: int = repeats) -> float:
            begin = time.perf_counter()
            for _ in range(repeats):
                call()
            return (time.perf_counter() - begin) / repeats * 1e6

        found = {
            "step(0)": cost(lambda b=batch: b.step(0)),  # type: ignore[misc]
            "step(1)": cost(lambda b=batch: b.step()),  # type: ignore[misc]
            "get": cost(lambda b=batch: b.get("hull.eta")),  # type: ignore[misc]
            "set": cost(lambda b=batch: b.set("hull.v_c", [0.1, 0.0, 0.0])),  # type: ignore[misc]
            "reset(seeds)": cost(lambda b=batch: b.reset(seeds=5)),  # type: ignore[misc]
        }
        print(f"  {n} environment(s): " + ", ".join(f"{k} {v:.1f} us" for k, v in found.items()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", type=int, default=1024)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--lanes", type=int)
    parser.add_argument("--dtypes", nargs="*", default=["float64", "float32"])
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--baseline", action="store_true", help="not for this processor alone")
    options = parser.parse_args()
    print(f"{processor()}; {options.envs} environments")
    measure("survey, complete", uuv.load("bluerov2_survey"), options)
    measure("hold, complete", uuv.load("bluerov2_hold"), options)
    measure("hull, T200", vehicle(), options)
    measure("hull, first order", vehicle("model:thruster"), options)
    print("calls, hold, float64:")
    calls(uuv.load("bluerov2_hold"))


if __name__ == "__main__":
    main()
