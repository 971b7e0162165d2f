"""Figures with the real ArduSub: ``python -m tests.bridge.autopilots.with_real_binary BINARY``.

Instead of all figures, ``--speed 60`` measures the time of a step, three times in 60 s of simulated
time, beside the fake autopilot. ``--survey 120`` flies the survey in its current for 120 s, and
``--navigation sensors`` with the DVL and the USBL instead of ArduSub's own GPS.
``--hours 2`` runs the endurance test: memory of both processes and lost frames; ``--minutes 60``
ends it after an hour by the clock. ``--rate 200`` makes 200 steps in a second, and the loop of
ArduSub as many; 400 is the default of both. The figures of docs/results.md are of this script.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np

import uuvsim_cosim as uuv
from tests.bridge.autopilots.conftest import compiled
from uuvsim_cosim.bridge.autopilots.ardusub import ArduSub
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.shipped.autopilot import with_autopilot, with_binary
from uuvsim_cosim.orchestrator.system.system import System


def flown(system: System, until: float, name: str, folder: Path) -> tuple[uuv.Signals, str]:
    """Run natively; return the signals, and the times with the warm-up."""
    start, own, other = time.monotonic(), time.process_time(), _children()
    signals = run(system, until=until, out=folder / name, backend="native").signals()
    wall, own = time.monotonic() - start, time.process_time() - own
    simulated = until + float(str(system.components["controller"].start.get("warm_up", 45.0)))
    other = _children() - other
    return signals, (
        f"{simulated:g} s simulated in {wall:.1f} s: {simulated / wall:.1f} x real time; "
        f"CPU {own:.1f} s here, {other:.1f} s in ArduSub"
    )


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("binary", type=Path)
    parser.add_argument("--hours", type=float, default=0.0, help="endurance test instead")
    parser.add_argument("--minutes", type=float, default=math.inf, help="its end by the clock")
    parser.add_argument("--rate", type=int, default=400, help="Hz of the steps and of ArduSub")
    parser.add_argument("--survey", type=float, default=0.0, help="seconds; the survey instead")
    parser.add_argument("--navigation", default="gps", help="of the survey: gps or sensors")
    parser.add_argument("--speed", type=float, default=0.0, help="seconds; time of a step instead")
    given = parser.parse_args()
    binary = str(given.binary.absolute())
    system = with_binary(uuv.load("bluerov2_ardusub"), binary)
    with tempfile.TemporaryDirectory() as name:
        if given.rate != 400:
            system = slower(system, given.rate, Path(name))
        if given.hours:
            endurance(system, given.hours, given.minutes)
        elif given.survey:
            survey(binary, given.survey, given.navigation, Path(name))
        elif given.speed:
            fake = with_binary(uuv.load("bluerov2_ardusub"), str(compiled(Path(name) / "ardusub")))
            for _ in range(3):
                for what, flown_by in (("ArduSub", system), ("the fake", fake)):
                    print(f"{what}: {step_time(flown_by, given.speed)}", flush=True)
        else:
            figures(system, Path(name))


def slower(system: System, rate: int, folder: Path) -> System:
    """Return the system with this number of steps a second, and ArduSub's loop with the same."""
    parameters = folder / "rate.parm"
    parameters.write_text(f"SCHED_LOOP_RATE {rate}\n")
    source = system.components["controller"].source
    system = system.replace("controller", f"{source}&parameters={parameters}")
    return replace(system, tick=Fraction(1, rate))


def survey(binary: str, seconds: float, navigation: str, folder: Path) -> None:
    """Print how far the survey with ArduSub is from its desired pose, in a current."""
    source = f"ardusub:?navigation={navigation}"
    system = with_autopilot(uuv.load("bluerov2_survey"), "controller", source)
    system = with_binary(system, binary)
    signals, times = flown(system, seconds, "survey", folder)
    eta, eta_d = signals["hull.eta"], signals["guidance.eta_d"]
    north, east = (eta - eta_d)[:, 0], (eta - eta_d)[:, 1]
    across = east * np.cos(eta_d[:, 5]) - north * np.sin(eta_d[:, 5])
    depth = eta[:, 2] - eta_d[:, 2]
    print(f"survey for {seconds:g} s: {times}")
    print(f"  RMS across the desired course {np.sqrt(np.mean(across**2)):.3f} m, "
          f"of the depth {np.sqrt(np.mean(depth**2)):.3f} m")  # fmt: skip


