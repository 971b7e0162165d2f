"""Run of a system into a folder with its recording and provenance.

The folder holds ``signals.parquet``, ``run.json`` and ``system.ssd``; the command line adds
``report.html``. After a failure or Ctrl-C, the recording up to that time is kept. A run that is
refused before its first step writes nothing.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from uuvsim_cosim.errors import (
    ComponentFailed,
    InputInvalid,
    LoopNotConverged,
    RecordingError,
    SystemInvalid,
    UuvsimError,
)
from uuvsim_cosim.fmus.isolation.guard import AtComponentExit, calling_component
from uuvsim_cosim.fmus.isolation.isolated import check_watchdog
from uuvsim_cosim.lazy import by_name
from uuvsim_cosim.notebook_bar import Progress, shown
from uuvsim_cosim.orchestrator.master.coupling import Residual
from uuvsim_cosim.orchestrator.master.event_log import Event, event_counts, write_events
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import Observer
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.master.real_time import Pace, Punctuality, Steps
from uuvsim_cosim.orchestrator.master.step_report import VariableStepReport
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.plan.vehicle_match import or_forced
from uuvsim_cosim.orchestrator.recording.recorder import Recorder
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.running.mission import duration
from uuvsim_cosim.orchestrator.running.ranges import RangeWatch
from uuvsim_cosim.orchestrator.running.run_folder import (
    RunFolder,
    lock_run_folder,
    provenance_of,
    refuse_too_large,
    write_run_json,
)
from uuvsim_cosim.orchestrator.scenarios.inputs import Driven, held_by, read_inputs, start_values
from uuvsim_cosim.orchestrator.scenarios.net_weight import net_weight_of_scenario
from uuvsim_cosim.orchestrator.scenarios.played import Played
from uuvsim_cosim.orchestrator.scenarios.scenario import (
    Change,
    Scenario,
    read_scenario,
    recorded_scenario,
)
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd
from uuvsim_cosim.orchestrator.system.elements import Loops
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.tracing.trace import Trace
__all__ = ["Interrupted", "Run", "run"]

_SECONDS = 0.1  # of wall time between two calls of `progress`


@dataclass(frozen=True)
class Run:
    """Result of a run: its folder, and what was measured while it ran.

    `folder` holds the recording; it is not `asked` if that folder was in use. `system` and `seed`
    are those of the run. It went from `start` to `time` [s], in `steps` of `tick` [s], and took
    `wall_time` [s]. `loop_delay` [s] is the delay of the slowest feedback loop, and `loop_path`
    the loop. `residual` is the largest coupling residual of a delayed connection; `iterated` are
    the algebraic loops that are iterated. `notes` are assumptions, `warnings` are possible
    mistakes; `waypoints` are those of a mission (N, E, D) [m]. `interrupted` is the reason for an
    early end; `punctuality` is that of a run in real time, `variable_step` the lengths of the
    steps of a run in which they vary (`steps` then counts ticks). `events` are those of a
    system with events, which events.csv in the folder lists. An attribute that does not apply is
    None or empty.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> run = uuv.run("bluerov2_hold", until=1.0)
    >>> run.steps, run.time, run.folder.name, run.recording.name
    (100, 1.0, 'bluerov2_hold-0', 'signals.parquet')
    >>> run.real_time_factor > 0  # simulated over wall time
    True
    >>> run.signals()["hull.eta"].shape
    (101, 6)
    >>> list(run.to_pandas())[:2]
    ['guidance.eta_d[1]', 'guidance.eta_d[2]']
    >>> run.to_xarray()["hull.eta"].dims
    ('time', 'hull.eta_element')
    """

    folder: Path
    system: str
    seed: int
    time: float
    steps: int
    tick: float
    wall_time: float
    loop_delay: float | None
    loop_path: str
    residual: Residual | None  # the largest of the delayed connections; None: none delays
    iterated: tuple[str, ...]  # the algebraic loops that are iterated, hop by hop
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    waypoints: tuple[tuple[float, ...], ...] | None
    asked: Path | None = None
    start: float = 0.0
    interrupted: str = ""
    punctuality: Punctuality | None = None  # of a run in real time
    variable_step: VariableStepReport | None = None  # None: every step is a tick
    events: tuple[Event, ...] | None = None  # of a system with events

    @property
    def real_time_factor(self) -> float:
        """Return simulated over wall time, from the first step to the closed recording."""
        return (self.time - self.start) / self.wall_time if self.wall_time > 0 else math.inf

    @property
    def recording(self) -> Path:
        """Return the file of the signals."""
        return self.folder / "signals.parquet"

    def signals(self) -> Signals:
        """Read the recorded signals as numpy arrays."""
        return read_signals(self.folder)

    @property
    def metrics(self) -> Mapping[str, float]:
        """Return the figures of merit of the report by key; `units` and `labels` have those keys.

        They are computed from the recording, on the true state. A system without a vehicle has
        none.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> metrics = uuv.run("bluerov2_hold", until=2.0).metrics
        >>> f"{metrics['depth_rms']:.2f} {metrics.units['depth_rms']}"
        '0.07 m'
        """
        found: Mapping[str, float] = by_name("view.notebook.run_metrics:metrics")(self)
        return found

    def to_pandas(self) -> Any:
        """Return the recorded signals as a DataFrame, see `Signals.to_pandas` (extra ``data``)."""
        return self.signals().to_pandas()

    def to_xarray(self) -> Any:
        """Return the recorded signals as a Dataset, see `Signals.to_xarray` (extra ``data``)."""
        return self.signals().to_xarray()

    def _repr_html_(self) -> str:
        """Return the report, for notebooks."""
        return str(by_name("view.notebook.displays:run_html")(self))


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while stepping; the recording is closed, and `run` is the result up to then."""

    def __init__(self, run: Run) -> None:
        super().__init__(run.interrupted)
        self.run = run


