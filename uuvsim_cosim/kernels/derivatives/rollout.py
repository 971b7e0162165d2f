"""Derivatives through a kernel: tangents along its steps, adjoints backwards over kept states."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import ceil, sqrt
from typing import final
from weakref import WeakKeyDictionary

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.errors import InputInvalid, Problem, SystemInvalid
from uuvsim_cosim.fmus.codegen.processor import processor_flags
from uuvsim_cosim.fmus.resources import refuse_unless_it_fits
from uuvsim_cosim.kernels.batch.batch import Batch, Seeds
from uuvsim_cosim.kernels.batch.memory import Lanes, Signal, aligned, signal_of
from uuvsim_cosim.kernels.codegen.derivative import (
    Mode,
    derivative_driver_text,
    derivative_text,
    tape_cells,
)
from uuvsim_cosim.kernels.codegen.program import Program, compiled
from uuvsim_cosim.models.hull.contact import HullContact, HullPlace
from uuvsim_cosim.models.intrinsics.network import NETWORKS, Network
from uuvsim_cosim.models.intrinsics.table import TABLES
from uuvsim_cosim.share import compute_in_threads

__all__ = ["Derivative", "Rollout", "Values", "derivative_of", "jvp", "run", "vjp"]


@final
class Derivative:
    """Compiled tangents, or adjoints, of a kernel's initialization and step."""

    def __init__(self, kernel: Program, mode: Mode) -> None:
        fused = kernel.fused
        kernel.check_unchanged()  # the derivatives are made from the declarations of now
        problems = [*_undifferentiable(kernel)]
        if problems:
            raise SystemInvalid(problems)
        flags = (f"-DUUV_W={kernel.lanes}", "-Wno-psabi", *processor_flags(kernel.baseline))
        texts = [derivative_text(fused.equations[s], mode) for s in fused.sources]
        driver = derivative_driver_text(fused, mode, [content_hash([t, *flags]) for t in texts])
        names = [f"{outline.name}_{mode}" for _, outline in fused.declarations.values()]
        jobs = [*zip([*names, f"kernel_{mode}"], [*texts, driver], strict=True)]
        built = dict(compute_in_threads(lambda job: compiled(*job, flags), jobs, 2))
        *libraries, self.c = (ctypes.CDLL(str(built[job])) for job in jobs)
        self._libraries = libraries
        pointer, u64 = ctypes.c_void_p, ctypes.c_uint64
        self.c.uuv_derivative_bind.argtypes = [ctypes.c_uint32, pointer]
        self.c.uuv_derivative_reset.argtypes = [pointer] * 4 + [u64, u64]
        self.c.uuv_derivative_step.argtypes = [pointer] * 3 + [u64, u64]
        for i, library in enumerate(libraries):
            table = ctypes.c_char.in_dll(library, "uuv_the_lane_derivative")
            self.c.uuv_derivative_bind(i, ctypes.addressof(table))
        self.tape_cells = tape_cells(fused)


def _undifferentiable(kernel: Program) -> Iterator[Problem]:
    if kernel.dtype != np.float64:
        yield Problem("kernel", f"derivatives in {kernel.dtype}", "a kernel of float64")
    for m in kernel.fused.members:
        e = kernel.fused.equations[m.source]
        called = {g.name() for f in (e.rhs, e.outputs, *e.updates) for g in f.find_functions()}
        known = {
            n for n in called if isinstance(NETWORKS.get(n), Network | HullContact | HullPlace)
        }
        if not called <= TABLES.keys() | known:
            yield Problem(
                m.path,
                "an optimiser, a transformer, a field or rays, in a derivative",
                "equations, tables, multilayer perceptrons and contact",
            )
        if m.rate >= 0:
            yield Problem(
                m.path,
                "a communication step longer than the system's, in a derivative",
                "components that all make the system's step",
            )


Values = dict[str, np.ndarray]
KEPT_BYTES = 1 << 25  # of states at the begin of steps; for more, most steps are made twice


_compiled: WeakKeyDictionary[Program, dict[Mode, Derivative]] = WeakKeyDictionary()


def derivative_of(kernel: Program, mode: Mode) -> Derivative:
    """Return the tangents, or adjoints, of a step; they are compiled at the first call."""
    known = _compiled.setdefault(kernel, {})
    if mode not in known:
        known[mode] = Derivative(kernel, mode)
    return known[mode]


