"""Derivatives through a kernel: tangents run with its steps, adjoints back over kept ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import ceil, sqrt
from typing import Any, Protocol, final

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels.batch.batch import Batch, Seeds
from uuvsim_cosim.kernels.batch.memory import Lanes, aligned
from uuvsim_cosim.kernels.batch.program import Program
from uuvsim_cosim.kernels.batch.signal import Signal, signal_of
from uuvsim_cosim.kernels.codegen.derivative import Mode
from uuvsim_cosim.kernels.derivatives.derivative import Derivative

__all__ = ["Differentiable", "Rollout", "Values", "jvp", "run", "vjp"]

Values = dict[str, np.ndarray]
KEPT_BYTES = 1 << 25  # of the begins of steps; beyond, most steps are made twice


class Differentiable(Program, Protocol):
    """A compiled plan that compiles its derivatives when they are asked for."""

    def derivative(self, mode: Mode) -> Derivative:
        """Return the compiled tangents or adjoints of a step."""


@final
class Rollout:
    """`steps` communication steps from start values: what is given, and what is looked at.

    `start` names parameters and unconnected inputs, of the variable's shape or one row an
    environment; `inputs` names unconnected inputs that change, (steps, …) of either of these.
    """

    def __init__(
        self,
        kernel: Differentiable,
        start: Mapping[str, Any],
        outputs: Sequence[str],
        *,
        steps: int,
        n_envs: int = 1,
        inputs: Mapping[str, Any] | None = None,
        seeds: Seeds | None = None,
        threads: int = 1,
        kept_bytes: int = KEPT_BYTES,
    ) -> None:
        if steps < 1:
            raise InputInvalid(f"{steps} steps; expected at least 1")
        self.kernel, self.steps, self.n_envs, self.kept_bytes = kernel, steps, n_envs, kept_bytes
        self.batch = Batch(kernel, n_envs, seeds=seeds, start=start, threads=threads)
        self.start = {name: np.asarray(v, dtype=float) for name, v in start.items()}
        self.inputs = {
            name: self._sequence(name, v) for name, v in (inputs if inputs else {}).items()
        }
        twice = self.start.keys() & self.inputs.keys()
        if twice:
            raise InputInvalid(f"{min(twice)}: is given as start and as inputs; expected one")
        self.outputs = {name: self._real(name) for name in outputs}
        self._tapes: np.ndarray | None = None

    def _real(self, name: str) -> Signal:
        signal = self.batch._signal(name)
        kind = signal.variable.type
        if kind != "Float64":
            raise InputInvalid(f"{name}: is {kind}, without derivatives; expected a Float64")
        return signal

    def _sequence(self, name: str, values: Any) -> np.ndarray:
        variable = self._real(name).variable
        if variable.causality != "input":
            raise InputInvalid(
                f"{name}: is {variable.causality}, in inputs; expected an input that changes"
            )
        shape = variable.shape
        array = np.asarray(values, dtype=float)
        expected = ((self.steps, *shape), (self.steps, self.n_envs, *shape))
        if array.shape not in expected:
            raise InputInvalid(
                f"{name}: values of shape {array.shape}; expected {expected[0]} or {expected[1]}"
            )
        return array

    def set_inputs(self, k: int) -> None:
        """Set the inputs of step k."""
        for name, values in self.inputs.items():
            self.batch.set(name, values[k])

    def read(self) -> Iterator[np.ndarray]:
        """Yield the outputs as they are now."""
        for signal in self.outputs.values():
            yield signal.own.read()

    def beside(self) -> tuple[Lanes, Lanes]:
        """Make zeros that lie as the environments' values and start values do."""
        fused, n = self.kernel.fused, self.n_envs
        width, dtype = self.kernel.lanes, self.kernel.dtype
        return (
            Lanes(n, fused.n_cells, width, dtype),
            Lanes(n, fused.n_start, width, dtype),
        )

    def empty(self) -> Values:
        """Make room for every output at the end of every step."""
        return {
            name: np.empty((self.steps, self.n_envs, *s.variable.shape))
            for name, s in self.outputs.items()
        }

    def each(self, call: Callable[[int, int, int], Any], derivative: Derivative) -> None:
        """Call with a work space for each range of blocks."""
        if self._tapes is None:
            workers = len(self.batch._scratch)
            self._tapes = aligned((workers, derivative.tape_cells, self.kernel.lanes))
        addresses = [int(tape.ctypes.data) for tape in self._tapes]
        self.batch._each(lambda n, a, b: call(addresses[n], a, b))


