"""The user's cache: compiled objects and unpacked archives, keyed by content, never trusted."""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from uuid import uuid4

from uuvsim_cosim.errors import InputInvalid

__all__ = [
    "cache_dir",
    "content_hash",
    "home",
    "intact",
    "keep",
    "whole_file",
    "write_whole",
    "written",
]


def home() -> Path | None:
    """Return the user's home folder; None without HOME and entry in passwd, as in containers."""
    try:
        return Path.home()
    except RuntimeError:
        return None


def cache_dir(*parts: str) -> Path:
    """Return a folder of the cache, made if missing; ``UUVSIM_CACHE`` overrides its place.

    Without a home folder it is in the folder for temporary files, writable by this user only.
    """
    import platformdirs

    asked = os.environ.get("UUVSIM_CACHE")
    try:
        root = Path(asked or platformdirs.user_cache_dir("uuvsim-cosim")).expanduser()
    except RuntimeError:  # no home folder
        if asked:
            raise InputInvalid(
                f"UUVSIM_CACHE={asked}", "there is no home folder", "a path without ~"
            ) from None
        root = _private_folder()
    folder = root.joinpath(*parts)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _refused(f"cache folder {folder}: cannot be made", error) from error
    return folder


def _refused(problem: str, error: OSError) -> InputInvalid:
    return InputInvalid(
        f"{problem} ({error.strerror}); set UUVSIM_CACHE to a folder that can be written"
    )


def _private_folder() -> Path:
    """Return a temporary folder that only this user can write, since code is loaded from it."""
    user = getattr(os, "getuid", lambda: 0)()  # Windows has no user numbers
    folder = Path(tempfile.gettempdir()) / f"uuvsim-cosim-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise _refused(f"cache folder {folder}: cannot be made", error) from error
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != user or found.st_mode & 0o022:
        raise InputInvalid(
            f"cache folder {folder}: others can write it; set UUVSIM_CACHE to a folder of your own"
        )
    return folder


def content_hash(parts: Iterable[bytes | str]) -> str:
    """Return a short hexadecimal hash of a sequence of contents."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path` to write to; then rename it to `path`.

    Readers see the old file or the whole new one. If the body raises, the old file stays. The data
    is on the disk before the rename: else a power failure could leave an empty file. A device
    or a pipe (`/dev/null`, `/dev/stdout`) is written to and never replaced. A link is replaced and
    not followed: in the place of a token's file it could lead anywhere.
    """
    is_special = path.exists() and not path.is_file() and not path.is_symlink()
    if is_special or str(path.parent) in ("/dev", "/dev/fd"):
        yield path
        return
    scratch = path.with_name(f".{path.stem}.{uuid4().hex}{path.suffix}")
    try:
        yield scratch
        with scratch.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(scratch, path)
    finally:
        with contextlib.suppress(OSError):
            scratch.unlink()


def write_whole(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all; raises OSError."""
    with whole_file(path) as scratch:
        scratch.write_bytes(data)


def written(path: Path, text: str, *, make_folder: bool = False) -> Path:
    """Write a text file, whole or not at all, and return its path; raises InputInvalid."""
    try:
        if make_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text.encode())
    except OSError as error:
        raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None
    return path


def keep(path: Path, data: bytes) -> None:
    """Write a file of the cache, and a file with its hash for `intact`."""
    try:
        write_whole(path, data)
        write_whole(_note(path), content_hash([data]).encode())
    except OSError as error:
        raise _refused(f"cache file {path}: cannot be written", error) from error


def intact(path: Path) -> bool:
    """Return whether a file of the cache is unchanged since `keep` wrote it."""
    try:
        return _note(path).read_bytes() == content_hash([path.read_bytes()]).encode()
    except OSError:
        return False


def _note(path: Path) -> Path:
    return path.with_name(f"{path.name}.hash")
