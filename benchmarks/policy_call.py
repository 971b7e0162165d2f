"""A policy per call: exported as a component, and in a kernel, against torch eager.

A call takes one observation (31) and gives one action (2), through layers of 256 and 256 in
float32: models/policies/source_sac.npz, in one thread. Every way in turn, window by window of one
run; the best window of each is the one that others on the machine disturbed least. "component" is
the FMU's own C, called in this process: set the inputs, do_step, read the output; "kernel" the
same C over 512 environments at once, per environment. `python benchmarks/policy_call.py`.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import torch

from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.learn.deployment.export import export_policy, sequential
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.orchestrator.system.system import System

FILE = content("models", "policies") / "source_sac.npz"
N = 512


def component() -> Callable[[np.ndarray], Any]:
    c = Native(declare("policy", plain=1), "policy")
    v = c.description.variables
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    begin, end = (v[name].value_references[0] for name in ("observation", "action"))
    library, block, instance = c._c, c._block, c._instance
    library.uuv_update_outputs.argtypes = [ctypes.c_void_p]
    step, show = library.uuv_do_step, library.uuv_update_outputs
    k = 0

    def call(observation: np.ndarray) -> Any:
        nonlocal k
        block[begin : begin + 31] = observation
        step(instance, k / 10, 0.1)
        show(instance)
        k += 1
        return block[end : end + 2]

    return call


def kernel(dtype: str) -> Callable[[np.ndarray], Any]:
    batch = fuse(System("one", "0.1").add("p", "model:policy?plain=1"), dtype=dtype).batch(N)
    rows = np.random.default_rng(0).normal(size=(N, 31))

    def call(observation: np.ndarray) -> Any:
        rows[0] = observation
        batch.set("p.observation", rows)
        batch.step()
        return batch.get("p.action")[0]

    return call


def eager() -> Callable[[np.ndarray], Any]:
    linear, relu = torch.nn.Linear, torch.nn.ReLU
    net = torch.nn.Sequential(
        linear(31, 256), relu(), linear(256, 256), relu(), linear(256, 2), torch.nn.Tanh()
    )
    tensors = {k: torch.from_numpy(v) for k, v in sequential(Policy.load(FILE)).items()}
    net[:-1].load_state_dict(tensors)

    def call(observation: np.ndarray) -> Any:
        with torch.inference_mode():
            return net(torch.from_numpy(observation)[None]).numpy()[0]

    return call


def onnx(folder: Path) -> Callable[[np.ndarray], Any]:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    file = export_policy(FILE, folder / "p.onnx")[0]
    session = onnxruntime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    return lambda observation: session.run(None, {"observation": observation[None]})[0][0]


def runner(folder: Path) -> Callable[[np.ndarray], Any]:
    code = export_policy(FILE, folder / "runner.py")[0]
    spec = importlib.util.spec_from_file_location("runner", code)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Runner().act  # type: ignore[no-any-return]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=30)
    windows = parser.parse_args().windows
    torch.set_num_threads(1)
    observation = np.random.default_rng(1).uniform(-1, 1, 31).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        ways = {
            "torch eager": (eager(), 300, 1),
            "numpy runner": (runner(Path(folder)), 300, 1),
            "onnxruntime": (onnx(Path(folder)), 300, 1),
            "component": (component(), 1000, 1),
            "kernel, float64": (kernel("float64"), 3, N),
            "kernel, float32": (kernel("float32"), 3, N),
        }
    best = dict.fromkeys(ways, float("inf"))
    acted = {name: np.array(call(observation), float) for name, (call, _, _) in ways.items()}
    for _ in range(windows):
        for name, (call, count, each) in ways.items():
            begun = time.perf_counter()
            for _ in range(count):
                call(observation)
            best[name] = min(best[name], (time.perf_counter() - begun) / count / each)
    slowest = best["torch eager"]
    for name, seconds in best.items():
        apart = np.abs(acted[name] - acted["torch eager"]).max()
        print(f"{name:16} {1e6 * seconds:7.2f} us a call   {slowest / seconds:5.1f} times torch   "
              f"{apart:.0e} from torch")  # fmt: skip


if __name__ == "__main__":
    main()
