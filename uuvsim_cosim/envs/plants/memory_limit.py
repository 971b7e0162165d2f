"""Limit of the number of environments by the memory of the machine."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid

__all__ = ["LEAST_MASTER", "available_memory", "refuse_beyond", "resident"]

LEAST_MASTER = 2048  # bytes of a component in a master; most take more


def refuse_beyond(n: int, each: int, *, least: bool = False) -> None:
    """Raise InputInvalid if n environments of `each` bytes (or at `least`) do not fit."""
    available = available_memory()
    if available is not None and n * each > available:
        size = f"{'at least ' if least else ''}{each} bytes"
        need = f"need {n * each / 1e9:.3g} GB, where {available / 1e9:.3g} GB are available"
        raise InputInvalid(f"{n} environments of {size} {need}", f"at most {available // each}")


def available_memory() -> int | None:
    """Return the bytes that may still be used, by the system and by its control group, if known."""
    found = []
    with contextlib.suppress(OSError):
        text = Path("/proc/meminfo").read_text()
        if match := re.search(r"MemAvailable:\s*(\d+) kB", text):
            found.append(int(match[1]) * 1024)
    with contextlib.suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        most = int((group / "memory.max").read_text())  # "max" where there is no limit
        used = int((group / "memory.current").read_text())
        cached = re.search(r"^inactive_file (\d+)", (group / "memory.stat").read_text(), re.M)
        found.append(max(most - used + (int(cached[1]) if cached else 0), 0))
    return min(found, default=None)


def resident() -> int | None:
    """Return the bytes of memory that this process has, if known."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None
