"""Images of a sonar as observations of a learner: bytes of a level in dB."""

from __future__ import annotations

from math import prod
from typing import Any, final

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorObservationWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["SonarPicture", "SonarPictures", "picture_of"]

Bytes = NDArray[np.uint8]
LEVELS = (80.0, 180.0)  # dB re 1 uPa, of a magnitude with the gain 40 log r


def picture_of(magnitude: NDArray[Any], levels: tuple[float, float] = LEVELS) -> Bytes:
    """Return magnitudes [Pa] as bytes: 0 at or below the first of two levels, 255 from the second.

    Levels are in dB re 1 uPa. Raises InputInvalid for levels that do not rise.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs.sonar_picture import picture_of
    >>> picture_of(np.array([0.0, 1e-2, 1.0, 1e3]), (80.0, 160.0))
    array([  0,   0, 128, 255], dtype=uint8)
    """
    low, high = levels
    if not -np.inf < low < high < np.inf:
        raise InputInvalid("levels", f"{low:g} to {high:g} dB", "two that rise")
    least = np.float32(10.0 ** ((low - 120.0) / 20.0))
    level = 20.0 * np.log10(np.maximum(np.asarray(magnitude, np.float32), least)) + 120.0
    share = np.clip((level - low) * (255.0 / (high - low)), 0.0, 255.0)
    return np.asarray(np.rint(share), np.uint8)


def _space(own: gymnasium.Space[Any], shape: tuple[int, int]) -> Box:
    """Return the space of a picture; raises InputInvalid if observations are not of its size."""
    if own.shape != (prod(shape),):
        beams, bins = shape
        raise InputInvalid(
            "observations of the environment",
            f"of shape {own.shape}",
            f"the {prod(shape)} magnitudes of {beams} beams of {bins} bins alone",
        )
    return Box(0, 255, shape, np.uint8)


@final
class SonarPicture(gymnasium.ObservationWrapper[Bytes, Any, Any]):
    """Environment whose observation is a picture (beams, bins) of bytes, a `Box` of uint8.

    The task of `env` observes the output `magnitude` of a sonar alone, without limits. `shape` is
    (beams, bins), `levels` are those of `picture_of`.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        shape: tuple[int, int],
        levels: tuple[float, float] = LEVELS,
    ) -> None:
        super().__init__(env)
        self.observation_space = _space(env.observation_space, shape)  # type: ignore[assignment]
        self.shape, self.levels = shape, levels

    def observation(self, observation: Any) -> Bytes:
        """Return the picture of an observation."""
        return picture_of(observation, self.levels).reshape(self.shape)


@final
class SonarPictures(VectorObservationWrapper):
    """Vector of environments whose observations are pictures, as `SonarPicture` makes them."""

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        shape: tuple[int, int],
        levels: tuple[float, float] = LEVELS,
    ) -> None:
        super().__init__(env)
        self.single_observation_space = _space(env.single_observation_space, shape)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.shape, self.levels = shape, levels

    def observations(self, observations: Any) -> Bytes:
        """Return the pictures (n, beams, bins) of observations."""
        return picture_of(observations, self.levels).reshape(-1, *self.shape)
