"""The fake autopilot, compiled once by the project's own compiler."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


def compiled(binary: Path) -> Path:
    """Compile the fake autopilot."""
    source = Path(__file__).parent / "fake_ardusub.c"
    subprocess.run(
        [sys.executable, "-m", "ziglang", "cc", "-O1", "-Wall", "-Wextra", "-Werror",
         "-o", str(binary), str(source)], check=True,
    )  # fmt: skip
    return binary


@pytest.fixture(scope="session")
def fake(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("fake") / "ardusub")
