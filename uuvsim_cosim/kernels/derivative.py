"""The compiled tangents, or adjoints, of a kernel; what it cannot differentiate is said by name."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, final

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.kernels.derivative_driver_text import derivative_driver_text, tape_cells
from uuvsim_cosim.kernels.derivative_text import Mode, derivative_text
from uuvsim_cosim.models.network import NETWORKS, Network
from uuvsim_cosim.models.table import TABLES

if TYPE_CHECKING:
    from uuvsim_cosim.kernels.kernel import Kernel

__all__ = ["Derivative"]


@final
class Derivative:
    """The compiled tangents, or adjoints, of a kernel's initialization and step."""

    def __init__(self, kernel: Kernel, mode: Mode) -> None:
        from uuvsim_cosim.kernels.kernel import _compiled, processor_flags

        fused = kernel.fused
        problems = [*_undifferentiable(kernel)]
        if problems:
            raise SystemInvalid(problems)
        flags = (f"-DUUV_W={kernel.lanes}", "-Wno-psabi", *processor_flags(kernel.baseline))
        texts = [derivative_text(fused.equations[s], mode) for s in fused.sources]
        driver = derivative_driver_text(fused, mode, [content_hash([t, *flags]) for t in texts])
        names = [f"{fused.equations[s].layout.model.name}_{mode}" for s in fused.sources]
        with ThreadPoolExecutor(2) as pool:
            jobs = zip([*names, f"kernel_{mode}"], [*texts, driver], strict=True)
            paths = [*pool.map(lambda job: _compiled(job[0], job[1], flags), jobs)]
        *libraries, self.c = (ctypes.CDLL(str(p)) for p in paths)
        self._libraries = libraries
        pointer, u64 = ctypes.c_void_p, ctypes.c_uint64
        self.c.uuv_derivative_bind.argtypes = [ctypes.c_uint32, pointer]
        self.c.uuv_derivative_reset.argtypes = [pointer] * 4 + [u64, u64]
        self.c.uuv_derivative_step.argtypes = [pointer] * 3 + [u64, u64]
        for i, library in enumerate(libraries):
            table = ctypes.c_char.in_dll(library, "uuv_the_lane_derivative")
            self.c.uuv_derivative_bind(i, ctypes.addressof(table))
        self.tape_cells = tape_cells(fused)


def _undifferentiable(kernel: Kernel) -> Iterator[Problem]:
    if kernel.dtype != np.float64:
        yield Problem("kernel", f"derivatives in {kernel.dtype}", "a kernel of float64")
    for m in kernel.fused.members:
        e = kernel.fused.equations[m.source]
        called = {g.name() for f in (e.rhs, e.outputs, *e.updates) for g in f.find_functions()}
        known = {name for name in called if isinstance(NETWORKS.get(name), Network)}
        if not called <= TABLES.keys() | known:
            yield Problem(
                m.path,
                "an optimiser, a transformer, a field or rays, in a derivative",
                "equations, tables and multilayer perceptrons",
            )
        if m.rate >= 0:
            yield Problem(
                m.path,
                "a communication step longer than the system's, in a derivative",
                "components that all make the system's step",
            )
