"""The default experiment of a component: its step, its inputs, and the reference result."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.fmus.codegen.lowering import Lowered
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["Experiment", "experiment_of", "input_at", "reference_result"]

STEPS = 100  # communication steps of the run
STEPS_PER_ROW = 5  # of the reference result


@dataclass(frozen=True)
class Experiment:
    """A run of `STEPS` communication steps from 0 with the start values."""

    step_size: float

    @property
    def stop_time(self) -> float:
        """Return the end of the run."""
        return STEPS * self.step_size


def experiment_of(model: Model) -> Experiment:
    """Return a step that suits the component: its fastest clock's period, else its h_max."""
    return Experiment(min([float(c.period) for c in model.clocks], default=model.h_max))


def input_at(v: Variable, first: int, step: int) -> Any:
    """Return an input's value at a step: slow sines about its start value, within its bounds.

    `first` is the number of elements of the inputs before it: no two elements move alike.
    """
    start = np.ravel(v.start)
    if v.type != "Float64":
        values = start
    else:
        values = np.array([_wave(v, float(s), first + i, step) for i, s in enumerate(start)])
    return values.reshape(v.shape) if v.shape else values[0].item()


def _wave(v: Variable, start: float, number: int, step: int) -> float:
    low = -math.inf if v.min is None else v.min
    high = math.inf if v.max is None else v.max
    room = min(start - low, high - start)
    size = 0.25 * (high - low) if math.isfinite(high - low) else 0.1
    if room <= 0.0:  # the start lies on a bound: lean away from it
        middle = start + size if start <= low else start - size
    else:
        middle, size = start, min(size, 0.5 * room)
    turns = (1.0 + 0.37 * (number % 7)) / STEPS
    # Six digits, so that the value in the CSV file is the value that was set.
    return round(middle + size * math.sin(2.0 * math.pi * turns * step + 0.7 * number), 6)


def reference_result(
    lowered: Lowered, library: Path | None = None
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Run the native component; give the inputs at every step, and some steps' outputs.

    Each row maps names to values, and ``time`` to the time at which they hold.
    """
    component = Native(lowered, lowered.model.name, library)
    step = experiment_of(lowered.model).step_size
    inputs, outputs = component.description.of("input"), component.description.of("output")
    firsts = np.cumsum([0, *(v.size for v in inputs)])
    given: list[dict[str, Any]] = []
    results: list[dict[str, Any]] = []
    try:
        component.enter_initialization_mode(0.0, None)
        for k in range(STEPS):
            row: Mapping[str, Any] = {
                v.name: input_at(v, int(n), k) for v, n in zip(inputs, firsts, strict=False)
            }
            for v in inputs:
                component.set(v, row[v.name])
            if k == 0:
                component.exit_initialization_mode()
            component.do_step(k * step, step)
            given.append({"time": k * step, **row})
            if (k + 1) % STEPS_PER_ROW == 0:
                values = {v.name: component.get(v) for v in outputs}
                results.append({"time": (k + 1) * step, **values})
    finally:
        component.free()
    return given, results