def run(
    system: System | str | Path,
    *,
    until: float | None = None,
    start_time: float | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    backend: Backend = "fmu",
    record_every: int = 1,
    progress: Progress | Literal[False] | None = None,
    about: Mapping[str, object] | None = None,
    real_time: float | Pace | None = None,
    scenario: Scenario | str | Path | None = None,
    isolate: Collection[str] = (),
    watchdog: float = 30.0,
    grants: Mapping[str, Sequence[str]] | None = None,
    trace_fmi: str | Path | None = None,
    observers: Sequence[Observer] = (),
    loops: Loops | None = None,
    inputs: Sequence[str] = (),
) -> Run:
    """Simulate a system from `start_time` to `until` [s]; record every output in a new folder.

    `system` is a `System`, or what `load` reads: a name or a file. Each component's random numbers
    come from `seed`. Without `start_time`, the run begins at the system's start time, else at 0.
    Without `until`, it ends at the end of its scenario, else of the system, else after the duration
    of a mission's path. The folder is `out`, by default ``runs/<system>-<seed>``; if it is not
    empty, the first free of NAME-2, NAME-3, …. Every `record_every`-th communication point is
    recorded. `backend`: "fmu" runs declarations as FMUs, "native" as native components; both give
    the same bits.

    ``progress(stage, done, total)`` is called while "building" (components) and "simulating"
    (seconds); without it, a notebook shows a bar, with False it does not. `about` is added to
    run.json. `real_time` is a factor of real time, or a `Pace`; without it the run is as fast as
    possible. `scenario` (or its file) is a list of events during the run. `isolate` names
    components that get a process of their own ("*": all), so that their crash only raises an error;
    one that does not answer within `watchdog` seconds fails. Isolated FMUs are in a sandbox, to
    which `grants` by component, such as ``{"controller": ["files:/data"]}``, are exceptions.
    `trace_fmi` is a CSV file of every
    call of every FMU; the run is slow then, with the same result. `observers` get the rows in
    addition to the recorder. `loops` is the policy for algebraic loops instead of the system's own
    (see `System.with_loops`). `inputs` are CSV files, or waveforms such as
    ``+controller.tau_d[1]:prbs,amplitude=5,hold=0.5``, for unconnected inputs, and with "+" for
    signals; the applied values are written to inputs.csv in the folder.

    Raises SystemInvalid, InputInvalid, FmuError and ToolchainError before anything runs;
    ComponentFailed and LoopNotConverged (their attribute `recording` is the folder), RecordingError
    and Overrun during the run; Interrupted on Ctrl-C while stepping. If a component asks to end the
    simulation, the run ends there with a warning.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> run = uuv.run("bluerov2_hold", until=2.0, seed=3, out="hold")
    >>> depth = run.signals()["hull.eta"][:, 2]  # of N, E, D [m], phi, theta, psi [rad]
    >>> f"{depth[0]:.2f} m to {depth[-1]:.2f} m"
    '1.00 m to 1.21 m'
    """
    if until is not None and not (math.isfinite(until) and until > 0):
        raise InputInvalid("until", f"{until:g} s was read", "more than 0")
    if start_time is not None and not (math.isfinite(start_time) and start_time >= 0):
        raise InputInvalid("start_time", f"{start_time:g} s was read", "0 or more")
    if record_every < 1:
        raise InputInvalid("record_every", f"{record_every} was read", "1 or more")
    check_watchdog(watchdog)
    if not isinstance(system, System):
        system = load(system)
    if trace_fmi is not None and (isolate or backend == "native"):
        other = "isolated components" if isolate else "native components"
        raise InputInvalid("trace_fmi", f"together with {other}", "FMUs in this process")
    if loops is not None:
        system = system.with_loops(loops)
    played = scenario if isinstance(scenario, Scenario | None) else read_scenario(scenario)
    pace = real_time if isinstance(real_time, Pace | None) else Pace(real_time)
    if start_time is not None:
        system = replace(system, start_time=start_time)
    plan = flatten(system, seed)
    drives = read_inputs(inputs, plan)
    if drives:
        changed = {e.variable for e in played.events if isinstance(e, Change)} if played else set()
        for d in drives:
            name = f"{d.component}.{d.variable.name}"
            if name in changed and not d.added:
                raise InputInvalid(f"--input {d.name}: the scenario sets {name}", "one of them")
        for name, value in start_values(drives, float(plan.start)).items():
            system = system.set(name, value)
        plan = flatten(system, seed)
    if played is not None:
        sinking = net_weight_of_scenario(played, plan)
        if sinking and system.mismatches == "refuse":
            raise SystemInvalid(or_forced(sinking))
        plan = replace(plan, warnings=(*plan.warnings, *map(str, sinking)))
    end = _end(played.end if until is None and played is not None else until, system, plan)
    trace: Trace | None = None
    if trace_fmi is not None:
        from uuvsim_cosim.fmus.tracing.trace import Trace

        trace = Trace(Path(trace_fmi))
    folder = lock_run_folder(out if out is not None else Path("runs") / f"{system.name}-{seed}")
    with shown(progress) as report:
        try:
            least = 1 if plan.variable is None else plan.variable.smallest
            rows = (end - float(plan.start)) / float(plan.tick) / max(record_every, least)
            refuse_too_large(plan, backend, isolate, folder.path, rows)
            provenance = provenance_of(system, plan, seed, backend, record_every, end, about or {})
            provenance["notes"] += [d.note for d in drives]
            if played is not None:
                provenance["scenario"] = recorded_scenario(played)
            instantiate = prepare(plan, backend, report, isolate, watchdog, trace, grants)
            write_ssd(system, folder.path / "system.ssd")
            recorder = Recorder(
                folder.path, provenance={k: provenance[k] for k in ("system", "seed")}
            )
            ranges = RangeWatch()
            master = Master(
                plan, instantiate, observers=[recorder, ranges, *observers],
                record_every=record_every, held=held_by(drives, plan),
            )  # fmt: skip
            try:
                # The last step of a component with a longer step may end after `end`.
                longer = [c.step_ticks * plan.tick for c in plan.components]
                span = Fraction(str(end)) - plan.start
                last = plan.start + max(math.ceil(span / s) * s for s in longer)
                master.initialize(None, float(last))
                steps: Steps = master if played is None else Played(master, played)
                if drives:
                    steps = Driven(steps, master, drives, folder.path / "inputs.csv")
            except BaseException:
                master.free()
                raise
        except BaseException:
            folder.discard()
            if trace is not None:
                trace.close()
            raise
        with trace or nullcontext():
            return _simulated(master, steps, plan, end, folder, provenance, report, pace, ranges)


