"""Images of a colour camera as observations of a learner: bytes by row, column and channel."""

from __future__ import annotations

from math import prod
from typing import Any, final

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["CameraPicture"]

Bytes = NDArray[np.uint8]


@final
class CameraPicture(gymnasium.ObservationWrapper[Bytes, Any, Any]):
    """Environment whose observation is an image (rows, columns, 3) of bytes, a `Box` of uint8.

    The task of `env` observes the output `image` of a colour camera alone, without limits. `rows`
    and `columns` are those of the camera. Raises InputInvalid for observations of another size.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], rows: int, columns: int) -> None:
        super().__init__(env)
        self.shape = rows, columns, 3
        if env.observation_space.shape != (prod(self.shape),):
            raise InputInvalid(
                "observations of the environment",
                f"of shape {env.observation_space.shape}",
                f"the {prod(self.shape)} grey levels of {rows} rows of {columns} pixels alone",
            )
        self.observation_space = Box(0, 255, self.shape, np.uint8)

    def observation(self, observation: Any) -> Bytes:
        """Return the image of an observation."""
        return np.asarray(observation).astype(np.uint8).reshape(self.shape)
