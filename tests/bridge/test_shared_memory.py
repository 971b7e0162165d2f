"""Large payloads lie in shared memory, small ones and those that do not fit are bytes."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.bridge import shared_memory
from uuvsim_cosim.bridge.shared_memory import LARGE, SharedMemory
from uuvsim_cosim.bridge.wrapped_session import listening
from uuvsim_cosim.bridge.zenoh_bridge import free_port

TAKES = """
import sys, zlib
from uuvsim_cosim.bridge.wrapped_session import connecting
settings = {"transport/shared_memory/enabled": sys.argv[2] == "True"}
with connecting("127.0.0.1", int(sys.argv[1]), settings) as session:
    frames = session.subscribe("frames", 64)
    print("ready", flush=True)
    for _ in range(6):
        payload = frames.recv().payload
        print(payload.as_shm() is not None, zlib.crc32(payload.to_bytes()), flush=True)
"""


def frames() -> list[np.ndarray]:
    return [np.random.default_rng(k).random(n) for k, n in enumerate((10, 20_000, 300_000) * 2)]


@pytest.mark.parametrize("shared", [True, False])
def test_frames_arrive_whole_with_and_without_shared_memory(shared: bool) -> None:
    import zlib

    memory, port = SharedMemory(), free_port("127.0.0.1")
    with listening(port) as session:
        publisher = session.raw.declare_publisher("frames")
        with subprocess.Popen(
            [sys.executable, "-c", TAKES, str(port), str(shared)], stdout=subprocess.PIPE, text=True
        ) as taker:
            assert taker.stdout is not None
            assert taker.stdout.readline() == "ready\n"
            while not publisher.matching_status:
                pass
            for frame in frames():
                publisher.put(memory.payload(b"head", frame))
            got = [line.split() for line in taker.stdout]
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