def run(rollout: Rollout, keep: Callable[[int], None] = lambda _: None) -> Values:
    """Return the outputs at the end of every step; `keep` is called where each begins."""
    values = rollout.empty()
    rollout.batch.reset()
    for k in range(rollout.steps):
        rollout.set_inputs(k)
        keep(k)
        rollout.batch.step()
        for name, value in zip(rollout.outputs, rollout.read(), strict=True):
            values[name][k] = value
    return values


def jvp(rollout: Rollout, tangents: Mapping[str, Any]) -> tuple[Values, Values]:
    """Return the outputs at the end of every step, and their derivative along `tangents`.

    `tangents` perturbs what the rollout was given, name by name in the same shapes; what it
    does not name stays. Outputs are (steps, n_envs, …).
    """
    derivative = rollout.kernel.derivative("tangent")
    d, d_start = rollout.beside()
    batch = rollout.batch
    moved = {name: signal_of(rollout.kernel, name, d, d_start) for name in rollout.outputs}
    sequences: dict[str, tuple[Signal, np.ndarray]] = {}
    for name, value in tangents.items():
        array = _like(rollout, name, value)
        rollout._real(name)
        signal = signal_of(rollout.kernel, name, d, d_start)
        if name in rollout.inputs:
            sequences[name] = signal, array
        else:
            signal.start.write(array)
    values, changes = rollout.empty(), rollout.empty()
    c, start = derivative.c, batch._start.address
    batch.reset()
    rollout.each(
        lambda tape, a, b: c.uuv_derivative_reset(start, d_start.address, d.address, tape, a, b),
        derivative,
    )
    for k in range(rollout.steps):
        rollout.set_inputs(k)
        for signal, array in sequences.values():
            signal.own.write(array[k])
        rollout.each(
            lambda tape, a, b: c.uuv_derivative_step(batch._address, d.address, tape, a, b),
            derivative,
        )
        batch.step()
        for name, value in zip(rollout.outputs, rollout.read(), strict=True):
            values[name][k], changes[name][k] = value, moved[name].own.read()
    return values, changes


def vjp(rollout: Rollout) -> tuple[Values, Callable[[Mapping[str, Any]], Values]]:
    """Return the outputs at the end of every step, and a function that pulls gradients back.

    It takes the gradient of a scalar with respect to outputs, (steps, n_envs, …) each, and gives
    that with respect to everything the rollout was given, in the shapes that were given.
    """
    derivative = rollout.kernel.derivative("adjoint")
    cells, steps = rollout.batch.cells, rollout.steps
    every = 1 if steps * cells.nbytes <= rollout.kept_bytes else ceil(sqrt(steps))
    kept: dict[int, np.ndarray] = {}

    def keep(k: int) -> None:
        if k % every == 0:
            kept[k] = _copy(cells)

    values = run(rollout, keep)

    def pull(gradients: Mapping[str, Any]) -> Values:
        given = {name: _gradient(rollout, name, g) for name, g in gradients.items()}
        return _pulled(rollout, derivative, kept, every, given)

    return values, pull


