"""`uuvsim run`: simulate a system, or a single FMU, and write what came out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from uuvsim_cosim.commands.options import assignments, by_component, value_of
from uuvsim_cosim.commands.run_progress import RunProgress
from uuvsim_cosim.commands.run_survey import mapped
from uuvsim_cosim.commands.run_table import show_run
from uuvsim_cosim.commands.run_view import Watched
from uuvsim_cosim.commands.terminal import line, size_of, tilde
from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.fmus.watchdog import check_watchdog

__all__ = ["run_command"]

SET = "component.parameter=value"
MAP = "component.variable=its_name_there"


def run_command(
    system: Annotated[str, typer.Argument(help="A name, or a path to .ssd, .ssp or .fmu.")],
    waypoints: Annotated[
        Path | None, typer.Option(help="CSV of waypoints: north, east, down in metres.")
    ] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help=f"{SET}; again for more.")] = None,
    until: Annotated[float | None, typer.Option(help="Simulated seconds.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder to write (for an .fmu: a CSV file).")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.")] = 0,
    replace: Annotated[
        list[str] | None, typer.Option(help="component=source: an .fmu, FILE.py:Class, model:…")
    ] = None,
    map_: Annotated[
        list[str] | None, typer.Option("--map", help=f"{MAP}, or component=FILE.ssm.")
    ] = None,
    rate: Annotated[
        list[str] | None, typer.Option(help="component=seconds: communication step.")
    ] = None,
    native: Annotated[
        bool, typer.Option("--native", help="Run models in process instead of as FMUs.")
    ] = False,
    record_every: Annotated[int, typer.Option(help="Record every N-th step.")] = 1,
    real_time: Annotated[
        float | None, typer.Option(help="Keep to this factor of real time, such as 1.")
    ] = None,
    overruns: Annotated[
        str, typer.Option(help="When a step takes too long: catch-up, slip or fail.")
    ] = "catch-up",
    scenario: Annotated[
        Path | None, typer.Option(help="What happens meanwhile: YAML, or libcosim's JSON.")
    ] = None,
    isolate: Annotated[
        list[str] | None, typer.Option(help="Component in a process of its own; * for all.")
    ] = None,
    watchdog: Annotated[
        float, typer.Option(help="Seconds that an isolated component has to answer.")
    ] = 30.0,
    trace_fmi: Annotated[
        Path | None, typer.Option(help="CSV of every FMI call of every FMU; slow.")
    ] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html.")] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the report in a browser.")] = False,
    view: Annotated[
        bool, typer.Option("--view", help="Show it live in a browser, then replay it; Ctrl-C ends.")
    ] = False,
    port: Annotated[int | None, typer.Option(help="Of --view; by default 8080 or near.")] = None,
    input_: Annotated[
        Path | None, typer.Option("--input", help="For an .fmu: CSV of inputs over time.")
    ] = None,
    step: Annotated[
        str | None, typer.Option(help="For an .fmu: communication step in seconds.")
    ] = None,
) -> None:
    """Simulate a system and write signals.parquet and report.html into a folder.

    With an .fmu, simulate that one FMU and write its outputs as CSV.
    """
    values = assignments("--set", set_ or [], SET, dotted=not _is_fmu(system))
    if until is not None and not (0 < until < float("inf")):
        raise InputInvalid(f"--until {until:g}: expected more than 0 seconds")
    if record_every < 1:
        raise InputInvalid(f"--record-every {record_every}: expected 1 or more")
    check_watchdog(watchdog, "--watchdog")
    if _is_fmu(system):
        refused = {
            "--waypoints": waypoints, "--replace": replace, "--map": map_, "--rate": rate,
            "--real-time": real_time, "--isolate": isolate, "--scenario": scenario,
            "--view": view,
        }  # fmt: skip
        for option, given in refused.items():
            if given:
                raise InputInvalid(f"{option}: is for systems; expected a system, not one FMU")
        _run_fmu(system, input_, until, step, out, values, trace_fmi)
        return
    if input_ is not None or step is not None:
        raise InputInvalid("--input and --step are for a single .fmu; expected SYSTEM to be one")
    changes = {
        "replace": assignments("--replace", replace or [], "component=source", dotted=False),
        "map": assignments("--map", map_ or [], MAP, dotted=False),
        "rate": assignments("--rate", rate or [], "component=seconds", dotted=False),
        "set": values,
    }
    if waypoints is not None:
        changes["waypoints"] = {"file": waypoints.name}
    if scenario is not None:
        changes["scenario"] = {"file": scenario.name}
    edited = _edited(system, waypoints, changes)
    _run_system(
        edited, changes, name=system, until=until, out=out, seed=seed, native=native,
        record_every=record_every, report=not no_report, show=open_,
        pace=_pace(real_time, overruns), isolate=isolate or [], watchdog=watchdog,
        scenario=scenario, trace_fmi=trace_fmi, watched=Watched(edited.name, port, view),
    )  # fmt: skip


def _pace(factor: float | None, overruns: str) -> Any:
    from uuvsim_cosim.orchestrator.real_time import Pace

    if factor is None:
        if overruns != "catch-up":
            raise InputInvalid(f"--overruns {overruns}: expected --real-time FACTOR with it")
        return None
    return Pace(factor, overruns)  # type: ignore[arg-type]


def _is_fmu(system: str) -> bool:
    return Path(system).suffix.lower() == ".fmu"


def _edited(name: str, waypoints: Path | None, changes: dict[str, dict[str, str]]) -> Any:
    """Load the system and apply the swaps, then rates, values and waypoints."""
    from uuvsim_cosim.orchestrator.library import load
    from uuvsim_cosim.orchestrator.mission import with_waypoints
    from uuvsim_cosim.waypoints import read_waypoints

    points = None if waypoints is None else read_waypoints(waypoints)
    system = load(name)
    rates, swaps = changes["rate"], changes["replace"]
    files = {c: f for c, f in changes["map"].items() if f.lower().endswith(".ssm")}
    maps = by_component({k: v for k, v in changes["map"].items() if k not in files})
    for component in {**files, **maps}:
        if component not in swaps:
            raise InputInvalid(
                f"--map {component}: nothing is put there; expected --replace {component}=SOURCE"
            )
    for component, source in swaps.items():
        # A file given on the command line lies where the user stands, not beside the system.
        mapping: Any = Path(files[component]) if component in files else maps.get(component)
        system = system.replace(component, _from_here(source), map=mapping,
                                rate=rates.get(component))  # fmt: skip
    for component, seconds in rates.items():
        if component not in swaps:
            system = _with_rate(system, component, seconds)
    for path, text in changes["set"].items():
        system = system.set(path, value_of(text))
        _check_effect(system, path)
    return system if points is None else with_waypoints(system, points)


def _check_effect(system: Any, path: str) -> None:
    """Refuse a value for an input that a connection overwrites at once."""
    for wire in system.checked.wires:
        fed = f"{wire.target.element}.{wire.target.variable.name}"
        if path.partition("[")[0] == fed:
            raise InputInvalid(
                f"--set {path}: is fed by {wire.connection.source}; expected a parameter, or an "
                "input that nothing is connected to"
            )


def _with_rate(system: Any, component: str, seconds: str) -> Any:
    element = system.components.get(component)
    if element is None:
        known = ", ".join(system.components)
        raise InputInvalid(f"--rate {component}: no such component; expected one of {known}")
    return system.replace(component, element.source, rate=seconds)


def _from_here(source: str) -> str:
    name, colon, _ = source.rpartition(":")
    file = name if colon and name.endswith(".py") else source
    path = Path(file).expanduser()
    if path.suffix.lower() in (".fmu", ".ssd", ".ssp", ".py"):
        return f"{path.absolute()}{source[len(file) :]}" if "#" not in file else source
    return source


def _run_system(
    system: Any, changes: dict[str, dict[str, str]], *, name: str, until: float | None,
    out: Path | None, seed: int, native: bool, record_every: int, report: bool, show: bool,
    pace: Any, isolate: list[str], watchdog: float, scenario: Path | None,
    trace_fmi: Path | None, watched: Watched,
) -> None:  # fmt: skip
    from uuvsim_cosim.orchestrator.run import Interrupted, run

    about = {
        "source": Path(name).name,
        "changes": {kind: given for kind, given in changes.items() if given},
    }
    report_file: Path | None = None
    with watched, RunProgress() as progress:
        try:
            done = run(
                system, until=until, out=out, seed=seed, backend="native" if native else "fmu",
                record_every=record_every, progress=progress, about=about, real_time=pace,
                isolate=isolate, watchdog=watchdog, scenario=scenario, trace_fmi=trace_fmi,
                observers=watched.observers,
            )  # fmt: skip
        except Interrupted as interrupted:
            done = interrupted.run
        except ComponentFailed as error:
            progress.close()
            kept: Path | None = getattr(error, "recording", None)
            if kept is not None:
                sys.stderr.write(f"uuvsim: the recording up to then is in {tilde(kept)}\n")
            raise
        surveyed = None if done.interrupted else mapped(name, done.folder, progress)
        if report:
            from uuvsim_cosim.view.run_report import write_report

            progress.say("writing the report")
            report_file = write_report(done.folder)
    show_run(done, report_file, surveyed)
    if show and report_file is not None:
        typer.launch(str(report_file))
    if done.interrupted:
        sys.stderr.write(f"uuvsim: {done.interrupted}; the recording is complete up to then\n")
        watched.close()
        raise typer.Exit(130)
    watched.replay(done.folder)


def _run_fmu(
    fmu: str, inputs: Path | None, until: float | None, step: str | None, out: Path | None,
    values: dict[str, str], trace_fmi: Path | None,
) -> None:  # fmt: skip
    from contextlib import nullcontext

    from uuvsim_cosim.fmus.simulate_fmu import SimulationResult, simulate_fmu

    target = out if out is not None else Path(f"{Path(fmu).stem}.csv")
    if not target.absolute().parent.is_dir():
        raise InputInvalid(f"{target}: its folder does not exist; expected a file in a folder")
    traced: Any = nullcontext()
    if trace_fmi is not None:
        from uuvsim_cosim.fmus.trace import Trace

        traced = Trace(trace_fmi)
    try:
        with traced as trace:
            result = simulate_fmu(
                Path(fmu), until=until, step=step, inputs=inputs, start=values, trace=trace,
            )  # fmt: skip
    except ComponentFailed as error:
        if isinstance(error.partial, SimulationResult):
            error.partial.write_csv(target)
            sys.stderr.write(f"uuvsim: the values up to then are in {tilde(target)}\n")
        raise
    result.write_csv(target)
    why = ", when it asked to end the simulation" if result.asked_to_end else ""
    rows, outputs = len(result.time), len(result.variables)
    line(f"{rows} rows, {outputs} outputs, until {result.time[-1]:g} s{why}")
    line(f"{tilde(target)}  {size_of(target)}")
