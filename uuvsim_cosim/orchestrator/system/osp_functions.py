"""Sums of signals as components: ``function:sum?inputs=3&dimension=2`` is y_j = u_1j + u_2j + u_3j.

A sum is a component of this package, so it runs natively, is packed as an FMU, and is fused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.sources import ModelSource

if TYPE_CHECKING:
    from uuvsim_cosim.models.declaration.model import Model

__all__ = ["FunctionSource", "sum_source"]

_LIMIT = 10_000


def sum_source(inputs: int, dimension: int = 1) -> str:
    """Return the source of a sum of `inputs` vectors of `dimension` elements."""
    return f"function:sum?inputs={inputs}&dimension={dimension}"


@dataclass(frozen=True)
class FunctionSource(ModelSource):
    """A function of signals, ``function:sum?inputs=…&dimension=…``."""

    def declaration(self) -> Model:
        """Return the declaration of the function."""
        name, _, query = self.text.removeprefix("function:").partition("?")
        options = dict(parse_qsl(query, keep_blank_values=True))
        given = [options.pop("inputs", ""), options.pop("dimension", "1")]
        inputs, dimension = (int(t) if t.isdecimal() and len(t) < 6 else 0 for t in given)
        if name != "sum" or options or not 0 < inputs * dimension <= _LIMIT:
            raise InputInvalid(f"function {self.text!r}", "'function:sum?inputs=3'")
        from uuvsim_cosim.models.declaration.model import Model

        m = Model(f"sum_{inputs}_{dimension}")
        shape = inputs * dimension if inputs * dimension > 1 else ()
        u = m.input("u", shape, unit="1", description="vectors, one after the other")
        y = u[:dimension]
        for i in range(1, inputs):
            y = y + u[i * dimension : (i + 1) * dimension]
        m.output("y", y, unit="1", description="their sum")
        return m
