"""Accuracy against cost of a variable communication step, beside fixed steps, in one run.

A stiff pair with a closed form: A follows B with a time constant of 1 ms, B turns back in 1 s, and
A begins 1 m away from it. The error is the largest of B over the run. With `--quarter-truck
FOLDER`, the quarter truck of the Open Simulation Platform too (libcosim,
tests/data/fmi2/quarter_truck); its error is that of the chassis' velocity, relative to its range,
against steps of 2 us. With `--libcosim PYTHON`, an interpreter that has libcosimpy, the same system
by libcosim with its ECCO. Native components or FMUs, CPU seconds of this process, medians.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import statistics
import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent, Transfer
from uuvsim_cosim.orchestrator.plan.variable_step import planned_variable_step
from uuvsim_cosim.orchestrator.system.variable_step import variable_step_of_text

FAST, SLOW = 1e-3, 1.0  # s
MATRIX = np.array([[-1.0 / FAST, 1.0 / FAST], [-1.0 / SLOW, 0.0]])  # of (a, b)
LIBCOSIM = """
import json, sys, time
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
run = CosimExecution.from_osp_config_file(sys.argv[1])
last = CosimObserver.create_last_value()
run.add_observer(last)
chassis = next(s.index for s in run.slave_infos() if s.name == b"chassis")
variable = next(v.reference for v in run.slave_variables(chassis) if v.name == b"velocity")
end, rows, spent = int(float(sys.argv[2]) * 1e9), [], 0.0
while not rows or rows[-1][0] < end:
    begin = time.process_time()
    run.step()
    spent += time.process_time() - begin
    rows.append((run.status().current_time, last.last_real_values(chassis, [variable])[0]))
