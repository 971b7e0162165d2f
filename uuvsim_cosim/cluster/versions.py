"""Machines compute the same bits only with the same code: what each has, and where two differ."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from uuvsim_cosim._version import __version__

__all__ = ["difference", "told_by_a_node", "versions"]

ALWAYS = ("ray", "numpy", "casadi")
CONTENT = ("models", "fmus", "orchestrator")
KINDS = (".py", ".c", ".h", ".yaml", ".ssd", ".ssv", ".ssm")  # files that results follow from


def versions(alike: Iterable[str] = ()) -> dict[str, str]:
    """Return versions by name: Python, uuvsim-cosim (with a hash of its files), packages."""
    found = {"Python": platform.python_version(), "uuvsim-cosim": f"{__version__} ({_hash()})"}
    for name in (*ALWAYS, *alike):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found


def difference(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """Say where two differ, in one clause; nothing where they do not."""
    wrong = [
        f"{name} {there.get(name, 'none')}; expected {here[name]}, as here"
        for name in here
        if there.get(name) != here[name]
    ]
    return wrong[0] if wrong else ""


def told_by_a_node() -> Callable[[tuple[str, ...]], Mapping[str, Any]]:
    """Return the question that a machine is asked, which it understands without this package."""

    def told(alike: tuple[str, ...]) -> Mapping[str, Any]:
        import platform as of

        try:
            from uuvsim_cosim.cluster.versions import versions as there
        except ImportError:
            return {"Python": of.python_version()}
        return there(alike)

    return told


@lru_cache(maxsize=1)
def _hash() -> str:
    """Return a hash of the package's files and content, whatever folder they are in."""
    from uuvsim_cosim.content import content

    digest = hashlib.blake2b(digest_size=4)
    for root in (Path(__file__).parents[1], *(content(name) for name in CONTENT)):
        for file in sorted(f for kind in KINDS for f in root.rglob(f"*{kind}")):
            place = file.relative_to(root)
            if place.parts[0] not in ("_content", "dist"):
                digest.update(place.as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
