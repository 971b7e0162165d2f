"""Compiler options for the processor of this machine."""

from __future__ import annotations

import platform
from functools import lru_cache
from pathlib import Path

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.fmus.codegen.toolchain import compiler

__all__ = ["processor_flags"]


@lru_cache
def _processor() -> str:
    """Return an id of this machine's processor: code compiled for it does not run on others."""
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n", 1)[0].splitlines()
    except OSError:
        return content_hash([platform.machine(), platform.processor(), platform.node()])[:16]
    wanted = ("model name", "flags", "Features", "CPU part", "CPU implementer", "isa")
    return content_hash([line for line in lines if line.startswith(wanted)])[:16]


def processor_flags(baseline: bool) -> tuple[str, ...]:
    """Return the compiler's options for this machine's processor, or none for every one."""
    if baseline:
        return ()
    zig = "ziglang" in compiler()[0]
    arm = platform.machine().lower() in ("aarch64", "arm64")
    option = "-mcpu=native" if zig or arm else "-march=native"
    # GCC 12 contracts expressions that look like a product of complex numbers (a rotated box),
    # which changes bits, although contraction is off.
    options = (option,) if zig else (option, "-fno-tree-slp-vectorize")
    return *options, f"-DUUV_PROCESSOR=0x{_processor()}"  # the latter only for the cache's key
