"""Versions of the code on each machine: only the same code computes the same bits."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from uuvsim_cosim._version import __version__

__all__ = ["difference", "versions", "versions_of_a_node"]

ALWAYS = ("ray", "numpy", "casadi")
CONTENT = ("models", "fmus", "orchestrator")
ENDINGS = (".py", ".c", ".h", ".yaml", ".ssd", ".ssv", ".ssm")  # files that results depend on


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
    """Return the first difference of two machines as a clause; empty if they are the same."""
    wrong = [
        f"{name} {there.get(name, 'none')}; expected {here[name]}, as here"
        for name in here
        if there.get(name) != here[name]
    ]
    return wrong[0] if wrong else ""


def versions_of_a_node() -> Callable[[tuple[str, ...]], Mapping[str, str]]:
    """Return a function that reports a machine's versions.

    It is sent to the machine as code, so that it also runs on one without this package.
    """

    def report(alike: tuple[str, ...]) -> Mapping[str, str]:
        import platform as of

        try:
            from uuvsim_cosim.cluster.versions import versions as there
        except ImportError:
            return {"Python": of.python_version()}
        return there(alike)

    return report


@lru_cache(maxsize=1)
def _hash() -> str:
    """Return a hash of the package's files and content, which does not depend on their folder."""
    from uuvsim_cosim.content import content

    digest = hashlib.blake2b(digest_size=4)
    for root in (Path(__file__).parents[1], *(content(name) for name in CONTENT)):
        for file in sorted(f for ending in ENDINGS for f in root.rglob(f"*{ending}")):
            place = file.relative_to(root)
            if place.parts[0] not in ("_content", "dist"):
                digest.update(place.as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
