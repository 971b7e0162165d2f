"""Linear model of a system of declarations, from the Jacobian of one communication step.

If clocks are slower than the tick, one sample of the linear model is the shortest time after which
all of them tick again; inputs are held during it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.models.analysis.linearize import state_space
from uuvsim_cosim.orchestrator.analysis.system_map import SystemMap
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

if TYPE_CHECKING:
    import control

__all__ = ["linear_system"]


def linear_system(
    system: System,
    at: float,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> control.StateSpace:
    """Linearise a system around its own trajectory, at `at` seconds; see `running/linearize.py`."""
    m = SystemMap(flatten(system))
    first, x, u = m.trajectory(at)
    A, B = np.eye(len(x)), np.zeros((len(x), len(u)))
    for k in range(first, first + m.period):
        step = m.jacobian(k, x, u)
        A, B = step.A @ A, step.A @ B + step.B.toarray()
        x = m.advance(k, x, u)
    places = [m.names.index(n) for n in m.outputs]
    C = np.eye(len(x))[places]
    D = np.zeros((len(places), len(u)))
    dt = float(m.period * m.plan.tick)
    return state_space((A, B, C, D), m.names, m.inputs, m.outputs, system.name, inputs, outputs, dt)
