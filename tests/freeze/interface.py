"""Public names with their signatures, commands with their options, entry points, MATLAB's files."""

from __future__ import annotations

import inspect
import json
import re
import tomllib
from collections.abc import Iterator
from enum import Enum
from importlib import import_module
from pathlib import Path, PurePath
from typing import Any

from tests.freeze.moved import resolve

ROOT = Path(__file__).parents[2]
PACKAGES = (
    "uuvsim_cosim",
    "uuvsim_cosim.envs",
    "uuvsim_cosim.envs.tasks",
    "uuvsim_cosim.errors",
    "uuvsim_cosim.kernels",
    "uuvsim_cosim.learn",
    "uuvsim_cosim.studies",
)
_IMPORT = re.compile(r"from (uuvsim_cosim[\w.]*) import (\([^)]*\)|[^\n;`\"#)]+)")
_DOTTED = re.compile(r"\b(uuvsim_cosim(?:\.[a-z_]\w*)+)\.([A-Za-z_]\w*)")


def names() -> dict[str, Any]:
    """Return each documented name with its kind and how it is called."""
    found = {}
    for package in PACKAGES:
        module = import_module(package)
        for name in sorted(module.__all__):
            if name != "__version__":
                found[f"{package}: {name}"] = described(getattr(module, name))
    for module_name, name in sorted(documented()):
        place = f"{module_name}: {name}"
        if place not in found:
            found[place] = described(resolve(module_name, name))
    return found


def now(recorded: dict[str, Any]) -> dict[str, Any]:
    """Return what the recorded names are now, also if they moved up into their package.

    New names and new members of classes break nobody's program and are left out.
    """
    found: dict[str, Any] = {}
    for place, before in recorded.items():
        module, _, name = place.partition(": ")
        try:
            about = described(resolve(module, name))
        except LookupError as error:
            about = str(error)
        if isinstance(about, dict) and "members" in about and "members" in before:
            kept = before["members"]
            about["members"] = {k: v for k, v in about["members"].items() if k in kept}
        found[place] = about
    return found


def documented() -> set[tuple[str, str]]:
    """Return the (module, name) of every import and dotted name in pages that users read."""
    found = set()
    for text in _pages():
        for module, imported in _IMPORT.findall(text):
            for part in imported.strip("()").split(","):
                name = part.split("#")[0].split(" as ")[0].strip()
                if name.isidentifier() and name != "__version__":
                    found.add((module, name))
        found |= {(m, n) for m, n in _DOTTED.findall(text) if _is_attribute(m, n)}
    return found


def _is_attribute(module: str, name: str) -> bool:
    """Whether a dotted name is something in a module, and no module or file itself."""
    try:
        value = getattr(import_module(module), name, None)
    except ImportError:
        return False
    return value is not None and not inspect.ismodule(value)


def _pages() -> Iterator[str]:
    for pattern in ("*.md", "docs/**/*.md", "docs/**/*.py", "matlab/**/*.m", "matlab/**/*.md"):
        for path in sorted(ROOT.glob(pattern)):
            # Not pages as they were built, generated pages, or the code that generates them.
            if not {"_build", "extensions"} & {*path.parts} and path.parents[1].name != "reference":
                yield path.read_text(encoding="utf-8")
    for path in sorted(ROOT.glob("docs/*/*.ipynb")):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            yield "".join(cell["source"])
    for folder in ("fmus", "models", "orchestrator", "matlab"):
        yield (ROOT / folder / "README.md").read_text(encoding="utf-8")
    for path in sorted((ROOT / "benchmarks").glob("*.py")):  # what a user copies from it
        yield path.read_text(encoding="utf-8").split('"""')[1]


def described(value: Any) -> Any:
    """Return the kind of an object and how it is called; of a class, also its public members."""
    if inspect.isclass(value):
        members = {}
        for name in sorted(dir(value)):
            if name.startswith("_") or not _is_ours(value, name):
                continue
            member = inspect.getattr_static(value, name)
            if isinstance(member, staticmethod | classmethod):
                member = member.__func__
            members[name] = _called(member) if callable(member) else type(member).__name__
        kind = "exception" if issubclass(value, BaseException) else "class"
        return {"kind": kind, "call": _called(value), "members": members}
    if callable(value):
        return {"kind": "function", "call": _called(value)}
    return {"kind": type(value).__name__}


def _is_ours(value: type, name: str) -> bool:
    owner = next((c for c in value.__mro__ if name in vars(c)), None)
    return owner is not None and owner.__module__.startswith("uuvsim_cosim")


