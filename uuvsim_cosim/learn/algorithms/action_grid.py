"""Grid of actions: continuous actions as a choice among a few, for DQN."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

__all__ = ["action_grid"]


def action_grid(width: int) -> NDArray[np.float32]:
    """Return the choices (k, width), in [-1, 1].

    Two actions, such as (a, omega) of target tracking: a grid of 3 x 5. One action: 5 levels. More
    actions: all 0, or one of them at -1 or 1, which are 2 width + 1 choices.
    """
    levels = np.linspace(-1.0, 1.0, 5)
    if width == 1:
        return levels[:, None].astype(np.float32)
    if width == 2:
        rows = list(itertools.product((-1.0, 0.0, 1.0), levels))
        return np.array(rows, np.float32)
    alone = np.eye(width)
    return np.concatenate([np.zeros((1, width)), alone, -alone]).astype(np.float32)
