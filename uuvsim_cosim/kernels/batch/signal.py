"""Variables of a batch: their place in memory, and the values that they accept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.kernels.batch.memory import Column, Lanes
from uuvsim_cosim.kernels.codegen.program import Program
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Signal", "signal_of"]


@dataclass(frozen=True, eq=False)
class Signal:
    """Variable, with its present values and its start values in all environments."""

    name: str
    variable: Variable
    member: int
    n_envs: int
    own: Column
    start: Column
    connected: bool
    largest: float  # largest finite number of the kernel's type

    @property
    def is_parameter(self) -> bool:
        """Return whether derived values depend on it."""
        return self.variable.causality == "parameter"

    def checked(self, values: object) -> np.ndarray:
        """Return values that may be set now; raises InputInvalid."""
        v = self.variable
        if v.causality != "input" and not (self.is_parameter and v.variability == "tunable"):
            raise self._wrong("an input or a tunable parameter (others: start= of reset)")
        if self.connected:
            raise InputInvalid(self.name, "is connected", "an unconnected input")
        return self._checked(values)

    def checked_start(self, values: object) -> np.ndarray:
        """Return values that may be start values; raises InputInvalid."""
        if self.variable.causality not in ("input", "parameter"):
            raise self._wrong("an input or a parameter")
        return self._checked(values)

    def _checked(self, values: object) -> np.ndarray:
        """Return values as an array of the right shape and range; raises InputInvalid."""
        v = self.variable
        try:
            array: np.ndarray = np.asarray(values, dtype=float)
        except (TypeError, ValueError):
            raise InputInvalid(self.name, f"value {values!r}", "numbers") from None
        if array.shape not in (v.shape, (self.n_envs, *v.shape)):
            raise InputInvalid(
                self.name,
                f"values of shape {array.shape}",
                f"{v.shape} or {(self.n_envs, *v.shape)}, a row for each environment (n_envs)",
            )
        low = -self.largest if v.min is None else v.min
        high = self.largest if v.max is None else v.max
        if not (array.min() >= low and array.max() <= high):  # comparisons with NaN are false
            wrong = array[~((array >= low) & (array <= high))].flat[0]
            raise InputInvalid(self.name, f"value {wrong}", f"finite numbers in [{low}, {high}]")
        return array

    def _wrong(self, expected: str) -> InputInvalid:
        v = self.variable
        return InputInvalid(self.name, f"is a {v.variability} {v.causality}", expected)


def signal_of(kernel: Program, name: str, memory: Lanes, start: Lanes) -> Signal:
    """Find a variable by its full name, "hull.eta"; raises InputInvalid with similar names."""
    fused = kernel.fused
    path, _, own = name.rpartition(".")
    i = fused.index.get(path)
    variables = {} if i is None else fused.plan.components[i].description.variables
    if i is None or own not in variables:
        known = [f"{c.path}.{n}" for c in fused.plan.components for n in c.description.variables]
        known = [n for n in known if n.startswith(f"{path}.")] or known
        raise InputInvalid(f"no variable {name!r}", expected_names(name, known))
    v, m = variables[own], fused.members[i]
    first = v.value_references[0]
    dtype = {"Float64": kernel.dtype, "Boolean": np.dtype(bool)}.get(v.type, np.dtype(np.int32))
    bits = kernel.dtype != np.float64 and m.is_seed(own)
    count = sum(
        len(t.target_elements)
        for t in fused.plan.transfers
        if t.target == i and t.target_variable.name == own
    )
    has_start = first < m.n_start
    return Signal(
        name,
        v,
        i,
        memory.n_envs,
        Column(memory, m.cell + first, v.shape, dtype, bits=bits),
        Column(start, m.start_cell + first if has_start else 0, v.shape, dtype, bits=bits),
        count == v.size,
        float(np.finfo(kernel.dtype).max),
    )
