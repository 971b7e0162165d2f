"""Each component's random key is a stable hash of the system's seed and the component's path."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.draws import WORD, philox

__all__ = ["component_seed", "component_seeds", "path_words"]


def component_seed(seed: int, path: str) -> tuple[int, int]:
    """Give two Int32 that depend on nothing but (seed, path): not on order, process or platform.

    The seed counts modulo 2^64.
    """
    first, second = component_seeds([seed], [path])[0, 0]
    return int(first), int(second)


def component_seeds(seeds: Sequence[int], paths: Sequence[str]) -> NDArray[np.int32]:
    """Give the keys of every path under every seed, of shape (seeds, paths, 2)."""
    s = np.array([int(seed) % 2**64 for seed in seeds], dtype=np.uint64)[:, None]
    p = np.array([path_words(path) for path in paths], dtype=np.uint64).reshape(-1, 2)
    first, second = (p[None, :, i] for i in (0, 1))
    words = philox((s & WORD, s >> 32, first, second), (0x75757673, 0x696D2E31))
    return np.stack(words[:2], axis=-1).astype(np.uint32).view(np.int32)


@lru_cache(maxsize=4096)
def path_words(path: str) -> tuple[int, int]:
    """Give what a path contributes to its component's key."""
    first, second = struct.unpack("<II", hashlib.blake2b(path.encode(), digest_size=8).digest())
    return first, second
