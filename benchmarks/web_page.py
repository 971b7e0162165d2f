"""A system on a page: size, time of compilation, and steps per CPU second in node and natively.

The native figure is that of the same system as a kernel of one lane for every processor, which is
the same C. Node and native steps are measured in turn; the medians are printed, and the hash of
node, which shows that the steps were made. `--uncached` compiles the module again.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time

import uuvsim_cosim as uuv
from uuvsim_cosim.cache import cache_dir
from uuvsim_cosim.kernels.web_assembly.module import web_assembly
from uuvsim_cosim.kernels.web_assembly.node import run_in_node
from uuvsim_cosim.view.live_page.live_page import live_page_html

SYSTEMS = ("bluerov2_hold", "bluerov2_survey")


def native_seconds(kernel: uuv.Kernel, steps: int) -> float:
    with kernel.batch(1, seeds=[0]) as batch:
        begun = time.process_time()
        batch.step(steps)
        return time.process_time() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("systems", nargs="*", default=SYSTEMS)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--uncached", action="store_true")
    asked = parser.parse_args()
    print("| system | page [kB] | module [kB] | compile [s] | node [steps/s] | native [steps/s] |")
    print("|---|---|---|---|---|---|")
    for name in asked.systems:
        system = uuv.load(name)
        with tempfile.TemporaryDirectory() as folder:
            if asked.uncached:  # what zig has compiled of its C library stays
                os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", f"{cache_dir('zig')}")
                os.environ["UUVSIM_CACHE"] = folder
            begun = time.perf_counter()
            compiled = web_assembly(system)
            seconds = time.perf_counter() - begun
            page = len(live_page_html(system).encode())
            kernel = uuv.fuse(system, lanes=1, baseline=True)
            node, native = [], []
            for _ in range(asked.repeats):
                run = run_in_node(compiled, asked.steps, record=False)
                node.append(asked.steps / run.seconds)
                native.append(asked.steps / native_seconds(kernel, asked.steps))
            size = compiled.module.stat().st_size
        print(
            f"| {name} | {page / 1000:.0f} | {size / 1000:.0f} | {seconds:.1f} "
            f"| {statistics.median(node):,.0f} | {statistics.median(native):,.0f} |"
        )


if __name__ == "__main__":
    main()
