"""Measure the code base: `python .ci/measure.py [--json] [FOLDER]`.

It reads the files of `uuvsim_cosim/` (or FOLDER) with Python's own parser and imports nothing. Each
measure is defined here, so that a number means the same today and later.

`lines`
    Lines of Python files, by top package, comments and empty lines included. Files are those below
    `uuvsim_cosim/` that end in `.py`, generated content excluded.
`folders`
    Folders with more than 25 entries (files and folders, without `__pycache__` and what git
    ignores), in the whole repository. Folders that hold lists of data are counted too and are
    marked: more than half of their entries are neither Python nor Markdown nor C.
`functions`, `single-use helpers`
    All functions and methods, those inside of functions included. A helper is a function of a
    module or a class whose name begins with one underscore. It has a single use if its name occurs
    once in its module beside its definition, and in no other module's import of this module.
    Methods count by `self._name` and `cls._name`, and any other `x._name` of the module.
`imports inside functions`
    Import statements in a function's body (of methods and inner functions too). `own` import this
    package; those of `commands` keep `uuvsim --help` fast and are counted apart. `extras` import an
    optional dependency, `start-up` any other library, whose cost is saved at start-up. Imports in
    `if TYPE_CHECKING:` are not counted.
`import cycles`
    Strongly connected components with more than one module. An edge leads from a module to each
    module of this package that it imports at its top or in a function. `from package import name`
    leads to the module `package.name` if it exists, else to `package`; importing a module does not
    count as importing the packages around it. The second count adds the imports in
    `if TYPE_CHECKING:`, which are never run.
`Any per thousand lines`
    Occurrences of the name `Any` in code (annotations, aliases, casts), without the imports of it,
    for each thousand `lines`. Text in quotes and comments does not count, except annotations in
    quotes.
`comments per thousand lines`
    Lines that hold a comment, alone or behind code, for each thousand `lines`. `# noqa`, `# type:`,
    `# fmt:` and `#!` are none.
`docstrings`, `docstrings that begin with "Give"`
    Docstrings of modules, classes and functions; the first word is `Give` or `Gives`.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import re
import subprocess
import sys
import tokenize
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
MOST = 25  # entries of a folder
Function = ast.FunctionDef | ast.AsyncFunctionDef
IGNORED = re.compile(r"#\s*(noqa|type:|fmt:|!)")


@dataclass(frozen=True)
class Module:
    """A parsed file, and its name as it is imported."""

    name: str
    path: Path
    text: str
    tree: ast.Module

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """All nodes of the tree."""
        return list(ast.walk(self.tree))

    @property
    def is_package(self) -> bool:
        """Whether it is the `__init__.py` of a package."""
        return self.path.name == "__init__.py"


def modules(folder: Path) -> list[Module]:
    """Return the parsed modules below a package's folder."""
    found = []
    for path in sorted(folder.rglob("*.py")):
        parts = list(path.relative_to(folder.parent).with_suffix("").parts)
        if "_content" in parts:
            continue
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        text = path.read_text(encoding="utf-8")
        found.append(Module(name, path, text, ast.parse(text)))
    return found


# ---- lines, folders -------------------------------------------------------------------------


def lines_by_package(found: list[Module]) -> dict[str, int]:
    """Return the lines of each top package, and of the modules beside them."""
    counted: Counter[str] = Counter()
    for m in found:
        parts = m.name.split(".")
        is_in_package = len(parts) > 2 or (len(parts) == 2 and m.is_package)
        counted[parts[1] if is_in_package else "(top)"] += len(m.text.splitlines())
    return dict(sorted(counted.items()))


