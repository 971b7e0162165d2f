"""Verification of a system: the hash that all ways agree on, or the first value that differs."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.resources import refuse_unless_it_fits
from uuvsim_cosim.kernels.codegen.fusible import fused_of
from uuvsim_cosim.kernels.verification.emulated import EMULATOR, emulator
from uuvsim_cosim.kernels.verification.ways import (
    COMPILERS,
    TEXTS,
    Output,
    Rows,
    Way,
    by_compiler,
    outputs_of,
    ways_of,
)
from uuvsim_cosim.kernels.web_assembly.node import node
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import ModelSource
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Difference", "Outcome", "Verification", "first_difference", "verify"]

_COPIES = 8  # of all rows at most: of the reference and of another way, and their bits
_FOREIGN = {
    "FMU": "an FMU, not of a declaration",
    "Python": "a Python component",
}


@dataclass(frozen=True)
class Outcome:
    """The hash of one way, and its wall time [s] with compilation."""

    way: str
    compiler: str
    hash: str
    seconds: float


@dataclass(frozen=True)
class Difference:
    """The first value that differs from the reference: `a` there, `b` in the other way."""

    output: str
    time: float  # s
    reference: str
    way: str
    a: float
    b: float


@dataclass(frozen=True)
class Verification:
    """Results of all ways; `hash` is None if two of them differ."""

    steps: int
    tick: float  # s
    outputs: int
    outcomes: tuple[Outcome, ...]
    difference: Difference | None
    not_covered: tuple[str, ...]
    missing: tuple[str, ...]  # on this machine

    @property
    def hash(self) -> str | None:
        """The hash that all ways agree on."""
        return self.outcomes[0].hash if self.difference is None else None


def verify(
    system: System,
    steps: int = 1000,
    *,
    seed: int = 0,
    progress: Callable[[str], object] = lambda way: None,
) -> Verification:
    """Run a system in every way that this machine has, and compare the bits of all outputs.

    `progress` gets the name of each way before it runs. Raises InputInvalid for fewer than one
    step and for more than the memory can hold, and the errors of a run.
    """
    if steps < 1:
        raise InputInvalid("steps", steps, "1 or more")
    plan = flatten(system, seed=seed)
    outputs = outputs_of(plan)
    if not outputs:
        raise InputInvalid(system.name, "it has no outputs", "a system with one output or more")
    refuse_unless_it_fits(
        "steps", f"{steps:,} steps of {len(outputs)} outputs",
        _COPIES * 8.0 * steps * len(outputs), "{times} times fewer steps",
    )  # fmt: skip
    not_covered = [*_foreign(plan), *_texts(plan)]
    try:
        fused_of(plan)
        fused = True
    except SystemInvalid as error:
        fused = False
        not_covered += [
            f"one FMU of the system, kernel and WebAssembly: {problem}"
            for problem in error.problems
        ]
    missing = [
        *(f"the compiler {c}" for c in COMPILERS if c != "zig" and shutil.which(c) is None),
        *(["node, for WebAssembly"] if fused and node() is None else []),
        *(["wasmtime, for FMUs as WebAssembly"] if find_spec("wasmtime") is None else []),
        *([f"{EMULATOR}, for aarch64"] if fused and emulator() is None else []),
    ]
    outcomes: list[Outcome] = []
    reference: tuple[str, Rows] | None = None
    difference: tuple[int, Difference] | None = None
    for way in ways_of(fused=fused, node=node() is not None, emulator=emulator() is not None):
        progress(_named(way))
        begun = time.perf_counter()
        with by_compiler(way.compiler):
            rows = way.run(system, steps, seed)
        seconds = time.perf_counter() - begun
        found = output_hash(rows, [o.whole for o in outputs])
        outcomes.append(Outcome(way.name, way.compiler, found, seconds))
        if reference is None:
            reference = (_named(way), rows)
            continue
        other = first_difference(outputs, reference, (_named(way), rows), float(plan.tick))
        if other is not None and (difference is None or other[0] < difference[0]):
            difference = other
    return Verification(
        steps,
        float(plan.tick),
        len(outputs),
        tuple(outcomes),
        None if difference is None else difference[1],
        tuple(not_covered),
        tuple(missing),
    )


def first_difference(
    outputs: list[Output], reference: tuple[str, Rows], other: tuple[str, Rows], tick: float
) -> tuple[int, Difference] | None:
    """Return the first point at which two ways have other bits, and the first output there.

    A way that has ended early has NaN from its end on.
    """
    (a_name, a), (b_name, b) = reference, other
    points, whole = max(len(a), len(b)), np.array([o.whole for o in outputs])
    a, b = (np.pad(r, ((0, points - len(r)), (0, 0)), constant_values=np.nan) for r in (a, b))
    bits = [np.where(whole, r + 0.0, r).view(np.uint64) for r in (a, b)]
    found = np.argwhere(bits[0] != bits[1])
    if not len(found):
        return None
    k, j = (int(i) for i in found[0])
    time = round(k * tick, 12)
    return k, Difference(outputs[j].name, time, a_name, b_name, float(a[k, j]), float(b[k, j]))


def _named(way: Way) -> str:
    return f"{way.name} ({way.compiler})"


def _foreign(plan: Plan, kinds: Mapping[str, str] = _FOREIGN) -> list[str]:
    """Return the components whose code is not generated: it is the same in all ways."""
    found = []
    for c in plan.components:
        source = resolve(c.source)
        if not isinstance(source, ModelSource):
            what = kinds.get(source.kind, source.kind)
            found.append(f"{c.path}: {what}, {c.source}, runs the same code in all ways")
    return found


def _texts(plan: Plan) -> list[str]:
    """Return the outputs that are no numbers: they have no part in the hash."""
    return [
        f"{c.path}.{v.name}: a {v.type}, which is not compared"
        for c in plan.components
        for v in c.description.of("output")
        if v.type in TEXTS
    ]
