"""Large payloads lie in shared memory, small ones and those that do not fit are bytes."""

from __future__ import annotations

import subprocess
import sys
import zlib
from queue import Queue
from threading import Thread
from typing import Any

import numpy as np
import pytest
import zenoh

from uuvsim_cosim.bridge.zenoh import shared_memory
from uuvsim_cosim.bridge.zenoh.session import listening
from uuvsim_cosim.bridge.zenoh.shared_memory import LARGE, SharedMemory

TAKES = """
import sys, zlib
from uuvsim_cosim.bridge.zenoh.session import connecting
settings = {"transport/shared_memory/enabled": sys.argv[2] == "True"}
with connecting("127.0.0.1", int(sys.argv[1]), settings) as session:
    frames = session.subscribe("frames", 64)
    print("ready", flush=True)
    count = 0
    while count < 6:
        payload = frames.recv().payload
        if payload.to_bytes() == b"hello":
            print("met", flush=True)
            continue
        count += 1
        print(payload.as_shm() is not None, zlib.crc32(payload.to_bytes()), flush=True)
"""


def frames() -> list[np.ndarray]:
    return [np.random.default_rng(k).random(n) for k, n in enumerate((10, 20_000, 300_000) * 2)]


def _read(stream: Any, lines: Queue[str]) -> None:
    for line in stream:
        lines.put(line.strip())


@pytest.mark.parametrize("shared", [True, False])
def test_frames_arrive_whole_with_and_without_shared_memory(shared: bool) -> None:
    memory = SharedMemory()
    with listening(0) as session:
        publisher = session.raw.declare_publisher(
            "frames", congestion_control=zenoh.CongestionControl.BLOCK
        )
        with subprocess.Popen(
            [sys.executable, "-c", TAKES, str(session.port), str(shared)],
            stdout=subprocess.PIPE,
            text=True,
        ) as taker:
            lines: Queue[str] = Queue()
            Thread(target=_read, args=(taker.stdout, lines), daemon=True).start()
            try:
                assert lines.get() == "ready"
                while lines.empty():  # the first ones after a subscription may be dropped
                    publisher.put(b"hello")
                for frame in frames():
                    publisher.put(memory.payload(b"head", frame))
                got: list[list[str]] = []
                while len(got) < len(frames()):
                    if (line := lines.get()) != "met":
                        got.append(line.split())
            finally:
                taker.kill()
    assert memory.used == 4
    assert [int(crc) for _, crc in got] == [zlib.crc32(b"head" + f.tobytes()) for f in frames()]
    assert [place == "True" for place, _ in got] == [shared and f.nbytes >= LARGE for f in frames()]


def test_without_shared_memory_large_payloads_are_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    from zenoh import shm

    frame = np.zeros(LARGE)
    assert SharedMemory(wanted=False).payload(b"head", frame) == b"head" + frame.tobytes()
    with monkeypatch.context() as patched:
        patched.setattr(shared_memory, "POOL", 1000)
        full = SharedMemory()
        assert full.payload(b"head", frame) == b"head" + frame.tobytes()
    with monkeypatch.context() as patched:
        patched.setattr(shared_memory, "SMALL", 1 << 60)  # as where next to none is free
        little = SharedMemory()
        assert little.payload(b"head", frame) == b"head" + frame.tobytes()

    class Absent:
        @staticmethod
        def default_backend(size: int) -> Any:
            raise OSError("no /dev/shm here")

    monkeypatch.setattr(shm, "ShmProvider", Absent)
    none = SharedMemory()
    assert none.payload(b"", frame) == frame.tobytes()
    assert none.payload(b"", frame) == frame.tobytes()
    assert none.used == 0
