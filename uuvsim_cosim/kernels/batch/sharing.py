"""Parameters and inputs that have equal values in all environments, and so are read once."""

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
    others is then not read, and a step of many environments takes less time. The same holds for
    each input without a connection, where cells are in parts (`parts.py`).
    """

    def __init__(self, fused: Fused) -> None:
        self._members = fused.members
        # By first cell of a component, for its parameters, or of an input:
        self._varied: dict[int, set[str]] = {}  # start values that differ
        self._set: set[int] = set()  # those that were set after the reset
        self._own = np.zeros(fused.n_cells, np.uint8)
        self.address: int | None = int(self._own.ctypes.data)
        for m in fused.members:
            if m.is_seed("seed"):  # each lane always reads its own seed
                self._own[m.cell + m.layout.offset_of("seed")] = True

    def started(self, s: Signal, *, every: bool) -> None:
        """Note that start values of a variable were written, in `every` environment or in some."""
        name, key = s.variable.name, self._key(s)
        if self._members[s.member].is_seed(name):
            return
        varied = self._varied.setdefault(key, set())
        if not every and name in varied:
            return  # it could only be equal by chance, and to find out takes time
        (varied.discard if s.start.is_equal() else varied.add)(name)
        self._own[key] = bool(varied) or key in self._set

    def reset(self, *, every: bool) -> None:
        """Note that `every` environment gets its start values, or only some."""
        for key in self._set:
            self._own[key] = bool(self._varied.get(key)) if every else True
        if every:
            self._set.clear()

    def set(self, s: Signal, *, equal: bool) -> None:
        """Note that a variable was set, to an `equal` value in all environments or not."""
        key = self._key(s)
        self._set.add(key)
        if not equal:
            self._own[key] = True

    def written(self, s: Signal) -> None:
        """Note that a caller may write an input at any time, which differs from now on."""
        self._varied.setdefault(self._key(s), set()).add("")
        self._own[self._key(s)] = True

    def _key(self, s: Signal) -> int:
        m = self._members[s.member]
        return m.cell + (0 if s.is_parameter else s.variable.value_references[0])

    def end(self) -> None:
        """Let each environment read its own parameters from now on."""
        self.address = None
