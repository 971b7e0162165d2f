"""Pages of the command line: one for each command, from the options that it reads."""

from __future__ import annotations

import re
from typing import Any

from uuvsim_cosim.cli import command_tree
from uuvsim_cosim.commands.shared.common_options import walk


def commands() -> dict[str, Any]:
    """Return all commands by their words: "run", "models show"."""
    return {path: command for path, command in walk(command_tree()) if path}


def pages() -> dict[str, str]:
    """Return the pages, by file name; a group and its commands share one page."""
    texts: dict[str, str] = {}
    rows = []
    for path, command in commands().items():
        page = f"{path.split()[0]}.md"
        if page not in texts:
            texts[page] = ""
        level = "#" * len(path.split())
        texts[page] += f"{level} uuvsim {path}\n\n{_entry(command, path)}\n\n"
        anchor = "" if " " not in path else "#uuvsim-" + path.replace(" ", "-")
        rows.append(f"| [`uuvsim {path}`]({page}{anchor}) | {_text(command.help).split('. ')[0]} |")
    texts["index.md"] = (
        "# Commands\n\nEvery command has `--help`, `--json` (the result as one JSON object on "
        "stdout) and `--quiet`. The exit status is 0 for success, 2 for a wrong input, 3 for a "
        "component that failed and 130 after Ctrl-C. [Command line](../../cli.md) introduces them "
        "by task.\n\n| command | purpose |\n|---|---|\n" + "\n".join(rows)
        + "\n\n```{toctree}\n:hidden:\n\n"
        + "\n".join(n.removesuffix(".md") for n in texts) + "\n```\n"
    )  # fmt: skip
    return {name: text.rstrip() + "\n" for name, text in texts.items()}


def _entry(command: Any, path: str) -> str:
    parts = [_text(command.help)]
    examples = [
        line.strip() for line in (command.epilog or "").splitlines() if line.startswith("uuvsim")
    ]
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    usage = " ".join(["uuvsim", path, *(_usage(a) for a in arguments), "[OPTIONS]"])
    parts.append(f"```text\n{usage}\n```")
    if arguments:
        parts.append(
            "| argument | meaning |\n|---|---|\n"
            + "\n".join(f"| `{_usage(a)}` | {_text(getattr(a, 'help', ''))} |" for a in arguments)
        )
    options = [p for p in command.params if p.param_type_name == "option" and not p.hidden]
    if options:
        parts.append(
            "| option | type | default | meaning |\n|---|---|---|---|\n"
            + "\n".join(_option(o) for o in options)
        )
    if examples:
        parts.append("Examples:\n\n```text\n" + "\n".join(examples) + "\n```")
    return "\n\n".join(p for p in parts if p)


def _usage(argument: Any) -> str:
    name = argument.metavar or argument.name.upper()
    name = name + ("..." if argument.nargs == -1 else "")
    return name if argument.required else f"[{name.strip('[]')}]"


def _option(option: Any) -> str:
    names = ", ".join(f"`{n}`" for n in [*option.opts, *option.secondary_opts])
    kind = (
        "" if option.is_flag else option.metavar or str(option.bare_type()).removesuffix(" | None")
    )
    if kind.startswith("list["):
        kind = f"{kind[5:-1]}, repeatable"
    kind = kind.replace("|", "\\|")
    default = option.default
    shown = "" if default in (None, False, ()) or callable(default) else f"`{default}`"
    return f"| {names} | {kind} | {shown} | {_text(option.help)} |"


def _text(help: str | None) -> str:
    """Return a help text as Markdown in one line."""
    text = " ".join((help or "").replace("\b", "").split())
    text = re.sub(r"(?<!`)(--[a-z][a-z-]*)(?!`)", r"`\1`", text.replace("``", "`"))
    return text.replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;")
