"""A kernel: a system's plan compiled into one function of one communication step."""

from __future__ import annotations

import ctypes
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.lowering import runtime
from uuvsim_cosim.fmus.toolchain import compile_shared, compiler
from uuvsim_cosim.kernels.declaration_text import declaration_text
from uuvsim_cosim.kernels.driver_text import driver_text
from uuvsim_cosim.kernels.fusible import Fused, fused_of
from uuvsim_cosim.orchestrator.flatten import flatten
from uuvsim_cosim.orchestrator.system import System

if TYPE_CHECKING:
    from uuvsim_cosim.kernels.batch import Batch, Seeds
    from uuvsim_cosim.kernels.derivative import Derivative
    from uuvsim_cosim.kernels.derivative_text import Mode
    from uuvsim_cosim.kernels.rollout import Values

__all__ = ["Kernel", "fuse"]

LANES = {"float64": (1, 2, 4, 8, 16), "float32": (4, 8, 16, 32)}
_USUAL = {"float64": 8, "float32": 16}


def fuse(
    system: System, *, dtype: str = "float64", lanes: int | None = None, baseline: bool = False
) -> Kernel:
    """Compile a system of declarations into a kernel over `lanes` environments at a time.

    The code is for this machine's processor, or with `baseline` for every one of its kind. In
    float64 the results are the master's to the last bit; float32 (16 lanes by default instead of
    8) is faster and rounds. Raises SystemInvalid with every component that is no declaration and
    everything else that only the master can do; ToolchainError.
    """
    if dtype not in LANES:
        near = ", ".join(LANES)
        raise InputInvalid(f"dtype: {dtype!r}; expected one of {near}")
    width = _USUAL[dtype] if lanes is None else lanes
    if width not in LANES[dtype]:
        allowed = ", ".join(map(str, LANES[dtype]))
        raise InputInvalid(f"lanes: {width}; expected one of {allowed} in {dtype}")
    number = np.dtype(dtype)
    return Kernel(fused_of(flatten(system), 8 // number.itemsize), width, number, baseline)


@final
class Kernel:
    """The compiled plan; `batch` makes environments of it."""

    def __init__(self, fused: Fused, lanes: int, dtype: np.dtype, baseline: bool) -> None:
        self.fused = fused
        self.lanes = lanes
        self.dtype = dtype
        self.baseline = baseline
        self._derivatives: dict[Mode, Derivative] = {}
        single = dtype == np.float32
        flags = (f"-DUUV_W={lanes}", "-Wno-psabi", *processor_flags(baseline))
        draws_flags = ("-DUUV_W=8", "-Wno-psabi", *flags[2:])
        if single:
            flags = (*flags, "-DUUV_FLOAT32", "-ffp-contract=fast")
        texts = [declaration_text(fused.equations[s], dtype) for s in fused.sources]
        names = [fused.equations[s].layout.model.name for s in fused.sources]
        driver = driver_text(fused, [content_hash([t, *flags]) for t in texts])
        workers = max(1, min(len(texts) + 1, os.cpu_count() or 1))
        with ThreadPoolExecutor(workers) as pool:
            longest_first = sorted(range(len(texts)), key=lambda i: -len(texts[i]))
            built = {i: pool.submit(_compiled, names[i], texts[i], flags) for i in longest_first}
            driven = pool.submit(_compiled, "kernel", driver, flags)
            drawn = pool.submit(_compiled_draws, draws_flags) if single else None
            path = driven.result()
            paths = [built[i].result() for i in range(len(texts))]
        self.c = ctypes.CDLL(str(path))
        _declare(self.c)
        self._libraries = [ctypes.CDLL(str(p)) for p in paths]
        if drawn is not None:
            draws = ctypes.CDLL(str(drawn.result()))
            for library in self._libraries:
                place = ctypes.c_void_p.in_dll(library, "uuv_the_lane_draws")
                place.value = ctypes.cast(draws.uuv_float_draws, ctypes.c_void_p).value
            self._libraries.append(draws)
        for i in range(len(texts)):
            table = ctypes.c_char.in_dll(self._libraries[i], "uuv_the_lane_stepper")
            self.c.uuv_kernel_bind(i, ctypes.addressof(table))

    @cached_property
    def variables(self) -> Mapping[str, Variable]:
        """Give every variable by its full name, "hull.eta"."""
        return {
            f"{c.path}.{name}": v
            for c in self.fused.plan.components
            for name, v in c.description.variables.items()
        }

    def batch(
        self,
        n_envs: int,
        *,
        seeds: Seeds | None = None,
        start: Mapping[str, Any] | None = None,
        threads: int = 1,
    ) -> Batch:
        """Make initialized environments.

        `seeds` is a system seed for each, or one s for s, s + 1, …; by default 0, 1, …. `start`
        names start values ("hull.eta_0"): of the variable's shape, or one row an environment.
        """
        from uuvsim_cosim.kernels.batch import Batch

        return Batch(self, n_envs, seeds=seeds, start=start, threads=threads)

    def jvp(
        self,
        start: Mapping[str, Any],
        tangents: Mapping[str, Any],
        outputs: Sequence[str],
        *,
        steps: int,
        **more: Any,
    ) -> tuple[Values, Values]:
        """Give outputs at the end of every step, and their derivative along `tangents`.

        `start` and `more` are what `Rollout` takes: n_envs, inputs, seeds, threads.
        """
        from uuvsim_cosim.kernels.rollout import Rollout, jvp

        return jvp(Rollout(self, start, outputs, steps=steps, **more), tangents)

    def vjp(
        self, start: Mapping[str, Any], outputs: Sequence[str], *, steps: int, **more: Any
    ) -> tuple[Values, Callable[[Mapping[str, Any]], Values]]:
        """Give outputs at the end of every step, and a function that pulls gradients back.

        `start` and `more` are what `Rollout` takes: n_envs, inputs, seeds, threads.
        """
        from uuvsim_cosim.kernels.rollout import Rollout, vjp

        return vjp(Rollout(self, start, outputs, steps=steps, **more))

    def derivative(self, mode: Mode) -> Derivative:
        """Compile the tangents, or adjoints, of a step; once, when first asked for."""
        from uuvsim_cosim.kernels.derivative import Derivative

        if mode not in self._derivatives:
            self._derivatives[mode] = Derivative(self, mode)
        return self._derivatives[mode]


def _compiled(name: str, text: str, flags: tuple[str, ...]) -> Path:
    folder = cache_dir("generated", content_hash([text]))
    path = folder / f"{name}.c"
    if not intact(path):
        keep(path, text.encode())
    include = [content("fmus", "kernels"), runtime()]
    return compile_shared([path], name=f"{name}_lanes", include=include, flags=flags)


def _compiled_draws(flags: tuple[str, ...]) -> Path:
    source = content("fmus", "kernels") / "float_draws.c"
    include = [content("fmus", "kernels"), runtime()]
    return compile_shared([source], name="float_draws", include=include, flags=flags)


@lru_cache
def _processor() -> str:
    """Identify this machine's processor: what is compiled for it runs on no other."""
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n", 1)[0].splitlines()
    except OSError:
        return content_hash([platform.machine(), platform.processor(), platform.node()])[:16]
    wanted = ("model name", "flags", "Features", "CPU part", "CPU implementer", "isa")
    return content_hash([line for line in lines if line.startswith(wanted)])[:16]


def processor_flags(baseline: bool) -> tuple[str, ...]:
    """Give the compiler's options for this machine's processor, or none for every one."""
    if baseline:
        return ()
    zig = "ziglang" in compiler()[0]
    arm = platform.machine().lower() in ("aarch64", "arm64")
    option = "-mcpu=native" if zig or arm else "-march=native"
    return option, f"-DUUV_PROCESSOR=0x{_processor()}"  # the latter for the cache's key alone


def _declare(c: ctypes.CDLL) -> None:
    pointer, u32, u64 = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "uuv_kernel_bind": (None, [u32, pointer]),
        "uuv_kernel_step": (ctypes.c_int32, [pointer, u64, u64, u64]),
        "uuv_kernel_reset": (ctypes.c_int32, [pointer, pointer, pointer, pointer, u64, u64]),
        "uuv_kernel_seed": (None, [pointer, pointer, pointer, u64, u64]),
        "uuv_kernel_derive": (None, [pointer, u32, u64, u64]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(c, name)
        function.restype, function.argtypes = result, arguments
