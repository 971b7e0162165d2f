"""Random keys of components: stable hashes of the system's seed and the component's path."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.philox import WORD, philox

__all__ = ["component_seed", "component_seeds", "path_words", "seed_words"]


def component_seed(seed: int, path: str) -> tuple[int, int]:
    """Return two Int32 that depend on (seed, path) only: not on order, process or platform.

    Raises InputInvalid for a seed outside of 0 … 2^64 - 1.
    """
    first, second = component_seeds([seed], [path])[0, 0]
    return int(first), int(second)


def component_seeds(seeds: Sequence[int], paths: Sequence[str]) -> NDArray[np.int32]:
    """Return the keys of every path under every seed, of shape (seeds, paths, 2)."""
    s = seed_words(seeds)[:, None]
    p = np.array([path_words(path) for path in paths], dtype=np.uint64).reshape(-1, 2)
    first, second = (p[None, :, i] for i in (0, 1))
    words = philox((s & WORD, s >> 32, first, second), (0x75757673, 0x696D2E31))
    return np.stack(words[:2], axis=-1).astype(np.uint32).view(np.int32)


def seed_words(seeds: Sequence[int]) -> NDArray[np.uint64]:
    """Return seeds as an array; raises InputInvalid for one outside of 0 … 2^64 - 1."""
    for seed in seeds:
        if not 0 <= int(seed) < 2**64:  # it would give the same draws as its remainder
            raise InputInvalid(f"seed {seed}: expected an integer of 0 … 2^64 - 1")
    return np.array([int(seed) for seed in seeds], dtype=np.uint64)


@lru_cache(maxsize=4096)
def path_words(path: str) -> tuple[int, int]:
    """Return the part of a component's key that depends on its path."""
    first, second = struct.unpack("<II", hashlib.blake2b(path.encode(), digest_size=8).digest())
    return first, second
