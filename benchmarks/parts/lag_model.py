"""The first-order lag of the benchmarks as a declaration."""

from __future__ import annotations

from uuvsim_cosim.models.declaration.model import Model

__all__ = ["lag"]


def lag() -> Model:
    m = Model("lag")
    u, T = m.input("u", unit="1"), m.parameter("T", 0.5, unit="s")
    x = m.state("x", unit="1")
    m.der(x, (u - x) / T)
    m.output("y", x, unit="1")
    return m
