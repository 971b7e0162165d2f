"""Every shipped component three ways: its C, its C from another compiler, and CasADi's own word."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.fmus.codegen.equations import Equations
from uuvsim_cosim.fmus.codegen.lowering import Lowered, lower
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.codegen.runtime import runtime, runtime_file
from uuvsim_cosim.fmus.codegen.toolchain import (
    FLAGS,
    compile_shared,
    component_flags,
    generated_sources,
    host,
)
from uuvsim_cosim.models.declaration.library import available, declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.philox import normals

NAMES = available()
H = 0.01
STEPS = 40


def random_inputs(model: Model, rng: np.random.Generator) -> dict[str, Any]:
    """Inputs as they might come: near the start value, in range, Booleans either way."""
    values: dict[str, Any] = {}
    for v in model.of_kind("input"):
        if v.type == "Boolean":
            values[v.name] = rng.integers(0, 2, v.shape).astype(float)
            continue
        value = v.start.reshape(v.shape) + rng.normal(0.0, 0.3, v.shape)
        low, high = v.min if v.min is not None else -np.inf, v.max if v.max is not None else np.inf
        values[v.name] = np.clip(value, low, high)
    return values


def casadi_step(eq: Equations, block: np.ndarray, ticks: list[int], t: float) -> np.ndarray:
    """One communication step as uuv_do_step does it, evaluated by CasADi."""
    at, n = eq.layout.offset, eq.layout.count
    b = block.copy()
    x = slice(at["state"], at["state"] + n["state"])
    z = slice(at["discrete"], at["discrete"] + n["discrete"])
    d = slice(at["derived"], at["derived"] + n["derived"])
    known = at["output"]

    def f(function: Any, time: float, *more: np.ndarray) -> np.ndarray:
        b[0] = time
        return np.array(function(b[:known], *more)).ravel()

    def integrate(start: float, end: float) -> None:
        pieces = (end - start) / eq.layout.model.h_max
        count = max(int(pieces) + (pieces - int(pieces) > 1e-6), 1)
        h = (end - start) / count
        for i in range(count):
            at_start, x0 = start + i * h, b[x].copy()
            k1 = f(eq.rhs, at_start)
            b[x] = x0 + 0.5 * h * k1
            k2 = f(eq.rhs, at_start + 0.5 * h)
            b[x] = x0 + 0.5 * h * k2
            k3 = f(eq.rhs, at_start + 0.5 * h)
            b[x] = x0 + h * k3
            k4 = f(eq.rhs, at_start + h)
            b[x] = x0 + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)

    b[d] = f(eq.derived, t)
    now = t
    clocks = eq.layout.model.clocks
    while True:
        due = [float(k * c.period) for k, c in zip(ticks, clocks, strict=True)]
        if not due or min(due) >= t + H - 1e-6 * H:
            break
        i = int(np.argmin(due))
        if due[i] > now + 1e-6 * H and n["state"]:
            integrate(now, due[i])
            now = due[i]
        size = sum(w.numel() for w in clocks[i].draws)
        seed = eq.layout.offset_of("seed") if size else 0
        b[z] = f(eq.updates[i], due[i], normals(b[seed : seed + 2], i, ticks[i], size))
        ticks[i] += 1
    if n["state"]:
        integrate(now, t + H)
    b[known:] = f(eq.outputs, t + H)
    return b


def stepped(native: Native, model: Model, rng: np.random.Generator, k: int) -> np.ndarray:
    for name, value in random_inputs(model, rng).items():
        v = native.description.variables[name]
        native.set(v, value if v.shape else float(value))
    before = native._block.copy()
    native.do_step(k * H, H)
    return before


def started(lowered: Lowered, library: Path | None = None) -> Native:
    native = Native(lowered, lowered.model.name, library)
    native.enter_initialization_mode(0.0, None)
    native.exit_initialization_mode()
    return native


@pytest.mark.parametrize("name", NAMES)
def test_the_c_of_a_component_agrees_with_casadi_within_1e_12(name: str) -> None:
    model = declare(name)
    lowered = lower(model)
    native, eq = started(lowered), lowered.equations
    rng = np.random.default_rng(5)
    ticks = [0] * len(model.clocks)
    for k in range(STEPS):
        before = stepped(native, model, rng, k)
        wanted = casadi_step(eq, before, ticks, k * H)
        scale = np.maximum(np.abs(wanted), 1.0)
        if "sonar" in name:  # an image is a sum of many echoes
            scale = np.full_like(scale, scale.max())
        worst = np.abs(native._block - wanted) / scale
        least = 1e-5 if "sonar" in name else 1e-12  # images are summed up in float32
        assert worst.max() < least, (k, int(worst.argmax()), worst.max())
    native.free()


@pytest.fixture(scope="module")
def runtime_by_gcc(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The runtime's object by gcc, compiled once; zig keeps its own."""
    target = tmp_path_factory.mktemp("runtime") / "uuv_runtime.o"
    source = [str(runtime_file("uuv_runtime.c")), *(f"-I{folder}" for folder in runtime())]
    subprocess.run(["gcc", *FLAGS, "-fPIC", "-c", *source, "-o", str(target)], check=True)
    return target


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here; zig is what users have")
@pytest.mark.parametrize("name", [n for n in NAMES if "@" not in n])
def test_gcc_and_zig_give_the_same_bits(
    name: str, runtime_by_gcc: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = declare(name)
    lowered = lower(model)
    zig = started(lowered)
    monkeypatch.setenv("CC", "gcc")
    parts = [runtime_by_gcc, generated_sources(lowered.files)[0]]
    library = compile_shared(
        parts, name=f"{name}_gcc", include=runtime(), flags=component_flags(host())
    )
    gcc = started(lowered, library)
    rngs = np.random.default_rng(6), np.random.default_rng(6)
    for k in range(STEPS):
        for native, rng in zip((zig, gcc), rngs, strict=True):
            stepped(native, model, rng, k)
        np.testing.assert_array_equal(zig._block, gcc._block)
    zig.free()
    gcc.free()
