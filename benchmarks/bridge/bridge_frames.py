"""Frames a second from a co-simulation to a Python client on the same machine, with and without
shared memory, in one run.

A Python component gives an image as one array output; a block of it leaves after every step, as
float64, and a subscriber in another process takes it and sums it up. `raw` is Zenoh alone:
the same bytes, put as fast as can be. Run it on an idle machine.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from typing import Any, ClassVar

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.zenoh.session import WrappedSession, free_port, listening
from uuvsim_cosim.bridge.zenoh.shared_memory import SharedMemory
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.system import resolve

OFF = {"transport/shared_memory/enabled": False}
TAKES = """
import sys, time
from uuvsim_cosim.bridge.zenoh.session import connecting
shared = sys.argv[3] == "True"
session = connecting("127.0.0.1", int(sys.argv[1]), {"transport/shared_memory/enabled": shared})
frames = session.subscribe(sys.argv[2], 8)
frames.recv()
count, begun, seconds = 0, time.perf_counter(), float(sys.argv[4])
while (took := time.perf_counter() - begun) < seconds:
    size = len(frames.recv().payload.to_bytes())
    count += 1
print(count / took, size, flush=True)
session.close()
"""


def taking(port: int, key: str, shared: bool, seconds: float) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", TAKES, str(port), key, str(shared), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def told(taker: subprocess.Popen[str]) -> tuple[float, float]:
    rate, size = taker.communicate()[0].split()
    return float(rate), float(size)


def raw(pixels: int, shared: bool, seconds: float) -> float:
    """Return frames a second of Zenoh alone."""
    port = free_port("127.0.0.1")
    memory, frame = SharedMemory(wanted=shared), np.arange(float(pixels))
    with listening(port, settings={} if shared else OFF) as session:
        publisher = publisher_of(session)
        taker = taking(port, "frames", shared, seconds)
        while taker.poll() is None:
            publisher.put(memory.payload(b"", frame))
            if not publisher.matching_status:
                time.sleep(0.001)
        return told(taker)[0]


def publisher_of(session: WrappedSession) -> Any:
    import zenoh

    return session.raw.declare_publisher("frames", congestion_control=zenoh.CongestionControl.BLOCK)


class _Camera:
    """A generated image that changes at each step."""

    inputs: ClassVar[dict[str, Any]] = {}
    outputs: ClassVar[dict[str, Any]] = {}

    def __init__(self) -> None:
        self.count = 0.0

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        self.count += 1.0
        return {"image": np.full(self.outputs["image"][0], self.count % 256.0)}


class Camera:
    """The source `camera:PIXELS`."""

    kind = "Python"

    def __init__(self, text: str, base: Any) -> None:
        self.text = text
        pixels = int(text.partition(":")[2])
        self._class = type("Camera", (_Camera,), {"outputs": {"image": (pixels, "1")}})

    def describe(self) -> Any:
        """Describe it."""
        return self.instantiate("camera").description

    def instantiate(self, path: str, *, backend: str = "native") -> Any:
        """Make one."""
        return PythonComponent(self._class, path)


def served(pixels: int, shared: bool, seconds: float) -> tuple[float, int]:
    """Return frames a second of a running co-simulation, and the bytes of one."""
    system = uuv.System("frames", "0.001").add("camera", f"camera:{pixels}")
    with uuv.Bridge(system, port=0, shared_memory=shared, anyone=True) as bridge:
        taker = taking(bridge.port, "uuvsim/frames/state/camera", shared, seconds)
        bridge.stream.wait_until_wanted("camera", 30.0)
        from uuvsim_cosim.bridge.calls.service import Client

        bridge.conductor.run(Client("benchmark", "local"), factor=1.0)
        rate, size = told(taker)
    return rate, int(size)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=2.0)
    options = parser.parse_args()
    resolve.register("camera", Camera)
    print(f"{'frame':>10} {'':8} {'without':>11} {'shared':>11} {'ratio':>6}")
    for width, height in ((32, 32), (160, 120), (320, 240), (640, 480)):
        pixels = width * height
        for what, measure in (("raw", raw), ("served", lambda *a: served(*a)[0])):
            without, shared = (measure(pixels, on, options.seconds) for on in (False, True))
            print(
                f"{8 * pixels / 1e6:7.2f} MB {what:8} {without:9.0f}/s {shared:9.0f}/s "
                f"{shared / without:6.2f}  {width}x{height}",
                flush=True,
            )


if __name__ == "__main__":
    main()
