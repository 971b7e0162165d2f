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
from uuvsim_cosim.orchestrator.shipped.tracking import tracker


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


def one_step_a_call(name: str, n: int, repeats: int) -> None:
    """Compare 1 and 100 steps a call, by what passes through memory in a step.

    These are the poses and velocities of hulls alone ("read"), all inputs and outputs ("shared"),
    the same in whole blocks of lanes ("blocks"), and also the parameters ("own").
    """
    kernel = fuse(uuv.load(name))
    reads = [v for v in kernel.variables if v.endswith(("hull.eta", "hull.nu"))]
    batches = {"read": kernel.batch(n, reads=reads)}
    batches |= {form: kernel.batch(n) for form in ("shared", "blocks", "own")}
    _ = batches["blocks"].free_cells  # from now on, blocks are whole
    _ = batches["own"].cells  # a caller may write them, so nothing is shared
    times: dict[tuple[str, int], list[float]] = {}
    for batch in batches.values():
        batch.step(20)
    for _ in range(repeats):
        for form, batch in batches.items():
            for m, calls in ((1, 5), (100, 1)):
                begin = time.process_time()
                for _ in range(calls):
                    batch.step(m)
                times.setdefault((form, m), []).append(
                    (time.process_time() - begin) / (calls * m * n)
                )
    for form, batch in batches.items():
        one, many = (1e6 * statistics.median(times[form, m]) for m in (1, 100))
        print(
            f"  {name}, {n} environments, {form:6}: {one:.3f} us with 1 step a call, "
            f"{many:.3f} us with 100: {many / one:.0%} of the rate"
        )
        batch.close()


def convoy(k: int) -> uuv.System:
    """Return k vehicles in one pool; the first steers for a place behind its wall."""
    system = uuv.System("convoy", "0.01").add("modem", f"model:modem@m64?nodes={k}")
    for i in range(1, k + 1):
        vehicle = tracker(f"auv_{i}", tick="0.01", eta_0=(0.5 - 0.6 * i, 0, 0.5, 0, 0, 0))
        system = system.add(f"auv_{i}", vehicle).add(f"helm_{i}", "model:helm")
        for a, b in (("eta", "eta"), ("nu", "nu")):
            system = system.connect(f"auv_{i}.{a}", f"helm_{i}.{b}")
        for a in ("a", "omega"):
            system = system.connect(f"helm_{i}.{a}", f"auv_{i}.{a}")
        for n in (1, 2, 3):
            system = system.connect(f"auv_{i}.eta[{n}]", f"modem.position_{i}[{n}]")
            system = system.connect(f"auv_{i}.eta[{n}]", f"modem.x_{i}[{n}]")
        if i > 1:
            system = system.connect(f"modem.y_{i}", f"helm_{i}.position_d")
    return system.set("helm_1.position_d", [20.0, 0.0, 0.5])


def fleet(n: int, sizes: list[int], repeats: int) -> None:
    """Print how many simulated seconds pass in a second, by wall time and by CPU time of a core."""
    for k in sizes:
        kernel = fuse(convoy(k))
        count = -(-n // k)
        with kernel.batch(count, threads=2) as batch:
            batch.step(1000)  # the first vehicle is at the wall, and packets have arrived
            heard = batch.get("modem.received_2").min()
            pushed = np.abs(batch.get("auv_1.pool.tau")).max(axis=1).min()
            print(
                f"{n} vehicles, {k} in each of {count} convoys; each second vehicle has heard at "
                f"least {heard:.0f} packets, each first one is pushed with at least {pushed:.2f} N"
            )
            for per_call in (1, 10, 100):

                def run(batch: object = batch, m: int = per_call) -> None:
                    for _ in range(100 // m):
                        batch.step(m)  # type: ignore[attr-defined]

                wall = median(run, time.perf_counter, repeats)
                cpu = median(run, time.process_time, repeats)
                print(
                    f"  {per_call:3d} step(s) a call: {1 / wall:.2f} times real time by wall time, "
                    f"{2 / cpu:.2f} by CPU time of two cores: "
                    f"{'holds' if wall <= 1 else 'does not hold'}"
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
    parser.add_argument("--one-step", action="store_true", help="1 and 100 steps a call alone")
    parser.add_argument("--fleet", type=int, help="vehicles in convoys at 100 Hz alone")
    parser.add_argument("--convoys", type=int, nargs="*", default=[2, 4], help="their sizes")
    options = parser.parse_args()
    if options.fleet:
        print(processor())
        fleet(options.fleet, options.convoys, options.repeats)
        return
    print(f"{processor()}; {options.envs} environments")
    if options.one_step:
        for name in ("bluerov2_survey", "bluerov2_hold", "target_tracking"):
            for n in (1024, 16384):
                one_step_a_call(name, n, options.repeats)
        return
    measure("survey, complete", uuv.load("bluerov2_survey"), options)
    measure("hold, complete", uuv.load("bluerov2_hold"), options)
    measure("hull, T200", vehicle(), options)
    measure("hull, first order", vehicle("model:thruster"), options)
    print("calls, hold, float64:")
    calls(uuv.load("bluerov2_hold"))


if __name__ == "__main__":
    main()
