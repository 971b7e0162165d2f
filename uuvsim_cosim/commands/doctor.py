"""`uuvsim doctor`: versions, platform, compiler, extras and the cache, ready to paste."""

from __future__ import annotations

import os
import platform
import re
import sys
import time
from pathlib import Path

from uuvsim_cosim._version import __version__
from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.terminal import line, put, size_of
from uuvsim_cosim.errors import UuvsimError

__all__ = ["doctor_command", "facts", "packages"]

# Purpose of each extra of pyproject.toml, which lists the packages.
EXTRAS = {
    "rl": "`uuvsim train`, `train-offline`, export to ONNX, Minari's data sets",
    "scene": "`uuvsim terrain` of charts and grids, LAZ clouds, meshes, gridded currents",
    "sonar": "`uuvsim export` of sonar images as WebP and XTF",
    "view": "`uuvsim view`, `--view`",
    "rerun": "`uuvsim export -o FILE.rrd`",
    "hydro": "added mass of a surface in `uuvsim models import`",
    "mavlink": "ArduSub or PX4 as a component, `--mavlink`",
    "logs": "recordings in `uuvsim identify`: .tlog, .ulg, and bags of ROS",
    "ros": "`--ros2` of `uuvsim serve` and `uuvsim export`",
    "foxglove": "`--foxglove` of `uuvsim serve`",
    "sandbox": "`--isolate wasm`",
    "data": "`run.to_pandas()`, `run.to_xarray()`",
    "distributed": "`--ray`",
    "security": "`uuvsim access certificates`",
    "bench": "benchmarks against other simulators",
    "dev": "tests, documentation, other FMU tools",
}
_REQUIREMENT = re.compile(r"(?P<name>[A-Za-z0-9._-]+)")
_EXTRA = re.compile(r"extra\s*==\s*['\"]([^'\"]+)")
PROBE = "double probe(double x) { return 2.0 * x; }\n"


def doctor_command() -> None:
    """Print the versions and packages of this installation, and test its compiler."""
    found = facts()
    for name, text in found.items():
        line(f"{name:13} {text}")
    put("installation", found)
    core = packages()[""]
    line()
    for name, number in core.items():
        line(f"{name:13} {number or 'MISSING: pip install uuvsim-cosim'}")
    put("packages", core)
    line()
    line(
        "extras: install one with pip install 'uuvsim-cosim[EXTRA]'; without it, its functions "
        "are missing"
    )
    put("extras", {})
    for extra, wanted in packages().items():
        if extra:
            missing = [name for name, number in wanted.items() if number is None]
            there = ", ".join(f"{name} {number}" for name, number in wanted.items() if number)
            state = there if not missing else f"without {', '.join(missing)}"
            purpose = EXTRAS.get(extra, "")
            line(f"{extra:13} {'installed' if not missing else 'MISSING'}: {purpose} ({state})")
            entry = {"installed": not missing, "for": purpose, "packages": wanted}
            put("extras", {**answer().fields["extras"], extra: entry})


def facts() -> dict[str, str]:
    """Return version, platform, compiler and cache; paths are shown from ~ on."""
    libc = " ".join(platform.libc_ver())
    return {
        "uuvsim-cosim": __version__,
        "python": f"{platform.python_version()} ({platform.python_implementation()})",
        "platform": f"{platform.system()} {platform.release()}, {platform.machine()}"
        f"{f', {libc}' if platform.libc_ver()[0] else ''}, {os.cpu_count()} processors",
        "compiler": _compiler(),
        "cache": _cache(),
    }


def packages() -> dict[str, dict[str, str | None]]:
    """Return the packages of each extra ("": always needed) with their versions, None: missing.

    They are read from the metadata of the installed package, so the list is never out of date.
    """
    found: dict[str, dict[str, str | None]] = {"": {}}
    from importlib.metadata import PackageNotFoundError, requires, version

    try:
        wanted = requires("uuvsim-cosim") or []
    except PackageNotFoundError:  # run from a checkout that is not installed
        wanted = []
    for text in wanted:
        match = _REQUIREMENT.match(text)
        if match is None or match["name"] == "uuvsim-cosim":
            continue
        extra = _EXTRA.search(text)
        listed = found.setdefault(extra[1] if extra else "", {})
        try:
            listed[match["name"]] = version(match["name"])
        except PackageNotFoundError:
            listed[match["name"]] = None
    return found


def _hidden(text: str) -> str:
    """Return a text without the names of the home and temporary folders."""
    import tempfile

    from uuvsim_cosim.cache import home

    for folder, short in ((str(home() or ""), "~"), (tempfile.gettempdir(), "<tmp>"),
                          (sys.prefix, "<python>")):  # fmt: skip
        if len(folder) > 1:
            text = text.replace(folder, short)
    return text


def _compiler() -> str:
    try:
        from uuvsim_cosim.fmus.codegen.toolchain import compiler, host

        identity = compiler()[1]
        start = time.perf_counter()
        works = _compiles()
        took = time.perf_counter() - start
        target = host().fmi2
    except UuvsimError as error:
        return _hidden(f"DOES NOT WORK: {error}")
    set_by = " (set by CC)" if os.environ.get("CC", "").strip() else ""
    state = f"works, {took:.1f} s" if works else "COMPILES, BUT THE RESULT IS WRONG"
    return _hidden(f"{identity}{set_by} for {target}: {state}")


def _compiles() -> bool:
    """Compile a function, load it, and check its result."""
    import ctypes
    import shutil
    import tempfile

    from uuvsim_cosim.fmus.codegen.toolchain import compile_shared

    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "probe.c"
        source.write_text(f"/* {time.time_ns()} */\n{PROBE}")  # never in the cache
        library = compile_shared([source], name="probe", flags=["-fvisibility=default"])
        try:
            probe = ctypes.CDLL(str(library)).probe
            probe.argtypes, probe.restype = [ctypes.c_double], ctypes.c_double
            return bool(probe(21.0) == 42.0)
        except (OSError, AttributeError):
            return False
        finally:
            shutil.rmtree(library.parent, ignore_errors=True)


def _cache() -> str:
    from uuvsim_cosim.cache import cache_dir, home

    try:
        folder = cache_dir()
    except UuvsimError as error:
        return _hidden(f"DOES NOT WORK: {error}")
    set_by = ", set by UUVSIM_CACHE" if os.environ.get("UUVSIM_CACHE") else ""
    set_by += "" if home() else ", because there is no home folder"
    shown = _hidden(str(folder)) if not os.environ.get("UUVSIM_CACHE") else "UUVSIM_CACHE"
    return f"{shown} ({size_of(folder)}{set_by})"
