"""The C runtime of components, `fmus/runtime`: its folders and files.

Includes name a file without its folder, because in the sources of an FMU all files are in one.
"""

from __future__ import annotations

from pathlib import Path

from uuvsim_cosim.content import content

__all__ = ["runtime", "runtime_file", "runtime_files"]

FOLDERS = ("component", "fmi", "intrinsics", "math", "worlds")


def runtime() -> list[Path]:
    """Return the folders of the C runtime: all of them are include folders."""
    return [content("fmus", "runtime", folder) for folder in FOLDERS]


def runtime_files() -> list[Path]:
    """List the C files and headers in the order of their names, on which tokens depend."""
    files = (f for folder in runtime() for f in folder.glob("*.[ch]"))
    return sorted(files, key=lambda f: f.name)


def runtime_file(name: str) -> Path:
    """Return a file of the C runtime by its name; KeyError if there is none."""
    return {f.name: f for f in runtime_files()}[name]
