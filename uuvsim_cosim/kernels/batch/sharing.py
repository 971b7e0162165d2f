"""Components whose parameters have equal values in all environments, and so are read once."""

from __future__ import annotations

from typing import final

import numpy as np

from uuvsim_cosim.kernels.batch.memory import Signal
from uuvsim_cosim.kernels.codegen.fusible import Fused

__all__ = ["Sharing"]


@final
class Sharing:
    """The argument `is_own` of the C of a step (fmus/kernels/uuv_lane_component.h).

    Every block of lanes has all parameters. If those of a component are equal in all lanes, each
    step reads them in the first block, which stays in the processor's cache. The memory of the
    others is then not read, and a step of many environments takes less time.
    """

    def __init__(self, fused: Fused) -> None:
        self._members = fused.members
        self._varied: dict[int, set[str]] = {}  # start values that differ, by component
        self._set: set[int] = set()  # components with parameters that were set after the reset
        self._own = np.zeros(fused.n_cells, np.uint8)
        self.address: int | None = int(self._own.ctypes.data)

    def started(self, s: Signal, *, every: bool) -> None:
        """Note that start values of a variable were written, in `every` environment or in some."""
        m = self._members[s.member]
        name = s.variable.name
        if not s.is_parameter or m.is_seed(name):  # each lane always reads its own seed
            return
        varied = self._varied.setdefault(s.member, set())
        if not every and name in varied:
            return  # it could only be equal by chance, and to find out takes time
        (varied.discard if s.start.is_equal() else varied.add)(name)
        self._own[m.cell] = bool(varied) or s.member in self._set

    def reset(self, *, every: bool) -> None:
        """Note that `every` environment gets its start values, or only some."""
        for i in self._set:
            self._own[self._members[i].cell] = bool(self._varied.get(i)) if every else True
        if every:
            self._set.clear()

    def set(self, s: Signal, *, equal: bool) -> None:
        """Note that a parameter was set, to an `equal` value in all environments or not."""
        self._set.add(s.member)
        if not equal:
            self._own[self._members[s.member].cell] = True

    def end(self) -> None:
        """Let each environment read its own parameters from now on."""
        self.address = None
