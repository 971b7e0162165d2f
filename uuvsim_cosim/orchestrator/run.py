"""A run: a system is simulated into a folder with its recording and where it came from.

The folder holds ``signals.parquet``, ``run.json`` and ``system.ssd``; the command line adds
``report.html``. After a failure or Ctrl-C the recording up to then stays; a run that is refused
before its first step leaves nothing.
"""

from __future__ import annotations

import json
import math
import platform
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuvsim_cosim._version import __version__
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, RecordingError, UuvsimError
from uuvsim_cosim.fmus.watchdog import check_watchdog
from uuvsim_cosim.orchestrator.flatten import flatten
from uuvsim_cosim.orchestrator.loops import loop_delays
from uuvsim_cosim.orchestrator.mission import duration, path_of
from uuvsim_cosim.orchestrator.observer import Observer
from uuvsim_cosim.orchestrator.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.prepared import Progress, prepare
from uuvsim_cosim.orchestrator.real_time import Pace, Punctuality, Steps
from uuvsim_cosim.orchestrator.run_folder import RunFolder, check_room, claim
from uuvsim_cosim.orchestrator.scenario import Played, Scenario
from uuvsim_cosim.orchestrator.sources import Backend
from uuvsim_cosim.orchestrator.system import System

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.component import Component
    from uuvsim_cosim.fmus.trace import Trace
    from uuvsim_cosim.orchestrator.master import Master
    from uuvsim_cosim.orchestrator.recording import Signals

__all__ = ["Interrupted", "Run", "run"]

SCHEMA_VERSION = 1
_SECONDS = 0.1  # of wall time between two calls of `progress`


@dataclass(frozen=True)
class Run:
    """What a run was, and the folder in which it lies; times in s."""

    folder: Path
    system: str
    seed: int
    time: float
    steps: int
    tick: float
    wall_time: float
    loop_delay: float | None
    loop_path: str
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    waypoints: tuple[tuple[float, ...], ...] | None
    asked: Path | None = None
    interrupted: str = ""
    punctuality: Punctuality | None = None  # of a run in real time

    @property
    def real_time_factor(self) -> float:
        """Give simulated over wall time, from the first step to the closed recording."""
        return self.time / self.wall_time if self.wall_time > 0 else math.inf

    @property
    def recording(self) -> Path:
        """Give the file of the signals."""
        return self.folder / "signals.parquet"

    def signals(self) -> Signals:
        """Read the recorded signals as numpy arrays."""
        from uuvsim_cosim.orchestrator.recording import read_signals

        return read_signals(self.folder)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while stepping; the recording is closed, and `run` says what there is."""

    def __init__(self, run: Run) -> None:
        super().__init__(run.interrupted)
        self.run = run


def run(
    system: System | str | Path,
    *,
    until: float | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    backend: Backend = "fmu",
    record_every: int = 1,
    progress: Progress | None = None,
    about: Mapping[str, Any] | None = None,
    real_time: float | Pace | None = None,
    scenario: Scenario | str | Path | None = None,
    isolate: Collection[str] = (),
    watchdog: float = 30.0,
    trace_fmi: str | Path | None = None,
    observers: Sequence[Observer] = (),
) -> Run:
    """Simulate a system from 0 to `until` [s] and record every output into a fresh folder.

    Without `until`, a run ends where its scenario says, else where the system does, else a mission
    runs as long as its path takes (see `mission.duration`). The folder is `out`, by default
    ``runs/<system>-<seed>``; if it holds something already, the first free of NAME-2, NAME-3, ….
    ``progress(stage, done, total)`` is called while "building" (components) and "simulating"
    (seconds). `about` goes into run.json. `real_time`
    is a factor of real time to be kept, or a `Pace`; without it the run is as fast as it can be.
    `scenario`, or a file of one, is what happens meanwhile. `isolate` names components that get a
    process of their own ("*": all), so that a crash is an error and no more; one that does not
    answer within `watchdog` seconds fails. `trace_fmi` is a CSV file for every call of every FMU;
    the run is slow then, with the same result. `observers` watch beside the recorder.

    Raises SystemInvalid and InputInvalid before anything runs, ComponentFailed while it runs
    (its attribute `recording` is the folder), Interrupted on Ctrl-C while stepping. A component
    that asks to end the simulation ends it in good order, with a warning.
    """
    if until is not None and not (math.isfinite(until) and until > 0):
        raise InputInvalid(f"until: {until:g} s was read; expected more than 0")
    if record_every < 1:
        raise InputInvalid(f"record_every: {record_every} was read; expected 1 or more")
    check_watchdog(watchdog)
    if not isinstance(system, System):
        from uuvsim_cosim.orchestrator.library import load

        system = load(system)
    if trace_fmi is not None and (isolate or backend == "native"):
        other = "isolated components" if isolate else "native components"
        raise InputInvalid(f"trace_fmi: together with {other}; expected FMUs in this process")
    played = scenario if isinstance(scenario, Scenario | None) else _read_scenario(scenario)
    pace = real_time if isinstance(real_time, Pace | None) else Pace(real_time)
    plan = flatten(system, seed)
    asked = played.end if until is None and played is not None else until
    end = _end(system, plan) if asked is None else asked
    _check_end(end, plan)
    trace = None if trace_fmi is None else _trace(Path(trace_fmi))
    folder = claim(out if out is not None else Path("runs") / f"{system.name}-{seed}")
    try:
        provenance = _provenance(system, plan, seed, backend, record_every, end, about or {})
        instantiate = prepare(plan, backend, progress, isolate, watchdog, trace)
        master = _started(
            system, plan, folder, instantiate, record_every, provenance, end, observers
        )
        try:
            rows = end / float(plan.tick) / record_every
            steps = master if played is None else Played(master, played)
            check_room(folder.path, rows * 8.0 * (master.recorded + 2))
        except BaseException:
            master.free()
            raise
    except BaseException:
        folder.discard()
        if trace is not None:
            trace.close()
        raise
    with trace or nullcontext():
        return _stepped(master, steps, plan, end, folder, provenance, progress, pace)


def _trace(path: Path) -> Trace:
    from uuvsim_cosim.fmus.trace import Trace

    return Trace(path)


def _read_scenario(path: str | Path) -> Scenario:
    from uuvsim_cosim.orchestrator.scenario_file import read_scenario

    return read_scenario(path)


def _end(system: System, plan: Plan) -> float:
    """Give where a run ends that nobody ends, at the first step that reaches the system's end."""
    if system.stop_time is None:
        return duration(plan)
    return float(math.ceil(Fraction(str(system.stop_time)) / plan.tick) * plan.tick)


