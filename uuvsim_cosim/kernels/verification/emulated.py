"""A system on another processor, aarch64, which qemu-user emulates: a program compiled by zig."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ToolchainError
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_program, generated_sources
from uuvsim_cosim.kernels.system_fmu.system_fmu import SystemParts, system_parts
from uuvsim_cosim.kernels.web_assembly.module import WebAssembly, page_text
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["EMULATOR", "emulator", "run_emulated"]

EMULATOR = "qemu-aarch64"
_TARGET = "aarch64-linux-musl"  # linked statically, so that no library of that processor is needed


def emulator() -> str | None:
    """Return the path of the emulator, or None if this machine has none."""
    return shutil.which(EMULATOR) or shutil.which(f"{EMULATOR}-static")


def run_emulated(system: System, steps: int, *, seed: int = 0) -> NDArray[np.float64]:
    """Return the outputs of a run, (points, elements); it has fewer points after a failure.

    Raises SystemInvalid for a system that cannot be fused, and ToolchainError without the emulator
    or if the program fails.
    """
    qemu = emulator()
    if qemu is None:
        raise ToolchainError(f"{EMULATOR} is missing", "the package qemu-user of Debian or Ubuntu")
    parts = system_parts(system, naming="structured")
    table = WebAssembly(Path(), parts).table
    done = subprocess.run(
        [qemu, str(_program(parts, table)), str(seed), str(steps)], capture_output=True, check=False
    )
    if done.returncode:
        reason = done.stderr.decode(errors="replace").strip() or "no message"
        raise ToolchainError(f"{EMULATOR} failed with status {done.returncode}: {reason}")
    return np.frombuffer(done.stdout).reshape(-1, sum(row["size"] for row in table["output"]))


def _program(parts: SystemParts, table: dict[str, object]) -> Path:
    rows: list[dict[str, int]] = table["output"]  # type: ignore[assignment]
    places = [row["at"] + k for row in rows for k in range(row["size"])]
    own = (
        f"enum {{ seed_place = {table['seed']} }};\n"
        f"static const uint32_t output_places[] = {{{', '.join(map(str, places)) or '0'}}};\n"
        '#include "uuv_driver.h"\n'
    )
    main, *declared = parts.texts
    texts = {
        main: parts.texts[main] + page_text(parts) + own,
        **{name: parts.texts[name] for name in declared},
    }
    include = [content("fmus", folder) for folder in ("driver", "page", "whole", "kernels")]
    return compile_program(
        generated_sources(texts),
        name=parts.whole.identifier,
        target=_TARGET,
        include=[*include, *runtime()],
    )
