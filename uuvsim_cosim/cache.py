"""The user's cache: compiled objects and unpacked archives, keyed by content, never trusted."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from uuid import uuid4

from uuvsim_cosim.errors import InputInvalid

__all__ = ["cache_dir", "content_hash", "intact", "keep", "write_whole"]


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


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under a name of its own, then rename: others see all of it or nothing."""
    scratch = path.with_name(f".{path.name}.{uuid4().hex}")
    try:
        scratch.write_bytes(data)
        os.replace(scratch, path)
    except BaseException:
        with contextlib.suppress(OSError):
            scratch.unlink()
        raise


def keep(path: Path, data: bytes) -> None:
    """Write a file of the cache, and beside it a note by which `intact` knows it again."""
    try:
        write_whole(path, data)
        write_whole(_note(path), content_hash([data]).encode())
    except OSError as error:
        raise InputInvalid(
            f"cache file {path}: cannot be written ({error.strerror}); "
            "set UUVSIM_CACHE to a folder that can be written"
        ) from error


def intact(path: Path) -> bool:
    """Say whether a file of the cache is there as `keep` wrote it."""
    try:
        return _note(path).read_bytes() == content_hash([path.read_bytes()]).encode()
    except OSError:
        return False


def _note(path: Path) -> Path:
    return path.with_name(f"{path.name}.hash")
