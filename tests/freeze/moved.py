"""Definitions of the package by their name, wherever their module is now.

The freeze outlives the moves of modules. What has no documented import is found by its name and
its top package: a move needs no change here, a new name does.
"""

from __future__ import annotations

import ast
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import uuvsim_cosim

ROOT = Path(uuvsim_cosim.__file__).parent


def definition(name: str, package: str) -> Any:
    """Return the one function or class of this name in a top package; raises LookupError."""
    found = [module for module, names in _defined(package).items() if name in names]
    if len(found) != 1:
        where = ", ".join(found) or "no module"
        raise LookupError(f"{name} is defined in {where} of uuvsim_cosim.{package}; expected one")
    return getattr(import_module(found[0]), name)


@cache
def _defined(package: str) -> dict[str, set[str]]:
    defined = {}
    for file in sorted((ROOT / package).rglob("*.py")):
        module = ".".join(file.relative_to(ROOT.parent).with_suffix("").parts)
        tree = ast.parse(file.read_text(encoding="utf-8"))
        defined[module.removesuffix(".__init__")] = {
            node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)
        }
    return defined


def resolve(module: str, name: str) -> Any:
    """Return a documented name from its module, or else from the nearest package above it."""
    parts = module.split(".")
    for end in range(len(parts), 0, -1):
        try:
            return getattr(import_module(".".join(parts[:end])), name)
        except ModuleNotFoundError as error:
            if not (error.name or "").startswith("uuvsim_cosim"):
                raise
        except AttributeError:
            pass
    raise LookupError(f"`from {module} import {name}` works no more, nor from a package above it")