print("RESULT" + json.dumps([spent, rows]))
"""


def follower(name: str, time_constant: float, start: float, sign: float) -> Model:
    m = Model(name, h_max=FAST / 20)
    u = m.input("u", unit="m")
    y = m.state("y_", start=m.parameter("y_0", start, unit="m"), unit="m")
    rate = (u - y if sign > 0 else -u) / m.parameter("T", time_constant, unit="s")
    m.der(y, rate)
    m.output("y", y, unit="m")
    return m


def pair(tick: str) -> tuple[Plan, dict[str, Model]]:
    models = {"a": follower("a", FAST, 1.0, 1.0), "b": follower("b", SLOW, 0.0, -1.0)}
    described = {name: Native(m, name) for name, m in models.items()}
    components = tuple(PlannedComponent(n, n, c.description) for n, c in described.items())
    for component in described.values():
        component.free()
    y, u = (components[0].description.variables[n] for n in ("y", "u"))
    transfers = (Transfer(0, y, (0,), 1, u, (0,)), Transfer(1, y, (0,), 0, u, (0,)))
    groups = (Group("jacobi", (0, 1)),)
    return Plan(Fraction(tick), components, transfers, groups, ((0,), (1,))), models


def of_pair(tick: str, text: str | None, until: float) -> tuple[float, float, int]:
    """Return the largest error of B [m], CPU seconds and steps."""
    plan, models = pair(tick)
    if text is not None:
        step, _ = variable_step_of_text(text)
        about = plan.tick, plan.components, plan.transfers, plan.groups
        plan = replace(plan, variable=planned_variable_step(step, *about))

    def make(planned: PlannedComponent) -> Component:
        return Native(models[planned.path], planned.path)

    with Master(plan, make) as master:
        master.initialize()
        rows, spent = [(0.0, 0.0)], 0.0
        while master.time < until:
            begin = time.process_time()
            master.step()
            spent += time.process_time() - begin
            rows.append((master.time, master.get("b", "y")))
    times, values = np.array(rows).T
    poles, modes = np.linalg.eig(MATRIX)
    shares = np.linalg.solve(modes, [1.0, 0.0]) * modes[1]
    exact = np.exp(np.outer(times, poles)) @ shares
    return float(np.abs(values - exact).max()), spent, len(rows) - 1


def of_truck(system: uuv.System, until: float) -> tuple[np.ndarray, float]:
    """Return rows of (time, the chassis' velocity), and the CPU seconds."""
    plan = flatten(system)
    with silent(), Master(plan, prepare(plan)) as master:
        master.initialize()
        rows = [(0.0, 0.0)]
        begin = time.process_time()
        while master.time < until:
            master.step()
            rows.append((master.time, master.get("chassis", "velocity")))
        return np.array(rows), time.process_time() - begin


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Keep what FMUs print away from the table."""
    kept = os.dup(1)
    with open(os.devnull, "w", encoding="utf-8") as nothing:
        os.dup2(nothing.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def by_libcosim(python: Path, file: Path, until: float) -> tuple[np.ndarray, float]:
    """Return the same rows of libcosim."""
    done = subprocess.run(
        [python, "-c", LIBCOSIM, file, str(until)], check=True, capture_output=True, text=True
    )
    spent, rows = json.loads(done.stdout.rpartition("RESULT")[2].splitlines()[0])
    return np.array([(0.0, 0.0), *((t * 1e-9, v) for t, v in rows)]), spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--until", type=float, default=2.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quarter-truck", type=Path)
    parser.add_argument("--libcosim", type=Path)
    args = parser.parse_args()
    ways: list[tuple[str, str, str | None]] = [
        (f"fixed {h} s", h, None) for h in ("0.001", "0.0001", "0.00001")
    ]
    ways += [
        (f"variable, order {order}, tolerance {tol}", "0.000001",
         f"smallest=1e-6 largest=0.1 absolute={tol} relative={tol} order={order}")
        for order in (0, 1, 2) for tol in ("1e-4", "1e-6")
    ]  # fmt: skip
    print("stiff pair                                    steps    error [m]   CPU [ms]")
    for name, tick, text in ways:
        runs = [of_pair(tick, text, args.until) for _ in range(args.repeats)]
        error, _, steps = runs[0]
        cost = 1e3 * statistics.median(r[1] for r in runs)
        print(f"{name:42} {steps:8} {error:12.2e} {cost:10.2f}")
    if args.quarter_truck is None:
        return
    file = args.quarter_truck / "OspSystemStructure.xml"
    ecco = uuv.load(file)
    finest, _ = of_truck(replace(ecco, tick="2e-6", variable_step=None), args.until)
    found = {"reference, fixed 2e-06 s": (finest, 0.0)}
    for h in ("0.0001", "0.00001"):
        found[f"fixed {float(h):g} s"] = of_truck(
            replace(ecco, tick=h, variable_step=None), args.until
        )
    found["ECCO as the file has it"] = of_truck(ecco, args.until)
    named = (("chassis.force", 0.05, 1e-4), ("wheel.in_vel", 1e-6, 1e-4))
    # These FMUs make no step if they are told that it may be undone (fmi2DoStep's fourth argument).
    for order in (0, 1):
        step = replace(
            variable_step_of_text(f"smallest=1e-5 largest=0.01 order={order} rollback=no")[0],
            tolerances=named,
        )
        found[f"by connections, order {order}"] = of_truck(
            replace(ecco, variable_step=step), args.until
        )
    if args.libcosim is not None:
        found["libcosim, ECCO"] = by_libcosim(args.libcosim, file, args.until)
    grid = np.linspace(0.0, args.until, 20001)
    exact = np.interp(grid, *finest.T)
    print("\nquarter truck                                 steps   error [%]    CPU [ms]")
    for name, (rows, cost) in found.items():
        error = np.abs(np.interp(grid, *rows.T) - exact).max() / np.ptp(exact)
        print(f"{name:42} {len(rows) - 1:8} {100 * error:11.4f} {1e3 * cost:11.1f}")
    if args.libcosim is not None:
        ours, theirs = (
            np.interp(grid, *found[n][0].T) for n in ("ECCO as the file has it", "libcosim, ECCO")
        )
        error = np.abs(ours - theirs).max() / np.ptp(theirs)
        print(f"ECCO here against libcosim: {100 * error:.6f} % of the range")


if __name__ == "__main__":
    main()
