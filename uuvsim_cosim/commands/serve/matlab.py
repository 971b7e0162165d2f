"""`uuvsim matlab`: print the addpath line of the client for MATLAB or Octave."""

from __future__ import annotations

from uuvsim_cosim.commands.shared.terminal import line, put
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid

__all__ = ["matlab_command"]


def matlab_command() -> None:
    """Print the addpath line for MATLAB and GNU Octave; then: s = uuvsim.connect().

    It names the client, its examples, and the folder of the optional MEX client.
    """
    folder = content("matlab")
    if not (folder / "+uuvsim" / "connect.m").is_file():
        raise InputInvalid(
            folder,
            "the MATLAB client is missing",
            "the folder +uuvsim of the wheel; install uuvsim-cosim again",
        )
    folders = [
        str(part).replace("'", "''") for part in (folder, folder / "examples", folder / "mex")
    ]
    put("folders", folders)
    line("addpath(" + ", ".join(f"'{part}'" for part in folders) + ")")
