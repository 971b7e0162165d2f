"""Random numbers of many episodes, each of which depends on its seed and episode alone."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.models.declaration.philox import WORD, philox

__all__ = ["Asked", "Draws"]

Array = NDArray[np.float64]
_AHEAD = 64  # episodes that are drawn at once for an environment alone
_KEPT = 256
_TOGETHER = 8192  # blocks that are drawn at once for some of many environments
# Draws by name and size, or 0 for a seed, and how many blocks of random words each needs.
Asked = dict[tuple[str, int], int]
_ahead: dict[tuple[int, str, int], tuple[int, NDArray[Any]]] = {}  # seed, name, size: first, rows


@final
class Draws:
    """Random numbers of n episodes: row e depends on seeds[e], episodes[e] and a name only.

    An environment therefore draws the same numbers alone and among ten thousand, in any order.
    `seeds` are whole numbers modulo 2^64, and `episodes` count from 0; both have the shape (n,). A
    task receives such draws in its method `start`. The `name` of a draw makes it independent of
    other draws: "start", "start/2" for a second try. The same name gives the same numbers again.
    `asked` are the draws of earlier episodes, which few episodes make together.

    Example:

    >>> from uuvsim_cosim.envs import Draws
    >>> draws = Draws(seeds=[7, 7, 8], episodes=[0, 1, 0])
    >>> draws.uniform("depth", 2.0, 8.0)  # one number for each of the three episodes
    array([3.88280454, 4.29459463, 7.37899309])
    """

    def __init__(
        self, seeds: ArrayLike, episodes: ArrayLike, *, asked: Asked | None = None
    ) -> None:
        """`asked` are draws of earlier episodes, which few episodes make together: it is faster."""
        self._asked = asked
        self._drawn: dict[tuple[str, int], NDArray[Any]] = {}
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
        return Draws(self._seeds[chosen], self._episodes[chosen], asked=self._asked)

    def seeds(self, name: str = "system") -> NDArray[np.uint64]:
        """Return a seed for each episode, of shape (n,).

        With the default `name`, these are the seeds with which an environment resets its system.

        Example:

        >>> from uuvsim_cosim.envs import Draws
        >>> Draws(seeds=[7, 8], episodes=[0, 0]).seeds()
        array([12352026036946472830, 11950623533197062401], dtype=uint64)
        """
        kept = self._kept(name, 0)
        return self._numbers(self._words([name], [1]), 0) if kept is None else kept

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
        if not size:
            return np.zeros((self.n, 0))
        kept = self._kept(name, size)
        return self._numbers(self._words([name], [(size + 1) // 2]), size) if kept is None else kept

    def _numbers(self, words: Sequence[NDArray[np.uint64]], size: int) -> NDArray[Any]:
        """Return the `size` numbers in (0, 1) of each episode, or with size 0 its seed."""
        a, b, c, d = words
        if not size:
            return (a << np.uint64(32) | b)[:, 0]
        pairs = np.stack([a << np.uint64(20) | b >> np.uint64(12),
                          c << np.uint64(20) | d >> np.uint64(12)], axis=-1)  # fmt: skip
        return np.asarray((pairs.reshape(self.n, -1)[:, :size] + 0.5) * 2.0**-52)

    def _kept(self, name: str, size: int) -> NDArray[Any] | None:
        """Return `_unit`, or with size 0 `seeds`, from a cache; None where nothing is cached.

        A single environment asks for one episode after another, so the numbers of several episodes
        are drawn at once, which costs no more. A few of many environments draw all names at once.
        """
        if self._asked is not None:
            if not self._drawn and self._asked:
                self._draw(self._asked)
            self._asked[name, size] = max(1, (size + 1) // 2)
            return self._drawn.get((name, size))
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

    def _draw(self, asked: Asked) -> None:
        """Draw everything that earlier episodes asked for, unless it is much."""
        if self.n * sum(asked.values()) > _TOGETHER:
            return
        words, at = self._words([name for name, _ in asked], [*asked.values()]), 0
        for (name, size), blocks in asked.items():
            own = [w[:, at : at + blocks] for w in words]
            self._drawn[name, size] = self._numbers(own, size)
            at += blocks

    def _words(self, names: Sequence[str], blocks: Sequence[int]) -> tuple[NDArray[np.uint64], ...]:
        """Return the random words of some names, (n, blocks of all), in their order."""
        block = np.concatenate([np.arange(count, dtype=np.uint64) for count in blocks])[None, :]
        seed, episode = self._seeds[:, None], self._episodes[:, None]
        counter = (seed & WORD, seed >> 32, episode + 0 * block, block + 0 * seed)
        if len(names) == 1:
            return philox(counter, _key(names[0]))
        keys = np.array([_key(name) for name in names], np.uint64)
        first, second = np.repeat(keys, blocks, axis=0).T
        return philox(counter, (first, second))


@lru_cache(maxsize=4096)
def _key(name: str) -> tuple[int, int]:
    first, second = struct.unpack("<II", hashlib.blake2b(name.encode(), digest_size=8).digest())
    return first, second
