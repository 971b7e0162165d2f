"""Components for tests of the bridge: small classes whose results are known in closed form."""

from __future__ import annotations

from typing import Any


class Sum:
    """s(t + dt) = s(t) + (a + b) dt."""

    inputs = {"a": "m/s", "b": "m/s"}  # noqa: RUF012
    outputs = {"s": "m", "both": (2, "m/s")}  # noqa: RUF012
    parameters = {"k": (1.0, "1")}  # noqa: RUF012

    def __init__(self) -> None:
        self.s = 0.0

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        self.s += self.k * (u["a"] + u["b"]) * dt
        return {"s": self.s, "both": [u["a"], u["b"]]}


class Fails(Sum):
    """A sum that fails from 0.45 s on."""

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        if t > 0.45:
            raise ValueError("the well is dry")
        return super().step(t, dt, u)


class NotANumber(Sum):
    """A sum that is not a number from 0.45 s on."""

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        given = super().step(t, dt, u)
        return {**given, "s": float("nan")} if t > 0.45 else given


class Twice:
    """y = 2 x, as it was a step before."""

    inputs = {"x": "m"}  # noqa: RUF012
    outputs = {"y": "m"}  # noqa: RUF012

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        return {"y": 2.0 * u["x"]}


class Feet(Sum):
    """A sum in another unit."""

    outputs = {"s": "km", "both": (2, "m/s")}  # noqa: RUF012


class Current:
    """The names of a Gauss-Markov current, with other shapes."""

    outputs = {"v_c": (2, "m/s")}  # noqa: RUF012
    names = ("speed", "direction", "v_D", "sigma", "tau", "sigma_direction", "tau_direction")
    parameters = dict.fromkeys(names, (1.0, "1"))
    inputs: dict[str, str] = {}  # noqa: RUF012

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        return {"v_c": [0.0, 0.0]}
