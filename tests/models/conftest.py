"""Many lanes of one sampled model at once, in CasADi's own evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.model import Model

Array = NDArray[np.float64]


class Mapped:
    """A CasADi function over `n` lanes, called on memory that stays where it is."""

    def __init__(self, f: Any, n: int) -> None:
        g = f.map(n)
        self.memory = [np.zeros(g.numel_in(i)) for i in range(g.n_in())]
        self.arguments = [a.reshape(g.size_in(i), order="F") for i, a in enumerate(self.memory)]
        out = np.zeros(g.numel_out(0))
        self.result = out.reshape(g.size_out(0), order="F")
        self.buffer, self.evaluate = g.buffer()
        for i, a in enumerate(self.memory):
            self.buffer.set_arg(i, memoryview(a))
        self.buffer.set_res(0, memoryview(out))

    def __call__(self, *values: ArrayLike) -> Array:
        """Return f, one column for each lane."""
        for a, value in zip(self.arguments, values, strict=True):
            a[:] = value
        self.evaluate()
        return self.result.copy()


class Lanes:
    """`n` instances of a model without continuous states; values are (size, n)."""

    def __init__(
        self, model: Model, n: int = 1, seed: int = 0, parameters: Mapping[str, Any] | None = None
    ) -> None:
        f = Evaluation(model)
        self.model, self.n = model, n
        self.places: dict[tuple[str, str], slice] = {}
        ends: dict[str, int] = {}
        for v in model.variables.values():
            first = ends.get(v.kind, 0)
            ends[v.kind] = first + v.size
            self.places[v.kind, v.name] = slice(first, first + v.size)
        self.random = np.random.default_rng(seed)
        self.u = np.tile(f.values_of("input", {})[:, None], n)
        self.p = np.tile(f.values_of("parameter", {})[:, None], n)
        for name, value in (parameters or {}).items():
            at = self._place("parameter", name)
            value = np.asarray(value, dtype=float)
            lanes = value.ndim == 2 and value.shape == (at.stop - at.start, n)
            self.p[at] = value if lanes else value.reshape(-1, 1)
        self.d = Mapped(f.derived, n)(self.p)
        self.z = Mapped(f.initial, n)(self.p, self.d)
        self.updates = [Mapped(g, n) for g in f.updates]
        self.outputs = Mapped(f.outputs, n)
        self.k = [0] * len(model.clocks)
        self.x = np.zeros((0, n))
        self.y = self._evaluate(0.0)

    def step(self, t: float, h: float, **inputs: ArrayLike) -> Lanes:
        """Set inputs, take every tick within [t, t + h), and evaluate outputs at its end."""
        for name, value in inputs.items():
            at = self._place("input", name)
            value = np.asarray(value, dtype=float)
            self.u[at] = value if value.ndim == 2 else value.reshape(-1, 1)
        while True:
            due = [
                (k * float(c.period), c.index)
                for k, c in zip(self.k, self.model.clocks, strict=True)
            ]
            at_time, i = min(due)
            if at_time >= t + h - 1e-9:
                break
            size = sum(w.numel() for w in self.model.clocks[i].draws)
            w = self.random.standard_normal((size, self.n))
            time = np.full((1, self.n), at_time)
            self.z = self.updates[i](time, self.u, self.p, self.d, self.x, self.z, w)
            self.k[i] += 1
        self.y = self._evaluate(t + h)
        return self

    def __getitem__(self, name: str) -> Array:
        """Return an output or a discrete state: (size, n), or (size,) of a single lane."""
        for kind, values in (("output", self.y), ("discrete", self.z)):
            if (kind, name) in self.places:
                rows = values[self.places[kind, name]]
                return rows[:, 0] if self.n == 1 else rows
        raise KeyError(name)

    def _evaluate(self, t: float) -> Array:
        time = np.full((1, self.n), t)
        return self.outputs(time, self.u, self.p, self.d, self.x, self.z)

    def _place(self, kind: str, name: str) -> slice:
        return self.places[kind, name]


@pytest.fixture(scope="session")
def lanes() -> type[Lanes]:
    return Lanes


@pytest.fixture(scope="session")
def silent() -> Any:
    """Parameters that switch off every error of a sensor."""

    def parameters(model: Model) -> dict[str, float]:
        words = ("noise_density", "sigma", "dropout")
        return {
            v.name: 0.0
            for v in model.of_kind("parameter")
            if v.name.startswith("sigma") or v.name.endswith(words)
        }

    return parameters
