"""The fake autopilots: ArduSub in C, compiled once by the project's own compiler, and PX4."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import pytest

from uuvsim_cosim.errors import InputInvalid

L = TypeVar("L")


def at_free_instance(link: Callable[[int], L]) -> L:
    """Return a link of an instance whose ports no other test has now."""
    for instance in range(20, 39):  # `auto` takes lower ones
        with suppress(InputInvalid):
            return link(instance)
    return link(39)


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


@pytest.fixture(scope="session")
def px4(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder like a build of PX4, with a PX4 end in Python as its binary."""
    build = tmp_path_factory.mktemp("px4_sitl_default")
    airframes = build / "etc" / "init.d-posix" / "airframes"
    airframes.mkdir(parents=True)
    (airframes / "60002_gz_uuv_bluerov2_heavy").touch()
    (airframes.parent / "rcS").touch()
    (build / "bin").mkdir()
    code = (Path(__file__).parent / "fake_px4.py").read_text(encoding="utf-8")
    (build / "bin" / "px4").write_text(f"#!{sys.executable} -IS\n{code}", encoding="utf-8")
    (build / "bin" / "px4").chmod(0o755)
    return build