def large_folders(root: Path) -> dict[str, dict[str, Any]]:
    """Return folders of the repository with more than `MOST` entries."""
    command = ["git", "-C", str(root), "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    entries: dict[str, set[str]] = defaultdict(set)
    for file in listed.splitlines():
        parts = file.split("/")
        for i in range(len(parts)):
            entries["/".join(parts[:i]) or "."].add(parts[i])
    found = {}
    for folder, names in sorted(entries.items(), key=lambda e: -len(e[1])):
        if len(names) > MOST:
            code = sum(Path(n).suffix in (".py", ".md", ".c", ".h", ".m") for n in names)
            found[folder] = {"entries": len(names), "data": code < len(names) / 2}
    return found


# ---- functions ------------------------------------------------------------------------------


def functions(m: Module) -> list[ast.AST]:
    """Return all functions and methods."""
    return [n for n in m.nodes if isinstance(n, Function)]


def single_use_helpers(found: list[Module]) -> list[str]:
    """Return private functions and methods that are used once."""
    imported = {
        (target, alias.name)
        for m in found
        for node in m.nodes
        if isinstance(node, ast.ImportFrom)
        for target in [_absolute(m, node)]
        for alias in node.names
    }
    helpers = []
    for m in found:
        uses: Counter[str] = Counter()
        for node in m.nodes:
            if isinstance(node, ast.Name):
                uses[node.id] += 1
            elif isinstance(node, ast.Attribute):
                uses[node.attr] += 1
        for owner in [m.tree, *(n for n in m.nodes if isinstance(n, ast.ClassDef))]:
            for f in owner.body:
                private = isinstance(f, Function) and re.match(r"_[^_]", f.name)
                if private and uses[f.name] == 1 and (m.name, f.name) not in imported:
                    helpers.append(f"{m.name}.{f.name}")
    return helpers


def docstrings(found: list[Module]) -> list[str]:
    """Return all docstrings."""
    kinds = ast.Module | ast.ClassDef | Function
    nodes = (n for m in found for n in m.nodes if isinstance(n, kinds))
    return [d for d in map(ast.get_docstring, nodes) if d]


# ---- imports --------------------------------------------------------------------------------


def _absolute(m: Module, node: ast.ImportFrom) -> str:
    if not node.level:
        return node.module or ""
    parts = m.name.split(".") if m.is_package else m.name.split(".")[:-1]
    base = parts[: len(parts) - node.level + 1]
    return ".".join([*base, *([node.module] if node.module else [])])


def imports(m: Module) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Yield the imports that are run, and whether each is inside a function."""

    def walk(node: ast.AST, inside: bool) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import | ast.ImportFrom):
                yield child, inside
            elif isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                for other in child.orelse:
                    yield from walk(other, inside)
            else:
                yield from walk(child, inside or isinstance(child, Function | ast.Lambda))

    return walk(m.tree, False)


def graph(found: list[Module], *, types: bool = False) -> dict[str, set[str]]:
    """Return the modules of this package that each module imports, at its top or in functions.

    With `types`, also those that it imports for type checkers only.
    """
    known = {m.name for m in found}
    edges: dict[str, set[str]] = {m.name: set() for m in found}
    for m in found:
        every = [n for n in m.nodes if isinstance(n, ast.Import | ast.ImportFrom)]
        for node in every if types else [n for n, _ in imports(m)]:
            if isinstance(node, ast.Import):
                targets = [alias.name for alias in node.names]
            else:
                base = _absolute(m, node)
                full = [f"{base}.{alias.name}" for alias in node.names]
                targets = [name if name in known else base for name in full]
            edges[m.name] |= {t for t in targets if t in known and t != m.name}
    return edges


def cycles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Return strongly connected components of more than one module, the largest first (Tarjan)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(edges[name]):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            cut = stack.index(name)
            if len(stack) - cut > 1:
                found.append(sorted(stack[cut:]))
            del stack[cut:]

    sys.setrecursionlimit(10_000)
    for name in edges:
        if name not in index:
            visit(name)
    return sorted(found, key=len, reverse=True)


# Import names that differ from their distribution's name.
_IMPORTED_AS = {"eclipse-zenoh": "zenoh", "ruamel.yaml": "ruamel", "fmu-manipulation-toolbox":
                "fmu_manipulation_toolbox", "pillow": "PIL",
                "rerun-sdk": "rerun", "stable-baselines3": "stable_baselines3"}  # fmt: skip


def extras(root: Path) -> dict[str, set[str]]:
    """Return the import names that each extra of the wheel brings."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    plain = {re.split(r"[\[><=~ ]", d)[0] for d in project["dependencies"]}
    found: dict[str, set[str]] = {}
    for extra, needed in project["optional-dependencies"].items():
        names = {re.split(r"[\[><=~ ]", d)[0] for d in needed} - plain
        found[extra] = {_IMPORTED_AS.get(n, n.replace("-", "_")) for n in names}
    return found


def inside_functions(found: list[Module], root: Path) -> dict[str, Any]:
    """Count imports inside functions by what they import."""
    optional = {name: extra for extra, names in extras(root).items() for name in names}
    kinds: Counter[str] = Counter()
    by_extra: Counter[str] = Counter()
    own = found[0].name.split(".")[0]
    for m in found:
        for node, inside in imports(m):
            if not inside:
                continue
            relative = isinstance(node, ast.ImportFrom) and node.level > 0
            name = node.names[0].name if isinstance(node, ast.Import) else node.module or ""
            top = own if relative else name.split(".")[0]
            if top == own:
                kinds["own, in commands" if ".commands." in m.name else "own"] += 1
            elif top in optional:
                kinds["extras"] += 1
                by_extra[f"{optional[top]}: {top}"] += 1
            else:
                library = top not in sys.stdlib_module_names
                kinds["start-up, libraries" if library else "start-up, standard library"] += 1
    return {"total": kinds.total(), **kinds, "by extra": dict(by_extra.most_common())}


# ---- Any and comments -----------------------------------------------------------------------


def count_any(m: Module) -> int:
    """Count the uses of `Any` in a module, those in annotations in quotes included."""
    count = sum(isinstance(n, ast.Name) and n.id == "Any" for n in m.nodes)
    count += sum(isinstance(n, ast.Attribute) and n.attr == "Any" for n in m.nodes)
    quoted: list[ast.expr | None] = []
    for node in m.nodes:
        if isinstance(node, ast.arg | ast.AnnAssign):
            quoted.append(node.annotation)
        elif isinstance(node, Function):
            quoted.append(node.returns)
    texts = [q.value for q in quoted if isinstance(q, ast.Constant) and isinstance(q.value, str)]
    return count + sum(len(re.findall(r"\bAny\b", text)) for text in texts)


def count_comments(m: Module) -> int:
    """Count the lines that hold a comment which is written for a reader."""
    tokens = tokenize.generate_tokens(io.StringIO(m.text).readline)
    return sum(t.type == tokenize.COMMENT and not IGNORED.match(t.string) for t in tokens)


# ---- the table ------------------------------------------------------------------------------


def measure(folder: Path, root: Path = ROOT) -> dict[str, Any]:
    """Return all measures of a package."""
    found = modules(folder)
    by_package = lines_by_package(found)
    lines = sum(by_package.values())
    count = sum(len(functions(m)) for m in found)
    helpers = single_use_helpers(found)
    texts = docstrings(found)
    return {
        "files": len(found),
        "lines": lines,
        "lines by package": by_package,
        "folders": large_folders(root),
        "functions": count,
        "single-use helpers": len(helpers),
        "single-use helpers [%]": round(100 * len(helpers) / count, 1),
        "imports inside functions": inside_functions(found, root),
        "import cycles": cycles(graph(found)),
        "import cycles, imports for types included": cycles(graph(found, types=True)),
        "Any per thousand lines": round(1000 * sum(map(count_any, found)) / lines, 1),
        "comments per thousand lines": round(1000 * sum(map(count_comments, found)) / lines, 1),
        "docstrings": len(texts),
        'docstrings that begin with "Give"': sum(bool(re.match(r"Gives?\b", t)) for t in texts),
    }


def table(measured: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of the table."""
    for name, value in measured.items():
        if name == "lines by package":
            yield from (f"    {package:<38}{lines:>8}" for package, lines in value.items())
        elif name == "folders":
            yield f"{'folders with more than 25 entries':<42}{len(value):>8}"
            for folder, about in value.items():
                mark = "  (data)" if about["data"] else ""
                yield f"    {folder:<38}{about['entries']:>8}{mark}"
        elif name == "imports inside functions":
            yield f"{name:<42}{value['total']:>8}"
            kinds = {k: v for k, v in value.items() if k not in ("total", "by extra")}
            yield from (f"    {kind:<38}{n:>8}" for kind, n in sorted(kinds.items()))
            yield from (f"        {extra:<34}{n:>8}" for extra, n in value["by extra"].items())
        elif name.startswith("import cycles"):
            yield f"{name:<42}{len(value):>8}"
            for cycle in value:
                names = [module.partition(".")[2] for module in cycle]
                more = ", …" if len(names) > 4 else ""
                yield f"    {len(cycle):>3} modules: {', '.join(names[:4])}{more}"
        else:
            yield f"{name:<42}{value:>8}"


def main() -> None:
    """Print the measures."""
    parser = argparse.ArgumentParser(description="Measure the code base.")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "uuvsim_cosim")
    parser.add_argument("--json", action="store_true", help="print JSON, with all cycles")
    given = parser.parse_args()
    if not any(given.folder.rglob("*.py")):
        parser.error(f"{given.folder}: no Python files; expected the folder of a package")
    measured = measure(given.folder.resolve())
    text = json.dumps(measured, indent=1) if given.json else "\n".join(table(measured))
    print(text)


if __name__ == "__main__":
    main()
