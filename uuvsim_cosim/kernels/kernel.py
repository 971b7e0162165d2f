"""Kernel: a system's plan compiled into one function for one communication step."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any, final

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.kernels.batch.batch import Batch, Seeds
from uuvsim_cosim.kernels.codegen.compilation import compiled, compiled_draws, processor_flags
from uuvsim_cosim.kernels.codegen.declaration import declaration_text
from uuvsim_cosim.kernels.codegen.derivative import Mode
from uuvsim_cosim.kernels.codegen.driver import driver_text
from uuvsim_cosim.kernels.codegen.fusible import Fused, fused_of
from uuvsim_cosim.kernels.derivatives.rollout import Derivative, Rollout, Values, jvp, vjp
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.share import compute_in_threads

__all__ = ["Kernel", "fuse"]

LANES = {"float64": (1, 2, 4, 8, 16), "float32": (4, 8, 16, 32)}
_USUAL = {"float64": 8, "float32": 16}


def fuse(
    system: System, *, dtype: str = "float64", lanes: int | None = None, baseline: bool = False
) -> Kernel:
    """Compile a system of declarations into a kernel over `lanes` environments at a time.

    The code is for this machine's processor, or with `baseline` for all of the same architecture.
    In float64 the results are equal to the master's to the last bit; float32 (16 lanes by default
    instead of 8) is faster and less exact. Raises SystemInvalid, which names every component that
    is no declaration and every feature that only the master has; ToolchainError.
    """
    if dtype not in LANES:
        near = ", ".join(LANES)
        raise InputInvalid("dtype", f"{dtype!r}", f"one of {near}")
    width = _USUAL[dtype] if lanes is None else lanes
    if width not in LANES[dtype]:
        allowed = ", ".join(map(str, LANES[dtype]))
        raise InputInvalid("lanes", width, f"one of {allowed} in {dtype}")
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
        jobs: dict[int | str, Callable[[], Path]] = {
            i: partial(compiled, names[i], texts[i], flags) for i in range(len(texts))
        }
        jobs["driver"] = partial(compiled, "kernel", driver, flags)
        if single:
            jobs["draws"] = partial(compiled_draws, draws_flags)
        # The longest first, so that the compiler's threads end at about the same time.
        longest_first = sorted(jobs, key=lambda i: -len(texts[i]) if isinstance(i, int) else 0)
        built = dict(compute_in_threads(lambda i: jobs[i](), longest_first, os.cpu_count() or 1))
        self.c = ctypes.CDLL(str(built["driver"]))
        _declare(self.c)
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

    def batch(
        self,
        n_envs: int,
        *,
        seeds: Seeds | None = None,
        start: Mapping[str, object] | None = None,
        threads: int = 1,
    ) -> Batch:
        """Make initialized environments.

        `seeds` is a system seed for each, or one s for s, s + 1, …; by default 0, 1, …. `start`
        are start values by name ("hull.eta_0"): of the variable's shape, or one row for each
        environment.
        """
        return Batch(self, n_envs, seeds=seeds, start=start, threads=threads)

    def jvp(
        self,
        start: Mapping[str, object],
        tangents: Mapping[str, object],
        outputs: Sequence[str],
        *,
        steps: int,
        **more: Any,
    ) -> tuple[Values, Values]:
        """Return outputs at the end of every step, and their derivative along `tangents`.

        `start` and `more` (n_envs, inputs, seeds, threads) are arguments of `Rollout`.
        """
        return jvp(Rollout(self, start, outputs, steps=steps, **more), tangents)

    def vjp(
        self, start: Mapping[str, object], outputs: Sequence[str], *, steps: int, **more: Any
    ) -> tuple[Values, Callable[[Mapping[str, object]], Values]]:
        """Return outputs at the end of every step, and a function that pulls gradients back.

        `start` and `more` (n_envs, inputs, seeds, threads) are arguments of `Rollout`.
        """
        return vjp(Rollout(self, start, outputs, steps=steps, **more))

    def derivative(self, mode: Mode) -> Derivative:
        """Return the tangents, or adjoints, of a step; they are compiled at the first call."""
        if mode not in self._derivatives:
            self._derivatives[mode] = Derivative(self, mode)
        return self._derivatives[mode]


def _declare(c: ctypes.CDLL) -> None:
    """Set the types of arguments and results of the driver's functions."""
    pointer, u32, u64 = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
    signatures: dict[str, tuple[type | None, list[type]]] = {
        "uuv_kernel_bind": (None, [u32, pointer]),
        "uuv_kernel_step": (ctypes.c_int32, [pointer, u64, u64, u64]),
        "uuv_kernel_reset": (ctypes.c_int32, [pointer, pointer, pointer, pointer, u64, u64]),
        "uuv_kernel_seed": (None, [pointer, pointer, pointer, u64, u64]),
        "uuv_kernel_derive": (None, [pointer, u32, u64, u64]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(c, name)
        function.restype, function.argtypes = result, arguments