@final
class Rollout:
    """`steps` communication steps from start values, with inputs, and the outputs to be read.

    `start` are values of parameters and unconnected inputs, of the variable's shape or one row for
    each environment. `inputs` are values of unconnected inputs that change, (steps, …) of these.
    """

    def __init__(
        self,
        kernel: Program,
        start: Mapping[str, object],
        outputs: Sequence[str],
        *,
        steps: int,
        n_envs: int = 1,
        inputs: Mapping[str, object] | None = None,
        seeds: Seeds | None = None,
        threads: int = 1,
        kept_bytes: int = KEPT_BYTES,
    ) -> None:
        if steps < 1:
            raise InputInvalid(f"{steps} steps", "at least 1")
        self.kernel, self.steps, self.n_envs, self.kept_bytes = kernel, steps, n_envs, kept_bytes
        self.batch = Batch(kernel, n_envs, seeds=seeds, start=start, threads=threads)
        _ = self.batch.free_cells  # derivatives read whole blocks
        self.start: Values = {name: np.asarray(v, dtype=float) for name, v in start.items()}
        self.inputs: Values = {name: self._sequence(name, v) for name, v in (inputs or {}).items()}
        twice = self.start.keys() & self.inputs.keys()
        if twice:
            raise InputInvalid(min(twice), "is given as start and as inputs", "one")
        self.outputs = {name: self._real(name) for name in outputs}
        refuse_unless_it_fits(
            "steps",
            f"outputs of {steps} steps of {n_envs} environments",
            8 * steps * n_envs * sum(s.variable.size for s in self.outputs.values()),
            "at most 1/{times} of these steps, fewer outputs or fewer environments",
        )
        self._tapes: np.ndarray | None = None

    def _real(self, name: str) -> Signal:
        signal = self.batch._signal(name)
        type_ = signal.variable.type
        if type_ != "Float64":
            raise InputInvalid(name, f"is {type_}, without derivatives", "a Float64")
        return signal

    def _sequence(self, name: str, values: object) -> np.ndarray:
        """Return an input's values over the steps; raises InputInvalid."""
        variable = self._real(name).variable
        if variable.causality != "input":
            raise InputInvalid(name, f"is {variable.causality}, in inputs", "an input that changes")
        shape = variable.shape
        array: np.ndarray = np.asarray(values, dtype=float)
        expected = ((self.steps, *shape), (self.steps, self.n_envs, *shape))
        if array.shape not in expected:
            raise InputInvalid(
                name, f"values of shape {array.shape}", f"{expected[0]} or {expected[1]}"
            )
        return array

    def set_inputs(self, k: int) -> None:
        """Set the inputs of step k."""
        for name, values in self.inputs.items():
            self.batch.set(name, values[k])

    def read(self) -> Iterator[np.ndarray]:
        """Yield the present values of the outputs."""
        for signal in self.outputs.values():
            yield signal.own.read()

    def beside(self) -> tuple[Lanes, Lanes]:
        """Return zeros with the memory layout of the environments' values and start values."""
        fused, n = self.kernel.fused, self.n_envs
        width, dtype = self.kernel.lanes, self.kernel.dtype
        return (
            Lanes(n, fused.n_cells, width, dtype),
            Lanes(n, fused.n_start, width, dtype),
        )

    def empty(self) -> Values:
        """Return arrays for every output at the end of every step."""
        return {
            name: np.empty((self.steps, self.n_envs, *s.variable.shape))
            for name, s in self.outputs.items()
        }

    def each(self, call: Callable[[int, int, int], object], derivative: Derivative) -> None:
        """Call with a work space for each range of blocks."""
        if self._tapes is None:
            workers = len(self.batch._scratch)
            self._tapes = aligned((workers, derivative.tape_cells, self.kernel.lanes))
        addresses = [int(tape.ctypes.data) for tape in self._tapes]
        self.batch._each(lambda n, a, b: call(addresses[n], a, b))


def run(rollout: Rollout, keep: Callable[[int], None] = lambda _: None) -> Values:
    """Return the outputs at the end of every step; `keep` is called at the begin of each."""
    values = rollout.empty()
    rollout.batch.reset()
    for k in range(rollout.steps):
        rollout.set_inputs(k)
        keep(k)
        rollout.batch.step()
        for name, value in zip(rollout.outputs, rollout.read(), strict=True):
            values[name][k] = value
    return values


