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
    """Compile a `system` of declarations into a kernel over `lanes` environments at a time.

    The code is for this machine's processor, or with `baseline` for all of the same architecture.
    With `dtype` float64 the results are equal to the master's to the last bit; float32 (16 lanes by
    default instead of 8) is faster and less exact. Raises SystemInvalid, which names every
    component that is no declaration and every feature that only the master has; InputInvalid for
    another `dtype` or number of lanes; ToolchainError.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> kernel = uuv.fuse(uuv.load("bluerov2_hold"))
    >>> with kernel.batch(16, seeds=0) as batch:
    ...     batch.step(100)
    ...     print(batch.get("hull.eta").shape, batch.time[0])
    (16, 6) 1.0
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
    """A compiled plan; `batch` makes environments of it. `fuse` returns one.

    `fused` is the plan, which is compiled for `lanes` environments at a time and numbers of
    `dtype`, with `baseline` for all processors of this architecture.

    Example: how far a sphere moves in a second, and the derivative by the force.

    >>> import numpy as np
    >>> import uuvsim_cosim as uuv
    >>> kernel = uuv.fuse(uuv.System("tank").add("hull", "model:sphere"))
    >>> kernel.variables["hull.tau"].shape
    (6,)
    >>> start = {"hull.tau": [10.0, 0, 0, 0, 0, 0]}  # N, N.m
    >>> with kernel.batch(4, start=start) as batch:
    ...     batch.step(100)
    ...     print(batch.get("hull.eta")[:, 0].round(3))  # [m]
    [0.098 0.098 0.098 0.098]
    >>> along = {"hull.tau": [1.0, 0, 0, 0, 0, 0]}
    >>> values, change = kernel.jvp(start, along, ["hull.eta"], steps=100)
    >>> values["hull.eta"].shape, f"{change['hull.eta'][-1, 0, 0]:.4f} m/N"
    ((100, 1, 6), '0.0096 m/N')
    >>> values, pull = kernel.vjp(start, ["hull.eta"], steps=100)
    >>> gradient = np.zeros((100, 1, 6))
    >>> gradient[-1, 0, 0] = 1.0  # of the last position N
    >>> f"{pull({'hull.eta': gradient})['hull.tau'][0]:.4f} m/N"
    '0.0096 m/N'
    """

    def batch(
        self,
        n_envs: int,
        *,
        seeds: Seeds | None = None,
        start: Mapping[str, object] | None = None,
        threads: int = 1,
        reads: Sequence[str] | None = None,
    ) -> Batch:
        """Make `n_envs` initialized environments, which `threads` threads step.

        `seeds` is a system seed for each, or one s for s, s + 1, …; by default 0, 1, …. `start`
        are start values by name ("hull.eta_0"): of the variable's shape, or one row for each
        environment. `reads` names the outputs and inputs that `get` returns, by default all; a
        step of many environments then takes less time.
        """
        return Batch(self, n_envs, seeds=seeds, start=start, threads=threads, reads=reads)

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

        Both are by name, (steps, n_envs, …). `start` are values of parameters and unconnected
        inputs, of the variable's shape or one row for each environment, and `tangents` changes of
        them in the same shapes. `outputs` are names, `steps` is the number of communication steps.
        `more` is n_envs, seeds, threads, and inputs: values of unconnected inputs that change, by
        name, (steps, …). Raises InputInvalid for a shape that does not fit, SystemInvalid for a
        component without derivatives.
        """
        return jvp(Rollout(self, start, outputs, steps=steps, **more), tangents)

    def vjp(
        self, start: Mapping[str, object], outputs: Sequence[str], *, steps: int, **more: Any
    ) -> tuple[Values, Callable[[Mapping[str, object]], Values]]:
        """Return outputs at the end of every step, and a function that pulls gradients back.

        Its argument is the gradient of a scalar with respect to `outputs`, by name,
        (steps, n_envs, …). It returns the gradient with respect to start values and inputs, in
        their shapes. `start`, `steps`, `more` and the errors are those of `jvp`.
        """
        return vjp(Rollout(self, start, outputs, steps=steps, **more))

    def derivative(self, mode: Mode) -> Derivative:
        """Return the tangents, or adjoints, of a step: `mode` "tangent" or "adjoint".

        They are compiled at the first call; `jvp` and `vjp` use them.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> kernel = uuv.fuse(uuv.System("tank").add("hull", "model:sphere"))
        >>> kernel.derivative("tangent") is kernel.derivative("tangent")
        True
        """
        return derivative_of(self, mode)
