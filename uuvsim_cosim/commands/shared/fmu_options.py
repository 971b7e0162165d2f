"""Options of the commands that write FMUs: `--fmi` and `--platform`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.export.model_description import FmiVersion

__all__ = ["fmi_version", "platform_names"]


def fmi_version(number: int) -> FmiVersion:
    """Return 2 or 3; raises InputInvalid for another number."""
    if number not in (2, 3):
        raise InputInvalid(f"--fmi: {number} was read", "2 or 3")
    return 2 if number == 2 else 3


def platform_names(text: str) -> list[str]:
    """Split a list of platforms; a wrong name is refused before anything is built."""
    from uuvsim_cosim.fmus.codegen.toolchain import platform_named

    names = [p.strip() for p in text.split(",") if p.strip()]
    for name in names:
        platform_named(name)
    return names
