"""Pages of the components: each is generated from the component's declaration.

A page has the text of the declaration, a live response (`live.py`), its equations where they are
short enough to be read, tables of variables, the parameters of a vehicle or of instruments with
their sources, a plot of the reference response in ``fmus/components/``, and the commands that build
and run its FMU.
"""

from __future__ import annotations

import csv
import hashlib
import inspect
import io
import re
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import casadi as ca
from ruamel.yaml import YAML

import uuvsim_cosim as uuv
from uuvsim_cosim.content import content
from uuvsim_cosim.models.declaration.library import LIBRARY
from uuvsim_cosim.models.declaration.preset import presets_of

LONGEST = 240  # characters of an equation that is shown
MOST = 12  # equations that are shown
REPOSITORY = Path(__file__).parents[2]


def names() -> list[str]:
    """Return the components that have a folder in ``fmus/components/``."""
    return sorted(p.parent.name for p in content("fmus", "components").glob("*/variables.md"))


def pages() -> dict[str, str]:
    """Return the pages and plots of all components, by file name."""
    texts: dict[str, str] = {}
    listed: dict[str, list[str]] = defaultdict(list)
    for name in names():
        model = uuv.declare(name)
        texts[f"{name}.md"] = page(name, model)
        texts[f"{name}.svg"] = _plot(name, model)
        listed[_group(name)].append(f"| [`{name}`]({name}.md) | {_cell(model.description)} |")
    rows = "\n\n".join(
        f"## {group}\n\n| component | what it is |\n|---|---|\n" + "\n".join(listed[group])
        for group in sorted(listed)
    )
    texts["index.md"] = (
        "# Components\n\nEvery component is a declaration in CasADi that runs as FMU, as native "
        "component, in a fused kernel and as derivative. A page states its equations, connectors, "
        "parameters with unit and source, and its reference response.\n\n"
        f"{rows}\n\n```{{toctree}}\n:hidden:\n\n" + "\n".join(names()) + "\n```\n"
    )
    return texts


def _declaring(name: str) -> Any:
    """Return the function that declares a component."""
    module, function = LIBRARY.get(name, LIBRARY["vehicle"]).split(":")
    return getattr(import_module(module), function)


def _group(name: str) -> str:
    """Return the heading of a component in the list: its folder in `models`."""
    if name not in LIBRARY:
        return "Vehicles"
    return LIBRARY[name].split(".")[2].capitalize()


def build_commands(name: str) -> str:
    """Return the commands that build a component's FMU and run it."""
    return f"uuvsim fmu build {name} --fmi 2 -o .\nuuvsim run {name}.fmu --until 2 -o {name}.csv"


