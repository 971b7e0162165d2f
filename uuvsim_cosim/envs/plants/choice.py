"""Choice of the plant of a system: a kernel if it can be fused, else masters, or processes."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, TypedDict

from uuvsim_cosim.envs.plants.plant import Plant
from uuvsim_cosim.envs.task.checks import whole
from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.resources import refuse_beyond
from uuvsim_cosim.kernels import Kernel, fuse
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan as SystemPlan
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Backend", "DType", "PlantOptions", "check_backend", "plant_of"]

_log = logging.getLogger(__name__)

Backend = Literal["auto", "kernel", "master"]
DType = Literal["float64", "float32"]


class PlantOptions(TypedDict, total=False):
    """The options of `plant_of`."""

    backend: Backend
    threads: int  # of a kernel
    dtype: DType  # of a kernel's numbers
    processes: int | None  # of masters; 0: in this process


_kernels: list[tuple[System, int, str, Kernel]] = []  # the last few, so that each is made once
_KEPT = 8
_LEAST_MASTER = 2048  # bytes of a component in a master; most take more
_SIGNALS = 64  # bytes of a number that is read or acted on: several arrays hold it
_logged: set[str] = set()  # warnings of plans, which are logged once


def check_backend(backend: str, dtype: str) -> None:
    """Raise InputInvalid for an unknown backend or number type."""
    if backend not in ("auto", "kernel", "master"):
        raise InputInvalid(f"backend {backend!r}", "'auto', 'kernel' or 'master'")
    if dtype not in ("float64", "float32"):
        raise InputInvalid(f"dtype {dtype!r}", "'float64' or 'float32'")
    if backend == "master" and dtype == "float32":
        raise InputInvalid("dtype 'float32' with backend 'master'", "backend 'kernel'")


def plant_of(
    system: System,
    n: int,
    *,
    reads: Sequence[str],
    acts: Sequence[tuple[str, int]],
    backend: Backend = "auto",
    threads: int = 1,
    dtype: DType = "float64",
    processes: int | None = None,
) -> Plant:
    """Make n copies of a system.

    "auto" makes a kernel if the system can be fused, else masters; "kernel" raises SystemInvalid if
    it cannot. Masters of more than one copy run in `processes` (0: in this process). Raises
    InputInvalid for more copies than memory holds, and ToolchainError.
    """
    check_backend(backend, dtype)
    threads = whole(threads, "threads")
    if processes is not None:
        processes = whole(processes, "processes", 0)
    if backend != "master":
        try:
            kernel = _kernel(system, n, dtype)
        except SystemInvalid:
            if backend == "kernel" or dtype == "float32":
                raise
        else:
            from uuvsim_cosim.envs.plants.kernel_plant import KernelPlant

            fused = kernel.fused
            cells = (fused.n_cells + fused.n_start) * kernel.dtype.itemsize
            refuse_beyond(n, cells + _SIGNALS * (len(reads) + len(acts)), least=True)
            return KernelPlant(kernel, n, reads=reads, acts=acts, threads=threads)
    plan = flatten(system)
    refuse_beyond(n, _LEAST_MASTER * len(plan.components), least=True)
    plan = log_warnings_once(plan)
    if n > 1 and processes != 0:
        from uuvsim_cosim.envs.plants.process_plant import ProcessPlant

        return ProcessPlant(plan, n, reads=reads, acts=acts, processes=processes)
    from uuvsim_cosim.envs.plants.master_plant import MasterPlant

    return MasterPlant(plan, prepare(plan, "native"), n, reads=reads, acts=acts)


def log_warnings_once(plan: SystemPlan) -> SystemPlan:
    """Log the warnings of a plan once in a process; returns the plan without them."""
    for warning in plan.warnings:
        if warning not in _logged:
            _logged.add(warning)
            _log.warning("%s", warning)
    return replace(plan, warnings=())


def _kernel(system: System, n: int, dtype: DType) -> Kernel:
    lanes = 1 if n == 1 else 16 if dtype == "float32" else 8
    for known, width, number, kernel in _kernels:
        if known is system and (width, number) == (lanes, dtype):
            return kernel
    made = fuse(system, lanes=lanes, dtype=dtype)
    _kernels.append((system, lanes, dtype, made))
    del _kernels[:-_KEPT]
    return made
