"""Round trip write + step + read of one hull: in process, Python over TCP, HTTP, and Octave's .m.

Each number is the median (and 99th percentile) of as many trips through the same co-simulation in
one run; the ratio is to a step in process. Set the six forces, make one step of 0.01 s, read
position and velocity. Where UUVSIM_ZENOH_PICO names an installed zenoh-pico, the MEX client on
Zenoh is compiled and measured as well.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import shutil
import socket
import struct
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.access.token import known_token
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.framing import frame
from uuvsim_cosim.bridge.tcp.server import TcpServer

FORCES = np.array([10.0, 0, 0, 0, 0, 1])
OUTPUTS = ["hull.eta", "hull.nu"]
OCTAVE = """
s = uuvsim.connect('port', %d); tau = [10; 0; 0; 0; 0; 1]; u.hull.tau = tau; taken = zeros(%d, 1);
for k = 1:numel(taken), q = tic; y = s.step(u, 0.01, {'hull.eta', 'hull.nu'}); taken(k) = toc(q);
end
printf('%%.9g %%.9g ', median(taken), quantile(taken, 0.99));
s.layout('hull.tau', {'hull.eta', 'hull.nu'});
for k = 1:numel(taken), q = tic; y = s.step(tau); taken(k) = toc(q); end
printf('%%.9g %%.9g\\n', median(taken), quantile(taken, 0.99)); s.close();
"""


ZENOH = """
build_zenoh('%s', '%s'); addpath('%s'); taken = zeros(%d, 1);
z = uuvsim.Zenoh('port', %d); u = {'hull.tau', [10; 0; 0; 0; 0; 1]};
for k = 1:numel(taken), q = tic; [a, b] = z.step(1, u, {'hull.eta', 'hull.nu'}); taken(k) = toc(q);
end
printf('%%.9g %%.9g\\n', median(taken), quantile(taken, 0.99)); z.close();
"""


def measured(trip: Callable[[], object], count: int) -> tuple[float, float]:
    for _ in range(20):
        trip()
    taken = np.empty(count)
    for k in range(count):
        begin = time.perf_counter()
        trip()
        taken[k] = time.perf_counter() - begin
    return float(np.median(taken)), float(np.quantile(taken, 0.99))


def over_tcp(port: int, count: int) -> tuple[float, float]:
    with socket.create_connection(("127.0.0.1", port)) as link:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        file = link.makefile("rb")

        def answer() -> bytes:
            head, body = struct.unpack("<II", file.read(8))
            return file.read(head + body)

        answer()
        hello = {"call": "hello", "protocol": 1, "token": known_token("127.0.0.1", port)}
        for said in (hello, {"call": "layout", "inputs": ["hull.tau"], "outputs": OUTPUTS}):
            link.sendall(frame(said))
            answer()
        step = frame(None, np.array([1.0, *FORCES]).tobytes())

        def trip() -> bytes:
            link.sendall(step)
            return answer()

        found = measured(trip, count)
        file.close()
    return found


def over_http(port: int, count: int) -> tuple[float, float]:
    connection = http.client.HTTPConnection("127.0.0.1", port)
    body = json.dumps({"inputs": {"hull.tau": FORCES.tolist()}, "outputs": OUTPUTS})
    token = known_token("127.0.0.1", port)
    headers = {"Content-Type": "application/json", "Authorization": f"Bearer {token}"}

    def trip() -> object:
        connection.request("POST", "/step", body, headers)
        return json.loads(connection.getresponse().read())

    found = measured(trip, count)
    connection.close()
    return found


def in_octave(port: int, count: int) -> list[tuple[float, float]]:
    octave = shutil.which("octave-cli")
    if octave is None:
        return []
    numbers = numbers_of(octave, OCTAVE % (port, count))
    return [(numbers[0], numbers[1]), (numbers[2], numbers[3])]


def in_octave_on_zenoh(port: int, count: int) -> list[tuple[float, float]]:
    octave, built = shutil.which("octave-cli"), os.environ.get("UUVSIM_ZENOH_PICO")
    if octave is None or built is None:
        return []
    with tempfile.TemporaryDirectory() as folder:
        numbers = numbers_of(octave, ZENOH % (built, folder, folder, count, port))
    return [(numbers[0], numbers[1])]


def numbers_of(octave: str, code: str) -> list[float]:
    folder = Path(__file__).parents[2] / "matlab"
    command = [octave, "--norc", "--quiet", "--no-window-system", "--eval"]
    paths = f"addpath('{folder}', '{folder / 'mex'}');"
    done = subprocess.run([*command, paths + code], check=True, capture_output=True, text=True)
    return [float(x) for x in done.stdout.split()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    count = parser.parse_args().count
    conductor = Conductor(uuv.System("hull_alone", "0.01").add("hull", "model:bluerov2_heavy"))
    me = Client("benchmark", "local")
    with (
        TcpServer(conductor, 0) as tcp,
        HttpServer(conductor, 0) as web,
        uuv.Bridge(conductor, port=0, anyone=True) as bridge,  # zenoh-pico shows no token
    ):
        rows = [
            (
                "in process",
                measured(lambda: conductor.step(me, 1, {"hull.tau": FORCES}, OUTPUTS), count),
            ),
            ("Python over TCP, compact step", over_tcp(tcp.port, count)),
            ("HTTP, JSON", over_http(web.port, count)),
        ]
        names = ("Octave .m, structs", "Octave .m, vectors")
        rows += list(zip(names, in_octave(tcp.port, count), strict=False))
        rows += [("Octave, Zenoh MEX", x) for x in in_octave_on_zenoh(bridge.port, count)]
    conductor.close()
    base = rows[0][1][0]
    print(f"{'round trip':32} {'p50 ms':>9} {'p99 ms':>9} {'ratio':>7}")
    for name, (middle, high) in rows:
        print(f"{name:32} {1e3 * middle:9.3f} {1e3 * high:9.3f} {middle / base:7.1f}")


if __name__ == "__main__":
    main()
