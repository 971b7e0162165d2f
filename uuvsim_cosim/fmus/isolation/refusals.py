"""Names of the accesses that the sandbox of an isolated FMU refuses; the parent's side of it.

The kernel asks the parent about each system call that the filter reports. The answer never permits
anything: a call is refused here, or goes on and is decided by Landlock or by the limit of memory.
So it does no harm if the FMU changes an argument after it was read.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import select
import socket
import struct
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, final

from uuvsim_cosim.fmus.isolation.confinement import Rules
from uuvsim_cosim.fmus.isolation.grants import size_text
from uuvsim_cosim.fmus.isolation.system_calls import GROUPS, NAMES

__all__ = ["Refusals"]

_CALL, _ANSWER = struct.Struct("=QIIiIQ6Q"), struct.Struct("=QqiI")
_RECEIVE, _SEND = 0xC0502100, 0xC0182101  # of linux/seccomp.h
_GO_ON = 1  # SECCOMP_USER_NOTIF_FLAG_CONTINUE
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_TRUNC
_PATH_ONLY = getattr(os, "O_PATH", 0)
_SOCKETS = {1: "TCP", 2: "UDP"}
_FAMILIES = {1: "Unix", 2: "", 10: "", 16: "netlink", 17: "packet"}
_MOST = 20  # different refusals that are reported


@final
class Refusals:
    """Reports each different refusal once by ``report(text)``, from a thread of its own.

    `lacking` are the protections that are left out, known once `wait_until_told` returns.
    """

    def __init__(self, component: str, rules: Rules, report: Callable[[str], None]) -> None:
        self.lacking: list[str] = []
        self.last = ""  # what was refused last
        self._component, self._rules, self._report = component, rules, report
        self._limit = 0
        self._seen: set[str] = set()
        self._told = threading.Event()
        self._ends = os.eventfd(0)
        self._socket, self.given = socket.socketpair()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def start(self) -> None:
        """Begin, once the child has `given`, its end of a pair of sockets."""
        self.given.close()
        self._thread.start()

    def wait_until_told(self) -> None:
        """Wait until the child has applied its sandbox, or has ended."""
        self._told.wait()

    def close(self) -> None:
        """End, after the child; processes that it has started get errors from then on."""
        os.eventfd_write(self._ends, 1)
        self._thread.join()
        os.close(self._ends)

    def _serve(self) -> None:
        try:
            with self._socket as pipe:
                flags = socket.MSG_CMSG_CLOEXEC
                data, descriptors, _, _ = socket.recv_fds(pipe, 1 << 16, 1, flags)
            told: dict[str, Any] = json.loads(data or '{"lacking": [], "limit": 0}')
            self.lacking, self._limit = told["lacking"], told["limit"]
        finally:
            self._told.set()
        for listener in descriptors:
            try:
                self._listen(listener)
            finally:
                os.close(listener)

    def _listen(self, listener: int) -> None:
        waits = select.poll()
        waits.register(listener, select.POLLIN)
        waits.register(self._ends, select.POLLIN)
        # Without POLLIN on the listener, no process has the filter any more.
        while waits.poll()[0] == (listener, select.POLLIN):
            call = bytearray(_CALL.size)
            try:
                fcntl.ioctl(listener, _RECEIVE, call)
            except OSError:  # the call was interrupted
                continue
            id, process, _, number, _, _, *arguments = _CALL.unpack(call)
            try:
                refused = self._examined(NAMES.get(number, f"call {number}"), process, arguments)
            except OSError:  # the caller is gone, or its memory cannot be read
                refused = NAMES.get(number) not in _LEFT_TO_KERNEL
            error, flags = (-errno.EACCES, 0) if refused else (0, _GO_ON)
            with contextlib.suppress(OSError):  # the caller is gone
                fcntl.ioctl(listener, _SEND, _ANSWER.pack(id, 0, error, flags))

    # ---- the calls ------------------------------------------------------------------------------

    def _examined(self, name: str, process: int, arguments: Sequence[int]) -> bool:
        """Report the refusal of a call, if it is one; return whether it is refused here."""
        if name in GROUPS["open"] or name in GROUPS["change"]:
            self._file(name, process, arguments)
            return False
        if name in GROUPS["memory"]:
            self._memory(name, process, arguments)
            return False
        if name == "socket":
            family, kind = arguments[0], arguments[1] & 0xF
            what = _FAMILIES.get(family, f"family {family}") or _SOCKETS.get(kind, f"type {kind}")
            self._refused(f"it tried to open a socket ({what})", "network")
        elif name in ("execve", "execveat"):
            at = 1 if name == "execveat" else 0
            program = _text(process, arguments[at])
            self._refused(f"it tried to start the program {program}", "processes")
        elif name in ("fork", "vfork", "clone"):
            self._refused("it tried to start a process", "processes")
        elif name in GROUPS["limits"]:
            self._refused(f"it tried to change its limits ({name})", "all")
        elif name in GROUPS["attributes"] and not name.startswith("f"):
            path = _path(process, arguments, name)
            self._refused(f"it tried to change attributes of {path} ({name})", "all")
        elif name in GROUPS["own"]:
            self._refused(f"it tried to send a signal to process {arguments[0]}", "all")
        else:
            self._refused(f"it tried to call {name}()", "all")
        return True

    def _file(self, name: str, process: int, arguments: Sequence[int]) -> None:
        """Report a file that Landlock is going to refuse."""
        opens = name in GROUPS["open"]
        flags = os.O_WRONLY | os.O_CREAT  # of creat
        if name in ("open", "openat"):
            flags = arguments[1 if name == "open" else 2]
        elif name == "openat2":
            flags = int.from_bytes(_read(process, arguments[2], 8), "little")
        if opens and flags & _PATH_ONLY:
            return
        path = _path(process, arguments[1:] if name.startswith("symlink") else arguments, name)
        real = os.path.realpath(path)
        exists = os.path.exists(real) if opens else os.path.lexists(path)
        makes = flags & os.O_CREAT if opens else name.startswith(("mk", "symlink"))
        if (not exists and not (makes and os.path.isdir(os.path.dirname(real)))) or (
            exists and makes and not opens
        ):
            return  # the call fails without the sandbox
        write = not opens or not exists or bool(flags & _WRITES)
        if self._rules.allow(real, write=write, process=process):
            return
        what = ("write" if write else "read") if opens else f"change ({name})"
        granted = real if exists else os.path.dirname(real)
        self._refused(f"it tried to {what} {real}", f"{'files' if write else 'read'}:{granted}")

    def _memory(self, name: str, process: int, arguments: Sequence[int]) -> None:
        """Report a piece of memory that is over the limit."""
        size = arguments[2] - arguments[1] if name == "mremap" else arguments[1]
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[0])
        used = pages * os.sysconf("SC_PAGE_SIZE")
        if self._limit and used + size > self._limit:
            memory = self._rules.grants.memory
            needed = size_text(used + size - self._limit + memory, digits=0).replace(" ", "")
            self._refused(
                f"it asked for {size_text(size)} of memory at once, and may have "
                f"{size_text(memory)}",
                f"memory:{needed}",
            )

    def _refused(self, what: str, grant: str) -> None:
        text = f"{what}, which its sandbox refuses; --grant {self._component}={grant} allows it"
        self.last = text
        # The C library asks for less memory then: that is the same refusal.
        key = "memory" if grant.startswith("memory") else text
        if key in self._seen or len(self._seen) > _MOST:
            return
        self._seen.add(key)
        if len(self._seen) > _MOST:
            text = "its sandbox refuses more, which is not listed"
        self._report(text)


_LEFT_TO_KERNEL = {*GROUPS["open"], *GROUPS["change"], *GROUPS["memory"]}


def _read(process: int, address: int, size: int) -> bytes:
    with Path(f"/proc/{process}/mem").open("rb", buffering=0) as memory:
        memory.seek(address)
        return memory.read(size)


def _text(process: int, address: int) -> str:
    """Read a text of the caller, which may end shortly before memory that cannot be read."""
    found = b""
    while address and b"\0" not in found and len(found) < 4096:
        found += _read(process, address + len(found), 256 - (address + len(found)) % 256)
    return os.fsdecode(found.partition(b"\0")[0])


def _path(process: int, arguments: Sequence[int], name: str) -> str:
    """Return the absolute path of a call's first file, links not followed."""
    in_folder = name.removesuffix("2").endswith("at")  # the first argument is its descriptor
    text = _text(process, arguments[1 if in_folder else 0])
    for own in ("/proc/self", "/proc/thread-self"):
        if text == own or text.startswith(own + "/"):
            text = f"/proc/{process}{text[len(own) :]}"
    if text.startswith("/"):
        return text
    folder = arguments[0] & 0xFFFFFFFF if in_folder else 0xFFFFFFFF
    of = "cwd" if folder >= 1 << 31 else f"fd/{folder}"
    return os.path.join(os.readlink(f"/proc/{process}/{of}"), text)