def _called(value: Any) -> str:
    """Return a signature without annotations, which may become more exact."""
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):
        return "(…)"
    bare = [
        p.replace(annotation=p.empty)
        if p.default is p.empty
        else p.replace(annotation=p.empty, default=_Shown(p.default))
        for p in signature.parameters.values()
    ]
    return str(signature.replace(parameters=bare, return_annotation=signature.empty))


class _Shown:
    """A default value that prints without addresses and modules."""

    def __init__(self, value: Any) -> None:
        text = getattr(value, "__name__", None) or repr(value)
        self.text = re.sub(r" at 0x[0-9a-f]+|uuvsim_cosim(\.\w+)*\.", "", text)

    def __repr__(self) -> str:
        return self.text


def signatures() -> dict[str, str]:
    """Return the full signature text of each function: for readers, not compared."""
    found = {}
    for place in names():
        module, _, name = place.partition(": ")
        value = resolve(module, name)
        if callable(value):
            try:
                found[place] = repr(_Shown(_Text(str(inspect.signature(value)))))
            except (TypeError, ValueError):
                continue
    return found


class _Text(str):
    def __repr__(self) -> str:
        return str(self)


def commands() -> dict[str, Any]:
    """Return the command line: each command with its arguments and options, by their names."""
    from uuvsim_cosim.cli import command_tree

    found: dict[str, Any] = {}

    def walk(command: Any, path: str) -> None:
        found[path] = {_spelt(p): _parameter(p) for p in command.params}
        for name, inner in getattr(command, "commands", {}).items():
            walk(inner, f"{path} {name}")

    walk(command_tree(), "uuvsim")
    return found


def _spelt(parameter: Any) -> str:
    opts = [*parameter.opts, *parameter.secondary_opts]
    return " ".join(opts) if parameter.param_type_name == "option" else str(parameter.name)


def _parameter(parameter: Any) -> dict[str, Any]:
    """Return the type, default and arity of an option or argument, without its help."""
    descriptor = parameter.type_descriptor
    annotation, info = descriptor.annotation, descriptor.parameter_info
    name = annotation.__name__ if inspect.isclass(annotation) else str(annotation)
    about: dict[str, Any] = {
        "kind": parameter.param_type_name,
        "type": str(annotation) if "[" in str(annotation) else name,
    }
    if info.parser is not None:
        about["written as"] = parameter.metavar or "text"
    if inspect.isclass(annotation) and issubclass(annotation, Enum):
        about["choices"] = [member.value for member in annotation]
    for attribute in ("min", "max"):
        if getattr(info, attribute, None) is not None:
            about[attribute] = getattr(info, attribute)
    if (default := parameter.default) is not None:
        plain = isinstance(default, bool | int | float | str | list)
        about["default"] = default if plain else repr(_Shown(default))
        if isinstance(default, PurePath):
            about["default"] = default.as_posix()
    for attribute in ("required", "multiple", "is_flag"):
        if getattr(parameter, attribute, False):
            about[attribute] = True
    if parameter.nargs != 1:
        about["nargs"] = parameter.nargs
    return about


def entry_points() -> dict[str, Any]:
    """Return the entry points of the wheel, and what each one's target is."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"scripts": project["scripts"], **project["entry-points"]}
    found: dict[str, Any] = {}
    for group, points in groups.items():
        for name, target in points.items():
            module, _, attribute = target.partition(":")
            value = getattr(import_module(module), attribute)
            found[f"{group}: {name}"] = described(value)
    found["extras"] = sorted(project["optional-dependencies"])
    found["content of the wheel"] = tomllib.loads(
        (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    )["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    return found


def content() -> dict[str, Any]:
    """Return the names that users type: systems, models, environments."""
    import gymnasium

    import uuvsim_cosim as uuv
    import uuvsim_cosim.envs
    from tests.freeze.moved import definition

    return {
        "systems": uuv.available(),
        "models": definition("available", "models")(),
        "environments": sorted(i for i in gymnasium.registry if i.startswith("uuvsim")),
    }


def matlab() -> dict[str, str]:
    """Return the first line of every file of the MATLAB client: function or class, and its call."""
    found = {}
    for path in sorted((ROOT / "matlab").rglob("*.m")):
        lines = path.read_text(encoding="utf-8").splitlines()
        first = next((x for x in lines if x.startswith(("function", "classdef"))), "script")
        found[path.relative_to(ROOT / "matlab").as_posix()] = first
    return found
