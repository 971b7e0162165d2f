"""A component whose results are known in closed form: s(t + dt) = s(t) + k (a + b) dt."""

from typing import Any


class Sum:
    inputs = {"a": "m/s", "b": "m/s", "gains": (2, "1")}  # noqa: RUF012
    outputs = {"s": "m", "both": (2, "m/s")}  # noqa: RUF012
    parameters = {"k": (1.0, "1")}  # noqa: RUF012

    def __init__(self) -> None:
        self.s = 0.0

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        if u["a"] == 13.0:
            raise ValueError("no thirteen")
        self.s += self.k * (u["a"] + u["b"]) * dt  # type: ignore[attr-defined]
        return {"s": self.s, "both": [u["a"], u["b"]]}
