"""What clients that read cost a client that steps: its steps beside readers, to its steps alone.

One client steps over HTTP in a process of its own, as fast as it can. In every other window of
the same run, readers in another process ask for /schema, /describe or values, as fast as they are
answered. Prints two ratios, of steps a second of the server's processor time and of steps a
second; 1 means that readers cost nothing. The first holds on a busy machine too. The second needs
an idle one: `python benchmarks/readers.py`.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.access.authentication import everybody
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor

STEPS = """
import http.client, sys
link = http.client.HTTPConnection("127.0.0.1", int(sys.argv[1]))
while True:
    link.request("POST", "/step", b"{}", {"Content-Type": "application/json"})
    assert link.getresponse().read().startswith(b'{"ok": true'), "a step was refused"
"""
READS = """
import http.client, sys, threading, time
port, path, count = int(sys.argv[1]), sys.argv[2], int(sys.argv[3])
go, answered = threading.Event(), [0] * count
def read(i):
    link = http.client.HTTPConnection("127.0.0.1", port)
    while True:
        go.wait()
        link.request("GET", path)
        assert link.getresponse().read().startswith(b'{"ok": true'), "reading was refused"
        answered[i] += 1
for i in range(count):
    threading.Thread(target=read, args=(i,), daemon=True).start()
for line in sys.stdin:
    go.set() if line.strip() == "read" else go.clear()
    print(sum(answered), flush=True)
"""


def ratio(conductor: Conductor, port: int, path: str, count: int, windows: int, s: float) -> None:
    """Print steps a second alone and beside readers, and the ratio of the two."""
    command = [sys.executable, "-c", READS, str(port), path, str(count)]
    readers = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )

    def told(word: str) -> int:
        assert readers.stdin is not None
        assert readers.stdout is not None
        readers.stdin.write(f"{word}\n")
        return int(readers.stdout.readline())

    rates: dict[bool, list[float]] = {False: [], True: []}
    made = {False: [0, 0.0], True: [0, 0.0]}  # steps, and the server's processor time [s]
    answered = 0
    try:
        for _ in range(windows):
            for reading in (False, True):
                before = told("read" if reading else "rest")
                time.sleep(0.1)  # until the window before has ended
                begun, tick = time.perf_counter(), conductor.moment().tick
                busy = time.process_time()
                time.sleep(s)
                steps = conductor.moment().tick - tick
                made[reading][0] += steps
                made[reading][1] += time.process_time() - busy
                rates[reading].append(steps / (time.perf_counter() - begun))
                answered += (told("rest") - before) if reading else 0
    finally:
        readers.kill()
        readers.communicate()
    alone, beside = (statistics.median(rates[kind]) for kind in (False, True))
    each = [made[kind][0] / made[kind][1] for kind in (False, True)]
    print(
        f"{count} reading {path[:12]:12}  by processor time {each[1] / each[0]:.3f}  by time "
        f"{beside / alone:.3f}  ({alone:.0f} steps/s alone, {beside:.0f} beside; "
        f"{answered / (windows * s):.0f} answers/s)",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--system", default="bluerov2_hold")
    parser.add_argument("--windows", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=0.25)
    parser.add_argument("--readers", type=int, nargs="+", default=[1, 8])
    options = parser.parse_args()
    with (
        Conductor(uuv.load(options.system)) as conductor,
        HttpServer(conductor, 0, admit=everybody) as web,
    ):
        stepping = subprocess.Popen([sys.executable, "-c", STEPS, str(web.port)])
        try:
            while conductor.moment().tick < 100:
                assert stepping.poll() is None, "the client that steps has ended"
                time.sleep(0.1)
            names = [s.name for s in conductor.schema() if s.causality == "output"]
            values = f"/signals?names={','.join(n for n in names if ' ' not in n)}"
            for path in ("/schema", "/describe", values):
                for count in options.readers:
                    windows, seconds = options.windows, options.seconds
                    ratio(conductor, web.port, path, count, windows, seconds)
        finally:
            stepping.kill()
            stepping.communicate()


if __name__ == "__main__":
    main()
