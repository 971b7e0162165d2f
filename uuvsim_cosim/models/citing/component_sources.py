"""What a component cites: the sources of the files that it reads, and of its equations.

Files are those that the declaration reads. Equations are followed from the declaring function
through the functions and classes of `models` that it names, and their docstrings and comments are
searched for short forms of the bibliography.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from ruamel.yaml import YAML

from uuvsim_cosim.content import content
from uuvsim_cosim.models.declaration.files_read import with_files
from uuvsim_cosim.models.declaration.library import ALIASES, IN_PROCESS, LIBRARY, declare_source
from uuvsim_cosim.models.declaration.parameter_files import split_address

__all__ = ["Cited", "equations_of", "sources_in", "sources_of"]

PACKAGE = "uuvsim_cosim.models."
# Of the declaration language, only these modules hold equations that somebody published.
PUBLISHED = ("declaration.kinematics", "declaration.inertia", "declaration.philox")


@dataclass(frozen=True)
class Cited:
    """A text that names sources, and where it stands."""

    text: str
    place: str  # the file, relative to the repository if it ships
    what: str  # a preset, a parameter set, a file, or the module of equations
    is_equations: bool = False  # a docstring, which says more than its sources


def sources_of(source: str) -> list[Cited]:
    """Return what a component cites; `source` is as in a system, ``model:dvl@a50``, or a name.

    Raises InputInvalid for a name or an option that does not exist.
    """
    name = unquote(source.removeprefix("model:").partition("?")[0])
    if name in (*IN_PROCESS, *IN_PROCESS.values()):  # it solves the problem of `mpc`
        module, function = IN_PROCESS.get(name, name).split(":")
        return [*equations_of(module, function), *sources_of("model:mpc")]
    model, files = with_files(declare_source, source)
    texts = [
        cited
        for file in files
        if file.suffix in (".yaml", ".yml")
        for cited in _of_file(file, source)
    ]
    id = split_address(name)[0]
    module, function = LIBRARY.get(ALIASES.get(id, id), LIBRARY["vehicle"]).split(":")
    texts += equations_of(module, function)
    if any(clock.draws for clock in model.clocks):
        texts += equations_of(f"{PACKAGE}declaration.philox", "")
    return list(dict.fromkeys(texts))


def _of_file(file: Path, source: str) -> Iterator[Cited]:
    """Yield the sources of a parameter file; of a hull's file, those of the set that is used."""
    data = _yaml(file)
    root = content()
    place = file.relative_to(root).as_posix() if file.is_relative_to(root) else str(file)
    if not isinstance(data, Mapping):
        return
    id = str(data.get("id", file.parent.name))
    what = f"{data['kind']}@{id}" if "kind" in data else f"{id}/{file.name}"
    if "sets" in data:
        named = re.search(rf"{re.escape(id)}@([\w.-]+)|[?&]set=([\w.-]+)", unquote(source))
        chosen = next((name for name in named.groups() if name), "") if named else data["default"]
        used = data["sets"][chosen if chosen in data["sets"] else data["default"]]
        what = f"{id}@{chosen}"
        yield Cited(f"{used['citation']} ({used.get('obtained', '')})", place, what)
        data = {"size": data.get("size"), "parameters": used["parameters"]}
    for text in _stated(data):
        yield Cited(text, place, what)


def sources_in(file: Path) -> list[str]:
    """Return every source and citation that a parameter file states, of all its sets."""
    return list(dict.fromkeys(_stated(_yaml(file))))


def _yaml(file: Path) -> Any:
    return YAML(typ="safe", pure=True).load(file.read_text(encoding="utf-8"))


def _stated(data: Any) -> Iterator[str]:
    if isinstance(data, Mapping):
        for key, value in data.items():
            if key in ("source", "citation") and isinstance(value, str):
                yield " ".join(value.split())
            else:
                yield from _stated(value)
    elif isinstance(data, list):
        for value in data:
            yield from _stated(value)


# ---- equations ------------------------------------------------------------------------------


def equations_of(module: str, name: str) -> list[Cited]:
    """Return the code that a declaring function uses, and the docstrings of its modules."""
    seen: set[tuple[str, str]] = set()
    waiting = [(module, name)]
    while waiting:
        here = waiting.pop()
        if here not in seen:
            seen.add(here)
            waiting += _names_in(*here)
    # The docstring of a module that declares components is about these components alone.
    own = {*LIBRARY.values(), *IN_PROCESS.values()}
    declaring = {target.partition(":")[0] for target in own}
    seen |= {(m, "") for m, n in seen if m not in declaring or f"{m}:{n}" in own}
    return [
        Cited(text, place, place.removeprefix("uuvsim_cosim/models/"), True)
        for module, name in sorted(seen)
        for place, text in _text_of(module, name)
    ]


def _names_in(module: str, name: str) -> Iterator[tuple[str, str]]:
    """Yield (module, name) of all definitions of `models` that a definition names."""
    _, nodes, imported, _ = _parsed(module)
    for node in ast.walk(nodes[name]) if name in nodes else ():
        if isinstance(node, ast.Name) and node.id in nodes:
            yield module, node.id
        elif isinstance(node, ast.Name) and node.id in imported:
            yield imported[node.id]
        elif isinstance(node, ast.ImportFrom):
            yield from _imports(node).values()


def _text_of(module: str, name: str) -> Iterator[tuple[str, str]]:
    place, nodes, _, text = _parsed(module)
    if name in nodes:  # whole lines, as a comment behind a number names its source
        node = nodes[name]
        yield place, "\n".join(text.splitlines()[node.lineno - 1 : node.end_lineno])
    elif not name:
        yield place, ast.get_docstring(ast.parse(text)) or ""


def _imports(node: ast.ImportFrom) -> dict[str, tuple[str, str]]:
    module = node.module or ""
    kept = module.removeprefix(PACKAGE)
    if not module.startswith(PACKAGE) or (
        kept.startswith("declaration.") and kept not in PUBLISHED
    ):
        return {}
    return {alias.asname or alias.name: (module, alias.name) for alias in node.names}


@cache
def _parsed(module: str) -> tuple[str, dict[str, ast.stmt], dict[str, tuple[str, str]], str]:
    """Return a module's place, its definitions, what it imports from `models`, and its text."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return "", {}, {}, ""
    text = Path(spec.origin).read_text(encoding="utf-8")
    nodes: dict[str, ast.stmt] = {}
    imported: dict[str, tuple[str, str]] = {}
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            nodes[node.name] = node
        elif isinstance(node, ast.ImportFrom):
            imported |= _imports(node)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            nodes |= {t.id: node for t in targets if isinstance(t, ast.Name)}
    return f"{module.replace('.', '/')}.py", nodes, imported, text
