"""How the cost of each stage grows with the size of a system: CPU seconds, and slopes.

A chain of N first-order lags (one FMU) is built, flattened, initialised and written; a convoy of K
surveying vehicles, each of which sends its position to the one behind it, is planned. A fleet of K
surveying vehicles without links is instantiated natively, and fused with an empty and a full cache.
CPU seconds include those of the compiler. The slope is that of a straight line through the
logarithms: 1 means proportional to the size.

A survey of T seconds is run, reported and exported, each in a process of its own: CPU seconds with
the start of the process, and peak memory in MB (Linux only).

``--figure FILE.svg`` draws the stages over the size, with the figures from before a change.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib.util
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import casadi as ca
from parts.growth_picture import picture, slope
from parts.lag_model import lag

import uuvsim_cosim as uuv
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.vectors import ETA
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.loop_delays import loop_delays

Seconds = dict[str, dict[int, float]]  # of each stage, by size


def cpu_seconds() -> float:
    """Return the CPU time of this process and of the compilers that it has run [s]."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


@contextlib.contextmanager
def stage(found: Seconds, name: str, size: int) -> Iterator[None]:
    """Add the CPU seconds of the block to the result."""
    gc.collect()
    begin = cpu_seconds()
    yield
    found.setdefault(name, {})[size] = cpu_seconds() - begin


def chain(found: Seconds, fmu: Path, n: int) -> None:
    """Measure a chain of n components."""
    with stage(found, "build: add, connect, set", n):
        system = uuv.System("chain", tick="0.01")
        for i in range(n):
            system = system.add(f"lag_{i}", str(fmu))
            if i:
                system = system.connect(f"lag_{i - 1}.y", f"lag_{i}.u")
            system = system.set(f"lag_{i}.T", 0.4)
    with stage(found, "flatten", n):
        plan = flatten(system)
    with stage(found, "loop delays of the chain", n):
        loop_delays(plan)
    with stage(found, "write .ssd, read it again", n), tempfile.TemporaryDirectory() as folder:
        system.write(Path(folder) / "chain.ssd")
        uuv.load(Path(folder) / "chain.ssd")
    with stage(found, "instantiate, initialise", n):
        master = Master(plan, prepare(plan))
        master.initialize()
    with stage(found, "100 steps", n):
        master.run_until(1.0)
    master.free()


def convoy(found: Seconds, vehicle: uuv.System, k: int) -> None:
    """Measure a ring of k vehicles, coupled by their guidance."""
    with stage(found, "convoy: build", k):
        system = uuv.System("convoy", tick=vehicle.tick)
        for i in range(k):
            system = system.add(f"auv_{i + 1}", vehicle)
        for i in range(k):
            system = system.connect(f"auv_{i + 1}.eta", f"auv_{(i + 1) % k + 1}.eta_ahead")
    with stage(found, "convoy: flatten", k):
        plan = flatten(system)
    with stage(found, "convoy: loop delays", k):
        loop_delays(plan)


# A process can inherit the peak of its parent in `ru_maxrss`, but not in VmHWM.
MEASURED = """
import json, sys, time
from uuvsim_cosim.cli import status_of
status = status_of(sys.argv[2:])
with open("/proc/self/status") as lines:
    peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
with open(sys.argv[1], "w") as out:
    json.dump([time.process_time(), peak / 1024], out)
sys.exit(status)
"""


def command(found: Seconds, name: str, size: int, *words: str) -> None:
    """Run `uuvsim` with these words in another process; add its CPU seconds and peak memory."""
    with tempfile.TemporaryDirectory() as folder:
        figures = Path(folder) / "figures.json"
        line = [sys.executable, "-c", MEASURED, str(figures), *words]
        subprocess.run(line, check=True, stdout=subprocess.DEVNULL)
        cpu, peak = json.loads(figures.read_text())
    found.setdefault(f"{name}: CPU", {})[size] = cpu
    found.setdefault(f"{name}: peak MB", {})[size] = peak


def recording(found: Seconds, length: int) -> None:
    """Measure a survey of a length [s]: run, report and exports."""
    kinds = ["csv", "mat", "mcap", *(["rrd"] if importlib.util.find_spec("rerun") else [])]
    with tempfile.TemporaryDirectory() as folder:
        run = f"{folder}/run"
        command(found, "survey: run", length, "run", "bluerov2_survey", "--until", f"{length}",
                "--out", run)  # fmt: skip
        command(found, "survey: report", length, "report", run)
        for kind in kinds:
            file = f"{folder}/run.{kind}"
            command(found, f"survey: export {kind}", length, "export", run, "-o", file)
            Path(file).unlink()


