"""Memory and disk space: work that needs more than there is is refused before it starts.

Estimates are rough, so that small work is never refused and a disk keeps a tenth of its space.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import shutil
from decimal import Decimal
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["available_memory", "refuse_beyond", "refuse_unless_it_fits", "resident"]

SMALL = 20e6  # bytes that are not checked


def refuse_unless_it_fits(
    place: object,
    what: str,
    wanted: float,
    expected: str,
    *,
    folder: Path | None = None,
    error: type[UuvsimError] = InputInvalid,
) -> None:
    """Raise an `error` if `what` takes more bytes than `folder` has free, or memory without it.

    `expected` is the correction. In it, "{times}" becomes the number by which the work has to be
    divided to need half of the space.
    """
    if wanted <= SMALL:
        return
    free = available_memory() if folder is None else shutil.disk_usage(folder).free
    if free is None or wanted <= (free if folder is None else 0.9 * free):
        return
    exact = Decimal(wanted)  # a number of rows may be too large for a float
    unit, state = (" of memory", "available") if folder is None else ("", "free")
    raise error(
        place,
        f"{what} would take about {exact / 10**9:.3g} GB{unit}, and {free / 1e9:.3g} GB "
        f"are {state}",
        expected.replace("{times}", f"{math.ceil(exact / Decimal(0.5 * free + 1.0))}"),
    )


def refuse_beyond(n: int, each: int, *, least: bool = False) -> None:
    """Raise InputInvalid if the memory is too small for n environments of (at `least`) `each` B."""
    available = available_memory() if n * each > SMALL else None
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
