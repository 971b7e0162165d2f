"""The libraries that the reader of a page does not have: those of extras that it does not name.

A page names an extra by `uuvsim-cosim[rl]`, `.[rl]` or "extra `rl`", and any other package by
`pip install PACKAGE`. The extra `dev` does not count: it is for work on this project.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
IN_BRACKETS = re.compile(r"(?:uuvsim-cosim|[\s'\"]\.)\[([\w, ]+)\]")
IN_WORDS = re.compile(r"\bextras?((?:,?\s+(?:and\s+|or\s+)?`\w+`)+)")
INSTALLED = re.compile(r"\bpip install ([^`\n#&)]+)")
# Python imports this file at its start. The libraries are then absent as if they had not been
# installed: `import` fails, and `find_spec` and `importlib.metadata` do not find them.
SITE = """
import re
import sys
from importlib.machinery import PathFinder

MODULES = {modules}
PACKAGES = {packages}


class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if path is None and name in MODULES:  # a module of that name elsewhere is not meant
            path = [x for x in sys.path if not x.endswith("-packages")]
        return super().find_spec(name, path, target)

    @staticmethod
    def find_distributions(context, **more):
        for found in PathFinder.find_distributions(context, **more):
            name = re.sub(r"[-_.]+", "-", str(found.name)).lower()
            if name not in PACKAGES:  # else its plugins would be looked for
                yield found


sys.meta_path[:] = [Finder if x is PathFinder else x for x in sys.meta_path]
"""


def named(page: str) -> set[str]:
    """Return what a page's reader installs, as requirements."""
    extras = {x.strip() for found in IN_BRACKETS.findall(page) for x in found.split(",")}
    extras |= {x for found in IN_WORDS.findall(page) for x in re.findall(r"`(\w+)`", found)}
    assert extras <= EXTRAS.keys(), (
        f"{extras - EXTRAS.keys()}: no such extra; there are {[*EXTRAS]}"
    )
    words = {x.strip("'\"") for found in INSTALLED.findall(page) for x in found.split()}
    return {f"uuvsim-cosim[{','.join(sorted(extras - {'dev'}))}]", *filter(_is_a_package, words)}


def hidden(page: str) -> tuple[set[str], set[str]]:
    """Return the top-level modules, and the packages, that the reader of a page does not have."""
    packages = _needed({f"uuvsim-cosim[{','.join(EXTRAS)}]"}) - _needed(named(page))
    modules = {
        module
        for module, providers in _modules().items()
        if {canonicalize_name(x) for x in providers} <= packages
    }
    return modules, packages


def write_site(folder: Path, page: str) -> None:
    """Write the `sitecustomize.py` that hides these libraries from Python with this PYTHONPATH."""
    modules, packages = hidden(page)
    text = SITE.format(modules=sorted(modules), packages=sorted(packages))
    (folder / "sitecustomize.py").write_text(text, encoding="utf-8")


def _is_a_package(word: str) -> bool:
    try:
        return canonicalize_name(Requirement(word).name) != "uuvsim-cosim"
    except InvalidRequirement:  # an option, a path
        return False


def _needed(wanted: Iterable[str]) -> set[str]:
    """Return the packages that requirements bring, those that they need included."""
    todo = [Requirement(x) for x in wanted]
    found: set[tuple[str, str]] = set()
    while todo:
        requirement = todo.pop()
        name = canonicalize_name(requirement.name)
        for extra in {"", *requirement.extras} - {x for n, x in found if n == name}:
            found.add((name, extra))
            todo += [
                x
                for x in _requirements(name)
                if x.marker is None or x.marker.evaluate({"extra": extra})
            ]
    return {name for name, _ in found}


@cache
def _requirements(package: str) -> list[Requirement]:
    if package == "uuvsim-cosim":  # as it is now, not as it was when it was installed
        of_extras = [f"{x}; extra == '{extra}'" for extra in EXTRAS for x in EXTRAS[extra]]
        return [Requirement(x) for x in (*PROJECT["dependencies"], *of_extras)]
    try:
        return [Requirement(x) for x in requires(package) or []]
    except PackageNotFoundError:
        return []


_modules = cache(packages_distributions)
