"""The token of a server without an access file: a secret in a file that only its user can read.

A server writes its token to ``FOLDER/PORT@MACHINE``, one file for each of its ports, with mode 0600
in a folder with mode 0700, and removes the files when it ends. Clients of the same user read the
file of the port that they connect to. On Windows the mode has no effect; there the folder is in
the user's profile, and its permissions protect the files.
"""

from __future__ import annotations

import contextlib
import hmac
import os
import re
import secrets
import socket
import stat
from pathlib import Path
from typing import final

from uuvsim_cosim.bridge.access.access_file import Access, is_loopback
from uuvsim_cosim.bridge.access.authentication import Admission, Authenticator
from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.closing import Closing, close_at_exit
from uuvsim_cosim.errors import InputInvalid

__all__ = ["TokenFile", "guarded_by_token", "known_token", "token_file", "token_folder"]

_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,200}")
_POSIX = os.name == "posix"


def token_folder() -> Path:
    """Return the folder of the user's token files; ``UUVSIM_TOKENS`` overrides it.

    Raises InputInvalid if it is not set and the user has no home directory.
    """
    import platformdirs

    named = os.environ.get("UUVSIM_TOKENS")
    state = Path(platformdirs.user_state_dir("uuvsim-cosim", appauthor=False))
    folder = Path(named).expanduser() if named else state / "tokens"
    if not folder.is_absolute():
        raise InputInvalid(
            f"token folder {folder}",
            "there is no home directory",
            (
                "the environment variable UUVSIM_TOKENS with the absolute path of "
                "a folder of your own"
            ),
        )
    return folder


def token_file(port: int) -> Path:
    """Return the file with the token of the server that listens on a port of this machine."""
    return token_folder() / f"{port}@{socket.gethostname().lower()}"


def guarded_by_token() -> Authenticator:
    """Return an `Admission` that gives the role of the owner to clients with its token.

    The token is the environment variable ``UUVSIM_TOKEN`` if that is set, else random. Raises
    InputInvalid for a token that is too short or has characters that a URL may not have.
    """
    token = os.environ.get("UUVSIM_TOKEN") or secrets.token_urlsafe(32)
    if not _TOKEN.fullmatch(token):
        raise InputInvalid(
            f"UUVSIM_TOKEN has {len(token)} characters", "16 to 200 letters, digits, _ and -"
        )
    return Authenticator(Access(token=token), place=str(token_folder()))


def known_token(host: str, port: int) -> str | None:
    """Return the token for a server, or None if this user has none for it.

    If the host is this machine, the token is in the file of the port, else in ``UUVSIM_TOKEN``.
    Raises InputInvalid for a file that other users may have read or written.
    """
    file = None
    if is_loopback(host):
        with contextlib.suppress(InputInvalid):  # no home directory: then a server has no file
            file = token_file(port)
    if file is not None:
        with contextlib.suppress(FileNotFoundError):
            return _read(file)
    return os.environ.get("UUVSIM_TOKEN") or None


@final
class TokenFile(Closing):
    """The token file of one port, from construction to `close`; no file if there is no token."""

    def __init__(self, admit: Admission | None, port: int) -> None:
        self._token = admit.access.token if isinstance(admit, Authenticator) else None
        self._process = os.getpid()
        if self._token is None:
            return
        self._file = token_file(port)
        try:
            self._file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            _refuse_others(self._file.parent, self._file.parent.lstat())
            # A new file of this user, then renamed, so that a link at its place is replaced.
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
            with (
                whole_file(self._file) as scratch,
                open(os.open(scratch, flags, 0o600), "w", encoding="ascii") as opened,
            ):
                opened.write(f"{self._token}\n")
        except OSError as error:
            raise InputInvalid(
                f"token file {self._file}",
                f"cannot be written ({error.strerror})",
                (
                    "the environment variable UUVSIM_TOKENS with a folder of your own, "
                    "or `uuvsim serve --anyone`, which requires no token"
                ),
            ) from None
        close_at_exit(self)

    def close(self) -> None:
        """Remove the file, unless another server has written its own token there."""
        token, self._token = self._token, None
        if token is None or self._process != os.getpid():  # the file is not of a forked child
            return
        with contextlib.suppress(OSError, InputInvalid):
            if hmac.compare_digest(_read(self._file), token):
                self._file.unlink()


def _read(file: Path) -> str:
    """Read a token; raises FileNotFoundError, or InputInvalid for a file that others can access."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        _refuse_others(file.parent, file.parent.lstat())
        with open(os.open(file, flags), "rb") as opened:
            _refuse_others(file, os.fstat(opened.fileno()))
            text = opened.read(256).decode("ascii", "replace").strip()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputInvalid(
            f"token file {file}", f"cannot be read ({error.strerror})", "a file of your own"
        ) from None
    if not _TOKEN.fullmatch(text):
        raise InputInvalid(f"token file {file}", "holds no token", "a file written by a server")
    return text


def _refuse_others(path: Path, found: os.stat_result) -> None:
    """Raise InputInvalid for a file or folder that other users may have read or written."""
    expected, mode = ("a folder", 0o700) if stat.S_ISDIR(found.st_mode) else ("a file", 0o600)
    if not stat.S_ISDIR(found.st_mode) and not stat.S_ISREG(found.st_mode):
        why = "it is a link or no file"
    elif not _POSIX:
        return
    elif found.st_uid != os.geteuid():
        why = f"it belongs to user {found.st_uid}"
    elif found.st_mode & 0o077:
        why = f"its mode {stat.S_IMODE(found.st_mode):o} gives other users access"
    else:
        return
    raise InputInvalid(
        path,
        f"{why}, so that a token there may be known to others",
        f"{expected} of your own with mode {mode:o}",
    )
