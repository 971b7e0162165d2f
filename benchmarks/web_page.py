"""A system on a page: size, compile time, and steps per CPU second in Chromium, node and natively.

The native figure is that of the same system as a kernel of one lane for every processor, which is
the same C. All three are measured in turn, by the CPU time of their processes; the medians are
printed. The figure of Chromium is the difference of two runs of the whole browser with all its
processes, of which one makes fewer steps, so that its start is not counted; the start varies by
0.5 s, so that the longer one makes three times the steps of the others. Its hash must be that of
node. `--uncached` compiles the module again. The CPU time of a browser is read from /proc (Linux).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import resource
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import uuvsim_cosim as uuv
from uuvsim_cosim.cache import cache_dir
from uuvsim_cosim.kernels.web_assembly.module import WebAssembly, web_assembly
from uuvsim_cosim.kernels.web_assembly.node import run_in_node
from uuvsim_cosim.view.live_page.live_page import live_page_html

SYSTEMS = (
    "bluerov2_hold", "bluerov2_survey", "bluerov2_task", "pool_tracking", "seabed_mapping",
    "target_tracking",
)  # fmt: skip
FEW, MOST = 1000, 9_999_999  # steps: of a run that is mostly the browser's start; of a link
LONGER = 3  # times the steps, in Chromium
FLAGS = (
    "--headless=new", "--no-sandbox", "--no-zygote", "--disable-gpu", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--virtual-time-budget=3000", "--dump-dom",
)  # fmt: skip


def of_children() -> float:
    """Return the CPU time of all processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def native_seconds(kernel: uuv.Kernel, steps: int) -> float:
    with kernel.batch(1, seeds=[0]) as batch:
        begun = time.process_time()
        batch.step(steps)
        return time.process_time() - begun


def chromium_seconds(browser: str, page: Path, steps: int) -> tuple[float, str]:
    """Return the CPU time of a browser that opens the page and makes steps, and its hash."""
    used: dict[int, float] = {}  # by process: it is gone at the end, so it is read while it runs
    with tempfile.TemporaryDirectory() as profile, tempfile.TemporaryFile("w+") as shown:
        address = f"{page.as_uri()}#steps={steps}"
        command = [browser, *FLAGS, f"--user-data-dir={profile}", address]
        with subprocess.Popen(command, stdout=shown, stderr=subprocess.DEVNULL) as process:
            while process.poll() is None:
                used |= dict(of_tree(process.pid))
                time.sleep(0.05)
        shown.seek(0)
        found = re.search(r'id="hash">(\w+)<', shown.read())
    assert found is not None, "the page shows no hash"
    return sum(used.values()), found[1]


def of_tree(root: int) -> Iterator[tuple[int, float]]:
    """Yield the processes below one and itself, each with its CPU time [s]."""
    parents, seconds = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            pid = int(stat.parent.name)
            parents[pid] = int(fields[1])
            seconds[pid] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    for pid, own in seconds.items():
        above = pid
        while above not in (0, root):
            above = parents.get(above, 0)
        if above == root:
            yield pid, own


def chromium_rate(browser: str, page: Path, compiled: WebAssembly, steps: int) -> float:
    """Return the steps per CPU second in Chromium."""
    few, _ = chromium_seconds(browser, page, FEW)
    many, found = chromium_seconds(browser, page, FEW + steps)
    expected = run_in_node(compiled, FEW + steps, record=False).hash
    assert found == expected, f"hash {found} in Chromium; expected {expected}, as in node"
    return steps / (many - few)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("systems", nargs="*", default=SYSTEMS)
    parser.add_argument("--seconds", type=float, default=2.0, help="CPU time of a measurement")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--uncached", action="store_true")
    asked = parser.parse_args()
    browser = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(
        "| system | page [kB] | module [kB] | compile [CPU s] | Chromium [steps/s] "
        "| node [steps/s] | native [steps/s] |\n|---|---|---|---|---|---|---|"
    )
    for name in asked.systems:
        system = uuv.load(name)
        with tempfile.TemporaryDirectory() as folder:
            if asked.uncached:  # what zig has compiled of its C library stays
                os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", f"{cache_dir('zig')}")
                os.environ["UUVSIM_CACHE"] = folder
            begun = of_children()
            compiled = web_assembly(system)
            seconds = of_children() - begun
            page = Path(folder, "page.html")
            page.write_text(live_page_html(system), encoding="utf-8")
            kernel = uuv.fuse(system, lanes=1, baseline=True)
            warm = run_in_node(compiled, 10 * FEW, record=False)
            steps = int(asked.seconds * 10 * FEW / warm.seconds)
            steps = max(FEW, min((MOST - FEW) // LONGER, steps))
            node, native, chromium = [], [], []
            for _ in range(asked.repeats):
                node.append(steps / run_in_node(compiled, steps, record=False).seconds)
                native.append(steps / native_seconds(kernel, steps))
                if browser is not None:
                    chromium.append(chromium_rate(browser, page, compiled, LONGER * steps))
            sizes = [f"{f.stat().st_size / 1000:.0f}" for f in (page, compiled.module)]
            rates = [f"{statistics.median(r):,.0f}" if r else "–" for r in (chromium, node, native)]
        print(f"| {name} | {' | '.join([*sizes, f'{seconds:.1f}', *rates])} |", flush=True)


if __name__ == "__main__":
    main()
