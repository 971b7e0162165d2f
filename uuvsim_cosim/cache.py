"""The user's cache: compiled objects and unpacked archives, keyed by content."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid

__all__ = ["cache_dir", "content_hash"]


def cache_dir(*parts: str) -> Path:
    """Give a folder of the cache, made if missing; ``UUVSIM_CACHE`` overrides its place."""
    import platformdirs

    root = os.environ.get("UUVSIM_CACHE") or platformdirs.user_cache_dir("uuvsim-cosim")
    folder = Path(root).expanduser().joinpath(*parts)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputInvalid(
            f"cache folder {folder}: cannot be made ({error.strerror}); "
            "set UUVSIM_CACHE to a folder that can be written"
        ) from error
    return folder


def content_hash(parts: Iterable[bytes | str]) -> str:
    """Give a short hexadecimal hash of a sequence of contents."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()
