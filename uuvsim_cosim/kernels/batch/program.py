"""Interface of a compiled plan, for batches and derivatives; `Kernel` implements it."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.kernels.codegen.fusible import Fused

__all__ = ["Program"]


class Program(Protocol):
    """One communication step of a plan, compiled over lanes of environments."""

    @property
    def fused(self) -> Fused:
        """Plan, and the place of every variable in an environment's memory."""

    @property
    def lanes(self) -> int:
        """Number of environments that one instruction processes."""

    @property
    def dtype(self) -> np.dtype:
        """Type of the numbers: float64 or float32."""

    @property
    def baseline(self) -> bool:
        """Whether the code runs on every processor of this architecture."""

    @property
    def c(self) -> ctypes.CDLL:
        """The library with the functions ``uuv_kernel_…``."""

    @property
    def variables(self) -> Mapping[str, Variable]:
        """Every variable by its full name, "hull.eta"."""