@contextlib.contextmanager
def empty_cache() -> Iterator[None]:
    """Use an empty cache in the block."""
    before = os.environ.get("UUVSIM_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["UUVSIM_CACHE"] = folder
        try:
            yield
        finally:
            del os.environ["UUVSIM_CACHE"]
            if before is not None:
                os.environ["UUVSIM_CACHE"] = before


def fleet(found: Seconds, vehicle: uuv.System, k: int) -> None:
    """Measure k equal vehicles: native components, and a kernel."""
    system = uuv.System("fleet", tick=vehicle.tick)
    for i in range(k):
        system = system.add(f"auv_{i + 1}", vehicle)
    plan = flatten(system)
    with empty_cache():
        with stage(found, "fleet: fuse, cold", k):
            in_new_process(lambda: uuv.fuse(system))
        with stage(found, "fleet: fuse, warm", k):
            in_new_process(lambda: uuv.fuse(system))
    make = prepare(plan, "native")
    with stage(found, "fleet: native instances", k):
        in_new_process(lambda: [make(c) for c in plan.components])
    kernel = uuv.fuse(system)
    with stage(found, "fleet: batch of 8", k):
        batch = kernel.batch(8)
    with stage(found, "fleet: 100 steps of the batch", k):
        batch.step(100)


def in_new_process(work: Callable[[], object]) -> None:
    """Call in a copy of this process, so that nothing is shared with later calls."""
    child = os.fork()
    if child == 0:
        try:
            work()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    if os.waitpid(child, 0)[1]:
        raise SystemExit("the measured call has failed")


def start_up(found: Seconds, repeats: int) -> None:
    """Measure commands of a warm installation, by the processor time of their process."""
    uuvsim = [sys.executable, "-m", "uuvsim_cosim"]
    for name, words in {
        "uuvsim --version": ["--version"],
        "uuvsim models": ["models"],
        "uuvsim systems": ["systems"],
        "survey to its tenth step": ["run", "bluerov2_survey", "--until", "0.1", "--no-report"],
    }.items():
        each = []
        for _ in range(repeats + 1):
            with tempfile.TemporaryDirectory() as folder:
                before = os.times()
                subprocess.run([*uuvsim, *words], cwd=folder, check=True, capture_output=True)
                after = os.times()
            used = after.children_user + after.children_system
            each.append(used - before.children_user - before.children_system)
        found[name] = {1: statistics.median(each[1:])}  # the first fills the caches


def keeper() -> Model:
    """Return the shore link of a vehicle: the pose of the vehicle ahead limits the thrusters."""
    m = Model("keeper")
    ahead = m.input("eta_ahead", 6, unit=ETA)
    m.output("health", ca.repmat(1.0 - 1e-12 * ahead[0], 8), unit="1")
    return m


def follower(fmu: Path) -> uuv.System:
    """Return a surveying vehicle that follows another one."""
    system = uuv.load("bluerov2_survey").add("keeper", str(fmu))
    system = system.connect("keeper.health", "allocation.health")
    return system.expose("eta", "navigation.eta").expose("eta_ahead", "keeper.eta_ahead")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--components", type=int, nargs="*", default=[300, 1000, 3000])
    parser.add_argument("--vehicles", type=int, nargs="*", default=[10, 30, 100])
    parser.add_argument("--lengths", type=int, nargs="*", default=[400, 4000], help="of runs [s]")
    parser.add_argument("--starts", type=int, default=5, help="repetitions of each command")
    parser.add_argument("--figure", type=Path, help="SVG to write: the stages before and after")
    arguments = parser.parse_args()
    found: Seconds = {}
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(lag(), target=Path(folder) / "lag.fmu")
        chain({}, fmu, 10)  # caches are warm then
        for n in arguments.components:
            chain(found, fmu, n)
        vehicle = follower(build_fmu(keeper(), target=Path(folder) / "keeper.fmu"))
        convoy({}, vehicle, 2)
        for k in arguments.vehicles:
            convoy(found, vehicle, k)
    for k in arguments.vehicles:
        fleet(found, uuv.load("bluerov2_survey"), k)
    for length in arguments.lengths:
        recording(found, length)
    start_up(found, arguments.starts)
    show: Callable[[float], str] = lambda x: f"{x:10.3f}"  # noqa: E731
    for name, seconds in found.items():
        figures = "".join(show(seconds[n]) for n in sorted(seconds))
        grown = slope(seconds) if len(seconds) > 1 else math.nan
        print(f"{name:30}{figures}   slope {grown:5.2f}", flush=True)
    if arguments.figure is not None:
        arguments.figure.write_text(picture(found))


if __name__ == "__main__":
    main()
