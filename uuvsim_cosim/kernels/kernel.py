"""Kernel: a system's plan compiled into one function for one communication step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels.batch.batch import Batch, Seeds
from uuvsim_cosim.kernels.codegen.derivative import Mode
from uuvsim_cosim.kernels.codegen.fusible import fused_of
from uuvsim_cosim.kernels.codegen.program import Program
from uuvsim_cosim.kernels.derivatives.rollout import (
    Derivative,
    Rollout,
    Values,
    derivative_of,
    jvp,
    vjp,
)
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

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
class Kernel(Program):
    """The compiled plan; `batch` makes environments of it."""

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
        return derivative_of(self, mode)