def _check_end(end: float, plan: Plan) -> None:
    steps = Fraction(str(end)) / plan.tick
    if steps.denominator != 1:
        near = float(math.ceil(steps) * plan.tick)
        raise InputInvalid(
            f"until: {end:g} s was read; expected a whole number of steps of "
            f"{float(plan.tick):g} s, such as {near:g}"
        )


def _started(
    system: System, plan: Plan, folder: RunFolder,
    instantiate: Callable[[PlannedComponent], Component], record_every: int,
    provenance: Mapping[str, Any], end: float, observers: Sequence[Observer],
) -> Master:  # fmt: skip
    """Write the system, build its components, and go through Initialization Mode."""
    from uuvsim_cosim.orchestrator.master import Master
    from uuvsim_cosim.orchestrator.recorder import Recorder
    from uuvsim_cosim.orchestrator.ssd import write_ssd

    write_ssd(system, folder.path / "system.ssd")
    recorder = Recorder(folder.path, provenance={k: provenance[k] for k in ("system", "seed")})
    master = Master(plan, instantiate, observers=[recorder, *observers], record_every=record_every)
    try:
        # A component with a longer step may end its last one behind `end`.
        steps = [c.step_ticks * plan.tick for c in plan.components]
        master.initialize(0.0, float(max(math.ceil(Fraction(str(end)) / s) * s for s in steps)))
    except BaseException:
        master.free()
        raise
    return master


