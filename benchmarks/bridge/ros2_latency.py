"""What a ROS 2 node costs the stepping loop, and how late its messages are beside plain Zenoh.

A source of 30 topics steps at 1 kHz in real time: an IMU with a message for each step, and 29
topics at 50 Hz. A subscriber in another process takes all of them in every other window of the same
run. Latency is the time from the end of a step to the subscriber's callback. Plain Zenoh is one
message of the size of an IMU's, which the stepping thread puts itself after each step. Run it on an
idle machine: `python benchmarks/bridge/ros2_latency.py`.
"""

from __future__ import annotations

import argparse
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
SIZE = 328  # bytes of a sensor_msgs/msg/Imu with this frame
ME = Client("benchmark", "local")

TAKES = """
import json, struct, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps(["tcp/127.0.0.1:" + sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
ros, plain, others = [], [], [0]
def imu(sample):
    sec, nanosec = struct.unpack_from("<iI", sample.payload.to_bytes(), 4)
    ros.append((round(sec * 1000 + nanosec / 1e6), time.time_ns()))
def other(sample):
    others[0] += 1
with zenoh.open(config) as session:
    kept = [session.declare_subscriber("0/imu/**", imu),
            session.declare_subscriber("0/numbers/**", other),
            session.declare_subscriber("plain", lambda s: plain.append(
                (struct.unpack_from("<q", s.payload.to_bytes())[0], time.time_ns())))]
    sys.stdin.readline()
print(json.dumps([ros, plain, others[0]]))
"""


class Source:
    """The source `imu:` (angular velocity, acceleration) or `numbers:` (29 vectors)."""

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
            for i in range(TOPICS - 1):
                m.output(f"y{i}", casadi.vertcat(x, x * i), unit="1")
        return m

    def describe(self) -> Any:
        """Describe it."""
        return describe(self.declare())

    def instantiate(self, path: str, *, backend: str = "native") -> Any:
        """Compile it into this process."""
        return Native(self.declare(), path)


class Stamps:
    """Observer: the time of day at the end of each step, and a message by plain Zenoh."""

    def __init__(self, port: int) -> None:
        self.session = connecting("127.0.0.1", port)
        self._publisher = self.session.publisher("plain")
        self.times: dict[int, int] = {}

    def begin(self, plan: Any, columns: Any) -> None:
        """Do nothing."""

    def observe(self, chunk: Any) -> None:
        """Note the time, and publish."""
        for tick in chunk.ticks.tolist():
            self.times[tick] = time.time_ns()
            self._publisher.put(struct.pack("<q", tick) + bytes(SIZE - 8))

    def end(self) -> None:
        """Do nothing."""


def topics(folder: Path) -> Path:
    """Write the file of topics."""
    lines = ["topics:", "  - topic: /imu/data_raw", "    type: sensor_msgs/msg/Imu",
             "    frame: imu_link", "    signals: {gyro: imu.gyro, acc: imu.acc}"]  # fmt: skip
    for i in range(TOPICS - 1):
        lines += [f"  - topic: /numbers/y{i}", "    type: std_msgs/msg/Float64MultiArray",
                  f"    rate: {RATE:g}", f"    signals: {{data: numbers.y{i}}}"]  # fmt: skip
    file = folder / "topics.yaml"
    file.write_text("\n".join(lines) + "\n")
    return file


def window(conductor: Conductor, seconds: float) -> tuple[float, int]:
    """Return the wall time of the loop per step [us], and the overruns, in a window."""

    def now() -> tuple[float, int, int]:
        told = conductor.describe()
        return told["busy"], told["overruns"], conductor.moment().tick

    busy, overruns, tick = now()
    time.sleep(seconds)
    after = now()
    return 1e6 * (after[0] - busy) / (after[2] - tick), after[1] - overruns


def taking(port: int) -> subprocess.Popen[str]:
    """Start a subscriber in a process of its own, which takes until a line is written to it."""
    return subprocess.Popen(
        [sys.executable, "-c", TAKES, str(port)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip


def quantiles(found: list[tuple[int, int]], times: dict[int, int]) -> tuple[float, float]:
    """Return the median and the 99th percentile of the latency [ms]."""
    late = sorted((at - times[tick]) / 1e6 for tick, at in found if tick in times)
    return late[len(late) // 2], late[len(late) * 99 // 100]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=3.0)
    options = parser.parse_args()
    for text in ("imu", "numbers"):
        resolve.register(text, lambda text, base: Source(text))
    system = uuv.System("bench", "0.001").add("imu", "imu:").add("numbers", "numbers:")
    steps: dict[str, list[float]] = {"without a node": [], "without a subscriber": [],
                                     "30 topics taken": []}  # fmt: skip
    over = dict.fromkeys(steps, 0)
    with tempfile.TemporaryDirectory() as folder, Conductor(system) as conductor:
        file, port = topics(Path(folder)), free_port("127.0.0.1")
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
                us, overruns = window(conductor, options.seconds)
                found.append(us)
                over[kind] += overruns
                if taker is not None:
                    taker.communicate("\n")
            assert node is not None
            node.close()
        for kind, found in steps.items():
            print(f"{kind}: {min(found):.1f} to {max(found):.1f} us a step, median "
                  f"{statistics.median(found):.1f}, {over[kind]} overruns")  # fmt: skip
        alone, taken = (statistics.median(steps[k]) for k in ("without a node", "30 topics taken"))
        print(f"the node takes {(taken - alone) / 1e3:.1%} of a period of 1 ms")
        with Ros2Node(conductor, topics=file, port=port, domain=0):
            stamps = Stamps(port)
            conductor.watch(stamps)
            for _ in range(options.windows):
                taker = taking(port)
                time.sleep(1.0 + options.seconds)
                ros, plain, others = json.loads(taker.communicate("\n")[0])
                (p50, p99), (plain50, plain99) = (quantiles(f, stamps.times) for f in (ros, plain))
                print(f"latency: ROS 2 p50 {p50:.2f} ms, p99 {p99:.2f} ms; plain Zenoh p50 "
                      f"{plain50:.2f} ms, p99 {plain99:.2f} ms; ratio {p50 / plain50:.2f}, "
                      f"{p99 / plain99:.2f}; {len(ros)} and {len(plain)} of the IMU, {others} of "
                      "29 other topics")  # fmt: skip
            conductor.unwatch(stamps)
            stamps.session.close()
        conductor.pause(ME)


if __name__ == "__main__":
    main()
