"""Environment steps a second, end to end, beside Gymnasium's own vector CartPole in the same run.

"hold" is a BlueROV2 Heavy with allocation and eight thrusters under commanded forces: 10
communication steps of 0.01 s an action, random starts; "hull" the hull alone, one communication
step an action. Medians of CPU time on one core; the share of Python is what is not inside the
kernel's step. "expressions" compares the compiled expressions of shipped tasks with their NumPy
form, step by step in turn; there, steps of one environment are also given as the least of all.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

import uuvsim_cosim as uuv
from uuvsim_cosim.envs import Channel, CosimEnv, CosimVectorEnv, Draws, FunctionTask, Solo, Task
from uuvsim_cosim.envs.tasks import StationKeeping, TrajectoryFollowing
from uuvsim_cosim.envs.tasks.tracking_scenarios import source, target
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.orchestrator.shipped.shipped import bluerov2_hold

ENVS = (1, 64, 4096)


def hold(horizon: float = 20) -> FunctionTask:
    system = bluerov2_hold().disconnect("allocation.tau_d").remove("controller").remove("guidance")
    return FunctionTask(
        system,
        actions=[Channel(f"allocation.tau_d[{i}]", -40, 40) for i in (1, 2, 3, 6)],
        observations=[
            Channel("hull.eta[1:3]", -5, 5),
            Channel("hull.eta[6]", sin_cos=True),
            Channel("hull.nu", -2, 2),
        ],
        reward=lambda m: -np.sum(m["hull.eta"][:, :3] ** 2, axis=1),
        start=started,
        action_step="0.1",
        horizon=horizon,
    )


def started(draws: Draws) -> Mapping[str, Any]:
    eta = np.zeros((draws.n, 6))
    eta[:, :3] = draws.uniform("place", -1, 1, (3,))
    return {"hull.eta_0": eta}


def hull(source: str) -> FunctionTask:
    return FunctionTask(
        uuv.System("hull", "0.01").add("hull", source),
        actions=[Channel("hull.tau", -40, 40)],
        observations=[Channel("hull.eta[1:3]", -5, 5), Channel("hull.nu", -2, 2)],
        reward=lambda m: -np.abs(m["hull.eta"][:, 2]),
        action_step="0.01",
        horizon=1000,
    )


def median(call: Callable[[], object], repeats: int) -> float:
    call()
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return statistics.median(times)


def rate(env: Any, n: int, repeats: int, actions: Any) -> float:
    """Return environment steps a second."""
    calls = max(3, min(2000, 40000 // n))
    env.reset(seed=1)

    def run() -> None:
        for _ in range(calls):
            env.step(actions)

    return n * calls / median(run, repeats)


def share_of_python(env: CosimVectorEnv, n: int, actions: Any) -> tuple[float, float, int]:
    """Return the share of a step that is not in the kernel, the kernel's rate, and its bytes."""
    plant: Any = env._simulation.episodes.plant  # type: ignore[union-attr]
    own, calls = plant.step, max(10, min(2000, 40000 // n))
    inside = 0.0

    def timed(ticks: int) -> None:
        nonlocal inside
        begin = time.process_time()
        own(ticks)
        inside += time.process_time() - begin

    plant.step = timed
    begin = time.process_time()
    for _ in range(calls):
        env.step(actions)
    whole = time.process_time() - begin
    plant.step = own
    fused = plant._kernel.fused
    return 1 - inside / whole, n * calls / inside, 8 * (fused.n_cells + fused.n_start)


def measure(name: str, task: FunctionTask, options: argparse.Namespace) -> None:
    print(f"{name}:")
    for n in ENVS:
        env = CosimVectorEnv(task, n)
        width = env.single_action_space.shape[0]
        actions = np.random.default_rng(1).uniform(-1, 1, (n, width)).astype(np.float32)
        ours = rate(env, n, options.repeats, actions)
        share, fused, memory = share_of_python(env, n, actions)
        env.close()
        cart: Any = gymnasium.make_vec("CartPole-v1", n, vectorization_mode="vector_entry_point")
        theirs = rate(cart, n, options.repeats, np.arange(n) % 2)
        cart.close()
        print(
            f"  {n:4d} environments: {ours:11,.0f} steps/s, fused step alone {fused:11,.0f}, "
            f"share of Python {share:5.1%}; CartPole {theirs:11,.0f}, "
            f"ratio {ours / theirs:5.2f}; {memory} bytes each"
        )


def without(task: Task) -> Task:
    """Let the environment call the methods of a task, which are in NumPy."""
    task = copy.copy(task)
    task.__class__ = type(type(task).__name__, (type(task),), {"expressions": lambda t, m: None})
    return task


def both_forms(name: str, task: Task, options: argparse.Namespace) -> None:
    forms = {"NumPy": without(task), "compiled": task}
    for n in (64, 4096):
        envs = {form: CosimVectorEnv(t, n) for form, t in forms.items()}
        shares: dict[str, list[tuple[float, float]]] = {form: [] for form in envs}
        for _ in range(options.repeats):
            for form, env in envs.items():
                actions = np.random.default_rng(1).uniform(-1, 1, env.action_space.shape or 0)
                env.reset(seed=1)
                share, fused, _ = share_of_python(env, n, actions)
                shares[form].append((share, fused * (1 - share)))
        for form, measured in shares.items():
            share, speed = (statistics.median(values) for values in zip(*measured, strict=True))
            print(
                f"  {name}, {n:4d}, {form:8}: {speed:9,.0f} steps/s, share of Python {share:5.1%}"
            )
            envs[form].close()
    ones = {form: CosimEnv(t) for form, t in forms.items()}
    times: dict[str, list[float]] = {form: [] for form in ones}
    for episode in range(4 * options.repeats):
        for form, one in ones.items():
            one.reset(seed=episode)
            action = np.zeros(one.action_space.shape or 0)
            for _ in range(45):
                begin = time.process_time()
                one.step(action)
                times[form].append(1e6 * (time.process_time() - begin))
    for form, each in times.items():
        ones[form].close()
        print(
            f"  {name}, one,  {form:8}: {statistics.median(each):6.0f} us a step, "
            f"least {min(each):6.0f} us"
        )


def single(name: str, env: CosimEnv, options: argparse.Namespace) -> None:
    width = env.action_space.shape[0]  # type: ignore[index]
    action = np.zeros(width, np.float32)
    env.reset(seed=1)

    def steps() -> None:
        env.reset()
        for _ in range(190):
            env.step(action)

    def resets() -> None:
        for _ in range(200):
            env.reset()

    step, reset = median(steps, options.repeats) / 190, median(resets, options.repeats) / 200
    print(f"  {name}: {1 / step:9,.0f} steps/s, {1 / reset:9,.0f} resets/s")
    env.close()


def compile_time(task: FunctionTask) -> float:
    """Return the seconds to the first environment with an empty cache."""
    import os

    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        before = os.environ.get("UUVSIM_CACHE")
        os.environ["UUVSIM_CACHE"] = folder

        def restore() -> None:
            if before is None:
                del os.environ["UUVSIM_CACHE"]
            else:
                os.environ["UUVSIM_CACHE"] = before

        stack.callback(restore)
        begin = time.perf_counter()
        fuse(task.system)
        return time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--compile", action="store_true", help="also with an empty cache")
    parser.add_argument("--expressions", action="store_true", help="both forms of tasks alone")
    options = parser.parse_args()
    if options.expressions:
        both_forms("target tracking, two trackers", Solo(target()), options)
        both_forms("target tracking, one tracker", Solo(source()), options)
        both_forms("station keeping", StationKeeping(), options)
        both_forms("trajectory following", TrajectoryFollowing(), options)
        return
    measure("hold, 10 communication steps an action", hold(), options)
    measure("hull, 1 communication step an action", hull("model:bluerov2_heavy"), options)
    print("one environment:")
    fmu: Path = build_fmu(declare("bluerov2_heavy"), fmi=3)
    single("hold, kernel", CosimEnv(hold(), backend="kernel"), options)
    single("hold, master", CosimEnv(hold(), backend="master"), options)
    single("hull, kernel", CosimEnv(hull("model:bluerov2_heavy")), options)
    single("hull, FMU   ", CosimEnv(hull(str(fmu))), options)
    env = CosimVectorEnv(hold(), 4096)
    env.reset(seed=1)
    every = median(env.reset, options.repeats)
    env.close()
    env = CosimVectorEnv(hold(), 4096, autoreset_mode=AutoresetMode.DISABLED)  # allows a mask
    env.reset(seed=1)
    mask = np.arange(4096) % 200 == 0
    some = median(lambda: env.reset(options={"reset_mask": mask}), options.repeats)
    print(
        f"4096 environments: {4096 / every:,.0f} resets/s; reset of {mask.sum()} of them in "
        f"{1e3 * some:.2f} ms"
    )
    env.close()
    if options.compile:
        for name, task in (("hold", hold()), ("hull", hull("model:bluerov2_heavy"))):
            print(f"{name}: kernel in {compile_time(task):.1f} s with an empty cache")


if __name__ == "__main__":
    main()
