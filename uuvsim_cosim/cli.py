"""The command `uuvsim`: its commands, and one error message for every error.

With `--json` every command, refused ones included, writes one JSON object (`commands.answer`).
"""

from __future__ import annotations

import logging
import os
import sys
import sysconfig
import traceback
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from uuvsim_cosim._version import __version__
from uuvsim_cosim.commands.shared.answer import answer, answering, error_fields, mode_of
from uuvsim_cosim.commands.shared.common_options import complete, path_of, walk
from uuvsim_cosim.commands.shared.completion import whole_words
from uuvsim_cosim.commands.shared.terminal import line, notice, put
from uuvsim_cosim.errors import UuvsimError

__all__ = ["main"]


class _Commands(TyperGroup):
    """Command group that reports Ctrl-C in commands that do not handle it themselves."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; exit with 130 after Ctrl-C."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupted:
            notice("interrupted")
            raise typer.Exit(130) from interrupted


def _version(wanted: bool) -> None:
    if wanted:
        put("version", __version__)
        line(f"uuvsim-cosim {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Simulate unmanned underwater vehicles as a co-simulation of exchangeable FMUs."""


SIMULATE = "Simulation and results"
BUILD = "Systems, models and FMUs"
SCENE = "Seabeds"
STUDY = "Studies and identification"
LEARN = "Learning"
INSTALL = "Installation and access"

# Commands by name: the object in `uuvsim_cosim.commands` (a group is an `app`), and the heading in
# `--help`. A module is imported when its command is needed. Groups are last, as Typer lists them.
COMMANDS = {
    "run": ("run.run:run_command", SIMULATE),
    "serve": ("serve.serve:serve_command", SIMULATE),
    "view": ("run.view:view_command", SIMULATE),
    "film": ("run.film:film_command", SIMULATE),
    "report": ("run.report:report_command", SIMULATE),
    "export": ("run.export:export_command", SIMULATE),
    "compare": ("run.compare:compare_command", SIMULATE),
    "verify": ("run.verify:verify_command", SIMULATE),
    "cite": ("models.cite:cite_command", BUILD),
    "pack": ("run.pack:pack_command", BUILD),
    "new": ("models.new:new_command", BUILD),
    "terrain": ("models.terrain:terrain_command", SCENE),
    "map": ("run.map:map_command", SCENE),
    "study": ("study.study:study_command", STUDY),
    "analyse": ("study.analyse:analyse_command", STUDY),
    "identify": ("study.identify:identify_command", STUDY),
    "envs": ("learn.envs:envs_command", LEARN),
    "train": ("learn.train:train_command", LEARN),
    "collect": ("learn.collect:collect_command", LEARN),
    "train-offline": ("learn.train_offline:train_offline_command", LEARN),
    "evaluate": ("learn.evaluate:evaluate_command", LEARN),
    "play": ("learn.play:play_command", LEARN),
    "export-policy": ("learn.export_policy:export_policy_command", LEARN),
    "reproduce": ("learn.reproduce:reproduce_command", LEARN),
    "lint": ("editor.lint:lint_command", BUILD),
    "doctor": ("doctor:doctor_command", INSTALL),
    "matlab": ("serve.matlab:matlab_command", INSTALL),
    "systems": ("run.systems:app", BUILD),
    "models": ("models.models:app", BUILD),
    "fmu": ("models.fmu:app", BUILD),
    "access": ("serve.access:app", INSTALL),
}


def _app(names: Iterable[str], *, completion: bool = True, headings: bool = False) -> typer.Typer:
    """Return the command with some of its subcommands, or with their `headings` for a list."""
    made = typer.Typer(
        name="uuvsim",
        cls=_Commands,
        help="Simulate unmanned underwater vehicles as a co-simulation of exchangeable FMUs.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        add_completion=completion,
    )
    made.callback()(_root)
    for name in names:
        place, panel = COMMANDS[name]
        module, _, attribute = place.partition(":")
        found = getattr(import_module(f"uuvsim_cosim.commands.{module}"), attribute)
        if headings:
            text = found.info.help if isinstance(found, typer.Typer) else getdoc(found)
            made.command(name, rich_help_panel=panel, help=text)(lambda: None)
        elif isinstance(found, typer.Typer):
            made.add_typer(found, name=name, rich_help_panel=panel)
        else:
            made.command(name, rich_help_panel=panel)(found)
    return made


