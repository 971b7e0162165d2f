"""Compiled tangents or adjoints of a kernel; components without derivatives are refused."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import final

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.kernels.batch.program import Program
from uuvsim_cosim.kernels.codegen.compilation import compiled, processor_flags
from uuvsim_cosim.kernels.codegen.derivative import Mode, derivative_text
from uuvsim_cosim.kernels.codegen.derivative_driver import derivative_driver_text, tape_cells
from uuvsim_cosim.models.hull.contact import HullContact, HullPlace
from uuvsim_cosim.models.intrinsics.network import NETWORKS, Network
from uuvsim_cosim.models.intrinsics.table import TABLES
from uuvsim_cosim.share import compute_in_threads

__all__ = ["Derivative"]


@final
class Derivative:
    """Compiled tangents, or adjoints, of a kernel's initialization and step."""

    def __init__(self, kernel: Program, mode: Mode) -> None:
        fused = kernel.fused
        problems = [*_undifferentiable(kernel)]
        if problems:
            raise SystemInvalid(problems)
        flags = (f"-DUUV_W={kernel.lanes}", "-Wno-psabi", *processor_flags(kernel.baseline))
        texts = [derivative_text(fused.equations[s], mode) for s in fused.sources]
        driver = derivative_driver_text(fused, mode, [content_hash([t, *flags]) for t in texts])
        names = [f"{fused.equations[s].layout.model.name}_{mode}" for s in fused.sources]
        jobs = [*zip([*names, f"kernel_{mode}"], [*texts, driver], strict=True)]
        built = dict(compute_in_threads(lambda job: compiled(*job, flags), jobs, 2))
        *libraries, self.c = (ctypes.CDLL(str(built[job])) for job in jobs)
        self._libraries = libraries
        pointer, u64 = ctypes.c_void_p, ctypes.c_uint64
        self.c.uuv_derivative_bind.argtypes = [ctypes.c_uint32, pointer]
        self.c.uuv_derivative_reset.argtypes = [pointer] * 4 + [u64, u64]
        self.c.uuv_derivative_step.argtypes = [pointer] * 3 + [u64, u64]
        for i, library in enumerate(libraries):
            table = ctypes.c_char.in_dll(library, "uuv_the_lane_derivative")
            self.c.uuv_derivative_bind(i, ctypes.addressof(table))
        self.tape_cells = tape_cells(fused)


def _undifferentiable(kernel: Program) -> Iterator[Problem]:
    if kernel.dtype != np.float64:
        yield Problem("kernel", f"derivatives in {kernel.dtype}", "a kernel of float64")
    for m in kernel.fused.members:
        e = kernel.fused.equations[m.source]
        called = {g.name() for f in (e.rhs, e.outputs, *e.updates) for g in f.find_functions()}
        known = {
            n for n in called if isinstance(NETWORKS.get(n), Network | HullContact | HullPlace)
        }
        if not called <= TABLES.keys() | known:
            yield Problem(
                m.path,
                "an optimiser, a transformer, a field or rays, in a derivative",
                "equations, tables, multilayer perceptrons and contact",
            )
        if m.rate >= 0:
            yield Problem(
                m.path,
                "a communication step longer than the system's, in a derivative",
                "components that all make the system's step",
            )
