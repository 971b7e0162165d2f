"""What a ROS 2 node costs the stepping loop, and how late its messages are beside plain Zenoh.

A system with 30 topics steps at 1 kHz in real time: an IMU with a message for each step, a cloud of
100,000 points at 10 Hz, and 28 topics at 50 Hz. A subscriber in another process takes all of them
in every third window of the same run. Latency is the time from the end of a step to the
subscriber's callback. Plain Zenoh is one message of the size of an IMU's, and one of the size of a
cloud, which the stepping thread puts itself. Run it on an idle machine:
`python benchmarks/bridge/ros2_latency.py`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import casadi

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.ros2.node import Ros2Node
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.zenoh.session import connecting, free_port
from uuvsim_cosim.fmus.codegen.describe import describe
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.system import resolve

TOPICS, RATE = 30, 50.0
POINTS, EVERY = 100_000, 100  # points of a cloud, and steps from cloud to cloud
SIZE = 328  # bytes of a sensor_msgs/msg/Imu with this frame
ME = Client("benchmark", "local")

TAKES = """
import json, struct, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps(["tcp/127.0.0.1:" + sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
ros, clouds, plain, plain_clouds, others = [], [], [], [], [0]
def stamped(found):
    def hear(sample):
        now = time.time_ns()
        sec, nanosec = struct.unpack_from("<iI", sample.payload.to_bytes(), 4)
        found.append((round(sec * 1000 + nanosec / 1e6), now))
    return hear
def numbered(found):
    def hear(sample):
        now = time.time_ns()
        found.append((struct.unpack_from("<q", sample.payload.to_bytes())[0], now))
    return hear
def other(sample):
    others[0] += 1
with zenoh.open(config) as session:
    kept = [session.declare_subscriber("0/imu/**", stamped(ros)),
            session.declare_subscriber("0/clouds/**", stamped(clouds)),
            session.declare_subscriber("0/numbers/**", other),
            session.declare_subscriber("plain", numbered(plain)),
            session.declare_subscriber("plain_clouds", numbered(plain_clouds))]
    sys.stdin.readline()
print(json.dumps([ros, plain, clouds, plain_clouds, others[0]]))
"""

# The test source of clouds: a sonar whose parameters are the directions of its beams.
CLOUDS = f"""
import numpy as np
N = {POINTS}
class Clouds:
    inputs = {{}}
    outputs = {{"range": (N, "m")}}
    parameters = {{"tilt": (np.linspace(0.0, 1.0, N), "rad"),
                  "azimuth": (np.linspace(0.0, 99.0, N), "rad"),
                  "r_s": (np.zeros(3), "m"), "Theta_s": (np.zeros(3), "rad")}}
    n = 0
    def step(self, t, dt, u):
        self.n += 1
        return {{"range": np.full(N, 1.0 + self.n % 10)}}
"""


class Source:
    """The source `imu:` (angular velocity, acceleration) or `numbers:` (28 vectors)."""

    kind = "model"

    def __init__(self, text: str) -> None:
        self.text = text

    def declare(self) -> Model:
        """Return the declaration."""
        m = Model(self.text[:-1])
        x = m.state("x", unit="1")
        m.der(x, 1.0 - x)
        if self.text == "imu:":
            m.output("gyro", casadi.vertcat(x, x, x), unit="rad/s")
            m.output("acc", casadi.vertcat(x, x, x), unit="m/s2")
        else:
            for i in range(TOPICS - 2):
                m.output(f"y{i}", casadi.vertcat(x, x * i), unit="1")
        return m

    def describe(self) -> Any:
        """Describe it."""
        return describe(self.declare())

    def instantiate(self, path: str, *, backend: str = "native") -> Any:
        """Compile it into this process."""
        return Native(self.declare(), path)


class StepTimes:
    """Observer: CPU time of the stepping thread [s], and the steps."""

    cpu, tick = 0.0, 0

    def begin(self, plan: Any, columns: Any) -> None:
        """Do nothing."""

    def observe(self, chunk: Any) -> None:
        """Note the thread's CPU time."""
        self.cpu, self.tick = time.thread_time(), int(chunk.ticks[-1])

    def end(self) -> None:
        """Do nothing."""


class Stamps:
    """Observer: the time of day at the end of each step, and messages by plain Zenoh."""

    def __init__(self, port: int) -> None:
        self.session = connecting("127.0.0.1", port)
        self._publisher = self.session.publisher("plain")
        self._clouds = self.session.publisher("plain_clouds")
        self.times: dict[int, int] = {}

    def begin(self, plan: Any, columns: Any) -> None:
        """Do nothing."""

    def observe(self, chunk: Any) -> None:
        """Note the time, and publish."""
        for tick in chunk.ticks.tolist():
            self.times[tick] = time.time_ns()
            self._publisher.put(struct.pack("<q", tick) + bytes(SIZE - 8))
            if tick % EVERY == EVERY // 2:  # not at the time of a ROS cloud
                self._clouds.put(struct.pack("<q", tick) + bytes(12 * POINTS - 8))

    def end(self) -> None:
        """Do nothing."""


def topics(folder: Path) -> Path:
    """Write the file of topics."""
    lines = ["topics:", "  - topic: /imu/data_raw", "    type: sensor_msgs/msg/Imu",
             "    frame: imu_link", "    signals: {gyro: imu.gyro, acc: imu.acc}",
             "  - topic: /clouds/points", "    type: sensor_msgs/msg/PointCloud2",
             "    frame: sonar_link", f"    rate: {1000 / EVERY:g}",
             "    signals: {range: clouds.range}"]  # fmt: skip
    for i in range(TOPICS - 2):
        lines += [f"  - topic: /numbers/y{i}", "    type: std_msgs/msg/Float64MultiArray",
                  f"    rate: {RATE:g}", f"    signals: {{data: numbers.y{i}}}"]  # fmt: skip
    file = folder / "topics.yaml"
    file.write_text("\n".join(lines) + "\n")
    return file


def window(conductor: Conductor, steps: StepTimes, seconds: float) -> tuple[float, float, int]:
    """Return wall time and CPU time of the loop per step [us], and the overruns, in a window."""

    def now() -> tuple[float, float, int, int]:
        told = conductor.describe()
        return told["busy"], steps.cpu, steps.tick, told["overruns"]

    busy, cpu, tick, overruns = now()
    time.sleep(seconds)
    after = now()
    n = (after[2] - tick) / 1e6
    return (after[0] - busy) / n, (after[1] - cpu) / n, after[3] - overruns


def taking(port: int) -> subprocess.Popen[str]:
    """Start a subscriber in a process of its own, which takes until a line is written to it."""
    return subprocess.Popen(
        [sys.executable, "-c", TAKES, str(port)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip


def quantiles(found: list[tuple[int, int]], times: dict[int, int]) -> tuple[float, float]:
    """Return the median and the 99th percentile of the latency [ms]; NaN without a message."""
    late = sorted((at - times[tick]) / 1e6 for tick, at in found if tick in times) or [float("nan")]
    return late[len(late) // 2], late[len(late) * 99 // 100]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=3.0)
    options = parser.parse_args()
    for text in ("imu", "numbers"):
        resolve.register(text, lambda text, base: Source(text))
    steps: dict[str, list[tuple[float, float]]] = {
        "without a node": [], "without a subscriber": [], "30 topics taken": []}  # fmt: skip
    over = dict.fromkeys(steps, 0)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as opened:
        source = Path(folder) / "clouds.py"
        source.write_text(CLOUDS)
        system = (uuv.System("bench", "0.001").add("imu", "imu:").add("numbers", "numbers:")
                  .add("clouds", f"{source}:Clouds", rate=f"{EVERY / 1000:g}"))  # fmt: skip
        conductor = opened.enter_context(Conductor(system))
        file, port = topics(Path(folder)), free_port("127.0.0.1")
        conductor.watch(times := StepTimes())
        conductor.run(ME, factor=1.0)
        for _ in range(options.windows):
            node = None
            for kind, found in steps.items():
                taker = None
                if kind != "without a node":
                    node = node or Ros2Node(conductor, topics=file, port=port, domain=0)
                if kind == "30 topics taken":
                    taker = taking(port)
                    time.sleep(1.0)
                wall, cpu, overruns = window(conductor, times, options.seconds)
                found.append((wall, cpu))
                over[kind] += overruns
                if taker is not None:
                    taker.communicate("\n")
            assert node is not None
            node.close()
        for kind, found in steps.items():
            wall, cpu = (sorted(column) for column in zip(*found, strict=True))
            print(f"{kind}: {wall[0]:.1f} to {wall[-1]:.1f} us a step, median "
                  f"{statistics.median(wall):.1f}; CPU time {statistics.median(cpu):.1f} us; "
                  f"{over[kind]} overruns")  # fmt: skip
        alone, taken = (
            [statistics.median(column) for column in zip(*steps[kind], strict=True)]
            for kind in ("without a node", "30 topics taken")
        )
        share, of_cpu = ((b - a) / 1e3 for a, b in zip(alone, taken, strict=True))
        print(f"the node takes {share:.1%} of a period of 1 ms; CPU time {of_cpu:.1%}")
        with Ros2Node(conductor, topics=file, port=port, domain=0):
            stamps = Stamps(port)
            conductor.watch(stamps)
            for _ in range(options.windows):
                taker = taking(port)
                time.sleep(1.0 + options.seconds)
                ros, plain, clouds, plain_clouds, others = json.loads(taker.communicate("\n")[0])
                for kind, own, beside in (("IMU", ros, plain), ("clouds", clouds, plain_clouds)):
                    (p50, p99), (plain50, plain99) = (
                        quantiles(f, stamps.times) for f in (own, beside)
                    )
                    print(f"latency of {kind}: ROS 2 p50 {p50:.2f} ms, p99 {p99:.2f} ms; plain "
                          f"Zenoh p50 {plain50:.2f} ms, p99 {plain99:.2f} ms; {len(own)} and "
                          f"{len(beside)} messages")  # fmt: skip
                print(f"{others} messages of 28 other topics")
            conductor.unwatch(stamps)
            stamps.session.close()
        conductor.pause(ME)


if __name__ == "__main__":
    main()