def page(name: str, model: Any) -> str:
    """Return the page of a component, whose declaration is `model`."""
    function = inspect.unwrap(_declaring(name))
    module = inspect.getmodule(function)
    assert module is not None
    file = Path(inspect.getsourcefile(function) or "").relative_to(REPOSITORY)
    parts = [
        f"# {name}",
        model.description + ".",
        f"Declared by `{function.__name__}` in `{file}`.",
        "## Live response",
        f"```{{live-component}} {name}\n```",
        "## Description",
        as_markdown(inspect.getdoc(module) or ""),
        as_markdown(inspect.getdoc(function) or ""),
        _options(function),
        "## Equations",
        _equations(model, file),
        "## Variables",
        _variables(name),
        _sources(name),
        "## Reference response",
        f"```{{image}} {name}.svg\n:alt: outputs of {name} over time\n:width: 100%\n```",
        f"Outputs for the inputs in `fmus/components/{name}/input.csv`. A test compares FMU, "
        f"native component and kernel with `fmus/components/{name}/reference.csv`.",
        "## Build and run",
        f"```bash\n{build_commands(name)}\n```",
        f"In Python, `uuv.declare({name!r})` returns the declaration; in a system, the source of a "
        f"component is `model:{name}`.",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def as_markdown(text: str) -> str:
    """Return a docstring as Markdown; equations and tables, indented or spaced, become code."""
    paragraphs = []
    for paragraph in text.replace("``", "`").split("\n\n"):
        if paragraph.startswith("    ") or len(re.findall(r"^\S+ {2,}\S", paragraph, re.M)) > 1:
            paragraphs.append("```text\n" + inspect.cleandoc(paragraph) + "\n```")
        elif "* " in paragraph[:2] or "- " in paragraph[:2]:
            paragraphs.append(paragraph)
        else:
            paragraphs.append(paragraph.replace("|", "\\|").replace("*", "\\*"))
    return "\n\n".join(paragraphs)


def _options(function: Any) -> str:
    """Return the options that a source takes: ``model:NAME?option=value``."""
    rows = [
        "| `{}` | `{}` | `{!r}` |".format(p.name, str(p.annotation).replace("|", "\\|"), p.default)
        for p in inspect.signature(function).parameters.values()
        if p.default is not p.empty and isinstance(p.default, str | int | float | bool | None)
    ]
    if not rows:
        return ""
    head = "| option | type | default |\n|---|---|---|\n"
    text = "Options are structural: they choose equations when the component is declared."
    return f"### Options\n\n{text}\n\n{head}" + "\n".join(rows)


# ---- equations ------------------------------------------------------------------------------


def _equations(model: Any, file: Path) -> str:
    lines: list[str] = []
    long = 0
    # CasADi counts a vector's elements from 0 in their names, FMI's from 1.
    names = {
        f"{v.name}_{i}": f"{v.name}[{i + 1}]"
        for v in model.variables.values()
        for i in range(v.size)
        if v.shape
    }
    left = [(f"d({v.name})/dt", v, model.derivatives[v.name]) for v in model.of_kind("state")]
    left += [(v.name, v, v.start) for v in model.of_kind("derived")]
    for clock in model.clocks:
        left += [(f"{v.name} at the next tick of {clock.name}", v, e) for v, e in clock.updates]
    left += [(v.name, v, v.symbol) for v in model.of_kind("output")]
    for head, variable, expression in left:
        elements = ca.vec(ca.densify(ca.SX(expression))).elements()
        for i, element in enumerate(elements):
            text = formula(element, names)
            name = (
                head
                if len(elements) == 1
                else head.replace(variable.name, f"{variable.name}[{i + 1}]", 1)
            )
            if text is None or len(lines) >= MOST:
                long += 1
            else:
                lines.append(f"{name} = {text}")
    if long > max(len(lines), 6):  # a few of many would mislead
        lines, long = [], long + len(lines)
    shown = "```text\n" + "\n".join(lines) + "\n```\n\n" if lines else ""
    more = f"{long} further scalar equations are" if lines else f"Its {long} scalar equations are"
    return shown + (f"{more} too long to be shown here; they are in `{file}`." if long else "")


BINARY = {
    ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/", ca.OP_LT: "<", ca.OP_LE: "<=",
    ca.OP_EQ: "==", ca.OP_NE: "!=", ca.OP_AND: "and", ca.OP_OR: "or",
}  # fmt: skip
CALLS = {
    ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_EXP: "exp", ca.OP_LOG: "log",
    ca.OP_SQRT: "sqrt", ca.OP_FABS: "abs", ca.OP_SIGN: "sign", ca.OP_ATAN2: "atan2",
    ca.OP_TANH: "tanh", ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan",
    ca.OP_FLOOR: "floor", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_FMIN: "min",
    ca.OP_FMAX: "max", ca.OP_FMOD: "fmod",
}  # fmt: skip


def formula(x: ca.SX, names: Mapping[str, str], longest: int = LONGEST) -> str | None:
    """Return a scalar expression as text with few brackets; None if it is longer than `longest`.

    `names` maps names of symbols to those that are shown.

    CasADi writes `if_else(c, a, b)` as `(c ? a : 0) + (!c ? b : 0)`; this is turned back.
    """
    budget = [longest]

    def read(x: ca.SX, above: int = 0) -> str:
        budget[0] -= 1
        if budget[0] < 0:
            raise OverflowError
        if x.is_constant():
            return f"{float(x):.10g}"
        if x.is_symbolic():
            return names.get(x.name(), x.name())
        op, parts = x.op(), [x.dep(i) for i in range(x.n_dep())]
        if op == ca.OP_ADD and all(p.op() == ca.OP_IF_ELSE_ZERO for p in parts):
            condition, other = parts[0].dep(0), parts[1].dep(0)
            if other.op() == ca.OP_NOT and ca.is_equal(other.dep(0), condition, 2):
                inner = (condition, parts[0].dep(1), parts[1].dep(1))
                return f"if_else({', '.join(read(p) for p in inner)})"
        if op in BINARY:
            rank = 3 if op in (ca.OP_MUL, ca.OP_DIV) else 2 if op in (ca.OP_ADD, ca.OP_SUB) else 1
            right = rank + (op in (ca.OP_SUB, ca.OP_DIV))
            text = f"{read(parts[0], rank)} {BINARY[op]} {read(parts[1], right)}"
            return f"({text})" if rank < above else text
        if op == ca.OP_NEG:
            return f"-{read(parts[0], 3)}"
        if op == ca.OP_SQ:
            return f"{read(parts[0], 4)}^2"
        if op == ca.OP_INV:
            return f"1 / {read(parts[0], 4)}"
        if op == ca.OP_TWICE:
            return f"2 * {read(parts[0], 4)}"
        if op == ca.OP_NOT:
            return f"not {read(parts[0], 4)}"
        if op == ca.OP_IF_ELSE_ZERO:
            return f"if_else({read(parts[0])}, {read(parts[1])}, 0)"
        if op in CALLS:
            return f"{CALLS[op]}({', '.join(read(p) for p in parts)})"
        raise OverflowError  # a call of a table, of rays or of a network

    try:
        text = read(x)
    except OverflowError:
        return None
    return text if len(text) <= longest else None


# ---- tables ---------------------------------------------------------------------------------


def _variables(name: str) -> str:
    """Return the table of variables of the component's folder, without its heading."""
    text = (content("fmus", "components") / name / "variables.md").read_text(encoding="utf-8")
    return text[text.index("| name") :].strip()


def _sources(name: str) -> str:
    """Return the parameters with their sources: of a vehicle's sets, of an instrument's presets."""
    reader = YAML(typ="safe")
    if name not in LIBRARY:
        file = content("models", "vehicles", name, "parameters.yaml")
        data = reader.load(file.read_text(encoding="utf-8"))
        parts = ["## Sources"]
        for title, published in data["sets"].items():
            default = ", the default" if title == data["default"] else ""
            parts += [f"### `{name}@{title}`{default}", f"{published['citation']}."]
            parts.append(_sourced(published["parameters"]))
        return "\n\n".join(parts)
    presets = presets_of(name)
    if not presets:
        return ""
    parts = [
        "## Instruments and gains",
        f"A preset is chosen by `model:{name}@ID`, for example `model:{name}@{min(presets)}`.",
    ]
    for id, description in presets.items():
        files = list(content("models").glob(f"*/{id}/*.yaml"))
        file = next((f for f in files if f.stem == name), files[0])
        data = reader.load(file.read_text(encoding="utf-8"))
        parts += [f"### `{name}@{id}`", f"{description[0].upper()}{description[1:]}."]
        parts.append(_sourced(data["parameters"]))
    return "\n\n".join(parts)


def _sourced(parameters: dict[str, Any]) -> str:
    rows = [
        f"| `{key}` | {value['value']} | {value.get('unit', '1')} | {_cell(value['source'])} |"
        for key, value in parameters.items()
        if isinstance(value, dict) and "value" in value
    ]
    return "| parameter | value | unit | source |\n|---|---|---|---|\n" + "\n".join(rows)


def _cell(text: str) -> str:
    return " ".join(str(text).split()).replace("|", "\\|")


# ---- plot -----------------------------------------------------------------------------------


def _plot(name: str, model: Any) -> str:
    """Return an SVG of the reference response: a panel for each output, elements as lines."""
    text = (content("fmus", "components") / name / "reference.csv").read_text(encoding="utf-8")
    mark = f"<!-- {hashlib.sha256((text + _version()).encode()).hexdigest()} -->"
    drawn = REPOSITORY / "docs" / "reference" / "components" / f"{name}.svg"
    if drawn.is_file() and mark in (before := drawn.read_text(encoding="utf-8")):
        return before  # drawing all takes half a minute

    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot as plt

    rows = list(csv.reader(text.splitlines()))
    head, values = rows[0], [[float(x) for x in row] for row in rows[1:]]
    time = [row[0] for row in values]
    panels: dict[str, list[int]] = defaultdict(list)
    for i, column in enumerate(head[1:], start=1):
        panels[column.partition("[")[0]].append(i)
    grey = "#808080"
    style = {
        "svg.hashsalt": name, "svg.fonttype": "none", "font.size": 9, "text.color": grey,
        "axes.edgecolor": grey, "axes.labelcolor": grey, "xtick.color": grey, "ytick.color": grey,
        "axes.prop_cycle": plt.cycler(
            color=["#2a7fb8", "#d1711f", "#3a9a5b", "#b8457a", "#7d6bb8", "#8a8a2a"],
            linestyle=["-", "--", "-.", ":", "-", "--"],
        ),
    }  # fmt: skip
    with mpl.rc_context(style):
        columns = min(3, len(panels))
        lines = -(-len(panels) // columns)
        figure, axes = plt.subplots(
            lines, columns, figsize=(10, 2.1 * lines), squeeze=False, sharex=True
        )
        for ax in axes.flat[len(panels) :]:
            ax.set_visible(False)
        for ax, (title, indices) in zip(axes.flat, panels.items(), strict=False):
            for n, i in enumerate(indices[:6], start=1):
                ax.plot(time, [row[i] for row in values], label=str(n), linewidth=1.2)
            variable = model.variables.get(title)
            unit = getattr(variable, "unit", "") or ", ".join(
                dict.fromkeys(getattr(variable, "units", ()) or ("",))
            )
            more = f", first 6 of {len(indices)}" if len(indices) > 6 else ""
            ax.set_title(f"{title} [{unit}]{more}" if unit else f"{title}{more}", fontsize=9)
            ax.grid(alpha=0.25)
            if len(indices) > 1:
                ax.legend(fontsize=7, ncols=3, framealpha=0.3)
        for ax in axes[-1]:
            ax.set_xlabel("time [s]")
        figure.tight_layout()
        out = io.StringIO()
        figure.savefig(out, format="svg", transparent=True, metadata={"Date": None})
        plt.close(figure)
    lines = [line.rstrip() for line in out.getvalue().splitlines()]
    return "\n".join([*lines, mark]) + "\n"


@cache
def _version() -> str:
    """Return the text of this file, on which a plot depends too."""
    return Path(__file__).read_text(encoding="utf-8")
