"""GNU Octave with the MATLAB client on its path, and the mark of tests that need it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

MATLAB = Path(__file__).parents[2] / "matlab"
OCTAVE = shutil.which("octave-cli") or shutil.which("octave")
PLAIN = ["--norc", "--no-history", "--quiet", "--no-window-system", "--eval"]
PACKAGE = (
    OCTAVE is not None
    and subprocess.run(
        [OCTAVE, *PLAIN, "pkg load instrument-control"], capture_output=True, check=False
    ).returncode
    == 0
)

NEEDS_OCTAVE = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not PACKAGE,
        reason="GNU Octave or its package instrument-control is not installed; the MATLAB client "
        "was not run (apt-get install octave octave-instrument-control)",
    ),
]


def octave(code: str) -> subprocess.Popen[str]:
    """Start Octave with the client on its path, and nothing of the user's."""
    assert OCTAVE is not None
    folders = ", ".join(f"'{MATLAB / name}'" for name in ("", "examples", "mex", "tests"))
    return subprocess.Popen(
        [OCTAVE, *PLAIN, f"addpath({folders}); {code}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def said(code: str) -> str:
    """Run code in Octave and give what it printed; it must succeed."""
    with octave(code) as process:
        words, _ = process.communicate()
    assert process.returncode == 0, words
    return words
