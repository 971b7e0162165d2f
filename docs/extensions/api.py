"""Pages of the Python API: one for each package, an entry for each public name.

A name is public if `__all__` of `uuvsim_cosim` or of a package directly below it lists it. It has
its entry on the page of the shortest path by which it can be imported.
"""

from __future__ import annotations

import inspect
import re
from functools import cached_property
from importlib import import_module
from types import ModuleType
from typing import Any

from uuvsim_cosim import errors

PACKAGES = (
    "",
    "models",
    "fmus",
    "orchestrator",
    "kernels",
    "scene",
    "bridge",
    "envs",
    "learn",
    "studies",
    "cluster",
)
ROOT = "uuvsim_cosim"
# Texts of public constants, which have no docstring of their own.
CONSTANTS = {
    "__version__": "Version of the package.",
    "scene.SEABED": "Kind of a ray that meets the seabed first, see `Caster.cast`.",
    "learn.CURRICULA": "Curricula that ship, by name, see `train_curriculum`.",
}


def module_of(package: str) -> ModuleType:
    """Return the package below `uuvsim_cosim` of a name, "" for `uuvsim_cosim` itself."""
    return import_module(f"{ROOT}.{package}" if package else ROOT)


def public_names() -> dict[str, Any]:
    """Return all public objects by their shortest path below `uuvsim_cosim`."""
    found: dict[str, Any] = {}
    for package in PACKAGES:
        module = module_of(package)
        for name in module.__all__:
            value = getattr(module, name)
            if not any(value is other for other in found.values()):
                found[f"{package}.{name}" if package else name] = value
    return found


def public_members(value: Any) -> dict[str, Any]:
    """Return the public methods and properties that a class defines in this project."""
    if not inspect.isclass(value):
        return {}
    return {
        name: member
        for owner in reversed(value.__mro__)
        if owner.__module__.startswith(ROOT)
        for name, member in vars(owner).items()
        if not name.startswith("_")
        and (callable(member) or isinstance(member, (property, cached_property, classmethod)))
    }


def pages() -> dict[str, str]:
    """Return the pages, by file name."""
    names = public_names()
    texts = {}
    for package in PACKAGES:
        module = module_of(package)
        title = module.__name__
        prefix = f"{package}." if package else ""
        here = [n for n in sorted(module.__all__, key=str.lower) if n != "__version__"]
        entries, elsewhere = [], []
        for name in here:
            path = prefix + name
            if path not in names:
                elsewhere.append(
                    f"`{name}` ({{py:obj}}`uuvsim_cosim.{_entry(name, module, names)}`)"
                )
                continue
            entries.append(_directive(f"{ROOT}.{path}", names[path]))
        lines = [f"# {title}", "", _markdown((inspect.getdoc(module) or "").split("\n\n")[0]), ""]
        if elsewhere:
            lines += ["Names that are documented elsewhere: " + ", ".join(elsewhere) + ".", ""]
        texts[f"{package or 'uuvsim_cosim'}.md"] = "\n".join([*lines, *entries, ""])
    texts["errors.md"] = _errors()
    listed = "\n".join(name.removesuffix(".md") for name in texts)
    texts["index.md"] = (
        "# Python API\n\nEvery name can be imported from the package of its page. Deeper "
        "module paths are private and may change with any version.\n\n"
        "An entry shows the signature, then shapes, units and errors, then an example that you "
        "can paste into Python or a notebook. Examples are tested.\n\n"
        f"```{{toctree}}\n:maxdepth: 2\n\n{listed}\n```\n"
    )
    return texts


def _errors() -> str:
    """Return the page of the errors that docstrings name."""
    rows = []
    for name in errors.__all__:
        value = getattr(errors, name)
        if issubclass(value, errors.UuvsimError):
            text = " ".join((inspect.getdoc(value) or "").split("\n\n")[0].split())
            base = value.__bases__[0].__name__
            rows.append(f"| `{name}` | `{base}` | {value.exit_status} | {_markdown(text)} |")
    return (
        "# uuvsim_cosim.errors\n\nAll errors derive from {py:obj}`uuvsim_cosim.UuvsimError`, so "
        "`except uuv.UuvsimError` catches each. The status is that with which the command line "
        "ends.\n\n| error | derives from | status | meaning |\n|---|---|---|---|\n"
        + "\n".join(rows) + "\n"
    )  # fmt: skip


def _entry(name: str, module: ModuleType, names: dict[str, Any]) -> str:
    value = getattr(module, name)
    return next(path for path, other in names.items() if other is value)


def _directive(path: str, value: Any) -> str:
    """Return the autodoc directive of a public object."""
    if inspect.isclass(value):
        members = sorted(public_members(value))
        option = f"\n   :members: {', '.join(members)}" if members else ""
        kind, option = "autoclass", f"{option}\n   :inherited-members:" if members else ""
    elif inspect.isroutine(value):
        kind, option = "autofunction", ""
    else:
        text = CONSTANTS[path.removeprefix(f"{ROOT}.")]
        kind, option = "autodata", f"\n   :no-value:\n\n   {_escaped(text)}"
    name = path.rpartition(".")[2]
    return f"## {name}\n\n```{{eval-rst}}\n.. {kind}:: {path}{option}\n```\n"


def _markdown(docstring: str) -> str:
    """Return a docstring as Markdown: code spans of RST get single backquotes."""
    return docstring.replace("``", "`")


# Characters that begin or end something in reStructuredText.
SPECIAL = re.compile(r"(?<=\w)_(?=\W|$)|(?<!\w)_(?=\w)|[\\*|](?!\s)|(?<=\S)[*|]")
CODE = re.compile(r"(``.+?``|`.+?`)", re.S)


def as_rst(
    app: object, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    """Turn the project's docstrings, which are plain text with `code`, into reStructuredText.

    Characters that mean something else in reStructuredText (``*``, ``|``, a trailing ``_``) are
    escaped outside of code. Blocks that are indented by four are shown as they are; `>>>` begins an
    example.
    """
    if what == "data":  # this is the text of the value's type
        lines.clear()
        return
    text = "\n".join(lines)
    out: list[str] = []
    for paragraph in re.split(r"\n\s*\n", text):
        first = paragraph.lstrip("\n")
        if first.startswith(">>>"):
            out.append(first)
        elif first.startswith("    "):
            out.append("::\n\n" + first)
        else:
            out.append(_escaped(first))
    lines[:] = "\n\n".join(out).splitlines()


def with_plain_types(
    app: object,
    what: str,
    name: str,
    obj: object,
    options: object,
    signature: str | None,
    result: str | None,
) -> tuple[str | None, str | None] | None:
    """Return a signature and its result with the names of type aliases as one writes them."""
    if "TypeAliasForwardRef" not in f"{signature} {result}":
        return None  # as it is
    plain = [
        text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)
        for text in (signature, result)
    ]
    return plain[0], plain[1]


def _escaped(text: str) -> str:
    parts = CODE.split(text)
    for i, part in enumerate(parts):
        if i % 2:
            parts[i] = f"``{part.strip('`')}``"
        else:
            parts[i] = re.sub(
                r"(?<=\w)_(?=\W|$)|(?<!\w)_(?=\w)|[\\*|](?!\s)|(?<=\S)[*|]", r"\\\g<0>", part
            )
            parts[i] = re.sub(r"^\\\*(?= )|^(?:\\\*|\*)(?= )", "*", parts[i], flags=re.M)
    # A literal must be parted from letters that follow it.
    return "".join(
        p + ("\\" if i % 2 and i + 1 < len(parts) and parts[i + 1][:1].isalnum() else "")
        for i, p in enumerate(parts)
    )
