"""Cost of derivatives through a kernel, as ratios to its plain steps in the same run.

"plain" is `run`: steps whose outputs are read at the end of each, as jvp and vjp do. One tangent
follows a step; one vjp is the rollout and the gradient with respect to everything given. The
first call compiles; it is told apart. Medians of CPU time on one core.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
from kernel_speed import processor, vehicle

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.kernels.derivatives.rollout import Rollout, jvp, run, vjp

OUTPUTS = ["hull.eta", "hull.nu"]


def median(call: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return statistics.median(times)


def measure(name: str, system: uuv.System, options: argparse.Namespace) -> None:
    n = options.environments
    kernel = fuse(system)
    start = {"hull.nu_0": 0.1 * np.random.default_rng(0).standard_normal((n, 6))}
    compiled = {}
    for mode in ("tangent", "adjoint"):
        begin = time.perf_counter()
        kernel.derivative(mode)
        compiled[mode] = time.perf_counter() - begin
    rollout = Rollout(kernel, start, OUTPUTS, steps=options.steps, n_envs=n)
    ones = {o: np.ones((options.steps, n, 6)) for o in OUTPUTS}
    twice = Rollout(kernel, start, OUTPUTS, steps=options.steps, n_envs=n, kept_bytes=0)
    plain = median(lambda: run(rollout), options.repeats)
    forward = median(lambda: jvp(rollout, start), options.repeats)
    back = median(lambda: vjp(rollout)[1](ones), options.repeats)
    again = median(lambda: vjp(twice)[1](ones), options.repeats)
    rate = n * options.steps / plain / 1e6
    print(
        f"{name}: plain {rate:.2f} million steps/s; jvp {forward / plain:.1f}, "
        f"vjp {back / plain:.1f}, with steps made twice {again / plain:.1f} times that; "
        f"ready in {compiled['tangent']:.1f} and {compiled['adjoint']:.1f} s"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--environments", type=int, default=256)
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--survey", action="store_true", help="compiles for minutes")
    options = parser.parse_args()
    print(f"{processor()}; {options.environments} environments, {options.steps} steps, one core")
    measure("hull, first order", vehicle("model:thruster"), options)
    measure("hull, T200", vehicle(), options)
    measure("hold", uuv.load("bluerov2_hold"), options)
    if options.survey:
        measure("survey", uuv.load("bluerov2_survey"), options)


if __name__ == "__main__":
    main()
