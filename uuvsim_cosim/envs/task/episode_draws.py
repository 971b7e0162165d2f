"""Random numbers of many episodes, each of which depends on its seed and episode alone."""

from __future__ import annotations

import hashlib
import math
import struct
from functools import lru_cache
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.models.declaration.philox import WORD, philox

__all__ = ["Draws"]

Array = NDArray[np.float64]
_AHEAD = 64  # episodes that are drawn at once for an environment alone
_KEPT = 256
_ahead: dict[tuple[int, str, int], tuple[int, NDArray[Any]]] = {}  # seed, name, size: first, rows


@final
class Draws:
    """Random numbers of n episodes: row e depends on seeds[e], episodes[e] and a name only.

    An environment therefore draws the same numbers alone and among ten thousand, in any order.
    `seeds` are whole numbers modulo 2^64, and `episodes` count from 0; both have the shape (n,). A
    task receives such draws in its method `start`. The `name` of a draw makes it independent of
    other draws: "start", "start/2" for a second try. The same name gives the same numbers again.

    Example:

    >>> from uuvsim_cosim.envs import Draws
    >>> draws = Draws(seeds=[7, 7, 8], episodes=[0, 1, 0])
    >>> draws.uniform("depth", 2.0, 8.0)  # one number for each of the three episodes
    array([3.88280454, 4.29459463, 7.37899309])
    """

    def __init__(self, seeds: ArrayLike, episodes: ArrayLike) -> None:
        self._seeds = np.asarray(seeds, dtype=np.uint64)
        self._episodes = np.asarray(episodes, dtype=np.uint64)

    @property
    def n(self) -> int:
        """The number of episodes.

        Example:

        >>> from uuvsim_cosim.envs import Draws
        >>> Draws(seeds=[7, 7, 8], episodes=[0, 1, 0]).n
        3
        """
        return len(self._seeds)

    def rows(self, chosen: ArrayLike) -> Draws:
        """Return the draws of the `chosen` episodes, given by a mask or by indices.

        Example:

        >>> from uuvsim_cosim.envs import Draws
        >>> draws = Draws(seeds=[7, 7, 8], episodes=[0, 1, 0])
        >>> draws.n, draws.rows([True, False, True]).n
        (3, 2)
        """
        chosen = np.asarray(chosen)
        return Draws(self._seeds[chosen], self._episodes[chosen])

    def seeds(self, name: str = "system") -> NDArray[np.uint64]:
        """Return a seed for each episode, of shape (n,).

        With the default `name`, these are the seeds with which an environment resets its system.

        Example:

        >>> from uuvsim_cosim.envs import Draws
        >>> Draws(seeds=[7, 8], episodes=[0, 0]).seeds()
        array([12352026036946472830, 11950623533197062401], dtype=uint64)
        """
        kept = self._kept(name, 0)
        if kept is not None:
            return kept
        a, b, _, _ = self._words(name, 1)
        return (a << np.uint64(32) | b)[:, 0]

    def uniform(
        self, name: str, low: ArrayLike = 0.0, high: ArrayLike = 1.0, shape: tuple[int, ...] = ()
    ) -> Array:
        """Return uniform numbers in (low, high), of shape (n, *shape).

        `low` and `high` are numbers, or arrays that NumPy broadcasts to that shape.

        Example:

        >>> from uuvsim_cosim.envs import Draws
        >>> draws = Draws(seeds=[7, 8], episodes=[0, 0])
        >>> draws.uniform("start", low=-1.0, high=1.0, shape=(2,)).round(2)  # N and E of each
        array([[-0.36,  0.56],
               [ 0.56,  0.35]])
        """
        unit = self._unit(name, math.prod(shape)).reshape(self.n, *shape)
        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        return np.asarray(low + (high - low) * unit)

    def normal(self, name: str, shape: tuple[int, ...] = ()) -> Array:
        """Return normal numbers of mean 0 and standard deviation 1, of shape (n, *shape).

        Example:

        >>> from uuvsim_cosim.envs import Draws
        >>> draws = Draws(seeds=[7, 8], episodes=[0, 0])
        >>> 0.1 * draws.normal("error", shape=(2,)).round(1)  # deviation 0.1
        array([[...],
               [...]])
        """
        from scipy.special import ndtri  # element by element: numpy's log differs with alignment

        return np.asarray(ndtri(self.uniform(name, shape=shape)))

    def _unit(self, name: str, size: int) -> Array:
        kept = self._kept(name, size) if size else None
        if kept is not None:
            return kept
        a, b, c, d = self._words(name, (size + 1) // 2)
        pairs = np.stack([a << np.uint64(20) | b >> np.uint64(12),
                          c << np.uint64(20) | d >> np.uint64(12)], axis=-1)  # fmt: skip
        return np.asarray((pairs.reshape(self.n, -1)[:, :size] + 0.5) * 2.0**-52)

    def _kept(self, name: str, size: int) -> NDArray[Any] | None:
        """Return `_unit`, or with size 0 `seeds`, of a single environment from a cache.

        A single environment asks for one episode after another, so the numbers of several episodes
        are drawn at once, which costs no more. Returns None where nothing is cached.
        """
        if self.n != 1:
            return None
        seed, episode = int(self._seeds[0]), int(self._episodes[0])
        first, rows = _ahead.get((seed, name, size), (0, None))
        if rows is None or not first <= episode < first + len(rows):
            if episode == 0:  # each reset may have another seed: do not draw ahead yet
                return None
            several = Draws([seed] * _AHEAD, np.arange(episode, episode + _AHEAD, dtype=np.uint64))
            first, rows = episode, several._unit(name, size) if size else several.seeds(name)
            if len(_ahead) >= _KEPT:
                _ahead.clear()
            rows.flags.writeable = False
            _ahead[seed, name, size] = first, rows
        place = episode - first
        return rows[place : place + 1]

    def _words(self, name: str, blocks: int) -> tuple[NDArray[np.uint64], ...]:
        block = np.arange(max(blocks, 1), dtype=np.uint64)[None, :]
        seed, episode = self._seeds[:, None], self._episodes[:, None]
        counter = (seed & WORD, seed >> 32, episode + 0 * block, block + 0 * seed)
        return philox(counter, _key(name))


@lru_cache(maxsize=4096)
def _key(name: str) -> tuple[int, int]:
    first, second = struct.unpack("<II", hashlib.blake2b(name.encode(), digest_size=8).digest())
    return first, second
