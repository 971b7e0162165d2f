"""A plan compiled for one communication step over lanes of environments."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.codegen.processor import processor_flags
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import (
    Signatures,
    compile_shared,
    generated_sources,
    load_library,
    refuse_to_compile,
)
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.kernels.codegen.driver import driver_text
from uuvsim_cosim.kernels.codegen.fusible import Fused
from uuvsim_cosim.kernels.codegen.outline import changed, written
from uuvsim_cosim.share import compute_in_threads

__all__ = ["Program", "compiled", "compiled_draws"]


def compiled(name: str, text: str, flags: tuple[str, ...]) -> Path:
    """Compile generated C into a library in the cache, and return its path."""
    (file,) = generated_sources({f"{name}.c": text})
    return _compiled_file(file, flags)


def _compiled_file(file: Path, flags: tuple[str, ...]) -> Path:
    include = [content("fmus", "kernels"), *runtime()]
    return compile_shared([file], name=f"{file.stem}_lanes", include=include, flags=flags)


def compiled_draws(flags: tuple[str, ...]) -> Path:
    """Compile the random draws of float32 kernels, which are computed in float64."""
    source = content("fmus", "kernels") / "float_draws.c"
    include = [content("fmus", "kernels"), *runtime()]
    return compile_shared([source], name="float_draws", include=include, flags=flags)


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
        texts = [written(*declared, dtype) for declared in fused.declarations.values()]
        self.tokens = [t.token for t in texts]  # of the declarations
        driver = driver_text(fused, [content_hash([t, *flags]) for t in self.tokens])
        refuse_to_compile("kernel", len(driver))  # it is compiled last
        jobs: dict[int | str, Callable[[], Path]] = {
            i: partial(_compiled_file, text.file, flags) for i, text in enumerate(texts)
        }
        jobs["driver"] = partial(compiled, "kernel", driver, flags)
        if single:
            jobs["draws"] = partial(compiled_draws, draws_flags)
        # The longest first, so that the compiler's threads end at about the same time.
        length = [text.outline.operations for text in texts]
        longest_first = sorted(jobs, key=lambda i: -length[i] if isinstance(i, int) else 0)
        built = dict(compute_in_threads(lambda i: jobs[i](), longest_first, os.cpu_count() or 1))
        pointer, u32, u64 = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
        signatures: Signatures = {
            "uuv_kernel_bind": (None, [u32, pointer]),
            "uuv_kernel_step": (ctypes.c_int32, [pointer, pointer, u64, u64, u64]),
            "uuv_kernel_step_parts": (
                ctypes.c_int32,
                [pointer, pointer, pointer, pointer, u64, u64, u64],
            ),
            "uuv_kernel_copy_parts": (
                None,
                [pointer, pointer, ctypes.c_int32, pointer, u64, u64],
            ),
            "uuv_kernel_reset": (ctypes.c_int32, [pointer, pointer, pointer, pointer, u64, u64]),
            "uuv_kernel_seed": (None, [pointer, pointer, pointer, u64, u64]),
            "uuv_kernel_derive": (None, [pointer, u32, u64, u64]),
            "uuv_kernel_gather": (None, [pointer, pointer, u64, pointer, u64]),
            "uuv_kernel_scatter": (None, [pointer, pointer, u64, pointer, u64]),
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

    def check_unchanged(self) -> None:
        """Raise InputInvalid if the declarations are no longer those that were compiled.

        Derivatives are made from the declarations as they are now, so they need this check.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> kernel = uuv.fuse(uuv.System("tank").add("hull", "model:sphere"))
        >>> kernel.check_unchanged()  # no file of the vehicle has changed since
        """
        declared = self.fused.declarations.values()
        for (source, outline), token in zip(declared, self.tokens, strict=True):
            if written(source, outline, self.dtype).token != token:
                raise changed(source)

    @cached_property
    def variables(self) -> Mapping[str, Variable]:
        """Return every variable by its full name, "hull.eta"."""
        return {
            f"{c.path}.{name}": v
            for c in self.fused.plan.components
            for name, v in c.description.variables.items()
        }