def figures(system: System, folder: Path) -> None:
    """Print what a dive, depth hold, two equal runs and a replay show."""
    signals, times = flown(system, 60.0, "dive", folder)
    depth = signals["hull.eta"][:, 2]
    armed = signals.time[np.argmax(signals["controller.armed"] > 0)]
    print(f"guided dive to 5 m, all sensors: {times}")
    late = depth[signals.time > 40.0] - 5.0
    print(f"  heartbeat says armed at {armed:.2f} s; error of 40 to 60 s: "
          f"mean {late.mean():+.4f} m, largest {np.abs(late).max():.4f} m")  # fmt: skip

    hold = system.set("controller.mode", 2)
    held, times = flown(hold, 60.0, "hold", folder)
    depth = held["hull.eta"][:, 2]
    late = depth[held.time > 10.0]
    print(f"depth hold: {times}")
    print(f"  depth {depth[0]:.3f} m at the start, {late.mean():.3f} m from 10 s on, "
          f"which varies by {np.ptp(late):.4f} m")  # fmt: skip

    again, _ = flown(system, 60.0, "again", folder)
    differs = np.any(signals["controller.pwm"] != again["controller.pwm"], axis=1)
    if differs.any():
        row = int(np.argmax(differs))
        channel = int(np.argmax(signals["controller.pwm"][row] != again["controller.pwm"][row]))
        a, b = signals["controller.pwm"][row, channel], again["controller.pwm"][row, channel]
        print(
            f"  two runs: packets differ first at {signals.time[row]:.4f} s, channel "
            f"{channel + 1}: {a:g} and {b:g} µs; {differs.mean():.0%} of the packets differ"
        )
    else:
        print(f"  two runs: all {len(differs)} packets are equal")
    apart = np.abs(signals["hull.eta"] - again["hull.eta"]).max(axis=0)[:3]
    print(f"  the poses differ by {apart.max():.4f} m at most")

    packets = folder / "packets.bin"
    packets.write_bytes(signals["controller.pwm"].astype("<u2").tobytes())
    os.environ["FAKE"] = f"replay:{packets}"
    fake = folder / "ardusub"
    compiled(fake)
    replayed = with_binary(uuv.load("bluerov2_ardusub"), str(fake)).set("controller.warm_up", 0.0)
    same, _ = flown(replayed, 59.9, "replay", folder)
    rows = len(same.time)
    equal = [n for n in same if n.startswith(("hull", "thruster", "imu", "dvl", "battery"))]
    bits = all(np.array_equal(same[n], signals[n][:rows], equal_nan=True) for n in equal)
    print(f"  replay of the packets: {'the same' if bits else 'OTHER'} bits in "
          f"{len(equal)} signals of the plant and {rows} rows")  # fmt: skip


class Frames:
    """Observer that counts gaps in the frame count, beside the recorded rows."""

    def __init__(self) -> None:
        self.last, self.gaps, self.rows = -1, 0, 0

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Find the column."""
        self.column = [c.name for c in columns].index("controller.frame")

    def observe(self, chunk: Chunk) -> None:
        """Count differences other than 1."""
        frames = chunk.values(self.column).astype(int)
        if self.last >= 0:
            frames = np.insert(frames, 0, self.last)
        self.gaps += int(np.count_nonzero(np.diff(frames) != 1))
        self.last, self.rows = int(frames[-1]), self.rows + len(chunk.ticks)

    def end(self) -> None:
        """Do nothing."""


def step_time(system: System, seconds: float) -> str:
    """Return the times of a step of 2.5 ms, without the start; all outputs are observed."""
    plan = flatten(system)
    with Master(plan, prepare(plan, "native"), observers=[Frames()]) as master:
        master.initialize()
        master.step(400)
        wall, own, other = time.monotonic(), time.process_time(), _ardusub()[1]
        n = round(400 * seconds)
        master.step(n)
        wall, own = time.monotonic() - wall, time.process_time() - own
        other = _ardusub()[1] - other
    return (
        f"{1e6 * wall / n:.0f} us a step, {seconds / wall:.1f} x real time; "
        f"CPU time {1e6 * own / n:.0f} us here, {1e6 * other / n:.0f} us there, which allows "
        f"{seconds / (own + other):.1f} x if no other program has the processors; "
        f"load {os.getloadavg()[0]:.1f}"
    )


def endurance(system: System, hours: float, minutes: float) -> None:
    """Run for hours, at most `minutes` by the clock; print lost frames and memory as it flies."""
    seconds, frames = 3600.0 * hours, Frames()
    plan = flatten(system)
    with Master(plan, prepare(plan, "native"), observers=[frames]) as master:
        master.initialize()
        start = time.monotonic()
        while True:
            print(f"  {master.time:8.0f} s: {_memory(os.getpid()):6.1f} MB here, "
                  f"{_ardusub()[0]:6.1f} MB in ArduSub; frame {frames.last}, {frames.gaps} gaps; "
                  f"depth {master.get('hull', 'eta')[2]:.3f} m; "
                  f"{time.monotonic() - start:.0f} s by the clock; "
                  f"load {os.getloadavg()[0]:.1f}", flush=True)  # fmt: skip
            if master.time >= seconds or time.monotonic() - start > 60.0 * minutes:
                break
            master.run_until(min(master.time + seconds / 144, seconds))
        seconds = master.time
        counts = [c.counts for c in master.components if isinstance(c, ArduSub)]
    wall = time.monotonic() - start
    print(f"{seconds / 3600:.2f} h in {wall:.0f} s ({seconds / wall:.1f} x real time): "
          f"{frames.rows} states, {frames.gaps} lost frames; "
          f"packets that were ignored or repeated: {counts}")  # fmt: skip


def _ardusub() -> tuple[float, float]:
    """Return the resident memory [MB] and the CPU time [s] of this process's children."""
    own = os.getpid()
    children = Path(f"/proc/{own}/task/{own}/children").read_text().split()
    stats = [Path(f"/proc/{c}/stat").read_text().rsplit(")", 1)[1].split() for c in children]
    ticks = sum(int(s[11]) + int(s[12]) for s in stats)
    return sum(_memory(int(c)) for c in children), ticks / os.sysconf("SC_CLK_TCK")


def _memory(process: int) -> float:
    """Return the resident memory in MB."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0.0


if __name__ == "__main__":
    main()
