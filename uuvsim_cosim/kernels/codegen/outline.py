"""Outline of a declaration: what a kernel needs to know besides its C, without any equations.

An outline and the C text of a declaration on lanes are kept in the cache until a file that the
declaration reads changes. So a system that was fused before is fused without CasADi.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import content_hash, intact
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.equations import Equations, equations
from uuvsim_cosim.fmus.codegen.optimiser_code import optimisers_of
from uuvsim_cosim.fmus.codegen.toolchain import generated_sources
from uuvsim_cosim.kernels.codegen.declaration import declaration_text
from uuvsim_cosim.models.declaration.files_read import kept_until_changed, noted_result
from uuvsim_cosim.models.declaration.model import Kind
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import FunctionSource, ModelSource

__all__ = ["Outline", "Value", "Written", "changed", "outline_of", "written"]


@dataclass(frozen=True)
class Value:
    """A variable in the block of a component; its first element is at `offset`."""

    name: str
    kind: Kind
    type: str
    shape: tuple[int, ...]
    size: int
    offset: int
    start: tuple[float, ...] = ()  # of inputs and parameters


@dataclass(frozen=True)
class Outline:
    """The block of a declaration's values, and what its steps need."""

    name: str
    values: tuple[Value, ...]
    offset: Mapping[Kind, int]  # first place of each kind
    count: Mapping[Kind, int]
    size: int
    periods: tuple[tuple[str, Fraction], ...]  # of each clock, with its name
    h_max: float
    operations: int  # of a right-hand side and the outputs
    draws: int  # most of a clock
    optimises: bool

    @cached_property
    def _by_name(self) -> Mapping[str, Value]:
        return {v.name: v for v in self.values}

    def start_values(self) -> np.ndarray:
        """Return the start values of the block before its derived values: 0 of the time."""
        block = np.zeros(self.offset["derived"])
        for v in self.values:
            if v.kind in ("input", "parameter"):
                block[v.offset : v.offset + v.size] = v.start
        return block

    def value(self, name: str) -> Value | None:
        """Return a variable by its name, if there is one."""
        return self._by_name.get(name)

    def offset_of(self, name: str) -> int:
        """Return the offset of a variable's first element."""
        return self._by_name[name].offset


@dataclass(frozen=True)
class Written:
    """A declaration on lanes: its outline, the file of its C text, and a hash of the text."""

    outline: Outline
    file: Path
    token: str


def written(source: ModelSource, outline: Outline, dtype: np.dtype) -> Written:
    """Return the declaration that has this outline as C on lanes of numbers of a type.

    Raises InputInvalid if a file that it reads has changed, so that the outline is another one.
    """
    if type(source) not in (ModelSource, FunctionSource):  # its text alone does not name it
        found = _write(source, dtype)
    else:
        found = _kept_text(f"{dtype.name}\n{source.text}")
        if not intact(found.file):
            found = _write(source, dtype)
    if repr(found.outline) != repr(outline):
        raise changed(source)
    return found


def changed(source: ModelSource) -> InputInvalid:
    """Return the error of a declaration that is no longer the one of a kernel."""
    return InputInvalid(source.text, "a file that it reads has changed", "a new kernel")


def outline_of(source: ModelSource) -> Outline:
    """Return the outline of a declaration."""
    if type(source) not in (ModelSource, FunctionSource):
        return _outline(equations(source.declare()))
    return _kept_outline(source.text)


# ---- inside -----------------------------------------------------------------------------------


@kept_until_changed
def _kept_outline(text: str) -> Outline:
    return _outline(equations(_source(text).declare()))


@kept_until_changed
def _kept_text(text: str) -> Written:
    dtype, _, source = text.partition("\n")
    made = _write(_source(source), np.dtype(dtype))
    noted_result(made.file)
    return made


def _source(text: str) -> ModelSource:
    found = resolve(text)
    assert isinstance(found, ModelSource)
    return found


def _write(source: ModelSource, dtype: np.dtype) -> Written:
    eq = equations(source.declare())
    outline, text = _outline(eq), declaration_text(eq, dtype)
    (file,) = generated_sources({f"{outline.name}.c": text})
    return Written(outline, file, content_hash([text]))


def _outline(eq: Equations) -> Outline:
    layout, model = eq.layout, eq.layout.model
    values = []
    for p in layout.placed:
        v = p.variable
        is_given = v.kind in ("input", "parameter")
        start = tuple(float(x) for x in v.start) if is_given else ()
        values.append(Value(v.name, v.kind, v.type, v.shape, v.size, p.offset, start))
    return Outline(
        name=model.name,
        values=tuple(values),
        offset=layout.offset,
        count=layout.count,
        size=layout.size,
        periods=tuple((c.name, c.period) for c in model.clocks),
        h_max=model.h_max,
        operations=int(eq.rhs.n_instructions() + eq.outputs.n_instructions()),
        draws=max((sum(int(d.numel()) for d in c.draws) for c in model.clocks), default=0),
        optimises=bool(optimisers_of(list(eq.updates))),
    )
