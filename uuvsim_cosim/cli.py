"""The command `uuvsim`: names the commands, and turns every error into one sentence."""

from __future__ import annotations

import logging
import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from uuvsim_cosim._version import __version__
from uuvsim_cosim.commands import (
    access,
    collect,
    doctor,
    evaluate,
    export,
    export_policy,
    fmu,
    identify,
    matlab,
    models,
    new,
    pack,
    play,
    report,
    reproduce,
    run,
    serve,
    study,
    systems,
    terrain,
    train,
    train_offline,
    view,
)
from uuvsim_cosim.commands import (
    map as map_,
)
from uuvsim_cosim.commands.other_code import place_in_other_code
from uuvsim_cosim.errors import UuvsimError

__all__ = ["app", "main"]


class _Commands(TyperGroup):
    """Commands of which those that have nothing to go on from say that they were interrupted."""

    def invoke(self, ctx: Any) -> Any:
        """Do what is asked."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupted:
            sys.stderr.write("uuvsim: interrupted\n")
            raise typer.Exit(130) from interrupted


app = typer.Typer(
    name="uuvsim",
    cls=_Commands,
    help="Simulate unmanned underwater vehicles as a co-simulation of exchangeable FMUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"uuvsim-cosim {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")
    ] = False,
) -> None:
    """Simulate unmanned underwater vehicles as a co-simulation of exchangeable FMUs."""


app.command("run")(run.run_command)
app.command("serve")(serve.serve_command)
app.add_typer(access.app, name="access")
app.command("matlab")(matlab.matlab_command)
app.command("export")(export.export_command)
app.command("report")(report.report_command)
app.command("map")(map_.map_command)
app.command("view")(view.view_command)
app.command("study")(study.study_command)
app.command("identify")(identify.identify_command)
app.command("train")(train.train_command)
app.command("collect")(collect.collect_command)
app.command("train-offline")(train_offline.train_offline_command)
app.command("reproduce")(reproduce.reproduce_command)
app.command("evaluate")(evaluate.evaluate_command)
app.command("play")(play.play_command)
app.command("export-policy")(export_policy.export_policy_command)
app.add_typer(systems.app, name="systems")
app.add_typer(models.app, name="models")
app.command("terrain")(terrain.terrain_command)
app.add_typer(fmu.app, name="fmu")
app.command("pack")(pack.pack_command)
app.command("new")(new.new_command)
app.command("doctor")(doctor.doctor_command)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave with its exit status."""
    sys.exit(status_of(arguments))


def status_of(arguments: list[str] | None = None) -> int:
    """Run the command line and give its exit status; a wrong input is one sentence on stderr."""
    # What components say is recorded, and what was assumed is in the table: not on stderr as well.
    logging.getLogger("uuvsim_cosim").addHandler(logging.NullHandler())
    command = typer.main.get_command(app)
    try:
        result = command.main(args=arguments, prog_name="uuvsim", standalone_mode=False)
    except UuvsimError as error:
        return _refused(str(error), error.exit_status, error)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()  # whoever read us (head, less) has left; nobody is there to be told
        return 0
    except Exception as error:
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
    return result if isinstance(result, int) else 0


def _usage(error: Any, message: str) -> str:
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "uuvsim"
    return f"{message.rstrip('.')}; see `{path} --help`"


def _refused(message: str, status: int, error: BaseException) -> int:
    if os.environ.get("UUVSIM_DEBUG"):
        import traceback

        traceback.print_exception(error, file=sys.stderr)
    sys.stderr.write(f"uuvsim: {'; '.join([message, *getattr(error, '__notes__', [])])}\n")
    return status


if __name__ == "__main__":
    main()
