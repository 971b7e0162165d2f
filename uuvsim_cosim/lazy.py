"""Names that are imported on first use: of a package that loads fast, or of a higher layer."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

__all__ = ["by_name", "lazy"]


def lazy(
    package: str, homes: Mapping[str, str]
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package.

    `homes` maps each name to the module that defines it, relative to the package.
    """

    def getattr_(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{homes[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    def dir_() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return getattr_, dir_


def by_name(name: str) -> Any:
    """Return an object by ``package.module:name``, relative to `uuvsim_cosim`.

    The few calls of a higher layer go through this: formats of systems, displays in notebooks.
    """
    module, _, attribute = name.partition(":")
    return getattr(import_module(f"uuvsim_cosim.{module}"), attribute)
