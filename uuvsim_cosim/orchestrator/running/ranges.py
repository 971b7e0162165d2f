"""Inputs that left their declared range during a run, as warnings.

A start value outside of [min, max] is refused. During a run a value may leave the range, for
example the voltage of a battery the range of a thruster's bench rows; the component then does what
its declaration says, such as using the rows at the edge. `RangeWatch` sees the recorded
communication points, so that a value between two of them, or between thinned rows, is not noticed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from uuvsim_cosim.fmus.values import range_text
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.values.values import is_float

__all__ = ["RangeWatch"]

_ROUNDING = 1e-9  # of the bound: a value that is off by less is within the range


@dataclass
class _Watched:
    """One recorded column and the inputs that it feeds by the same conversion and range."""

    column: int
    factor: float
    offset: float
    low: float
    high: float
    where: str  # of the source
    range: str  # with unit
    unit: str
    inputs: list[str] = field(default_factory=list)
    first: float | None = None  # s, of the first value beyond
    worst: float = 0.0  # the value that is furthest beyond

    def see(self, times: np.ndarray, values: np.ndarray) -> None:
        """Keep the first and the furthest value beyond the range."""
        v = self.factor * values + self.offset
        excess = np.fmax(self.low - v, v - self.high)
        k = int(np.argmax(excess))
        bound = self.low if v[k] < self.low else self.high
        if not excess[k] > _ROUNDING * (1.0 + abs(bound)):
            return
        if self.first is None:
            self.first = float(times[np.argmax(excess > 0.0)])
            self.worst = float(v[k])
        elif excess[k] > max(self.low - self.worst, self.worst - self.high):
            self.worst = float(v[k])


class RangeWatch:
    """Observer that collects inputs whose value leaves [min, max] at a recorded point."""

    def __init__(self) -> None:
        self._watched: list[_Watched] = []

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Find the columns that feed an input with a range."""
        numbers = {c.name: i for i, c in enumerate(columns)}
        found: dict[tuple[object, ...], _Watched] = {}
        for t in plan.transfers:
            v = t.target_variable
            if t.table or not is_float(v) or not is_float(t.source_variable):
                continue
            if v.min is None and v.max is None:
                continue
            for i, j in zip(t.source_elements, t.target_elements, strict=True):
                where = f"{plan.components[t.source].path}.{t.source_variable.name}"
                where += f"[{i + 1}]" if t.source_variable.shape else ""
                if where not in numbers:
                    continue
                low = -np.inf if v.min is None else float(v.min)
                high = np.inf if v.max is None else float(v.max)
                key = (where, t.factor, t.offset, low, high)
                unit = f" {v.unit}" if v.unit not in (None, "1") else ""
                watched = found.setdefault(
                    key,
                    _Watched(numbers[where], t.factor, t.offset, low, high, where,
                             f"{range_text(v)}{unit}", unit),
                )  # fmt: skip
                name = f"{plan.components[t.target].path}.{v.name}"
                watched.inputs.append(f"{name}[{j + 1}]" if v.shape else name)
        self._watched = list(found.values())

    def observe(self, chunk: Chunk) -> None:
        """Compare the rows with the ranges."""
        for w in self._watched:
            w.see(chunk.time, chunk.values(w.column))

    def end(self) -> None:
        """Close; the warnings are kept."""

    def warnings(self) -> list[str]:
        """Return one sentence for each output that left the range of an input that it feeds."""
        return [
            f"{w.where} was {w.worst:.6g}{w.unit}, from t = {w.first:.6g} s on beyond the range "
            f"{w.range} of {', '.join(w.inputs[:2])}{' …' if len(w.inputs) > 2 else ''}; see what "
            "the component does there (uuvsim models show), or use one with a wider range"
            for w in self._watched
            if w.first is not None
        ]
