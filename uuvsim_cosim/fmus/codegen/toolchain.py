"""Compilation of C to a shared library by zig from PyPI, or by ``CC`` if that is set."""

from __future__ import annotations

import ctypes
import logging
import os
import platform as host_platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ToolchainError
from uuvsim_cosim.fmus.resources import refuse_unless_it_fits

__all__ = [
    "PLATFORMS",
    "WASM32",
    "Platform",
    "Signatures",
    "compile_program",
    "compile_shared",
    "compile_web_assembly",
    "compiler",
    "component_flags",
    "fmi_headers",
    "generated_sources",
    "host",
    "linked_lightly",
    "load_library",
    "platform_named",
    "refuse_to_compile",
    "windows_files",
    "zig_compiler",
]

log = logging.getLogger("uuvsim_cosim.toolchain")


@dataclass(frozen=True)
class Platform:
    """A platform to compile for, with its folder names in FMI 2.0 and FMI 3.0 archives."""

    fmi2: str
    fmi3: str
    target: str  # of zig
    suffix: str


PLATFORMS = (
    Platform("linux64", "x86_64-linux", "x86_64-linux-gnu.2.17", ".so"),
    Platform("win64", "x86_64-windows", "x86_64-windows-gnu", ".dll"),
    Platform("darwin64", "x86_64-darwin", "x86_64-macos", ".dylib"),
    Platform("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
    Platform("aarch64-darwin", "aarch64-darwin", "aarch64-macos", ".dylib"),
)
# WebAssembly, with the folder that the layered standard FMI-LS-WASM names; it has no FMI 2.0.
WASM32 = Platform("wasm32", "wasm32-wasip2", "wasm32-wasi", ".wasm")

# No FMA contraction, so that FMU, native component and kernel agree to the last bit. Debugging
# information, which zig writes unless -g0 is given, would take a quarter of the compiler's time and
# contain paths of this machine.
FLAGS = ("-std=c11", "-O2", "-g0", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden")

# Without the start-up files and the run-time library of zig, which takes seconds to compile them
# first. If a library needs more than the C library, `defs` ends the link with an error.
_LIBC_ONLY = ("-nostdlib", "-lc", "-Wl,-z,defs")
_COMPILER, _COMPILED = 1.3e8, 840  # bytes of memory: zig's, and for each byte of generated C
_WINDOWS_LIBRARIES = ("ucrtbase", "kernel32")
_ZIG_CACHES = ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")
_DIAGNOSTIC = re.compile(r":\d+:\d+: (fatal )?error: ")
_EXPECTED = "a C compiler in CC, or CC unset (then zig, which comes with this package, is used)"


def platform_named(name: str) -> Platform:
    """Find a platform by its FMI 2.0 or FMI 3.0 folder name; ``host`` is this machine's."""
    if name == "host":
        return host()
    known = (*PLATFORMS, WASM32)
    for p in known:
        if name in (p.fmi2, p.fmi3):
            return p
    raise ToolchainError(f"unknown platform {name!r}", f"one of {', '.join(p.fmi2 for p in known)}")


def component_flags(platform: Platform) -> list[str]:
    """Return the additional options of a component's library."""
    flags = ["-s"]  # the library must not contain paths of this machine
    if platform.suffix == ".so":
        # Without it, an importer that loads with RTLD_GLOBAL would mix up two components.
        flags.append("-Wl,-Bsymbolic")
    return flags


def fmi_headers() -> Path:
    """Return the folder of FMI's own headers, which come with fmpy."""
    spec = find_spec("fmpy")
    places = (spec.submodule_search_locations or []) if spec else []
    for place in places:
        folder = Path(place) / "c-code"
        if (folder / "fmi3Functions.h").is_file():
            return folder
    raise ToolchainError("FMI's C headers are missing", "them with `pip install fmpy`")


@lru_cache
def host() -> Platform:
    """Return this machine's platform."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        host_platform.machine().lower(), host_platform.machine().lower()
    )
    return platform_named(f"{machine}-{host_platform.system().lower()}")


def compiler() -> tuple[list[str], str]:
    """Return the compiler's command line, and a text that identifies it for the cache."""
    override = os.environ.get("CC", "").strip()
    if override:
        command = shlex.split(override)
        if shutil.which(command[0]) is None:
            raise ToolchainError(f"CC={override!r}", "no such program", _EXPECTED)
        return command, f"{override} {_version(tuple(command))}"
    return zig_compiler()


def zig_compiler() -> tuple[list[str], str]:
    """Return the command line of zig's C compiler, and a text that identifies it for the cache."""
    try:
        identity = f"zig {_zig()}"
    except ModuleNotFoundError:
        raise ToolchainError(
            "no C compiler",
            "the package 'ziglang' is missing",
            "`pip install ziglang`, or CC set to a C compiler",
        ) from None
    return [sys.executable, "-m", "ziglang", "cc"], identity


@lru_cache
def _zig() -> str:
    from importlib.metadata import version

    return version("ziglang")


@lru_cache
def _version(command: tuple[str, ...]) -> str:
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False)
    return (done.stdout or done.stderr).split("\n", 1)[0]


Signatures = Mapping[str, tuple[type | None, Sequence[type]]]  # result and arguments by function


def load_library(path: Path, signatures: Signatures) -> ctypes.CDLL:
    """Load a library and declare its functions."""
    c = ctypes.CDLL(str(path))
    for name, (result, arguments) in signatures.items():
        function = getattr(c, name)
        function.restype, function.argtypes = result, arguments
    return c


def generated_sources(texts: Mapping[str, str]) -> list[Path]:
    """Write generated C files, by name, into a folder of the cache; return their paths."""
    folder = cache_dir("generated", content_hash([*texts.values()]))
    for name, text in texts.items():
        if not intact(folder / name):
            keep(folder / name, text.encode())
    return [folder / name for name in texts]


def compile_shared(
    sources: Sequence[Path],
    *,
    name: str,
    platform: str = "host",
    include: Sequence[Path] = (),
    flags: Sequence[str] = (),
) -> Path:
    """Compile C files into one shared library in the cache; return its path.

    The key of the cache includes the contents of the sources and of every header in the `include`
    folders, the flags, and the compiler. Sources that many libraries share should come first: zig
    caches their objects by the name of the first source. Raises ToolchainError with the compiler's
    message.
    """
    target = platform_named(platform)
    command, identity = compiler()
    zig = "ziglang" in command
    if not zig and target is not host():
        raise ToolchainError(
            f"CC={os.environ['CC']!r} compiles for this machine only",
            f"CC unset to compile for {target.fmi2}",
        )
    arguments = [*(["-target", target.target] if zig else []), *FLAGS, *flags]
    if target.suffix != ".dll":
        arguments.append("-fPIC")
    headers = [h for folder in include for h in sorted(folder.glob("*.h"))]
    headers += windows_files() if target.suffix == ".dll" else []

    def contents() -> str:
        return content_hash(
            [name, identity, target.target, *arguments, *_LIBC_ONLY]
            + [f.name for f in sources]
            + [f.read_bytes() for f in [*sources, *headers]]
        )

    key = contents()
    library = cache_dir("compiled", key) / f"{name}{target.suffix}"
    if intact(library):
        return library
    refuse_to_compile(name, sum(f.stat().st_size for f in sources))
    log.info("compiling %s for %s", name, target.fmi2)
    with tempfile.TemporaryDirectory(dir=library.parent) as scratch:
        fresh = Path(scratch) / library.name
        includes = [f"-I{folder}" for folder in include]
        whole = [*command, *arguments, "-shared", *includes, *map(str, sources), "-o", str(fresh)]
        linked = False
        if zig and target.suffix == ".dll":
            linked = linked_lightly(command, arguments, includes, sources, Path(scratch), fresh)
        elif zig and target.suffix == ".so":
            linked = _ran([*whole, *_LIBC_ONLY]).returncode == 0
        if not linked:
            _run(whole)
        try:
            data = fresh.read_bytes()
        except FileNotFoundError:
            raise ToolchainError(
                f"the C compiler {_named(command)} reports no error, but wrote no library",
                _EXPECTED,
            ) from None
    if contents() != key:  # otherwise the cache would keep a wrong library under this key
        raise ToolchainError(
            name, "its C was changed while it was compiled", "files that do not change"
        )
    keep(library, data)
    return library


def compile_web_assembly(
    sources: Sequence[Path], *, name: str, include: Sequence[Path], flags: Sequence[str] = ()
) -> Path:
    """Compile C files into one WebAssembly module in the cache; return its path.

    Only zig compiles it, whatever ``CC`` is. Raises ToolchainError.
    """
    own = ["-target", "wasm32-wasi", *FLAGS, *flags, "-mexec-model=reactor", "-s"]
    return _compiled_by_zig(sources, f"{name}.wasm", include, own, "WebAssembly")


def compile_program(
    sources: Sequence[Path], *, name: str, target: str, include: Sequence[Path]
) -> Path:
    """Compile C files into a static program for a `target` of zig; return its path in the cache.

    Raises ToolchainError.
    """
    path = _compiled_by_zig(
        sources, name, include, ["-target", target, *FLAGS, "-static", "-s", "-w"], target
    )
    path.chmod(0o755)
    return path


def _compiled_by_zig(
    sources: Sequence[Path], name: str, include: Sequence[Path], arguments: list[str], what: str
) -> Path:
    command, identity = zig_compiler()
    headers = [h for folder in include for h in sorted(folder.glob("*.h"))]
    key = content_hash(
        [name, identity, *arguments, *(f.name for f in sources)]
        + [f.read_bytes() for f in [*sources, *headers]]
    )
    made = cache_dir("compiled", key) / name
    if intact(made):
        return made
    refuse_to_compile(name, sum(f.stat().st_size for f in sources))
    log.info("compiling %s for %s", name, what)
    with tempfile.TemporaryDirectory(dir=made.parent) as scratch:
        fresh = Path(scratch) / made.name
        includes = [f"-I{folder}" for folder in include]
        _run([*command, *arguments, *includes, *map(str, sources), "-o", str(fresh)])
        keep(made, fresh.read_bytes())
    return made


def refuse_to_compile(name: str, size: int) -> None:
    """Raise ToolchainError if `size` bytes of C need more memory for the compiler than there is."""
    refuse_unless_it_fits(
        name,
        f"the compiler for its {size / 1e6:.3g} MB of C",
        _COMPILER + _COMPILED * size,
        "fewer different components in one system, or smaller ones",
        error=ToolchainError,
    )


def _run(command: list[str]) -> None:
    """Run the compiler; raises ToolchainError with its message if it fails."""
    done = _ran(command)
    own = "ziglang" in command and not set(_ZIG_CACHES) & set(os.environ)
    if done.returncode != 0 and own and not _DIAGNOSTIC.search(done.stderr):
        # No error in the source: zig does not check the objects in its cache, which may be damaged.
        shutil.rmtree(cache_dir("zig"), ignore_errors=True)
        done = _ran(command)
    if done.returncode != 0:
        lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
        reason = (
            f": {' | '.join(lines[:6])}" if lines else f" and printed nothing; expected {_EXPECTED}"
        )
        raise ToolchainError(
            f"the C compiler {_named(command)} failed with status {done.returncode}{reason}"
        )


def _ran(command: list[str]) -> subprocess.CompletedProcess[str]:
    environment = {**{name: str(cache_dir("zig")) for name in _ZIG_CACHES}, **os.environ}
    try:
        return subprocess.run(
            command, capture_output=True, text=True, errors="replace", env=environment, check=False
        )
    except OSError as error:
        raise ToolchainError(f"{command[0]}: cannot be run ({error.strerror})") from error


def _named(command: Sequence[str]) -> str:
    return "zig" if "ziglang" in command else command[0]


def windows_files() -> list[Path]:
    """List the files that every library for Windows is linked with."""
    return sorted(content("fmus", "runtime", "windows").iterdir())


def linked_lightly(
    command: Sequence[str], arguments: Sequence[str], includes: Sequence[str],
    sources: Sequence[Path], scratch: Path, library: Path,
) -> bool:  # fmt: skip
    """Compile and link with few imports; return False if the sources need more of C.

    `command` is zig's compiler, `arguments` its target and flags, including `-l`. Errors are not
    reported: the complete compilation, which then follows, reports them.
    """
    folder = windows_files()[0].parent
    asked = [a[2:] for a in arguments if a.startswith("-l")]
    definitions = [folder / f"{name}.def" for name in (*_WINDOWS_LIBRARIES, *asked)]
    if not all(d.is_file() for d in definitions):
        return False
    plain = [a for a in arguments if not a.startswith("-l")]
    objects, imports = [], []
    for k, source in enumerate([*sources, folder / "uuv_windows.c"]):
        objects.append(str(scratch / f"{k}.obj"))
        if _ran([*command, *plain, *includes, "-c", str(source), "-o", objects[-1]]).returncode:
            return False
    zig = [*command[:-1], "dlltool"]
    for definition in definitions:
        imports.append(str(scratch / f"{definition.stem}.lib"))
        made = [*zig, "-m", "i386:x86-64", "-d", str(definition), "-l", imports[-1]]
        if _ran(made).returncode:
            return False
    link = [*command, *plain, "-shared", "-nostdlib", *objects, *imports, "-o", str(library)]
    return _ran(link).returncode == 0 and library.is_file()
