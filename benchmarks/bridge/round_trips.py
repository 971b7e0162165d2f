"""Round trips of one lockstep step (set six forces, step 10 ms, read 12 numbers), and messages a
second, for each way of connecting from Python and over HTTP; all in one run on one hull.

Clients run in processes of their own, one after the other; "and" means two that hold the barrier
together, of which the first is shown. Octave's rows are in octave_round_trip.py. Run it on an
idle machine: `python benchmarks/bridge/round_trips.py`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor

FORCES = [10.0, 0, 0, 0, 0, 1]
OUTPUTS = ["hull.eta", "hull.nu"]
MEASURED = """
def measured(trip):
    for _ in range(50):
        trip()
    taken = []
    for _ in range(COUNT):
        begun = time.perf_counter()
        trip()
        taken.append(time.perf_counter() - begun)
    taken.sort()
    print(taken[COUNT // 2], taken[COUNT * 99 // 100])
"""
ZENOH = """
import uuvsim_cosim as uuv
with uuv.connect(port=PORT, lockstep=True, lag=60.0) as client:
    u = {"hull.tau": FORCES} if FIRST else {}
    measured(lambda: client.step(1, u, OUTPUTS))
"""
HTTP = """
import http.client, json
from uuvsim_cosim.bridge.access.token import known_token
link = http.client.HTTPConnection("127.0.0.1", PORT)
token = known_token("127.0.0.1", PORT)
headers = {"Content-Type": "application/json", "Authorization": f"Bearer {token}"}
def ask(path, said):
    link.request("POST", path, json.dumps(said), headers)
    answer = json.loads(link.getresponse().read())
    assert answer["ok"], answer
    return answer
headers["Uuvsim-Session"] = ask("/join", {"lockstep": True, "lag": 60})["session"]
u = {"hull.tau": FORCES} if FIRST else {}
measured(lambda: ask("/step", {"inputs": u, "outputs": OUTPUTS}))
ask("/leave", {})
"""
BLOCKS = """
import sys, time
import uuvsim_cosim as uuv
with uuv.connect(port=PORT) as client:
    blocks = client.subscribe()
    next(blocks)
    count, begun = 0, time.perf_counter()
    while (took := time.perf_counter() - begun) < 2.0:
        next(blocks)
        count += 1
    print(count / took)
"""
GETS = """
import uuvsim_cosim as uuv
with uuv.connect(port=PORT) as client:
    count, begun = 0, time.perf_counter()
    while (took := time.perf_counter() - begun) < 2.0:
        client.get(OUTPUTS)
        count += 1
    print(count / took)
"""


def client(code: str, port: int, count: int, *, first: bool = True) -> subprocess.Popen[str]:
    told = f"import time\nPORT, COUNT, FIRST = {port}, {count}, {first}\n"
    told += f"FORCES, OUTPUTS = {FORCES}, {OUTPUTS}\n"
    command = [sys.executable, "-c", told + MEASURED + code]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def numbers(running: subprocess.Popen[str]) -> list[float]:
    return [float(x) for x in running.communicate()[0].split()]


def in_process(conductor: Conductor, count: int) -> list[float]:
    me, taken = Client("benchmark", "local"), np.empty(count)
    for k in range(count):
        begun = time.perf_counter()
        conductor.step(me, 1, {"hull.tau": FORCES}, OUTPUTS)
        taken[k] = time.perf_counter() - begun
    return [float(np.median(taken)), float(np.quantile(taken, 0.99))]


def together(one: tuple[str, int], other: tuple[str, int], count: int) -> list[float]:
    running = [client(*one, count), client(*other, 20 * count, first=False)]
    try:
        return numbers(running[0])
    finally:
        running[1].kill()  # it is gone: the fail-safe lets the others go on
        running[1].communicate()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    count = parser.parse_args().count
    conductor = Conductor(uuv.System("hull_alone", "0.01").add("hull", "model:bluerov2_heavy"))
    me = Client("benchmark", "local")
    with uuv.Bridge(conductor, port=0) as bridge, HttpServer(conductor, 0) as web:
        zenoh, http = (ZENOH, bridge.port), (HTTP, web.port)
        rows = [("in process", in_process(conductor, count))]
        rows.append(("Python, Zenoh", numbers(client(*zenoh, count))))
        rows.append(("HTTP", numbers(client(*http, count))))
        rows.append(("Python and Python", together(zenoh, zenoh, count)))
        rows.append(("HTTP and Python", together(http, zenoh, count)))
        print(f"{'lockstep round trip':24} {'p50 ms':>8} {'p99 ms':>8} {'ratio':>7}")
        for name, (middle, high) in rows:
            ratio = middle / rows[0][1][0]
            print(f"{name:24} {1e3 * middle:8.3f} {1e3 * high:8.3f} {ratio:7.1f}", flush=True)
        for clients in (1, 4):
            running = [client(GETS, bridge.port, 0) for _ in range(clients)]
            total = sum(numbers(one)[0] for one in running)
            print(f"get of 12 numbers, {clients} Python client(s): {total:,.0f} messages/s")
        taker = client(BLOCKS, bridge.port, 0)
        while taker.poll() is None:
            conductor.step(me, 1000)
        rate = numbers(taker)[0]
        print(f"blocks of the hull, stepping as fast as can be: {rate:,.0f} messages/s")
    conductor.close()


if __name__ == "__main__":
    main()
