"""Landlock: the kernel's limits on files, TCP ports and signals of this thread and its successors.

It must be applied while the process has one thread, as older kernels limit the calling thread only.
This module imports no other package, because such imports may start threads.
"""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Iterable

__all__ = ["abi", "restrict"]

# Numbers of the system calls, the same on x86_64 and aarch64.
_CREATE, _ADD, _RESTRICT = 444, 445, 446
_NO_NEW_PRIVILEGES = 38
# Rights on files, by the bits of linux/landlock.h.
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 1 << 1, 1 << 2, 1 << 3
_TRUNCATE, _IOCTL_DEVICE = 1 << 14, 1 << 15
_OF_FILES = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _IOCTL_DEVICE
_READ = _EXECUTE | _READ_FILE | _READ_DIR
_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}  # the number of rights on files, by ABI; later 16
_TCP = 0b11  # bind and connect
_ABSTRACT_SOCKETS, _SIGNALS = 1, 2
_BENEATH, _PORT = 1, 2  # kinds of rules


def abi() -> int:
    """Return the version of the kernel's interface; 0 if it has none."""
    if sys.platform != "linux":
        return 0
    version: int = ctypes.CDLL(None).syscall(_CREATE, None, 0, 1)
    return max(0, version)


def restrict(
    read: Iterable[str], write: Iterable[str], ports: Iterable[int], *, network: bool
) -> list[str]:
    """Limit this thread to these files, and TCP to `ports` without `network`.

    Paths that do not exist are left out. Returns one sentence for each protection that the kernel
    lacks.
    """
    version = abi()
    if version == 0:
        return ["this kernel has no Landlock: files are not protected"]
    c = ctypes.CDLL(None, use_errno=True)
    files = (1 << _RIGHTS.get(version, 16)) - 1
    tcp = _TCP if version >= 4 and not network else 0
    scope = (_SIGNALS | (0 if network else _ABSTRACT_SOCKETS)) if version >= 6 else 0
    handled = struct.pack("=QQQ", files, tcp, scope)[
        : 8 if version < 4 else 16 if version < 6 else 24
    ]
    rules = c.syscall(_CREATE, handled, len(handled), 0)
    if rules < 0:
        return [f"Landlock is refused ({_error()}): files are not protected"]
    for paths, rights in ((read, _READ), (write, files)):
        for path in paths:
            _allow(c, rules, path, rights & files)
    if tcp:
        for port in ports:
            c.syscall(_ADD, rules, _PORT, struct.pack("=QQ", _TCP, port), 0)
    c.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    done = c.syscall(_RESTRICT, rules, 0)
    os.close(rules)
    if done < 0:
        return [f"Landlock is refused ({_error()}): files are not protected"]
    lacking = []
    if version < 3:
        lacking.append("this kernel's Landlock is older than 6.2: files can be cut to length 0")
    if version < 4 and tuple(ports):
        lacking.append("this kernel's Landlock is older than 6.7: TCP is granted with any port")
    return lacking


def _allow(c: ctypes.CDLL, rules: int, path: str, rights: int) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    rights &= -1 if os.path.isdir(path) else _OF_FILES
    c.syscall(_ADD, rules, _BENEATH, struct.pack("=Qi", rights, place), 0)
    os.close(place)


def _error() -> str:
    return os.strerror(ctypes.get_errno())
