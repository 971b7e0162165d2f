"""Each component's random key is a stable hash of the system's seed and the component's path."""

from __future__ import annotations

import hashlib
import struct

__all__ = ["component_seed"]


def component_seed(seed: int, path: str) -> tuple[int, int]:
    """Give two Int32 that depend on nothing but (seed, path): not on order, process or platform."""
    digest = hashlib.blake2b(f"{seed}/{path}".encode(), digest_size=8).digest()
    first, second = struct.unpack("<ii", digest)
    return first, second
