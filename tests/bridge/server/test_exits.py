"""Programs with a bridge or a client end with their own status, whatever their threads do.

Python ends daemon threads where they ask for its lock. Inside Zenoh, which is Rust, that aborts the
program: "FATAL: exception not rethrown", SIGABRT.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

PARTS = Path(__file__).parents[1] / "parts.py"
_HEAD = f"""
import os, sys, threading
import numpy
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.bridge.zenoh.session import connecting
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.orchestrator.system.system import System
system = System("sums", "0.1").add("sum", {str(PARTS)!r} + ":Sum")
"""

# Forked, so that one import serves all. A client asks 60 times and takes the first answer only.
_ANSWERS = """
def asks(port, done):
    session = connecting("127.0.0.1", int(os.read(port, 20)))
    asker = session.asker("uuvsim/sums/call/get")
    replies = [asker.get(payload='{"names": ["sum.s"]}') for _ in range(60)]
    next(iter(replies[0]))
    os.write(done, b"x")
    os.read(port, 1)
    os._exit(0)

for _ in range(5):
    program = os.fork()
    if not program:
        port, tells = os.pipe()
        heard, done = os.pipe()
        if not os.fork():
            os.close(tells)
            asks(port, done)
        bridge = Bridge(system, port=0, anyone=True)
        os.write(tells, str(bridge.port).encode())
        os.read(heard, 1)
        if sys.argv[1] == "closed":
            bridge.close()
        sys.exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(program, 0)[1]))
"""


@pytest.mark.parametrize("how", ["closed", "open"])
def test_a_program_that_ends_while_calls_are_answered_ends_with_its_own_status(how: str) -> None:
    done = _program(_ANSWERS, how)
    assert done.stdout.split() == ["0"] * 5, done.stderr
    assert done.stderr == ""


# Threads of daemon threads are daemons as well: Python would not wait for them.
_THREADS = """
from uuvsim_cosim.bridge.clients.remote_serving import serve_component
from uuvsim_cosim.errors import UuvsimError

ended = []

def begins():
    global bridge, client, served
    bridge = Bridge(system, port=0)
    client = connect(port=bridge.port)
    client.get("sum.s")
    served = serve_component(sys.argv[1] + ":Sum", port=0)

def receives():
    for _ in client.subscribe("sum.s"):
        received.set()
    ended.append("received")

def asks():
    try:
        while True:
            client.get("sum.s")
    except UuvsimError:  # it has left, or is disconnected
        ended.append("asked")

def begun(target):
    thread = threading.Thread(target=target, daemon=True)
    thread.start()
    return thread

received = threading.Event()
begun(begins).join()
threads = [begun(receives), begun(asks)]
client.run()
received.wait()
for closing in (client, served, bridge):
    closing.close()
print([t.name for t in threading.enumerate() if t not in (threading.main_thread(), *threads)])
for thread in threads:
    thread.join()
print(sorted(ended))
"""


def test_no_thread_of_a_bridge_a_client_or_a_served_component_outlives_its_closing() -> None:
    done = _program(_THREADS, PARTS)
    assert done.stdout.splitlines() == ["[]", "['asked', 'received']"], done.stderr
    assert (done.returncode, done.stderr) == (0, "")


_OPEN = """
bridge = Bridge(system, port=0)
client = connect(port=bridge.port)
begun = threading.Barrier(3)

def receives():
    blocks = client.subscribe("sum.s")
    begun.wait()
    for _ in blocks:
        pass

def asks():
    begun.wait()
    while True:
        try:
            client.get("sum.s")
        except Exception:
            return

for target in (receives, asks):
    threading.Thread(target=target, daemon=True).start()
client.run()
begun.wait()
print("at the end")
"""


def test_a_program_whose_daemon_threads_receive_and_ask_ends_without_closing() -> None:
    done = _program(_OPEN)
    assert (done.returncode, done.stdout, done.stderr) == (0, "at the end\n", "")


_CLOSED_FIRST = """
from uuvsim_cosim.bridge.server.conductor import Conductor
with Conductor(system) as conductor:
    bridge = Bridge(conductor, port=0)
bridge.close()
print([t.name for t in threading.enumerate() if t is not threading.main_thread()])
"""


def test_a_bridge_closes_after_its_co_simulation() -> None:
    done = _program(_CLOSED_FIRST)
    assert (done.returncode, done.stdout, done.stderr) == (0, "[]\n", "")


_FORKED = """
bridge = Bridge(system, port=0)
client = connect(port=bridge.port)
child = os.fork()
if not child:
    threading._shutdown()  # as multiprocessing ends its processes
    os._exit(7)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), client.get("sum.s"))
"""


def test_a_forked_child_leaves_the_bridge_of_its_parent_alone() -> None:
    done = _program(_FORKED)
    assert (done.returncode, done.stdout, done.stderr) == (0, "7 0.0\n", "")


def _program(text: str, *arguments: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", _HEAD + text, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)
