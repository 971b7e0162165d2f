"""`uuvsim doctor`: versions, platform, compiler, extras and the cache, ready to paste."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from uuvsim_cosim._version import __version__
from uuvsim_cosim.commands.terminal import line, size_of
from uuvsim_cosim.errors import UuvsimError

__all__ = ["doctor_command", "findings"]

NEEDED = (
    "numpy", "scipy", "casadi", "fmpy", "ziglang", "rich", "typer", "pyarrow", "mcap",
    "ruamel.yaml", "jsonschema", "platformdirs",
)  # fmt: skip
# Each package that may be missing, and what does not work without it.
EXTRAS = {
    "pythonfmu3": "building what `uuvsim new --as pythonfmu3` writes",
    "pythonfmu": "the tests of FMI 2.0 FMUs made by another tool",
    "matplotlib": "the plots of the examples in docs/",
    "pytest": "the tests",
    "mpmath": "the tests of the runtime's own math functions",
    "sphinx": "the documentation",
}
PROBE = "double probe(double x) { return 2.0 * x; }\n"


def doctor_command() -> None:
    """Say what this installation consists of and whether its compiler works."""
    for text in findings():
        line(text)


def findings() -> list[str]:
    """Give the lines of the report; no paths but those below ~."""
    lines = [
        f"uuvsim-cosim  {__version__}",
        f"python        {platform.python_version()} ({platform.python_implementation()})",
        f"platform      {platform.system()} {platform.release()}, {platform.machine()}"
        f"{_libc()}, {os.cpu_count()} processors",
        f"compiler      {_compiler()}",
        f"cache         {_cache()}",
        "",
    ]
    for name in NEEDED:
        found = _version(name)
        lines.append(f"{name:13} {found or 'MISSING: pip install uuvsim-cosim'}")
    lines += ["", "extras: `pip install 'uuvsim-cosim[dev]'` has them all"]
    for name, cost in EXTRAS.items():
        lines.append(f"{name:13} {_version(name) or f'missing; needed for {cost}'}")
    return lines


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _libc() -> str:
    name, number = platform.libc_ver()
    return f", {name} {number}" if name else ""


def _hidden(text: str) -> str:
    """Give a text with the home and temporary folders' names left out."""
    for folder, short in ((str(Path.home()), "~"), (tempfile.gettempdir(), "<tmp>"),
                          (sys.prefix, "<python>")):  # fmt: skip
        if len(folder) > 1:
            text = text.replace(folder, short)
    return text


def _compiler() -> str:
    try:
        from uuvsim_cosim.fmus.toolchain import compiler, host

        identity = compiler()[1]
        begun = time.perf_counter()
        works = _compiles()
        took = time.perf_counter() - begun
        target = host().fmi2
    except UuvsimError as error:
        return _hidden(f"DOES NOT WORK: {error}")
    set_by = " (set by CC)" if os.environ.get("CC", "").strip() else ""
    said = f"works, {took:.1f} s" if works else "COMPILES, BUT THE RESULT IS WRONG"
    return _hidden(f"{identity}{set_by} for {target}: {said}")


def _compiles() -> bool:
    """Compile a function, load it, and look at what it gives."""
    import ctypes

    from uuvsim_cosim.fmus.toolchain import compile_shared

    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "probe.c"
        source.write_text(f"/* {time.time_ns()} */\n{PROBE}")  # never one that is compiled already
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
    from uuvsim_cosim.cache import cache_dir

    try:
        folder = cache_dir()
    except UuvsimError as error:
        return _hidden(f"DOES NOT WORK: {error}")
    set_by = ", set by UUVSIM_CACHE" if os.environ.get("UUVSIM_CACHE") else ""
    shown = _hidden(str(folder)) if not set_by else "UUVSIM_CACHE"
    return f"{shown} ({size_of(folder)}{set_by})"
