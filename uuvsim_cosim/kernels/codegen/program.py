"""A plan compiled for one communication step over lanes of environments."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.fmus.codegen.toolchain import Signatures, load_library
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.kernels.codegen.compilation import compiled, compiled_draws, processor_flags
from uuvsim_cosim.kernels.codegen.declaration import declaration_text
from uuvsim_cosim.kernels.codegen.driver import driver_text
from uuvsim_cosim.kernels.codegen.fusible import Fused
from uuvsim_cosim.share import compute_in_threads

__all__ = ["Program"]


class Program:
    """One communication step of a plan, in the functions ``uuv_kernel_…`` of the library `c`."""

    def __init__(self, fused: Fused, lanes: int, dtype: np.dtype, baseline: bool) -> None:
        self.fused = fused
        self.lanes = lanes  # environments that one instruction processes
        self.dtype = dtype  # of the numbers: float64 or float32
        self.baseline = baseline  # the code runs on every processor of this architecture
        single = dtype == np.float32
        flags = (f"-DUUV_W={lanes}", "-Wno-psabi", *processor_flags(baseline))
        draws_flags = ("-DUUV_W=8", "-Wno-psabi", *flags[2:])
        if single:
            flags = (*flags, "-DUUV_FLOAT32", "-ffp-contract=fast")
        texts = [declaration_text(fused.equations[s], dtype) for s in fused.sources]
        names = [fused.equations[s].layout.model.name for s in fused.sources]
        driver = driver_text(fused, [content_hash([t, *flags]) for t in texts])
        jobs: dict[int | str, Callable[[], Path]] = {
            i: partial(compiled, names[i], texts[i], flags) for i in range(len(texts))
        }
        jobs["driver"] = partial(compiled, "kernel", driver, flags)
        if single:
            jobs["draws"] = partial(compiled_draws, draws_flags)
        # The longest first, so that the compiler's threads end at about the same time.
        longest_first = sorted(jobs, key=lambda i: -len(texts[i]) if isinstance(i, int) else 0)
        built = dict(compute_in_threads(lambda i: jobs[i](), longest_first, os.cpu_count() or 1))
        pointer, u32, u64 = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
        signatures: Signatures = {
            "uuv_kernel_bind": (None, [u32, pointer]),
            "uuv_kernel_step": (ctypes.c_int32, [pointer, u64, u64, u64]),
            "uuv_kernel_reset": (ctypes.c_int32, [pointer, pointer, pointer, pointer, u64, u64]),
            "uuv_kernel_seed": (None, [pointer, pointer, pointer, u64, u64]),
            "uuv_kernel_derive": (None, [pointer, u32, u64, u64]),
        }
        self.c = load_library(built["driver"], signatures)
        self._libraries = [ctypes.CDLL(str(built[i])) for i in range(len(texts))]
        if single:  # the declarations call the draws of a library that computes in float64
            draws = ctypes.CDLL(str(built["draws"]))
            for library in self._libraries:
                place = ctypes.c_void_p.in_dll(library, "uuv_the_lane_draws")
                place.value = ctypes.cast(draws.uuv_float_draws, ctypes.c_void_p).value
            self._libraries.append(draws)
        for i in range(len(texts)):
            table = ctypes.c_char.in_dll(self._libraries[i], "uuv_the_lane_stepper")
            self.c.uuv_kernel_bind(i, ctypes.addressof(table))

    @cached_property
    def variables(self) -> Mapping[str, Variable]:
        """Return every variable by its full name, "hull.eta"."""
        return {
            f"{c.path}.{name}": v
            for c in self.fused.plan.components
            for name, v in c.description.variables.items()
        }
