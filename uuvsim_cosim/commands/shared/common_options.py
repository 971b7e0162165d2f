"""Parts of every command: the options `--json` and `--quiet`, examples and groups in `--help`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import typer

from uuvsim_cosim.commands.shared.examples import EXAMPLES
from uuvsim_cosim.commands.shared.option_groups import OUTPUT, group

__all__ = ["complete", "path_of", "walk"]


def complete(command: Any) -> Any:
    """Add shared options, examples and groups of options to a command and all commands below it."""
    # `answer.mode_of` reads these options before anything is parsed.
    app = typer.Typer(add_completion=False)

    @app.command()
    def options(
        json: Annotated[
            bool,
            typer.Option(
                "--json", expose_value=False, rich_help_panel=OUTPUT,
                help="Write the result to stdout as one JSON object.",
            ),
        ] = False,
        quiet: Annotated[
            bool,
            typer.Option(
                "--quiet", expose_value=False, rich_help_panel=OUTPUT,
                help="Write only warnings and errors, to stderr.",
            ),
        ] = False,
    ) -> None:  # fmt: skip
        """Declare the options that every command has."""

    shared = typer.main.get_command(app).params[:2]
    for path, each in walk(command):
        group(path, each)
        each.params.extend(shared)
        examples = EXAMPLES.get(path, ())
        if examples:
            each.epilog = "\n\n".join(("Examples:", *(f"uuvsim {text}" for text in examples)))
    return command


def walk(command: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path of words and the command, for a command and all commands below it."""
    yield path, command
    for name, each in getattr(command, "commands", {}).items():
        yield from walk(each, f"{path} {name}".strip())


def path_of(command: Any, arguments: Sequence[str]) -> str:
    """Return the command that arguments name, such as "uuvsim models show"."""
    words = ["uuvsim"]
    for argument in arguments:
        if argument in getattr(command, "commands", {}):
            command = command.commands[argument]
            words.append(argument)
        elif not argument.startswith("-"):
            break
    return " ".join(words)
