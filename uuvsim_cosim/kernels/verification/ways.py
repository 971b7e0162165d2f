"""Ways to run a system: FMUs, native components, a kernel, WebAssembly, an emulated processor.

Each returns the bits of all outputs at all communication points as an array (points, elements).
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.fmus.description import Variable, VariableType
from uuvsim_cosim.fmus.export.model_description import FmiVersion
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.kernels.system_fmu.system_fmu import build_system_fmu
from uuvsim_cosim.kernels.verification.emulated import run_emulated
from uuvsim_cosim.kernels.web_assembly.module import web_assembly
from uuvsim_cosim.kernels.web_assembly.node import run_in_node
from uuvsim_cosim.orchestrator.master.isolation import WASM
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["COMPILERS", "TEXTS", "Output", "Rows", "Way", "by_compiler", "outputs_of", "ways_of"]

Rows = NDArray[np.float64]
Compiler = Literal["zig", "gcc"]
COMPILERS: tuple[Compiler, ...] = get_args(Compiler)
THREADS = (2, 4, 8, 16)
TEXTS: tuple[VariableType, ...] = ("String", "Binary")


@dataclass(frozen=True)
class Output:
    """An element of an output: its name, "hull.eta[3]", and whether it is a whole number."""

    name: str
    path: str
    variable: Variable
    whole: bool


def outputs_of(plan: Plan) -> list[Output]:
    """Return the elements of all outputs that are numbers, in the order of the plan."""
    return [
        Output(column.name, c.path, v, v.type not in ("Float64", "Float32"))
        for c in plan.components
        for v in c.description.of("output")
        if v.type not in TEXTS
        for column in Column.of(c.path, v)
    ]


@dataclass(frozen=True)
class Way:
    """A way to run a system; `run` has the arguments (system, steps, seed)."""

    name: str
    compiler: Compiler
    run: Callable[[System, int, int], Rows]


def ways_of(*, fused: bool, node: bool, emulator: bool = False) -> list[Way]:
    """List the ways, the reference first.

    `fused` ones need declarations; `node` and `emulator` say whether this machine has them.
    wasmtime is used if it is installed.
    """
    found = []
    for compiler in COMPILERS:
        if compiler != "zig" and shutil.which(compiler) is None:
            continue

        def add(name: str, run: Callable[[System, int, int], Rows], by: Compiler) -> None:
            found.append(Way(name, by, run))

        add("native components", lambda *a: _mastered(*a, backend="native"), compiler)
        add("an FMU for each component", lambda *a: _mastered(*a, backend="fmu"), compiler)
        if compiler == "zig":
            add("isolated FMUs", lambda *a: _mastered(*a, backend="fmu", isolate="*"), compiler)
        if compiler == "zig" and find_spec("wasmtime") is not None:
            name = "FMUs as WebAssembly in wasmtime"
            add(name, lambda *a: _mastered(*a, backend="fmu", isolate=[WASM]), compiler)
        if not fused:
            continue
        versions: tuple[FmiVersion, ...] = (2, 3)
        for fmi in versions if compiler == "zig" else versions[:1]:
            add(f"one FMU {fmi}.0", lambda *a, v=fmi: _one_fmu(*a, fmi=v), compiler)
        for lanes in (1, 8):
            name = f"kernel of {lanes} lane{'' if lanes == 1 else 's'}"
            add(name, lambda *a, n=lanes: _fused(*a, lanes=n), compiler)
        for threads in THREADS if compiler == "zig" else THREADS[-1:]:
            name = f"kernel of 8 lanes, {threads} threads"
            add(name, lambda *a, t=threads: _fused(*a, threads=t), compiler)
        if node and compiler == "zig":
            add("WebAssembly in node", _in_node, compiler)
        if emulator and compiler == "zig":
            add("aarch64 in qemu", _emulated, compiler)
    return found


@contextmanager
def by_compiler(compiler: Compiler) -> Iterator[None]:
    """Compile with this compiler inside the block."""
    before = os.environ.pop("CC", None)
    try:
        if compiler != "zig":
            os.environ["CC"] = compiler
        yield
    finally:
        os.environ.pop("CC", None)
        if before is not None:
            os.environ["CC"] = before


class _Kept:
    """All rows of a run as float64."""

    def __init__(self) -> None:
        self.parts: list[Rows] = []

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Note how many columns there are."""
        self._count = len(columns)

    def observe(self, chunk: Chunk) -> None:
        """Copy the rows."""
        values = [chunk.values(i).astype(float) for i in range(self._count)]
        self.parts.append(np.column_stack(values))

    def end(self) -> None:
        """Do nothing."""


def _mastered(
    system: System, steps: int, seed: int, *, backend: Backend, isolate: Collection[str] = ()
) -> Rows:
    return _recorded(flatten(system, seed=seed), steps, backend, isolate)


def _recorded(plan: Plan, steps: int, backend: Backend, isolate: Collection[str] = ()) -> Rows:
    kept = _Kept()
    record = list(dict.fromkeys((o.path, o.variable.name) for o in outputs_of(plan)))
    instantiate = prepare(plan, backend, isolate=isolate)
    with Master(plan, instantiate, observers=[kept], record=record, measured=False) as master:
        master.initialize()
        master.step(steps)
    return np.concatenate(kept.parts)


def _one_fmu(system: System, steps: int, seed: int, *, fmi: FmiVersion) -> Rows:
    """Run the whole system as one component, whose outputs are in the order of the plan."""
    tick = flatten(system).tick
    whole = System("whole", tick=tick).add("system", str(build_system_fmu(system, fmi=fmi)))
    return _recorded(flatten(whole.set("system.seed", seed)), steps, "fmu")


def _fused(system: System, steps: int, seed: int, *, lanes: int = 8, threads: int = 1) -> Rows:
    """Run equal environments; one that differs from the first is the one that is returned."""
    kernel = fuse(system, lanes=lanes)
    members = {m.path: m for m in kernel.fused.members}
    cells: list[int] = []
    for path, v in dict.fromkeys((o.path, o.variable) for o in outputs_of(kernel.fused.plan)):
        first = members[path].cell + members[path].layout.offset_of(v.name)
        cells += range(first, first + v.size)
    n_envs = lanes * threads
    rows, shown = np.empty((steps + 1, len(cells))), (0, 0)  # block and lane
    with kernel.batch(n_envs, seeds=[seed] * n_envs, threads=threads) as batch:
        for k in range(steps + 1):
            if k:
                batch.step()
            values = batch.free_cells[:, cells, :]
            bits = values.view(np.uint64)
            differ = np.argwhere((bits != bits[:1, :, :1]).any(axis=1))
            if len(differ) and shown == (0, 0):
                shown = (int(differ[0][0]), int(differ[0][1]))
            rows[k] = values[shown[0], :, shown[1]]
    return rows


def _in_node(system: System, steps: int, seed: int) -> Rows:
    return run_in_node(web_assembly(system), steps, seed=seed).rows


def _emulated(system: System, steps: int, seed: int) -> Rows:
    return run_emulated(system, steps, seed=seed)
