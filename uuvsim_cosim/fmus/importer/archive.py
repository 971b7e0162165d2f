"""Unpacking of an FMU or SSP archive, once, into a cache folder that is keyed by its content."""

from __future__ import annotations

import contextlib
import os
import re
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from uuvsim_cosim.cache import cache_dir, content_hash
from uuvsim_cosim.errors import FmuError

__all__ = ["shown", "unpack"]

MAX_MEMBERS = 50_000
MAX_BYTES = 4 * 1024**3
# Text is compressed 50 to 1, zeros 1000 to 1; small archives are not checked.
MAX_RATIO = 200
RATIO_MATTERS_FROM_BYTES = 64 * 1024**2
_CHUNK = 1 << 20
_DRIVE = re.compile(r"^[A-Za-z]:")


def unpack(path: Path, *, must_contain: str | None = None) -> Path:
    """Return the folder with the archive's members; unpack it if this content is new.

    `must_contain` is a required member; by default ``SystemStructure.ssd`` for .ssp, else
    ``modelDescription.xml``. Raises FmuError if the archive is missing or corrupt, if a member
    would leave its folder, or if it is much larger unpacked.
    """
    if must_contain is None:
        is_ssp = path.suffix.lower() == ".ssp"
        must_contain = "SystemStructure.ssd" if is_ssp else "modelDescription.xml"
    try:
        data = path.read_bytes()
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        read = "no such file" if missing else f"cannot be read ({error.strerror})"
        raise FmuError(shown(path), read, "an .fmu or .ssp archive") from None
    if not data.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        raise FmuError(shown(path), "not a zip archive", "an .fmu or .ssp, which are zip files")
    data_hash = content_hash([data])
    folder = cache_dir("archives") / data_hash
    _came_from[folder] = path
    try:
        with zipfile.ZipFile(path) as archive:
            members = list({m.filename: m for m in _checked(archive, path, must_contain)}.values())
            if not all(_intact(m, folder) for m in members):
                _extract(archive, members, folder, path)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, ValueError) as error:
        raise FmuError(shown(path), f"a corrupt archive ({error})", "a zip file") from error
    return folder


_came_from: dict[Path, Path] = {}


def shown(path: Path) -> str:
    """Return a file's name for the user; a file of an unpacked archive is named by the archive."""
    for folder in path.parents:
        if folder in _came_from:
            return f"{shown(_came_from[folder])}/{path.relative_to(folder).as_posix()}"
    return str(path)


def _checked(archive: zipfile.ZipFile, path: Path, must_contain: str) -> Iterator[zipfile.ZipInfo]:
    """Yield the members; raises FmuError for an archive that is not safe to unpack."""
    members = archive.infolist()
    if len(members) > MAX_MEMBERS:
        raise FmuError(shown(path), f"{len(members)} members", f"at most {MAX_MEMBERS}")
    total = sum(m.file_size for m in members)
    packed = max(path.stat().st_size, 1)
    if total > MAX_BYTES:
        raise FmuError(
            shown(path), f"an archive bomb, {total} bytes unpacked", f"at most {MAX_BYTES}"
        )
    if total > RATIO_MATTERS_FROM_BYTES and total > MAX_RATIO * packed:
        raise FmuError(
            shown(path),
            f"an archive bomb, unpacks to {total // packed} times its size",
            f"at most {MAX_RATIO} times",
        )
    for member in members:  # some tools on Windows write "\"
        member.filename = member.filename.replace("\\", "/")
    if not any(m.filename == must_contain for m in members):
        raise FmuError(shown(path), f"has no {must_contain}", "it at the top of the archive")
    for member in members:
        name = member.orig_filename.replace("\\", "/")
        outside = (
            not name
            or name.startswith("/")
            or "\0" in name
            or _DRIVE.match(name) is not None
            or ".." in PurePosixPath(name).parts
        )
        if outside:
            raise FmuError(
                shown(path),
                f"member {name!r} would leave its folder",
                "a relative name that stays in the archive's folder",
            )
        if stat.S_IFMT(member.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise FmuError(
                shown(path), f"member {name!r} is a symbolic link or a device", "files and folders"
            )
        if member.flag_bits & 0x1:
            raise FmuError(
                shown(path), f"member {name!r} is encrypted", "an archive without password"
            )
        yield member


def _extract(
    archive: zipfile.ZipFile, members: list[zipfile.ZipInfo], folder: Path, path: Path
) -> None:
    """Extract next to `folder`, then rename, so that other processes see all of it or nothing.

    A damaged folder is moved away first.
    """
    try:
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix="unpacking-") as scratch:
            fresh, damaged = Path(scratch) / "fresh", Path(scratch) / "damaged"
            fresh.mkdir()
            for member in members:
                _extract_member(archive, member, fresh, path)
            with contextlib.suppress(FileNotFoundError):
                os.rename(folder, damaged)
            try:
                os.rename(fresh, folder)
            except OSError:
                if not folder.is_dir():  # else another process has unpacked the same content
                    raise
    except OSError as error:
        raise FmuError(
            f"{shown(path)}: cannot be unpacked into {folder.parent} ({error})"
        ) from error


def _intact(member: zipfile.ZipInfo, folder: Path) -> bool:
    """Return whether the folder has a member with the content in the archive."""
    target = _target(member, folder)
    if member.is_dir():
        return target.is_dir()
    try:
        if target.stat().st_size != member.file_size:
            return False
        crc = 0
        with target.open("rb") as file:
            while chunk := file.read(_CHUNK):
                crc = zlib.crc32(chunk, crc)
    except OSError:
        return False
    return crc == member.CRC


def _target(member: zipfile.ZipInfo, folder: Path) -> Path:
    return folder.joinpath(*PurePosixPath(member.filename).parts)


def _extract_member(
    archive: zipfile.ZipFile, member: zipfile.ZipInfo, scratch: Path, path: Path
) -> None:
    target = _target(member, scratch)
    if member.is_dir():
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        with archive.open(member) as source, target.open("wb") as sink:
            remaining = member.file_size
            while chunk := source.read(_CHUNK):
                remaining -= len(chunk)
                if remaining < 0:
                    read = f"member {member.filename!r} is larger than the archive declares"
                    raise FmuError(f"{shown(path)}: {read}")
                sink.write(chunk)
    except RuntimeError as error:
        raise FmuError(f"{shown(path)}: member {member.filename!r}: {error}") from error
    if member.external_attr >> 16 & stat.S_IXUSR:
        target.chmod(0o755)