def jvp(rollout: Rollout, tangents: Mapping[str, object]) -> tuple[Values, Values]:
    """Return the outputs at the end of every step, and their derivative along `tangents`.

    `tangents` are perturbations of the rollout's start values and inputs, by name, in the same
    shapes; values that it does not name are constant. Outputs are (steps, n_envs, …).
    """
    derivative = derivative_of(rollout.kernel, "tangent")
    d, d_start = rollout.beside()
    batch = rollout.batch
    moved = {name: signal_of(rollout.kernel, name, d, d_start) for name in rollout.outputs}
    sequences: dict[str, tuple[Signal, np.ndarray]] = {}
    for name, value in tangents.items():
        array: np.ndarray = np.asarray(value, dtype=float)
        shape = _given(rollout, name).shape
        if array.shape != shape:
            raise InputInvalid(name, f"tangent of shape {array.shape}", f"{shape}, as given")
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


def vjp(rollout: Rollout) -> tuple[Values, Callable[[Mapping[str, object]], Values]]:
    """Return the outputs at the end of every step, and a function that pulls gradients back.

    Its argument is the gradient of a scalar with respect to outputs, (steps, n_envs, …) each. It
    returns the gradient with respect to the rollout's start values and inputs, in their shapes.
    """
    derivative = derivative_of(rollout.kernel, "adjoint")
    cells, steps = rollout.batch.cells, rollout.steps
    every = 1 if steps * cells.nbytes <= rollout.kept_bytes else ceil(sqrt(steps))
    kept: dict[int, np.ndarray] = {}

    def keep(k: int) -> None:
        if k % every == 0:
            kept[k] = _copy(cells)

    values = run(rollout, keep)

    def pull(gradients: Mapping[str, object]) -> Values:
        given: Values = {}
        for name, gradient in gradients.items():
            if name not in rollout.outputs:
                names = ", ".join(rollout.outputs)
                raise InputInvalid(name, "is no output of the rollout", f"one of {names}")
            array: np.ndarray = np.asarray(gradient, dtype=float)
            shape = (rollout.steps, *_rows(rollout, name))
            if array.shape != shape:
                raise InputInvalid(name, f"gradient of shape {array.shape}", shape)
            given[name] = array
        return _pulled_back(rollout, derivative, kept, every, given)

    return values, pull


def _pulled_back(
    rollout: Rollout,
    derivative: Derivative,
    kept: Mapping[int, np.ndarray],
    every: int,
    given: Values,
) -> Values:
    """Return the gradients with respect to start values and inputs.

    `kept` are the cells at the begin of every `every`-th step; the steps between are repeated.
    """
    a, a_start = rollout.beside()
    batch, kernel, c = rollout.batch, rollout.kernel, derivative.c
    observed = {name: signal_of(kernel, name, a, a_start) for name in given}
    changed = {name: signal_of(kernel, name, a, a_start) for name in rollout.inputs}
    found: Values = {name: np.zeros((rollout.steps, *_rows(rollout, name))) for name in changed}
    segment: dict[int, np.ndarray] = {}
    spare: list[np.ndarray] = []  # memory of the last segment, for the next one

    def back_over(k: int) -> None:
        m = int(segment[k].ctypes.data)
        rollout.each(lambda tape, i, j: c.uuv_derivative_step(m, a.address, tape, i, j), derivative)

    for k in reversed(range(rollout.steps)):
        if k not in segment:
            spare += [cells for first, cells in segment.items() if first not in kept]
            first = k - k % every
            segment = {first: kept[first]}
            if k > first:  # repeat the steps from kept cells on
                batch.cells[...] = kept[first]
                for j in range(first, k):
                    if j > first:
                        rollout.set_inputs(j)
                        segment[j] = _copy(batch.cells, spare)
                    batch.step()
                rollout.set_inputs(k)
                segment[k] = _copy(batch.cells, spare)
        for name, signal in observed.items():
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
    for name, gradient in found.items():
        # A value that was given for all environments gets the sum over them.
        if _given(rollout, name).ndim < gradient.ndim:
            axis = 1 if name in rollout.inputs else 0
            found[name] = np.asarray(gradient.sum(axis=axis))
    return found


def _copy(cells: np.ndarray, spare: list[np.ndarray] | None = None) -> np.ndarray:
    copy = spare.pop() if spare else aligned(cells.shape)
    copy.view(np.uint64)[...] = cells.view(np.uint64)  # bits: some cells hold integers
    return copy


def _rows(rollout: Rollout, name: str) -> tuple[int, ...]:
    return (rollout.n_envs, *rollout.batch._signal(name).variable.shape)


def _given(rollout: Rollout, name: str) -> np.ndarray:
    """Return a start value or input of the rollout; raises InputInvalid."""
    for known in (rollout.start, rollout.inputs):
        if name in known:
            return known[name]
    names = ", ".join([*rollout.start, *rollout.inputs]) or "nothing"
    raise InputInvalid(name, "was not given to the rollout", f"one of {names}")
