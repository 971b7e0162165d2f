"""Figures with the real ArduSub: ``python -m tests.bridge.autopilots.with_real_binary BINARY``.

``--hours 2`` runs the endurance test instead. The figures of docs/results.md are of this script.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.shipped.autopilot import with_binary
from uuvsim_cosim.orchestrator.system.system import System


def flown(system: System, until: float, name: str, folder: Path) -> tuple[uuv.Signals, str]:
    """Run natively; return the signals, and the times with the warm-up."""
    start, own, other = time.monotonic(), time.process_time(), _children()
    signals = run(system, until=until, out=folder / name, backend="native").signals()
    wall, own = time.monotonic() - start, time.process_time() - own
    simulated = until + float(system.components["controller"].start.get("warm_up", 45.0))
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
    parser.add_argument("--hours", type=float, default=0.0)
    given = parser.parse_args()
    system = with_binary(uuv.load("bluerov2_ardusub"), str(given.binary.absolute()))
    with tempfile.TemporaryDirectory() as name:
        if given.hours:
            endurance(system, given.hours)
        else:
            figures(system, Path(name))


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
    from tests.bridge.autopilots.conftest import compiled

    compiled(fake)
    replayed = with_binary(uuv.load("bluerov2_ardusub"), str(fake)).set("controller.warm_up", 0.0)
    same, _ = flown(replayed, 59.9, "replay", folder)
    rows = len(same.time)
    equal = [n for n in same if n.startswith(("hull", "thruster", "imu", "dvl", "battery"))]
    bits = all(np.array_equal(same[n], signals[n][:rows], equal_nan=True) for n in equal)
    print(f"  replay of the packets: {'the same' if bits else 'OTHER'} bits in "
          f"{len(equal)} signals of the plant and {rows} rows")  # fmt: skip


def endurance(system: System, hours: float) -> None:
    """Run for hours; print lost frames, and the memory of both processes over the time."""
    seconds = 3600.0 * hours
    rows: list[tuple[float, float, float]] = []

    plan = flatten(system)
    start = time.monotonic()
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        part = round(seconds / 20)
        for k in range(20):
            master.run_until((k + 1) * part)
            children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()
            rows.append((master.time, _memory(os.getpid()), sum(map(_memory, map(int, children)))))
            print("  {:8.0f} s: {:6.1f} MB here, {:6.1f} MB in ArduSub".format(*rows[-1]),
                  flush=True)  # fmt: skip
        frames = master.get("controller", "frame")
        depth = master.get("hull", "eta")[2]
    wall = time.monotonic() - start
    steps = (seconds + 45.0) * 400
    print(f"{hours:g} h in {wall:.0f} s ({seconds / wall:.1f} x real time): {frames:.0f} packets "
          f"in {steps:.0f} steps, depth {depth:.3f} m at the end")  # fmt: skip


def _memory(process: int) -> float:
    """Return the resident memory in MB."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0.0


if __name__ == "__main__":
    main()
