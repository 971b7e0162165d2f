"""What the Zenoh bridge costs the stepping loop, and how long a lockstep round trip takes.

20 components with 10 signals each at 1 kHz in real time; a subscriber in another process takes
all blocks in every other window of the same run; the best window of each kind is the one that
others on the machine disturbed least. "loop" is the wall time that a millisecond of simulated
time takes in the loop, waiting for Python's lock included; a client in a third process then steps
in lockstep. Run it on an idle machine: `python benchmarks/bridge/bridge_cost.py`.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from typing import Any

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.fmus.codegen.describe import describe
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.system import resolve

COMPONENTS, SIGNALS = 20, 10
ME = Client("benchmark", "local")

TAKES = """
import sys, time
import uuvsim_cosim as uuv
client = uuv.connect(port=int(sys.argv[1]))
blocks = client.subscribe(keep=100_000)
next(blocks)
print("takes", flush=True)
sys.stdin.readline()
ticks, begun = [], time.perf_counter()
for block in blocks:
    ticks.append(block.tick)
    if time.perf_counter() - begun > float(sys.argv[2]):
        break
print(len(ticks) / (time.perf_counter() - begun), len(ticks) / 20 / (ticks[-1] - ticks[0] + 1))
"""
STEPS = """
import sys, time
import uuvsim_cosim as uuv
client = uuv.connect(port=int(sys.argv[1]), lockstep=True)
times = []
for k in range(int(sys.argv[2]) + 200):
    begun = time.perf_counter()
    client.step(1, {"c0.u": float(k)}, ["c0.y0", "c1.y0"])
    times.append(time.perf_counter() - begun)
times = sorted(times[200:])
print(times[len(times) // 2], times[len(times) * 99 // 100])
"""


class Ten:
    """The source `ten:`: ten states that follow one input."""

    text, kind = "ten:", "model"

    def declare(self) -> Model:
        """Return the declaration."""
        m = Model("ten")
        u = m.input("u", unit="1")
        for i in range(SIGNALS):
            x = m.state(f"x{i}", unit="1")
            m.der(x, (u - x) * (1.0 + i))
            m.output(f"y{i}", x, unit="1")
        return m

    def describe(self) -> Any:
        """Describe it."""
        return describe(self.declare())

    def instantiate(self, path: str, *, backend: str = "native") -> Any:
        """Compile it into this process."""
        return Native(self.declare(), path)


def window(bridge: Any, seconds: float) -> tuple[float, float, int]:
    """Return wall and CPU time of the loop per step [us], and overruns, in a window."""
    conductor = bridge.conductor
    clock = time.pthread_getcpuclockid(conductor._thread.ident)

    def now() -> tuple[float, float, int, int]:
        told = conductor.describe()
        return (told["busy"], time.clock_gettime(clock), told["overruns"], conductor.moment().tick)

    busy, cpu, overruns, tick = now()
    time.sleep(seconds)
    after = now()
    n = after[3] - tick
    return 1e6 * (after[0] - busy) / n, 1e6 * (after[1] - cpu) / n, after[2] - overruns


def streaming(bridge: Any, windows: int, seconds: float) -> None:
    conductor, stream = bridge.conductor, bridge.stream
    found: dict[bool, list[tuple[float, float, int]]] = {False: [], True: []}
    rates: list[list[float]] = []
    conductor.run(ME, factor=1.0)
    for _ in range(windows):
        found[False].append(window(bridge, seconds))
        taker = taking(bridge, seconds)
        found[True].append(window(bridge, seconds))
        rates.append([float(x) for x in taker.communicate()[0].split()])
    conductor.pause(ME)
    for i, what in enumerate(("wall", "CPU ")):
        for kind, chosen in (("median", statistics.median), ("best  ", min)):
            off, on = (chosen(w[i] for w in found[k]) for k in (False, True))
            print(f"loop, {what} time a step, {kind} window: {off:6.1f} us alone, {on:6.1f} us "
                  f"published; {on / off - 1:.0%} of the step; {(on - off) / 1e3:.1%} of the 1 kHz "
                  "period")  # fmt: skip
    over = {k: sum(w[2] for w in found[k]) for k in found}
    print(f"overruns: {over[False]} alone, {over[True]} published; dropped {stream.dropped} rows")
    rate, whole = (statistics.median(r[i] for r in rates) for i in (0, 1))
    print(f"received: {rate:,.0f} blocks/s, {whole:.1%} of all")


def taking(bridge: Any, seconds: float) -> subprocess.Popen[str]:
    """Start a subscriber to all blocks in a process of its own, which counts for a while."""
    taker = subprocess.Popen(
        [sys.executable, "-c", TAKES, str(bridge.port), str(seconds)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert taker.stdout is not None
    assert taker.stdin is not None
    taker.stdout.readline()
    taker.stdin.write("\n")
    taker.stdin.flush()
    return taker


def free(bridge: Any, windows: int) -> None:
    """As fast as can be, with and without a subscriber."""
    conductor = bridge.conductor
    found: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(windows):
        for subscribed in (False, True):
            if subscribed:
                conductor.run(ME, factor=1.0)
                taker = taking(bridge, 0.5)
                conductor.pause(ME)
            begun = time.perf_counter()
            conductor.step(ME, 20_000)
            found[subscribed].append(20_000 / (time.perf_counter() - begun))
            if subscribed:
                conductor.run(ME, factor=1.0)
                taker.communicate()
                conductor.pause(ME)
    off, on = (statistics.median(found[k]) for k in (False, True))
    print(
        f"as fast as can be: {off:,.0f} steps/s alone, {on:,.0f} published (ratio {off / on:.2f})"
    )


def lockstep(bridge: Any, n: int, clients: int) -> None:
    running = [
        subprocess.Popen(
            [sys.executable, "-c", STEPS.replace("c0.u", f"c{i}.u"), str(bridge.port), str(n)],
            stdout=subprocess.PIPE, text=True,
        )
        for i in range(clients)
    ]  # fmt: skip
    p50, p99 = (float(x) for x in running[0].communicate()[0].split())
    for other in running[1:]:
        other.communicate()
    print(f"lockstep round trip, {clients} client(s): p50 {1e6 * p50:.0f} us, "
          f"p99 {1e6 * p99:.0f} us")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--steps", type=int, default=5000)
    options = parser.parse_args()
    resolve.register("ten", lambda text, base: Ten())
    system = uuv.System("bench", "0.001")
    for i in range(COMPONENTS):
        system = system.add(f"c{i}", "ten:")
    with uuv.Bridge(system, port=0) as bridge:
        streaming(bridge, options.windows, options.seconds)
        free(bridge, options.windows)
        lockstep(bridge, options.steps, 1)
        lockstep(bridge, options.steps, 2)


if __name__ == "__main__":
    main()
