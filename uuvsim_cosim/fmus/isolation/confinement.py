"""Sandbox of an isolated FMU: its rules, made by the parent and applied by the child.

The child applies Landlock when it starts, while it has one thread, and seccomp and the limit of
memory before it loads the library of the FMU. Children of the child inherit all of them.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, final

from uuvsim_cosim.fmus.isolation.grants import Grants
from uuvsim_cosim.fmus.isolation.landlock import restrict
from uuvsim_cosim.fmus.isolation.seccomp import filter_of, install

__all__ = ["Rules", "apply_files", "before_loading", "confine", "loads", "rules_of"]

_before_loading: list[Callable[[], None]] = []

# Files of the system that programs read, without those of its users and services.
_SYSTEM = (
    "/usr", "/lib", "/lib32", "/lib64", "/bin", "/sbin", "/nix/store", "/gnu/store",
    *(f"/etc/{n}" for n in (
        "ld.so.cache", "ld.so.conf", "ld.so.conf.d", "ld.so.preload", "alternatives", "localtime",
        "locale.alias", "nsswitch.conf", "passwd", "group", "hosts", "host.conf", "resolv.conf",
    )),
    *(f"/proc/{n}" for n in (
        "cpuinfo", "meminfo", "stat", "loadavg", "uptime", "version", "filesystems", "sys/vm",
        "sys/kernel",
    )),
    "/sys/devices/system", "/sys/kernel/mm", "/dev/zero", "/dev/random", "/dev/urandom",
)  # fmt: skip
_DEVICES = ("/dev/null", "/dev/full")
_MACHINES = ("x86_64", "aarch64")


@final
@dataclass(frozen=True)
class Rules:
    """The files that the child may read and write, and the grants of the FMU."""

    read: tuple[str, ...]
    write: tuple[str, ...]
    grants: Grants

    def to_text(self) -> str:
        """Return the rules as an argument of a command."""
        return json.dumps(asdict(self))

    @classmethod
    def of_text(cls, text: str) -> Rules:
        """Read an argument."""
        data = json.loads(text)
        grants: dict[str, Any] = data["grants"]
        for name in ("read", "files", "ports"):
            grants[name] = tuple(grants[name])
        return cls(tuple(data["read"]), tuple(data["write"]), Grants(**grants))

    def allow(self, path: str, *, write: bool, process: int = 0) -> bool:
        """Return whether the child, with this process number, may open a file by its real path."""
        roots = self.write if write else (*self.write, *self.read, f"/proc/{process}")
        return any(path == root or path.startswith(root.rstrip("/") + "/") for root in roots)


def rules_of(grants: Grants, *folders: Path) -> Rules:
    """Return the rules of an FMU that reads `folders`, and what Python and this package need."""
    from uuvsim_cosim.cache import cache_dir
    from uuvsim_cosim.content import content

    python = [sys.prefix, sys.base_prefix, sys.exec_prefix, os.path.dirname(os.__file__)]
    python += [p for p in sys.path if os.path.basename(p) in ("site-packages", "dist-packages")]
    own = [Path(__file__).parents[2], *(content(n) for n in ("models", "fmus", "orchestrator"))]
    paths: list[str | Path] = [
        *_SYSTEM,
        *python,
        *own,
        cache_dir("compiled"),
        *folders,
        *grants.read,
    ]
    real = dict.fromkeys(os.path.realpath(p) for p in paths)
    written = [os.path.realpath(p) for p in (*_DEVICES, *grants.files)]
    return Rules(tuple(real), tuple(written), grants)


def apply_files(rules: Rules) -> list[str]:
    """Limit files and TCP in this process; return a sentence for each protection left out."""
    read = (*rules.read, f"/proc/{os.getpid()}")
    grants = rules.grants
    lacking = restrict(read, rules.write, grants.ports, network=grants.network)
    threads = len(os.listdir("/proc/self/task"))
    if threads > 1:
        lacking.append(f"{threads} threads exist before Landlock, which limits only the first")
    return lacking


def confine(rules: Rules, lacking: list[str], report: socket.socket) -> None:
    """Limit system calls and memory; tell the parent what is left out, and give it the listener.

    Afterwards, this process opens files only if the parent answers.
    """
    import resource

    grants = rules.grants
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + grants.memory
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    if not grants.files:  # it can fill its output, and the memory that it shares with the parent
        resource.setrlimit(resource.RLIMIT_FSIZE, (grants.memory, grants.memory))
    listener = -1
    if os.uname().machine not in _MACHINES:
        lacking.append(f"no filter for {os.uname().machine}: sockets and processes are not refused")
    else:
        listener = _filtered(grants, lacking)
    with report:
        text = json.dumps({"lacking": lacking, "limit": limit}).encode()
        socket.send_fds(report, [text], [] if listener < 0 else [listener])
    if listener >= 0:
        os.close(listener)


def before_loading(function: Callable[[], None]) -> None:
    """Call a function once, before the first library of an FMU is loaded in this process."""
    _before_loading.append(function)


def loads() -> None:
    """Note that a library of an FMU is about to be loaded."""
    while _before_loading:
        _before_loading.pop()()


def _filtered(grants: Grants, lacking: list[str]) -> int:
    """Install the filter, with a listener if the kernel has it, else without."""
    for notify in (True, False):
        program = filter_of(
            os.getpid(),
            notify=notify,
            network=grants.network,
            ports=bool(grants.ports),
            processes=grants.processes,
        )
        try:
            return install(program, notify=notify)
        except OSError as error:
            lacking.append(
                f"seccomp cannot notify ({error.strerror}): refused accesses are not named"
                if notify
                else f"seccomp is refused ({error.strerror}): sockets and processes are not refused"
            )
    return -1
