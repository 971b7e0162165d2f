"""Fused kernels: a system of declarations compiled into one function over many environments.

The C text is generated in `codegen/`, derivatives are in `derivatives/`; a whole system as one FMU
is in `system_fmu/`. The fixed C around the generated text is in ``fmus/kernels/`` at the top.

It may import `orchestrator`, `fmus`, `models`. Start with `kernel.py`, then `batch/batch.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.kernels.batch.batch import Batch
    from uuvsim_cosim.kernels.derivatives.autograd import rollout
    from uuvsim_cosim.kernels.kernel import Kernel, fuse

__all__ = [
    "Batch",
    "Kernel",
    "fuse",
    "rollout",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Batch": "batch.batch",
        "Kernel": "kernel",
        "fuse": "kernel",
        "rollout": "derivatives.autograd",
    },
)