def _pulled(
    rollout: Rollout,
    derivative: Derivative,
    kept: Mapping[int, np.ndarray],
    every: int,
    given: Values,
) -> Values:
    a, a_start = rollout.beside()
    batch, kernel, c = rollout.batch, rollout.kernel, derivative.c
    looked = {name: signal_of(kernel, name, a, a_start) for name in given}
    changed = {name: signal_of(kernel, name, a, a_start) for name in rollout.inputs}
    found: Values = {name: np.zeros((rollout.steps, *_rows(rollout, name))) for name in changed}
    segment: dict[int, np.ndarray] = {}
    room: list[np.ndarray] = []  # what a segment was kept in serves the next one

    def back_over(k: int) -> None:
        m = int(segment[k].ctypes.data)
        rollout.each(lambda tape, i, j: c.uuv_derivative_step(m, a.address, tape, i, j), derivative)

    for k in reversed(range(rollout.steps)):
        if k not in segment:
            room += [cells for first, cells in segment.items() if first not in kept]
            segment = _again(rollout, kept, k - k % every, k, room)
        for name, signal in looked.items():
            signal.own.write(signal.own.read() + given[name][k])
        back_over(k)
        for name, signal in changed.items():
            found[name][k] = signal.own.read()
            signal.own.write(np.zeros(signal.variable.shape))
    start = batch._start.address
    rollout.each(
        lambda tape, i, j: c.uuv_derivative_reset(start, a_start.address, a.address, tape, i, j),
        derivative,
    )
    for name in rollout.start:
        if batch._signal(name).variable.type == "Float64":
            found[name] = signal_of(kernel, name, a, a_start).start.read()
    return {name: _as_given(rollout, name, g) for name, g in found.items()}


def _again(
    rollout: Rollout,
    kept: Mapping[int, np.ndarray],
    first: int,
    last: int,
    room: list[np.ndarray],
) -> dict[int, np.ndarray]:
    """Make the steps from a kept one again, and keep the begin of each."""
    found = {first: kept[first]}
    if last > first:
        rollout.batch.cells[...] = kept[first]
        for k in range(first, last):
            if k > first:
                rollout.set_inputs(k)
                found[k] = _copy(rollout.batch.cells, room)
            rollout.batch.step()
        rollout.set_inputs(last)
        found[last] = _copy(rollout.batch.cells, room)
    return found


def _copy(cells: np.ndarray, room: list[np.ndarray] | None = None) -> np.ndarray:
    copy = room.pop() if room else aligned(cells.shape)
    copy.view(np.uint64)[...] = cells.view(np.uint64)  # words are no numbers
    return copy


def _rows(rollout: Rollout, name: str) -> tuple[int, ...]:
    return (rollout.n_envs, *rollout.batch._signal(name).variable.shape)


def _given(rollout: Rollout, name: str) -> np.ndarray:
    for known in (rollout.start, rollout.inputs):
        if name in known:
            return known[name]
    names = ", ".join([*rollout.start, *rollout.inputs]) or "nothing"
    raise InputInvalid(f"{name}: was not given to the rollout; expected one of {names}")


def _like(rollout: Rollout, name: str, value: Any) -> np.ndarray:
    array = np.asarray(value, dtype=float)
    shape = _given(rollout, name).shape
    if array.shape != shape:
        raise InputInvalid(f"{name}: tangent of shape {array.shape}; expected {shape}, as given")
    return array


def _gradient(rollout: Rollout, name: str, value: Any) -> np.ndarray:
    if name not in rollout.outputs:
        names = ", ".join(rollout.outputs)
        raise InputInvalid(f"{name}: is no output of the rollout; expected one of {names}")
    array, shape = np.asarray(value, dtype=float), (rollout.steps, *_rows(rollout, name))
    if array.shape != shape:
        raise InputInvalid(f"{name}: gradient of shape {array.shape}; expected {shape}")
    return array


def _as_given(rollout: Rollout, name: str, gradient: np.ndarray) -> np.ndarray:
    """Sum over the environments where one value was given for all."""
    axis = 1 if name in rollout.inputs else 0
    one_for_all = _given(rollout, name).ndim < gradient.ndim
    return np.asarray(gradient.sum(axis=axis) if one_for_all else gradient)
