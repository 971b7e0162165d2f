"""A kernel: a system's plan compiled into one function of one communication step."""

from __future__ import annotations

import ctypes
import os
import platform
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.lowering import runtime
from uuvsim_cosim.fmus.toolchain import compile_shared, compiler
from uuvsim_cosim.kernels.fusible import Fused, fused_of
from uuvsim_cosim.kernels.source_text import declaration_text, driver_text
from uuvsim_cosim.orchestrator.flatten import flatten
from uuvsim_cosim.orchestrator.system import System

if TYPE_CHECKING:
    from uuvsim_cosim.kernels.batch import Batch, Seeds

__all__ = ["Kernel", "fuse"]

LANES = (1, 2, 4, 8, 16)


def fuse(system: System, *, lanes: int = 8, baseline: bool = False) -> Kernel:
    """Compile a system of declarations into a kernel over `lanes` environments at a time.

    The code is for this machine's processor, or with `baseline` for every one of its kind; the
    results are the same to the last bit. Raises SystemInvalid with every component that is no
    declaration and everything else that only the master can do; ToolchainError.
    """
    if lanes not in LANES:
        raise InputInvalid(f"lanes: {lanes}; expected one of {', '.join(map(str, LANES))}")
    return Kernel(fused_of(flatten(system)), lanes, baseline)


@final
class Kernel:
    """The compiled plan; `batch` makes environments of it."""

    def __init__(self, fused: Fused, lanes: int, baseline: bool) -> None:
        self.fused = fused
        self.lanes = lanes
        flags = (f"-DUUV_W={lanes}", "-Wno-psabi", *(() if baseline else _processor_flags()))
        texts = [declaration_text(fused.equations[s]) for s in fused.sources]
        names = [fused.equations[s].layout.model.name for s in fused.sources]
        driver = driver_text(fused, [content_hash([t, *flags]) for t in texts])
        workers = max(1, min(len(texts) + 1, os.cpu_count() or 1))
        with ThreadPoolExecutor(workers) as pool:
            built = [
                pool.submit(_compiled, name, text, flags)
                for name, text in zip(names, texts, strict=True)
            ]
            path = pool.submit(_compiled, "kernel", driver, flags).result()
            paths = [b.result() for b in built]
        self.c = ctypes.CDLL(str(path))
        _declare(self.c)
        self._declarations = [ctypes.CDLL(str(p)) for p in paths]
        for i, library in enumerate(self._declarations):
            table = ctypes.c_char.in_dll(library, "uuv_the_lane_component")
            self.c.uuv_kernel_bind(i, ctypes.addressof(table))

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


def _compiled(name: str, text: str, flags: tuple[str, ...]) -> Path:
    folder = cache_dir("generated", content_hash([text]))
    path = folder / f"{name}.c"
    if not intact(path):
        keep(path, text.encode())
    include = [content("fmus", "kernels"), runtime()]
    return compile_shared([path], name=f"{name}_lanes", include=include, flags=flags)


@lru_cache
def _processor() -> str:
    """Identify this machine's processor: what is compiled for it runs on no other."""
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n", 1)[0].splitlines()
    except OSError:
        return content_hash([platform.machine(), platform.processor(), platform.node()])[:16]
    wanted = ("model name", "flags", "Features", "CPU part", "CPU implementer", "isa")
    return content_hash([line for line in lines if line.startswith(wanted)])[:16]


def _processor_flags() -> tuple[str, ...]:
    zig = "ziglang" in compiler()[0]
    arm = platform.machine().lower() in ("aarch64", "arm64")
    option = "-mcpu=native" if zig or arm else "-march=native"
    return option, f"-DUUV_PROCESSOR=0x{_processor()}"  # the latter for the cache's key alone


def _declare(c: ctypes.CDLL) -> None:
    pointer, u32, u64 = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "uuv_kernel_bind": (None, [u32, pointer]),
        "uuv_kernel_step": (ctypes.c_int32, [pointer, u64, u64, u64]),
        "uuv_kernel_reset": (None, [pointer, pointer, pointer, pointer, u64, u64]),
        "uuv_kernel_derive": (None, [pointer, u32, u64, u64]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(c, name)
        function.restype, function.argtypes = result, arguments
