"""`uuvsim identify`: fit parameters of a vehicle to a recording, with intervals."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.cache import written
from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.completion import replacements, systems_and_models
from uuvsim_cosim.commands.shared.options import assignments, seconds, value_of
from uuvsim_cosim.commands.shared.progress import FitProgress
from uuvsim_cosim.commands.shared.terminal import (
    file_line,
    for_shell,
    line,
    number,
    put,
    remark,
    table,
    tilde,
)
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.studies.identification.identify import Identified

__all__ = ["identify_command"]

_SHOWN = 3


def identify_command(
    recording: Annotated[
        Path,
        typer.Argument(
            help="Recording: folder of a run, .parquet, .mcap, .csv, ArduSub's .BIN or .tlog, "
            "PX4's .ulg, or a bag of ROS (.mcap, .db3, .bag)."
        ),
    ],
    parameters: Annotated[
        str,
        typer.Option(
            "--parameters",
            "-p",
            help="Parameters to fit, separated by commas: D_q_11,M_A_11,thruster_*.K_n.",
        ),
    ],
    system: Annotated[
        str | None,
        typer.Option(
            "--system",
            autocompletion=systems_and_models,
            help="System by name or file, or a hull such as model:bluerov2. "
            "By default the vehicle that an autopilot's log names.",
        ),
    ] = None,
    log_parameters: Annotated[
        Path | None,
        typer.Option(
            "--log-parameters", help="File of the autopilot's parameters that the log lacks."
        ),
    ] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option(
            "--channel",
            help="Where a quantity is in the log: attitude=/ahrs:data?unit=deg&frame=ned, or a "
            "YAML file of such lines.",
        ),
    ] = None,
    replace: Annotated[
        list[str] | None,
        typer.Option(
            "--replace", autocompletion=replacements, help="component=source; may be repeated."
        ),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="component.parameter=value; of a fitted parameter: its start value."
        ),
    ] = None,
    map_: Annotated[
        list[str] | None, typer.Option("--map", help="component.variable=signal of the recording.")
    ] = None,
    hull: Annotated[
        str | None, typer.Option("--hull", help="Path of the hull, if the system has several.")
    ] = None,
    first: Annotated[
        float,
        typer.Option(
            "--from",
            help="Start time in the recording: seconds, or '2 min'.",
            parser=seconds("--from"),
            metavar="TIME",
        ),
    ] = 0.0,
    last: Annotated[
        float | None,
        typer.Option(
            "--to", help="End time in the recording.", parser=seconds("--to"), metavar="TIME"
        ),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(
            "--step",
            help="Time between points of the fit.",
            parser=seconds("--step"),
            metavar="TIME",
        ),
    ] = None,
    inputs: Annotated[
        str,
        typer.Option(
            "--inputs",
            help="How commands and forces vary between samples: held, linear or smooth.",
            autocompletion=lambda: ["held", "linear", "smooth"],
        ),
    ] = "held",
    delay: Annotated[
        float,
        typer.Option(
            "--delay",
            help="Time by which commands and forces act later than recorded.",
            parser=seconds("--delay"),
            metavar="TIME",
        ),
    ] = 0.0,
    unknown: Annotated[
        str | None,
        typer.Option(
            "--unknown",
            help="What is fitted besides the parameters: delay,current,bias (or bias_r, …).",
        ),
    ] = None,
    residuals: Annotated[
        str,
        typer.Option(
            "--residuals",
            help="How residuals are correlated: ar1 (fitted), robust (wider intervals), or white.",
            autocompletion=lambda: ["robust", "ar1", "white"],
        ),
    ] = "robust",
    save_as: Annotated[
        str | None,
        typer.Option("--save-as", help="Name of a new parameter set, or FOLDER@NAME for a copy."),
    ] = None,
    manoeuvre: Annotated[
        Path | None, typer.Option("--manoeuvre", help="CSV to write: force of the best manoeuvre.")
    ] = None,
    no_proposals: Annotated[
        bool, typer.Option("--no-proposals", help="Do not search for a more informative manoeuvre.")
    ] = False,
) -> None:
    """Fit parameters to a recording, and list those that it does not determine.

    Multiple shooting on the declared equations, 95 % intervals, and a more informative manoeuvre.
    """
    from uuvsim_cosim.studies.identification.assumptions import Assumptions
    from uuvsim_cosim.studies.identification.identify import identify, recorded_system
    from uuvsim_cosim.studies.identification.logs import read_log, read_parameter_file
    from uuvsim_cosim.studies.identification.readers.channels import read_channels
    from uuvsim_cosim.studies.identification.save import save_as as save

    if manoeuvre is not None and no_proposals:
        raise InputInvalid("--manoeuvre: with --no-proposals there is no manoeuvre to write")
    names = tuple(n.strip() for n in (unknown or "").split(",") if n.strip())
    assumed = Assumptions(inputs, delay, names, residuals)
    given = read_parameter_file(log_parameters) if log_parameters is not None else {}
    signals = read_log(recording, given, read_channels(channel or []))
    edited = recorded_system(signals, system)
    sources = assignments("--replace", replace or [], "component=source", dotted=False)
    for pattern, source in sources.items():
        for component in [c for c in edited.components if fnmatchcase(c, pattern)] or [pattern]:
            edited = edited.replace(component, source)
    values = assignments("--set", set_ or [], "component.parameter=value", dotted=True)
    for path, value in values.items():
        edited = edited.set(path, value_of(value))
    with FitProgress() as shown:
        found = identify(
            signals,
            edited,
            parameters.split(","),
            mapped=assignments("--map", map_ or [], "component.variable=signal", dotted=True),
            hull=hull,
            step=step,
            first=first,
            last=last,
            proposals=not no_proposals,
            assumed=assumed,
            report=lambda text: remark("note", text),
            progress=lambda iteration, residual: shown.say(
                f"iteration {iteration}: weighted residual {residual:.5g}; Ctrl-C keeps the best"
            ),
        )
    _show(found)
    if manoeuvre is not None:
        if not found.proposals:
            raise InputInvalid(
                "--manoeuvre: nothing pushes for each identified component; none can be flown"
            )
        p = found.proposals[0]
        rows = [
            f"# {p.name}: generalised force in b, held from row to row (zero-order hold)",
            "time,tau[1],tau[2],tau[3],tau[4],tau[5],tau[6]",
            *(",".join(f"{v:.6g}" for v in (s, *tau)) for s, tau in zip(p.t, p.tau, strict=True)),
        ]
        written(manoeuvre, "\n".join(rows) + "\n")
        file_line(manoeuvre, f"written: {tilde(manoeuvre)}")
    if save_as is not None:
        for saved in save(found, save_as):
            where = f"set {save_as.rpartition('@')[2]} in {tilde(saved.file)}"
            file_line(saved.file, f"written: {where}; use it as {saved.source}")
            if saved.file.name == "parameters.yaml":  # gains of other sets are refused with it
                vehicle = saved.source.removeprefix("model:")
                line(f"fly it with  uuvsim run hold --vehicle {for_shell(vehicle)}")


def _show(found: Identified) -> None:
    line(
        f"{found.recording}: {found.samples} samples of {found.seconds:.4g} s, "
        f"step {found.step:.4g} s, {found.iterations} iterations"
    )
    if not found.converged:
        reached = f"{found.iterations} iterations, {found.status}"
        remark("warning", f"the fit did not converge ({reached}): these are its best values so far")
    table(
        ("parameter", "value", "± (95 %)", "began at", "unit"),
        [
            (n.name, *map(number, (n.value, n.half_width, n.start), (".5g", ".2g", ".5g")), n.unit)
            for n in found.numbers
        ],
        key="parameters",
    )
    put("residuals", found.residuals)
    put("converged", found.converged)
    line(f"residuals (rms, SI): {', '.join(f'{n} {s:.2g}' for n, s in found.residuals.items())}")
    for text in found.assumed:
        remark("assumed", text)
    if found.warning is not None:
        remark("warning", found.warning)
    for text in found.notes:
        remark("note", text)
    for text in found.open:
        answer().add("open", text)
        line(f"open: {text}")
    if found.proposals:
        line()
        table(
            (
                "manoeuvre of 40 s that would tell more",
                *(f"± {n.name}" for n in found.numbers if not n.nuisance),
            ),
            [
                (
                    p.name,
                    *(
                        number(w, ".2g")
                        for n, w in zip(found.numbers, p.half_widths, strict=True)
                        if not n.nuisance
                    ),
                )
                for p in found.proposals[:_SHOWN]
            ],
            key="manoeuvres",
        )