def command_tree(arguments: Sequence[str] = ()) -> Any:
    """Return the command with all subcommands, each with the shared options.

    If `arguments` begin with a subcommand, it is the only one: that takes half the time.
    """
    if tuple(arguments) in (("-h",), ("--help",)):
        return complete(typer.main.get_command(_app(COMMANDS, headings=True)))
    if not arguments or arguments[0] not in COMMANDS:
        return complete(typer.main.get_command(_app(COMMANDS)))
    command = complete(typer.main.get_command(_app(arguments[:1], completion=False)))
    if not any(a.startswith(("-h", "--h")) for a in arguments):
        for _, each in walk(command):
            each.add_help_option = False  # reading that option imports pydantic
    return command


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave with its exit status."""
    with whole_words(os.environ):
        status = status_of(arguments)
    sys.exit(status)


def status_of(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status; errors are one message on stderr."""
    # Messages of components are recorded, and assumptions are in the summary: not on stderr too.
    logging.getLogger("uuvsim_cosim").addHandler(logging.NullHandler())
    given = sys.argv[1:] if arguments is None else arguments
    command = command_tree(given)
    status = 0
    with suppress(BrokenPipeError), answering(mode_of(given)) as found:
        found.put("command", path_of(command, given))
        status = _status(command, given)
        found.put("status", status)
        if status == 130 and "error" not in found.fields:
            reason = found.fields.get("messages", ["interrupted"])[-1]
            found.put("error", error_fields(KeyboardInterrupt(), reason, status))
    return status


def _status(command: Any, arguments: list[str]) -> int:
    try:
        result = command.main(args=arguments, prog_name="uuvsim", standalone_mode=False)
    except UuvsimError as error:
        return _refused(str(error), error.exit_status, error)
    except KeyboardInterrupt:
        return 130
    except RuntimeError as error:
        if "home directory" in str(error):  # of Path.expanduser
            what = "a path begins with ~, but there is no home folder; expected a path without ~"
            return _refused(f"{what}, or HOME to be set", 2, error)
        return _unexpected(error)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of the pipe (head, less) has ended: no one reads messages
        return 0
    except Exception as error:
        return _unexpected(error)
    return result if isinstance(result, int) else 0


def _unexpected(error: Exception) -> int:
    """Return the status of any other error: of the parser, of user code, or a bug."""
    if type(error).__name__ == "Abort":
        return 130
    usage = getattr(error, "format_message", None)
    if usage is not None:
        return _refused(_usage(error, str(usage())), 2, error)
    if (place := _place_in_user_code(error)) is not None:
        return _refused(f"{place}: {type(error).__name__}: {error}", 2, error)
    return _refused(
        f"unexpected {type(error).__name__}: {error}; this is a mistake in uuvsim-cosim, "
        "please report it with the output of `uuvsim doctor` (UUVSIM_DEBUG=1 shows where)",
        1,
        error,
    )


def _place_in_user_code(error: Exception) -> str | None:
    """Return "FILE:LINE" of the user's code (a task, a component) that raised the error, if any."""
    libraries = ("<", *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib")))
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = frame.filename
        if file.startswith(str(Path(__file__).parent)):
            return None
        installed = {"site-packages", "dist-packages"} & set(Path(file).parts)
        if not file.startswith(libraries) and not installed:
            return f"{file}:{frame.lineno}"
    return None


def _usage(error: Any, message: str) -> str:
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "uuvsim"
    read = getattr(error.__cause__, "errors", None)
    if read is not None:  # a value that does not fit the option's type
        option = (error.param.opts or [error.param.name])[0]
        kind = str(read()[0]["type"])
        names = {"int": "a whole number", "float": "a number", "bool": "true or false"}
        wanted = names.get(kind.partition("_")[0], "another value")
        message = f"{option} {read()[0]['input']}: expected {wanted}"
    return f"{message.rstrip('.')}; see `{path} --help`"


def _refused(message: str, status: int, error: BaseException) -> int:
    if os.environ.get("UUVSIM_DEBUG"):
        traceback.print_exception(error, file=sys.stderr)
    message = "; ".join([message, *getattr(error, "__notes__", [])])
    answer().put("error", error_fields(error, message, status))
    sys.stderr.write(f"uuvsim: {message}\n")
    return status


if __name__ == "__main__":
    main()
