"""Results that are made from files: shared until one of the files changes.

`shared_until_changed` keeps them in the process, `kept_until_changed` also in the user's cache, for
later processes that run the same program.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import platform
import sys
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import lru_cache, wraps
from importlib.util import find_spec
from pathlib import Path
from typing import ParamSpec, TypeVar

from uuvsim_cosim.cache import cache_dir, content_hash, home, write_whole
from uuvsim_cosim.content import content
from uuvsim_cosim.models.declaration.interruption import interruptible

__all__ = [
    "Stamp",
    "kept_until_changed",
    "noted",
    "noted_result",
    "shared_until_changed",
    "stamp",
    "with_files",
]

# Modified, changed [ns] (also when a tool sets the first one back), size, inode; None: no file.
Stamp = tuple[int, int, int, int] | None
P = ParamSpec("P")
R = TypeVar("R")
_MOST = 256  # results of a function that are kept in the process
_BEGAN = time.time_ns()


@dataclass
class _Basis:
    """What a result was made from, besides its arguments and this program."""

    files: dict[Path, Stamp] = field(default_factory=dict)
    folder: str = ""  # the working folder, if a file was named by a relative path

    def holds(self) -> bool:
        """Return whether nothing has changed since."""
        return self.folder in ("", _folder()) and all(
            stamp(path) == was for path, was in self.files.items()
        )

    def add_to_outer(self) -> None:
        """Let the result in the making, if there is one, depend on the same."""
        if (outer := _reading.get()) is not None:
            outer.files.update(self.files)
            outer.folder = outer.folder or self.folder


_reading: ContextVar[_Basis | None] = ContextVar("basis of the result in the making", default=None)


def noted(path: Path) -> Path:
    """Return the path of a file that is read next: a result in the making depends on it.

    It depends on the file's folder too, for a file may appear there that was not found before.
    """
    basis = _reading.get()
    if basis is not None:
        for place in (path.absolute(), path.absolute().parent):
            basis.files.setdefault(place, stamp(place))
        if not path.is_absolute():
            basis.folder = _folder()
    return path


def noted_result(path: Path) -> Path:
    """Return the path of a file that belongs to the result in the making, such as a built file."""
    basis = _reading.get()
    if basis is not None:
        basis.files.setdefault(path.absolute(), stamp(path))
    return path


def shared_until_changed(function: Callable[P, R], *, most: int = _MOST) -> Callable[P, R]:
    """Call a function once for the same arguments, until a file that it has read changes.

    Every file that it reads must be given to `noted` first. Arguments may name files by relative
    paths, so a result holds in one working folder. An error is not kept. The last `most` results
    are.
    """
    kept: dict[object, tuple[R, _Basis]] = {}

    @wraps(function)
    def shared(*args: P.args, **kwargs: P.kwargs) -> R:
        key = (_folder(), args, tuple(kwargs.items()))
        found = kept.get(key)
        if found is None or not found[1].holds():
            with interruptible(), _noting() as basis:
                found = kept[key] = function(*args, **kwargs), basis
            for old in list(kept)[:-most]:
                kept.pop(old, None)
        found[1].add_to_outer()
        return found[0]

    return shared


def with_files(function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> tuple[R, list[Path]]:
    """Call a function; return its result and the files that it read, in order."""
    with _noting() as basis:
        result = function(*args, **kwargs)
    return result, [path for path in basis.files if path.is_file()]


def kept_until_changed(function: Callable[[str], R]) -> Callable[[str], R]:
    """Like `shared_until_changed`, and keep results in the user's cache too.

    Later processes use a kept result if the code of this package, Python, CasADi and NumPy are the
    same. It must be possible to pickle it.
    """

    @shared_until_changed
    @wraps(function)
    def kept(text: str) -> R:
        program = _program()
        if program is None:
            return function(text)
        name = f"{function.__module__}.{function.__qualname__}"
        key = content_hash([name, program, str(home()), text])  # "~" stands for the home
        file: Path | None = None
        # Whatever is wrong with the cache or a file of it, the result is computed anew.
        with contextlib.suppress(Exception):
            file = cache_dir("results") / f"{key}.pickle"
            digest, data = _own_bytes(file)
            if digest == content_hash([data]):
                result, basis = pickle.loads(data)
                if basis.holds():
                    basis.add_to_outer()
                    return result  # type: ignore[no-any-return]
        with interruptible(), _noting() as basis:  # a result that was disturbed is not kept
            result = function(text)
        basis.add_to_outer()
        if file is not None:
            with contextlib.suppress(OSError):
                data = pickle.dumps((result, basis))
                write_whole(file, content_hash([data]).encode() + b"\n" + data)
        return result

    return kept


def _own_bytes(file: Path) -> tuple[str, bytes]:
    """Return the hash that a kept file states, and its data; PermissionError if others wrote it.

    A pickle can run code, so that it has to be from this user.
    """
    user = getattr(os, "getuid", lambda: 0)()  # Windows has no user numbers
    for place in (file, file.parent):
        found = place.stat()
        if os.name == "posix" and (found.st_uid != user or found.st_mode & 0o002):
            raise PermissionError(f"{place} can be written by others")
    digest, _, data = file.read_bytes().partition(b"\n")
    return digest.decode(), data


def _folder() -> str:
    """Return the working folder; it may have been deleted."""
    try:
        return os.getcwd()
    except FileNotFoundError:
        return "(deleted)"


@contextlib.contextmanager
def _noting() -> Iterator[_Basis]:
    """Collect what the result that is made in the block depends on."""
    basis = _Basis()
    before = _reading.set(basis)
    try:
        yield basis
    finally:
        _reading.reset(before)


@lru_cache
def _program() -> str | None:
    """Return a hash of this package and of the tools that its results depend on.

    None if a file has changed since this process began: it may run the code from before, and its
    results may not be kept as those of the new code.
    """
    root = Path(__file__).parents[2]
    tools = [Path(str(found.origin)) for t in ("casadi", "numpy") if (found := find_spec(t))]
    files = []
    for top in (root, content("fmus", "runtime")):  # beside the package in a checkout
        for folder, inner, names in os.walk(top):
            inner[:] = sorted(name for name in inner if name != "__pycache__")
            files += [Path(folder, name) for name in sorted(names)]
    stamps = {file: stamp(file) for file in [*tools, *files]}
    if any(found is None or max(found[:2]) > _BEGAN for found in stamps.values()):
        return None
    return content_hash([sys.version, platform.machine(), *map(str, stamps.items())])


def stamp(path: Path) -> Stamp:
    """Return a value that is another one after any change of a file or folder."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino
