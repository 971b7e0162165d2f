"""Checks of `--out`: a folder must not be named like a file that the command cannot write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from uuvsim_cosim.errors import InputInvalid

__all__ = ["expect_folder", "folder_option"]

_OF_FILES = """
    avi bag csv db3 doc docx fmu gif h5 hdf5 htm html jpeg jpg json laz mat mcap md mkv mov mp4 npy
    npz onnx parquet pdf png pt pth py rrd ssd ssp svg tif tiff toml txt webm xls xlsx xml yaml yml
    zip
""".split()  # noqa: SIM905


def folder_option(help: str) -> Any:
    """Return the option `--out` of a command that writes a folder."""

    def checked(out: Path | None) -> Path | None:
        if out is not None:
            expect_folder(out)
        return out

    return typer.Option("--out", "-o", callback=checked, help=help)


def expect_folder(out: Path, *files: str) -> None:
    """Raise InputInvalid for a file, or its name (``run.csv``), but for the endings `files`."""
    ending = out.suffix.lower()
    if ending in files or out.is_dir():
        return
    wanted = ", ".join((*files, "or the name of a folder" if files else "the name of a folder"))
    if out.exists():
        raise InputInvalid(f"--out {out}: is a file", wanted)
    if ending[1:] in _OF_FILES:
        raise InputInvalid(f"--out {out}: ending {out.suffix!r} was read", wanted)
