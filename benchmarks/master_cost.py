"""The master's own cost: a chain of FMUs stepped by it, as a ratio to a plain loop in C.

Both step the same exported FMI 3.0 FMUs, in the same process, in turn; medians of CPU time.
Targets: at most 1.5, and 2 with every signal recorded.

``--systems`` measures shipped systems instead: µs of CPU time a step, medians of turns, as FMUs,
native and as a kernel with one lane, beside ten of these FMUs and the loop in C over them.
"""

from __future__ import annotations

import argparse
import ctypes
import statistics
import tempfile
import time
from fractions import Fraction
from pathlib import Path

from parts.lag_model import lag

import uuvsim_cosim as uuv
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.read_description import read_description
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent, Transfer
from uuvsim_cosim.orchestrator.recording.recorder import Recorder

H = Fraction(1, 100)


class Fmu(ctypes.Structure):
    """One row of the table that plain_loop.c reads."""

    _fields_ = (
        ("instance", ctypes.c_void_p),
        ("do_step", ctypes.c_void_p),
        ("get", ctypes.c_void_p),
        ("set", ctypes.c_void_p),
        ("u", ctypes.c_uint32),
        ("y", ctypes.c_uint32),
    )


def chain(fmu: Path, n: int) -> Plan:
    description = read_description(fmu)
    u, y = description.variables["u"], description.variables["y"]
    parts = tuple(
        PlannedComponent(f"lag_{i}", str(fmu), description, {"u": 1.0} if i == 0 else {})
        for i in range(n)
    )
    hops = tuple(Transfer(i, y, (0,), i + 1, u, (0,)) for i in range(n - 1))
    return Plan(H, parts, hops, (Group("jacobi", tuple(range(n))),), tuple((i,) for i in range(n)))


def plain_library() -> ctypes.CDLL:
    import fmpy

    here = Path(__file__).parent / "parts" / "plain_loop.c"
    headers = Path(fmpy.__file__).parent / "c-code"
    return ctypes.CDLL(str(compile_shared([here], name="plain_loop", include=[headers])))


def plain_table(master: Master) -> ctypes.Array[Fmu]:
    rows = []
    for c in master.components:
        f, v = c.binding(), c.description.variables
        refs = (v["u"].value_references[0], v["y"].value_references[0])
        addresses = (f.functions[n] for n in ("DoStep", "GetFloat64", "SetFloat64"))
        rows.append(Fmu(f.instance, *addresses, *refs))
    return (Fmu * len(rows))(*rows)


def measure(fmu: Path, n: int, steps: int, repeats: int) -> tuple[float, ...]:
    """Return CPU seconds: plain loop, master, master with recorder, and the recorder's closing."""
    plan = chain(fmu, n)
    library = plain_library()
    times: list[list[float]] = [[], [], [], []]
    for _ in range(repeats):
        with (
            tempfile.TemporaryDirectory() as folder,
            ready(plan) as by_hand,
            ready(plan) as ours,
            ready(plan, Recorder(folder)) as recorded,
        ):
            table, y = plain_table(by_hand), (ctypes.c_double * n)()
            begin = time.process_time()
            bad = library.plain_loop(table, n, ctypes.c_int64(steps), ctypes.c_double(float(H)), y)
            times[0].append(time.process_time() - begin)
            assert not bad
            for master, kept in ((ours, times[1]), (recorded, times[2])):
                begin = time.process_time()
                master.step(steps)
                kept.append(time.process_time() - begin)
            last = by_hand.components[-1]
            assert last.get(last.description.variables["y"]) == ours.get(last.path, "y")
            begin = time.process_time()
            recorded.terminate()
            times[3].append(time.process_time() - begin)
    return tuple(statistics.median(t) for t in times)


GOALS = {"bluerov2_hold": 1.2, "bluerov2_survey": 2.5}  # µs a step, as FMUs


def measure_systems(fmu: Path, steps: int, repeats: int) -> None:
    """Print the CPU time of a step of each shipped system [µs], and whether it holds its goal."""
    for name in ("bluerov2_hold", "bluerov2_survey", "target_tracking"):
        system = uuv.load(name)
        plan = flatten(system)
        with Master(plan, prepare(plan)) as fmus, Master(plan, prepare(plan, "native")) as native:
            fmus.initialize()
            native.initialize()
            batch = uuv.fuse(system).batch(1)
            kinds = {"FMUs": fmus.step, "native": native.step, "kernel": batch.step}
            times: dict[str, list[float]] = {kind: [] for kind in kinds}
            for _ in range(repeats):
                for kind, step in kinds.items():
                    begin = time.process_time()
                    step(steps)
                    times[kind].append(1e6 * (time.process_time() - begin) / steps)
        medians = {kind: statistics.median(t) for kind, t in times.items()}
        goal = GOALS.get(name)
        holds = "holds" if goal is not None and medians["FMUs"] <= goal else "does not hold"
        verdict = "" if goal is None else f"   goal {goal} as FMUs: {holds}"
        print(f"{name:20}" + "".join(f"{m:9.2f}" for m in medians.values()) + verdict, flush=True)
    plain, ours, *_ = (1e6 * t / steps for t in measure(fmu, 10, steps, repeats))
    print(f"{'ten lags':20}{ours:9.2f}        -        -   loop in C {plain:.2f}")


def ready(plan: Plan, *observers: Recorder) -> Master:
    master = Master(plan, lambda p: instantiate_fmu(Path(p.source), p.path), observers=observers)
    master.initialize()
    return master


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--systems", action="store_true", help="steps of shipped systems")
    options = parser.parse_args()
    fmu = build_fmu(lag(), fmi=3)
    if options.systems:
        print(f"{'[µs/step]':20}     FMUs   native   kernel")
        measure_systems(fmu, options.steps, options.repeats)
        return
    print(" FMUs  plain [ns/step]  master  recording  recording, closed")
    for n in (2, 10, 50):
        plain, ours, recorded, closing = measure(fmu, n, options.steps, options.repeats)
        each = 1e9 * plain / (n * options.steps)
        ratios = (ours / plain, recorded / plain, (recorded + closing) / plain)
        print(f"{n:5d}  {each:15.1f}  {ratios[0]:6.2f}  {ratios[1]:9.2f}  {ratios[2]:17.2f}")


if __name__ == "__main__":
    main()
