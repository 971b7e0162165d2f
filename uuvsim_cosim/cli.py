"""The command `uuvsim`: its commands, and one error message for every error.

With `--json` every command, refused ones included, writes one JSON object (`commands.answer`).
"""

from __future__ import annotations

import logging
import os
import sys
from contextlib import suppress
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from uuvsim_cosim._version import __version__
from uuvsim_cosim.commands import doctor
from uuvsim_cosim.commands.learn import (
    collect,
    envs,
    evaluate,
    export_policy,
    play,
    reproduce,
    train,
    train_offline,
)
from uuvsim_cosim.commands.models import fmu, models, new, terrain
from uuvsim_cosim.commands.run import compare, export, pack, report, run, systems, view
from uuvsim_cosim.commands.run import map as map_
from uuvsim_cosim.commands.serve import access, matlab, serve
from uuvsim_cosim.commands.shared.answer import answer, answering, error_fields, mode_of
from uuvsim_cosim.commands.shared.common_options import complete, path_of
from uuvsim_cosim.commands.shared.completion import whole_words
from uuvsim_cosim.commands.shared.terminal import line, notice, put
from uuvsim_cosim.commands.shared.user_code import place_in_other_code
from uuvsim_cosim.commands.study import identify, study
from uuvsim_cosim.errors import UuvsimError

__all__ = ["app", "main"]


class _Commands(TyperGroup):
    """Command group that reports Ctrl-C in commands that do not handle it themselves."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; exit with 130 after Ctrl-C."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupted:
            notice("interrupted")
            raise typer.Exit(130) from interrupted


app = typer.Typer(
    name="uuvsim",
    cls=_Commands,
    help="Simulate unmanned underwater vehicles as a co-simulation of exchangeable FMUs.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        put("version", __version__)
        line(f"uuvsim-cosim {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")
    ] = False,
) -> None:
    """Simulate unmanned underwater vehicles as a co-simulation of exchangeable FMUs."""


SIMULATE = "Simulate and look"
BUILD = "Systems, models and FMUs"
SCENE = "Seabeds"
STUDY = "Studies and identification"
LEARN = "Learning"
INSTALL = "Installation and access"

app.command("run", rich_help_panel=SIMULATE)(run.run_command)
app.command("serve", rich_help_panel=SIMULATE)(serve.serve_command)
app.command("view", rich_help_panel=SIMULATE)(view.view_command)
app.command("report", rich_help_panel=SIMULATE)(report.report_command)
app.command("export", rich_help_panel=SIMULATE)(export.export_command)
app.command("compare", rich_help_panel=SIMULATE)(compare.compare_command)
app.add_typer(systems.app, name="systems", rich_help_panel=BUILD)
app.add_typer(models.app, name="models", rich_help_panel=BUILD)
app.add_typer(fmu.app, name="fmu", rich_help_panel=BUILD)
app.command("pack", rich_help_panel=BUILD)(pack.pack_command)
app.command("new", rich_help_panel=BUILD)(new.new_command)
app.command("terrain", rich_help_panel=SCENE)(terrain.terrain_command)
app.command("map", rich_help_panel=SCENE)(map_.map_command)
app.command("study", rich_help_panel=STUDY)(study.study_command)
app.command("identify", rich_help_panel=STUDY)(identify.identify_command)
app.command("envs", rich_help_panel=LEARN)(envs.envs_command)
app.command("train", rich_help_panel=LEARN)(train.train_command)
app.command("collect", rich_help_panel=LEARN)(collect.collect_command)
app.command("train-offline", rich_help_panel=LEARN)(train_offline.train_offline_command)
app.command("evaluate", rich_help_panel=LEARN)(evaluate.evaluate_command)
app.command("play", rich_help_panel=LEARN)(play.play_command)
app.command("export-policy", rich_help_panel=LEARN)(export_policy.export_policy_command)
app.command("reproduce", rich_help_panel=LEARN)(reproduce.reproduce_command)
app.command("doctor", rich_help_panel=INSTALL)(doctor.doctor_command)
app.command("matlab", rich_help_panel=INSTALL)(matlab.matlab_command)
app.add_typer(access.app, name="access", rich_help_panel=INSTALL)


def command_tree() -> Any:
    """Return the command with all subcommands, each with the shared options."""
    return complete(typer.main.get_command(app))


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
    command = command_tree()
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
    if (place := place_in_other_code(error)) is not None:
        return _refused(f"{place}: {type(error).__name__}: {error}", 2, error)
    return _refused(
        f"unexpected {type(error).__name__}: {error}; this is a mistake in uuvsim-cosim, "
        "please report it with the output of `uuvsim doctor` (UUVSIM_DEBUG=1 shows where)",
        1,
        error,
    )


def _usage(error: Any, message: str) -> str:
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "uuvsim"
    read = getattr(error.__cause__, "errors", None)
    if read is not None:  # a value that does not fit the option's type
        option = (error.param.opts or [error.param.name])[0]
        kind = str(read()[0]["type"])
        wanted = _KINDS.get(kind.partition("_")[0], "another value")
        message = f"{option} {read()[0]['input']}: expected {wanted}"
    return f"{message.rstrip('.')}; see `{path} --help`"


_KINDS = {"int": "a whole number", "float": "a number", "bool": "true or false"}


def _refused(message: str, status: int, error: BaseException) -> int:
    if os.environ.get("UUVSIM_DEBUG"):
        import traceback

        traceback.print_exception(error, file=sys.stderr)
    message = "; ".join([message, *getattr(error, "__notes__", [])])
    answer().put("error", error_fields(error, message, status))
    sys.stderr.write(f"uuvsim: {message}\n")
    return status


if __name__ == "__main__":
    main()
