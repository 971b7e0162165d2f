"""Linking for Windows without mingw-w64: C functions are imported from ucrtbase.dll.

Zig compiles some four hundred files of mingw-w64 before its first library for Windows is linked
(100 s of processor time); components use two dozen functions, which every Windows 10 has.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

from uuvsim_cosim.content import content

__all__ = ["linked_lightly", "windows_files"]

_ALWAYS = ("ucrtbase", "kernel32")
Ran = Callable[[list[str]], "subprocess.CompletedProcess[str]"]


def windows_files() -> list[Path]:
    """List the files that every library for Windows is linked with."""
    return sorted(content("fmus", "runtime", "windows").iterdir())


def linked_lightly(
    run: Ran, command: Sequence[str], arguments: Sequence[str], includes: Sequence[str],
    sources: Sequence[Path], scratch: Path, library: Path,
) -> bool:  # fmt: skip
    """Compile and link with few imports; return False if the sources need more of C.

    `command` is zig's compiler, `arguments` its target and flags, including `-l`. Errors are not
    reported: the complete compilation, which then follows, reports them.
    """
    folder = windows_files()[0].parent
    asked = [a[2:] for a in arguments if a.startswith("-l")]
    definitions = [folder / f"{name}.def" for name in (*_ALWAYS, *asked)]
    if not all(d.is_file() for d in definitions):
        return False
    plain = [a for a in arguments if not a.startswith("-l")]
    objects, imports = [], []
    for k, source in enumerate([*sources, folder / "uuv_windows.c"]):
        objects.append(str(scratch / f"{k}.obj"))
        if run([*command, *plain, *includes, "-c", str(source), "-o", objects[-1]]).returncode:
            return False
    zig = [*command[:-1], "dlltool"]
    for definition in definitions:
        imports.append(str(scratch / f"{definition.stem}.lib"))
        made = [*zig, "-m", "i386:x86-64", "-d", str(definition), "-l", imports[-1]]
        if run(made).returncode:
            return False
    link = [*command, *plain, "-shared", "-nostdlib", *objects, *imports, "-o", str(library)]
    return run(link).returncode == 0 and library.is_file()
