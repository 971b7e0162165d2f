"""`uuvsim run`: simulate a system or a single FMU, and write the results."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.run.map import mapped
from uuvsim_cosim.commands.run.summary import show_run, summary
from uuvsim_cosim.commands.run.view import Watched
from uuvsim_cosim.commands.shared.completion import components, of, systems
from uuvsim_cosim.commands.shared.options import (
    assignments,
    expect_folder,
    grants,
    seconds,
    step_text,
)
from uuvsim_cosim.commands.shared.progress import RunProgress
from uuvsim_cosim.commands.shared.system_options import (
    SET,
    ArdusubBinary,
    ArmReal,
    Events,
    Force,
    Loops,
    Maps,
    Px4Build,
    Rates,
    Replacements,
    Unsigned,
    Until,
    Values,
    VariableSteps,
    VehicleOfMission,
    changes_of,
    edited_system,
    permit_commands,
)
from uuvsim_cosim.commands.shared.terminal import file_line, line, notice, put, remark, tilde
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, LoopNotConverged
from uuvsim_cosim.fmus.isolation.grants import GRANTS

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.component import Component
    from uuvsim_cosim.fmus.importer.read_description import FmuArchive
    from uuvsim_cosim.fmus.tracing.trace import Trace

__all__ = ["run_command"]

INPUT = "CSV of inputs over time, or [+]component.variable:step, chirp or prbs"


def run_command(
    system: Annotated[
        str,
        typer.Argument(
            autocompletion=systems,
            help="Name of a system, a path to .ssd, .ssp or .fmu; with --vehicle: hold or survey.",
        ),
    ],
    vehicle: VehicleOfMission = None,
    waypoints: Annotated[
        Path | None,
        typer.Option(
            help="CSV of north, east, down in m, or of lat, lon, depth; or a .plan of "
            "QGroundControl."
        ),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(help="LAT,LON of the local frame's origin, for --waypoints in degrees."),
    ] = None,
    set_: Values = None,
    until: Until = None,
    start: Annotated[
        float | None,
        typer.Option(
            help="Start of the simulated time; by default that of the file, else 0.",
            parser=seconds("--start"),
            metavar="TIME",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder to write (for an .fmu: a CSV file).")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.")] = 0,
    replace: Replacements = None,
    ardusub: ArdusubBinary = None,
    px4: Px4Build = None,
    map_: Maps = None,
    rate: Rates = None,
    force: Force = False,
    arm_real: ArmReal = False,
    unsigned: Unsigned = False,
    native: Annotated[
        bool, typer.Option("--native", help="Run models in this process instead of as FMUs.")
    ] = False,
    record_every: Annotated[int, typer.Option(help="Record every N-th step.")] = 1,
    real_time: Annotated[
        float | None, typer.Option(help="Keep to this factor of real time, such as 1.")
    ] = None,
    overruns: Annotated[
        str,
        typer.Option(
            autocompletion=of("catch-up", "slip", "fail"),
            help="Reaction to a step that takes too long: catch-up, slip or fail.",
        ),
    ] = "catch-up",
    scenario: Annotated[
        Path | None, typer.Option(help="Scenario (timed events): YAML, or JSON of libcosim.")
    ] = None,
    isolate: Annotated[
        list[str] | None,
        typer.Option(
            autocompletion=components,
            help="Component to run in a separate process, * for all; C=wasm: as WebAssembly.",
        ),
    ] = None,
    watchdog: Annotated[
        float, typer.Option(help="Longest time in s until an isolated component answers.")
    ] = 30.0,
    grant: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Exception to an isolated FMU's sandbox, component=GRANT: {GRANTS}; repeatable."
        ),
    ] = None,
    loops: Loops = None,
    variable_step: VariableSteps = None,
    events: Events = False,
    trace_fmi: Annotated[
        Path | None, typer.Option(help="CSV to write: every FMI call of every FMU; slow.")
    ] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html.")] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the report in a browser.")] = False,
    view: Annotated[
        bool,
        typer.Option(
            "--view", help="Show the run live in a browser, then replay it; Ctrl-C ends it."
        ),
    ] = False,
    port: Annotated[
        int | None, typer.Option(help="Port of --view; by default the first free one from 8080 on.")
    ] = None,
    input_: Annotated[
        list[str] | None,
        typer.Option("--input", help=f"{INPUT}; may be repeated. For an .fmu: one CSV."),
    ] = None,
    step: Annotated[
        str | None, typer.Option(help="For an .fmu: communication step, 0.01 or 10ms.")
    ] = None,
    interface: Annotated[
        str | None,
        typer.Option(
            autocompletion=of("CoSimulation", "ModelExchange", "ScheduledExecution"),
            help="For an .fmu that offers several: CoSimulation (cs), ModelExchange (me) or "
            "ScheduledExecution (se).",
        ),
    ] = None,
) -> None:
    """Simulate a system and write signals.parquet and report.html into a folder.

    With an .fmu, simulate that one FMU and write its outputs as CSV.
    """
    is_fmu = Path(system).suffix.lower() == ".fmu"
    if until is not None and not (0 < until < float("inf")):
        raise InputInvalid(f"--until {until:g}: expected more than 0 seconds")
    if start is not None and not math.isfinite(start):
        raise InputInvalid(f"--start {start:g}: expected seconds")
    if record_every < 1:
        raise InputInvalid(f"--record-every {record_every}: expected 1 or more")
    from uuvsim_cosim.fmus.isolation.isolated import check_watchdog

    check_watchdog(watchdog, "--watchdog")
    if is_fmu:
        refused = {
            "--waypoints": waypoints, "--origin": origin, "--replace": replace, "--map": map_,
            "--rate": rate, "--vehicle": vehicle, "--force": force, "--ardusub": ardusub,
            "--px4": px4, "--real-time": real_time,
            "--scenario": scenario, "--view": view, "--loops": loops,
            "--variable-step": variable_step, "--events": events, "--arm-real": arm_real,
            "--unsigned": unsigned,
        }  # fmt: skip
        for option, given in refused.items():
            if given:
                raise InputInvalid(option, "applies to systems", "a system, not a single FMU")
        if grant and not isolate:
            raise InputInvalid(
                "--grant", "the FMU is not isolated", "--isolate wasm or '*' with it"
            )
        if trace_fmi is not None and isolate:
            raise InputInvalid("--trace-fmi", "together with --isolate", "FMUs in this process")
        if len(input_ or []) > 1:
            raise InputInvalid(f"--input {' '.join(input_ or [])}: expected one CSV for an .fmu")
        table = Path(input_[0]) if input_ else None
        asked = None if step is None else step_text(step, "--step")
        values = assignments("--set", set_ or [], SET, dotted=False)
        limits = partial(_limited, isolate, watchdog, grants(grant or [])) if isolate else None
        _run_fmu(system, table, until, asked, out, values, trace_fmi, start, interface, limits)
        return
    if step is not None:
        raise InputInvalid("--step applies to a single .fmu", "--rate component=step")
    if interface is not None:
        raise InputInvalid(
            f"--interface {interface} applies to a single .fmu", "SYSTEM to be an .fmu"
        )
    changes = changes_of(set_, replace, map_, rate)
    changes["input"] = {f"{n}": text for n, text in enumerate(input_ or [], start=1)}
    if waypoints is not None:
        changes["waypoints"] = {"file": waypoints.name} | ({"origin": origin} if origin else {})
    if scenario is not None:
        changes["scenario"] = {"file": scenario.name}
    if out is not None:
        expect_folder(out)
    follows = permit_commands(changes["replace"], arm_real=arm_real, unsigned=unsigned)
    if follows and real_time is None:
        raise InputInvalid(
            "--replace mavlink:…", "a followed vehicle has the time of the wall clock",
            "--real-time 1 as well",
        )  # fmt: skip
    edited = edited_system(system, waypoints, changes, loops, origin, vehicle, force,
                           {"ardusub": ardusub, "px4": px4}, variable_step, events)  # fmt: skip
    if real_time is None and overruns != "catch-up":
        raise InputInvalid(f"--overruns {overruns}: expected --real-time FACTOR with it")
    from uuvsim_cosim.orchestrator.master.real_time import Pace
    from uuvsim_cosim.orchestrator.running.run import Interrupted, run
    from uuvsim_cosim.view.recorded.metrics import write_metrics

    pace = None if real_time is None else Pace(real_time, overruns)  # type: ignore[arg-type]
    about = {
        "source": Path(system).name,
        **({} if vehicle is None else {"vehicle": vehicle}),
        "changes": {kind: given for kind, given in changes.items() if given},
    }
    report_file: Path | None = None
    watched = Watched(edited.name, port, view)
    with watched, RunProgress() as progress:
        try:
            done = run(
                edited, until=until, start_time=start, out=out, seed=seed,
                backend="native" if native else "fmu",
                record_every=record_every, progress=progress, about=about, real_time=pace,
                isolate=isolate or [], watchdog=watchdog, grants=grants(grant or []),
                scenario=scenario, trace_fmi=trace_fmi, observers=watched.observers,
                inputs=input_ or [],
            )  # fmt: skip
        except Interrupted as interrupted:
            done = interrupted.run
        except (ComponentFailed, LoopNotConverged) as error:
            progress.close()
            if error.recording is not None:
                notice(f"the recording up to that time is in {tilde(error.recording)}")
            raise
        surveyed = (
            None
            if done.interrupted or vehicle is not None
            else mapped(system, done.folder, progress)
        )
        figures, warnings = summary(done, surveyed)
        write_metrics(done.folder, figures)
        if not no_report:
            from uuvsim_cosim.view.reports.run_report import write_report

            progress.say("writing the report")
            report_file = write_report(done.folder)
    show_run(done, report_file, figures, warnings)
    if open_ and report_file is not None:
        typer.launch(str(report_file))
    if done.interrupted:
        notice(f"{done.interrupted}; the recording is complete up to that time")
        watched.close()
        raise typer.Exit(130)
    watched.replay(done.folder)


def _limited(
    isolate: list[str], watchdog: float, given: dict[str, list[str]], fmu: FmuArchive, name: str
) -> Component:
    """Instantiate a single FMU as WebAssembly or in a process, as `isolate` says of its name."""
    from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_limited
    from uuvsim_cosim.orchestrator.master.isolation import isolations

    for wrong in given.keys() - {name, "*"}:
        raise InputInvalid("--grant", f"no component {wrong!r}", f"{name} or *")
    texts = [text for path in ("*", name) for text in given.get(path, ())]
    way = isolations(isolate, [name])[name]
    return instantiate_limited(fmu, name, way, watchdog=watchdog, grants=texts)


def _run_fmu(
    fmu: str, inputs: Path | None, until: float | None, step: str | None, out: Path | None,
    values: dict[str, str], trace_fmi: Path | None, start: float | None, interface: str | None,
    limits: Callable[[FmuArchive, str], Component] | None,
) -> None:  # fmt: skip
    from contextlib import AbstractContextManager, nullcontext

    from uuvsim_cosim.fmus.check.simulate_fmu import (
        SimulationFile,
        SimulationInterrupted,
        simulate_fmu_to_csv,
    )

    target = out if out is not None else Path(f"{Path(fmu).stem}.csv")
    if target.suffix.lower() not in ("", ".csv"):
        raise InputInvalid(f"--out {target}: ending {target.suffix!r} was read", ".csv")
    if not target.absolute().parent.is_dir():
        raise InputInvalid(target, "its folder does not exist", "a file in a folder")
    known = {"cs": "CoSimulation", "me": "ModelExchange", "se": "ScheduledExecution"}
    named = {word.lower(): name for short, name in known.items() for word in (short, name)}
    if interface is not None and interface.lower() not in named:
        expected = "CoSimulation (cs), ModelExchange (me) or ScheduledExecution (se)"
        raise InputInvalid(f"--interface {interface}: expected {expected}")
    chosen = None if interface is None else named[interface.lower()]
    traced: AbstractContextManager[Trace | None] = nullcontext()
    if trace_fmi is not None:
        from uuvsim_cosim.fmus.tracing.trace import Trace

        traced = Trace(trace_fmi)
    try:
        with traced as trace:
            done = simulate_fmu_to_csv(
                Path(fmu), target, until=until, step=step, inputs=inputs, start=values,
                trace=trace, start_time=start, interface=chosen, instantiate=limits,
            )  # fmt: skip
    except ComponentFailed as error:
        if isinstance(error.partial, SimulationFile):
            notice(f"the values up to that time are in {tilde(target)}")
        raise
    except SimulationInterrupted as interrupted:
        end = interrupted.partial.end
        notice(f"interrupted; the values up to t = {end:g} s are in {tilde(target)}")
        raise typer.Exit(130) from None
    for key in ("rows", "outputs", "begin", "end", "asked_to_end"):
        put(key, getattr(done, key))
    why = ", when it asked to end the simulation" if done.asked_to_end else ""
    begun = f"from {done.begin:g} s " if done.begin else ""
    line(f"{done.rows} rows, {done.outputs} outputs, {begun}until {done.end:g} s{why}")
    for note in done.notes:
        remark("note", note)
    file_line(target)