def _stepped(
    master: Master, stepped: Steps, plan: Plan, end: float, folder: RunFolder,
    provenance: dict[str, Any], progress: Progress | None, pace: Pace | None,
) -> Run:  # fmt: skip
    """Step to the end, and leave a closed recording and run.json whatever happens."""
    begun = time.perf_counter()
    steps = math.ceil(Fraction(str(end)) / plan.tick)
    stopped = ""
    error: UuvsimError | None = None
    interrupted = False
    with master:
        try:
            if pace is None:
                _advance(stepped, steps, end, progress)
            else:
                report = progress or (lambda stage, done, total: None)
                pace.advance(
                    stepped, steps, float(plan.tick), lambda done: report("simulating", done, end)
                )
        except KeyboardInterrupt:
            interrupted = True
            stopped = f"interrupted at t = {master.time:.6g} s"
        except UuvsimError as failure:
            if isinstance(failure, ComponentFailed) and failure.asks_to_end:
                said = f"{failure.path} asks to end the simulation at t = {master.time:.6g} s"
                provenance["warnings"].append(said)
            else:
                error, stopped = failure, str(failure)
        done, reached = master.tick, master.time
        if error is not None:
            master.free()  # not terminate(): what has failed may not answer
    wall_time = time.perf_counter() - begun
    known = {
        "time": reached, "steps": done, "wall_time": wall_time,
        "real_time_factor": reached / wall_time if wall_time > 0 else None, "interrupted": stopped,
        "real_time": None if pace is None else asdict(pace.punctuality()),
    }  # fmt: skip
    try:
        _write_json(folder.path / "run.json", {**provenance, **known})
    except OSError as full:
        reason = f"{folder.path / 'run.json'}: {full.strerror}; expected room on the disk"
        error = error or RecordingError(reason)
    if error is not None:
        if isinstance(error, ComponentFailed):
            error.recording = folder.path  # type: ignore[attr-defined]
        raise error
    result = Run(
        folder=folder.path,
        system=provenance["system"],
        seed=provenance["seed"],
        time=reached,
        steps=done,
        tick=float(plan.tick),
        wall_time=wall_time,
        loop_delay=provenance["loop_delay"],
        loop_path=provenance["loop_path"],
        notes=tuple(provenance["notes"]),
        warnings=tuple(provenance["warnings"]),
        waypoints=None if provenance["waypoints"] is None else tuple(
            tuple(w) for w in provenance["waypoints"]
        ),
        asked=folder.asked if folder.renamed else None,
        interrupted=stopped,
        punctuality=None if pace is None else pace.punctuality(),
    )  # fmt: skip
    if interrupted:
        raise Interrupted(result)
    return result


def _advance(master: Steps, steps: int, end: float, progress: Progress | None) -> None:
    """Step in pieces that take about a tenth of a second, and report in between."""
    report: Progress = progress or (lambda stage, done, total: None)
    piece = 8
    while master.tick < steps:
        begun = time.perf_counter()
        master.step(min(piece, steps - master.tick))
        report("simulating", master.time, end)
        took = time.perf_counter() - begun
        piece = max(1, min(4 * piece, int(piece * _SECONDS / max(took, 1e-6))))


def _provenance(
    system: System, plan: Plan, seed: int, backend: Backend, record_every: int, end: float,
    about: Mapping[str, Any],
) -> dict[str, Any]:  # fmt: skip
    loops = loop_delays(plan)
    path = path_of(plan)
    return {
        "schema_version": SCHEMA_VERSION,
        "version": __version__,
        "system": system.name,
        "seed": seed,
        "backend": {"fmu": "FMUs", "native": "native components"}[backend],
        "until": end,
        "tick": float(plan.tick),
        "record_every": record_every,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "loop_delay": float(loops[0].delay) if loops else None,
        "loop_path": str(loops[0]).partition(": ")[2] if loops else "",
        "notes": list(system.notes),
        "warnings": [w for w in plan.warnings if w not in system.notes],
        "waypoints": None if path is None else path.tolist(),
        "components": [
            {
                "path": c.path,
                "kind": c.description.kind if backend == "native" or "model:" not in c.source
                else "FMI 3.0",
                "source": _shown(c.source),
                "token": c.description.token,
                "step": float(c.step_ticks * plan.tick),
            }
            for c in plan.components
        ],
        **about,
    }  # fmt: skip


def _shown(source: str) -> str:
    """Give a source without the folders of this machine."""
    return source if source.startswith("model:") else Path(source).name


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    fresh = path.with_suffix(".tmp")
    try:
        fresh.write_text(json.dumps(content, indent=2, default=str) + "\n", encoding="utf-8")
        fresh.replace(path)
    except OSError:
        fresh.unlink(missing_ok=True)
        raise
