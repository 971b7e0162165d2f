"""CasADi functions whose values Python computes: they are called by name and never inlined."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

__all__ = ["CALLBACKS", "register_callback"]

CALLBACKS: dict[str, ca.Function] = {}  # by name; CasADi does not keep a Callback alive


def register_callback(
    name: str,
    function: Callable[..., Any],
    inputs: Sequence[int],
    output: tuple[int, int],
    gradients: Sequence[ca.Function] = (),
) -> ca.Function:
    """Register a function of columns (DM) of so many rows, with one output of a shape.

    `gradients` are the derivatives of the output by each input; without them it has none.
    """

    class PythonCallback(ca.Callback):
        """A function that CasADi evaluates by Python, and differentiates by further callbacks."""

        def __init__(self) -> None:
            ca.Callback.__init__(self)
            self.construct(name, {})

        def get_n_in(self) -> int:
            return len(inputs)

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, i: int) -> ca.Sparsity:
            return ca.Sparsity.dense(inputs[i], 1)

        def get_sparsity_out(self, i: int) -> ca.Sparsity:
            return ca.Sparsity.dense(*output)

        def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
            return [ca.DM(np.asarray(function(*arguments), float))]

        def has_jacobian(self) -> bool:
            return bool(gradients)

        def get_jacobian(
            self, name: str, inputs_: list[str], outputs: list[str], options: dict[str, object]
        ) -> ca.Function:
            at = [ca.MX.sym(f"at{i}", rows) for i, rows in enumerate(inputs)]
            value = ca.MX.sym("value", ca.Sparsity(*output))
            partials = [g(*at) for g in gradients]
            return ca.Function(name, [*at, value], partials, inputs_, outputs, options)

    CALLBACKS[name] = PythonCallback()
    return CALLBACKS[name]
