"""The default experiment of a component: its step, its inputs, and the reference result."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuvsim_cosim.fmus.codegen.lowering import Lowered
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.export.documentation import Row
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
        """The end of the run [s]."""
        return STEPS * self.step_size


def experiment_of(model: Model) -> Experiment:
    """Return the component's default experiment; its step is the fastest clock's, else h_max."""
    return Experiment(min([float(c.period) for c in model.clocks], default=model.h_max))


def input_at(v: Variable, first: int, step: int) -> float | np.ndarray:
    """Return an input's value at a step: slow sines around its start value, within its bounds.

    `first` is the number of elements of the inputs before it, so that all elements differ.
    """
    start = np.ravel(v.start)
    if v.type != "Float64":
        values = start
    else:
        values = np.array([_wave(v, float(s), first + i, step) for i, s in enumerate(start)])
    scalar: float = values[0].item()
    return values.reshape(v.shape) if v.shape else scalar


def _wave(v: Variable, start: float, number: int, step: int) -> float:
    """Return the sine of element `number` of the inputs."""
    low = -math.inf if v.min is None else v.min
    high = math.inf if v.max is None else v.max
    room = min(start - low, high - start)
    size = 0.25 * (high - low) if math.isfinite(high - low) else 0.1
    if room <= 0.0:  # the start is on a bound: the sine stays on its other side
        middle = start + size if start <= low else start - size
    else:
        middle, size = start, min(size, 0.5 * room)
    turns = (1.0 + 0.37 * (number % 7)) / STEPS
    # Six digits, so that the CSV file has exactly the value that was set.
    return round(middle + size * math.sin(2.0 * math.pi * turns * step + 0.7 * number), 6)


def reference_result(lowered: Lowered, library: Path | None = None) -> tuple[list[Row], list[Row]]:
    """Run the native component; return the inputs of every step, and the outputs of some steps.

    Each row maps names to values, and ``time`` to the time at which they are valid.
    """
    component = Native(lowered, lowered.model.name, library)
    step = experiment_of(lowered.model).step_size
    inputs, outputs = component.description.of("input"), component.description.of("output")
    firsts = np.cumsum([0, *(v.size for v in inputs)])
    given: list[Row] = []
    results: list[Row] = []
    try:
        component.enter_initialization_mode(0.0, None)
        for k in range(STEPS):
            row = {v.name: input_at(v, int(n), k) for v, n in zip(inputs, firsts, strict=False)}
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