def _end(asked: float | None, system: System, plan: Plan) -> float:
    """Return the end of a run [s]: as asked, else that of the system, else the mission's.

    Raises InputInvalid for an end before the start, or between two communication points.
    """
    end = asked
    if end is None and (system.stop_time is None or system.stop_time <= plan.start):
        end = float(plan.start) + duration(plan)
    elif end is None:  # the first step that reaches the system's end
        end = float(math.ceil(Fraction(str(system.stop_time)) / plan.tick) * plan.tick)
    if end <= plan.start:
        raise InputInvalid(
            "until",
            f"{end:g} s was read, but the run begins at {float(plan.start):g} s",
            "a later end, or another start time",
        )
    steps = Fraction(str(end)) / plan.tick
    if steps.denominator != 1:
        near = float(math.ceil(steps) * plan.tick)
        raise InputInvalid(
            "until",
            f"{end:g} s was read",
            f"a whole number of steps of {float(plan.tick):g} s, such as {near:g}",
        )
    return end


def _simulated(
    master: Master, stepped: Steps, plan: Plan, end: float, folder: RunFolder,
    provenance: dict[str, Any], progress: Progress | None, pace: Pace | None,
    ranges: RangeWatch,
) -> Run:  # fmt: skip
    """Step to the end, and write a closed recording and run.json, also after a failure."""
    begun = time.perf_counter()
    steps = math.ceil(Fraction(str(end)) / plan.tick)
    stopped = ""
    error: UuvsimError | None = None
    interrupted = False

    def ended() -> None:
        """Write run.json if a component ends the whole program."""
        known = {
            "time": master.time, "steps": master.tick - int(plan.start / plan.tick),
            "wall_time": time.perf_counter() - begun,
            "interrupted": f"component {calling_component()!r} called exit()",
        }  # fmt: skip
        write_run_json(folder.path / "run.json", {**provenance, **known})
        sys.stderr.write(
            f"uuvsim: the recording up to t = {master.time:.6g} s is in {folder.path}\n"
        )

    with AtComponentExit(ended), master:
        try:
            master.stop_at([steps])
            report: Progress = progress or (lambda stage, done, total: None)
            if pace is not None:
                pace.advance(
                    stepped, steps, float(plan.tick), lambda done: report("simulating", done, end)
                )
            piece = 8  # steps between two calls of `report`
            while stepped.tick < steps:
                at = time.perf_counter()
                stepped.step(min(piece, steps - stepped.tick))
                report("simulating", stepped.time, end)
                took = time.perf_counter() - at
                piece = max(1, min(4 * piece, int(piece * _SECONDS / max(took, 1e-6))))
        except KeyboardInterrupt:
            interrupted = True
            stopped = f"interrupted at t = {master.time:.6g} s"
        except UuvsimError as failure:
            if isinstance(failure, ComponentFailed) and failure.asks_to_end:
                warning = f"{failure.path} asks to end the simulation at t = {master.time:.6g} s"
                provenance["warnings"].append(warning)
            else:
                error, stopped = failure, str(failure)
        finally:
            if isinstance(stepped, Driven):
                stepped.close()
        left_out = {text for c in master.components for text in getattr(c, "lacking", ())}
        provenance["warnings"] += [f"isolation: {text}" for text in sorted(left_out)]
        provenance["warnings"] += [
            f"{c.path}: {text}"
            for c in master.components
            for category, text in getattr(c, "messages", ())
            if category == "note"
        ]
        first = int(plan.start / plan.tick)
        done, reached = master.tick - first, master.time
        largest, varied = master.largest_residual, master.variable_step
        events = None if plan.events is None else tuple(master.events)
        provenance["warnings"] += [*master.remarks, *ranges.warnings()]
        if error is not None:
            master.free()  # not terminate(): a failed component may not answer
    wall_time = time.perf_counter() - begun
    known = {
        "time": reached, "steps": done, "wall_time": wall_time, "interrupted": stopped,
        "real_time_factor": (reached - float(plan.start)) / wall_time if wall_time > 0 else None,
        "real_time": None if pace is None else asdict(pace.punctuality()),
        "coupling_residual": None if largest is None else asdict(largest),
        "variable_step": None if varied is None else asdict(varied),
        "events": None if events is None else event_counts(events),
    }  # fmt: skip
    try:
        if events is not None:
            write_events(folder.path / "events.csv", events)
        write_run_json(folder.path / "run.json", {**provenance, **known})
    except OSError as full:
        reason = f"{folder.path / 'run.json'}: {full.strerror}; expected free space on the disk"
        error = error or RecordingError(reason)
    if error is not None:
        if isinstance(error, ComponentFailed | LoopNotConverged):
            error.recording = folder.path
        raise error
    result = Run(
        folder=folder.path,
        system=provenance["system"],
        seed=provenance["seed"],
        time=reached,
        start=float(plan.start),
        steps=done,
        tick=float(plan.tick),
        wall_time=wall_time,
        loop_delay=provenance["loop_delay"],
        loop_path=provenance["loop_path"],
        residual=largest,
        iterated=tuple(x["hops"] for x in provenance["algebraic_loops"] if x["iterated"]),
        notes=tuple(provenance["notes"]),
        warnings=tuple(provenance["warnings"]),
        waypoints=None if provenance["waypoints"] is None else tuple(
            tuple(w) for w in provenance["waypoints"]
        ),
        asked=folder.asked if folder.renamed else None,
        interrupted=stopped,
        punctuality=None if pace is None else pace.punctuality(),
        variable_step=varied,
        events=events,
    )  # fmt: skip
    if interrupted:
        raise Interrupted(result)
    return result
