"""The current master, its names, snapshots and run, and the error that has stopped it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from math import ceil, isfinite
from pathlib import Path
from typing import Any, final

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.calls.service import Moment
from uuvsim_cosim.bridge.server.active_run import Record, Running
from uuvsim_cosim.bridge.server.call_queue import Answer
from uuvsim_cosim.bridge.server.playback import Playback, Stepped, is_recording
from uuvsim_cosim.bridge.server.row_distributor import RowDistributor
from uuvsim_cosim.bridge.server.signal_names import Fitted, Names
from uuvsim_cosim.bridge.server.snapshots import Snapshots
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["CurrentMaster"]


@final
class CurrentMaster:
    """The master of a system, in the conductor's thread; after a step that failed it is paused."""

    def __init__(
        self,
        system: System | Plan | Master | Playback | str | Path,
        seed: int,
        backend: Backend,
        record: Path | None,
    ) -> None:
        if isinstance(system, str | Path) and is_recording(system):
            system = Playback(system)
        elif isinstance(system, str | Path):
            from uuvsim_cosim.orchestrator.running.library import load

            system = load(system)
        self._system = system if isinstance(system, System) else None
        self._seed, self._backend = seed, backend
        self._replay = system if isinstance(system, Playback) else None
        self.name = "plan" if isinstance(system, Plan | Master) else system.name
        record = None if self._replay else record  # there is a recording already
        self.rows = RowDistributor(record, {"system": self.name, "seed": seed})
        self.running: Running | None = None
        self.failed: UuvsimError | None = None
        self.is_closed = False
        self.last = Moment(0, 0.0, False)
        self.snapshots = Snapshots()
        self._overruns, self._busy = 0, 0.0  # of the last run, once it has ended
        self._components: list[dict[str, object]] | None = None
        self.master: Stepped
        if isinstance(system, Playback):
            system.initialize([self.rows])
            self.master = system
        else:
            self.master = self._begun(
                flatten(system, seed) if isinstance(system, System) else system
            )
        self.names = Names(self.master)
        self.warnings = self.warned()

    def warned(self) -> tuple[str, ...]:
        """Return the warnings of the plan and of the run so far; a recording has none."""
        if not isinstance(self.master, Master):
            return ()
        return (*self.master.plan.warnings, *self.master.remarks)

    def moment(self) -> Moment:
        """Return the communication point; if a step failed, the last one before it."""
        if not self.is_closed:
            self.last = Moment(self.master.tick, self.master.time, self.running is not None)
        return self.last

    def describe(self) -> dict[str, object]:
        """Return system, version, tick and components."""
        running, plan = self.running, self.master.plan
        if self._components is None:  # described once for each master
            self._components = [
                {
                    "path": c.path,
                    "name": c.description.name,
                    "kind": "recording" if self._replay else resolve(c.source).kind,
                    "step": float(c.step_ticks * plan.tick),
                    "can_snapshot": c.description.can_get_and_set_state,
                }
                for c in plan.components
            ]
        return {
            "system": self.name,
            "version": __version__,
            "seed": self._seed,
            "tick": float(plan.tick),
            "failed": None if self.failed is None else str(self.failed),
            "real_time_factor": running.factor if running else None,
            "warnings": list(self.warned()),
            "overruns": running.overruns if running and running.factor else self._overruns,
            "busy": running.busy if running else self._busy,
            "recordings": [folder.name for folder in self.rows.folders],
            **({} if self._replay is None else self._replay.described),
            "components": self._components,
        }

    def set(self, values: Sequence[Fitted]) -> None:
        """Set values that `names.fit` has returned, and note them beside the recording."""
        self.names.set(values)
        self.rows.note(self.master.time, values)

    # ---- stepping -------------------------------------------------------------------------

    def check_idle(self, call: str) -> None:
        """Refuse a call that needs a master which neither runs nor has failed."""
        if self.failed is not None:
            raise InputInvalid(
                call,
                f"the co-simulation is paused, because {self.failed}",
                "reset, restore or replace first",
            )
        if self.running is not None:
            raise InputInvalid(call, "the co-simulation runs", "pause first")

    def step(self, n: int) -> None:
        """Make n communication steps; after a failure the run is paused."""
        self._check_ahead(self.master.tick + n, "step")
        try:
            self.master.step(n)
        except UuvsimError as error:
            self.failed = error
            self.moment()
            raise

    def run(
        self,
        until: float | None,
        factor: float | None,
        record: Sequence[str],
        answer: Answer,
        most: int | None = None,
    ) -> None:
        """Begin a run; without `until` it streams in real time, and is answered immediately.

        `most` is the largest size of the recording in bytes; a longer run is refused.
        """
        end = None
        if until is not None:
            if not isfinite(until):
                raise InputInvalid("run", f"until {until:g} s", "a time")
            end = ceil(Fraction(str(until)) / self.master.plan.tick)
            if end < self.master.tick:
                raise InputInvalid(
                    "run",
                    f"until {until:g} s",
                    f"a time after {self.master.time:g} s, the current time",
                )
        elif record:
            raise InputInvalid("run", "record without until", "a time, or subscribe")
        if until is None and factor is None:
            factor = 1.0
        if end is not None:
            self._check_ahead(end, "run")
        places = {name: self.names.find(name) for name in record}
        last = end if self._replay is None or end is not None else self._replay.last_tick
        if end is None:
            self._begin(Running(self.master, last, factor, None, None, dict))
            answer.set_result({})
            return
        rows = end - self.master.tick + 1
        kept = Record(places, self.rows.columns, self.names.read, self.master, rows, most)
        self._begin(Running(self.master, last, factor, answer, kept, kept.result))
        self.rows.add(kept)
        assert self.running is not None
        if self.running.is_over:  # `until` is the current time
            self.pause()

    def _begin(self, running: Running) -> None:
        self.running = running
        if running.factor:
            self._overruns = 0

    def run_for(self, n: int, answer: Answer, finish: Callable[[], object]) -> None:
        """Begin a run of n steps, whose answer is the result of `finish` at its end."""
        self._check_ahead(self.master.tick + n, "step")
        self._begin(Running(self.master, self.master.tick + n, None, answer, None, finish))

    def pause(self) -> None:
        """Stop the run, and answer it with the rows that it has so far."""
        running = self._ended()
        if running is None:
            return
        self.moment()
        if running.record is not None:
            self.rows.remove(running.record)
        if running.answer is not None:
            try:
                running.answer.set_result(running.finish())
            except UuvsimError as error:
                running.answer.set_exception(error)

    def _ended(self) -> Running | None:
        """Remove the run and return it; keep its overruns and busy time for `describe`."""
        running, self.running = self.running, None
        if running is not None:
            self._busy = running.busy
            if running.factor:
                self._overruns = running.overruns
        return running

    def abandon(self, answer: Answer) -> None:
        """End the run of an answer that its client does not wait for any more."""
        if self.running is not None and self.running.answer is answer:
            self.pause()

    @property
    def wait(self) -> float | None:
        """The time until the run's next step is due [s]; None if nothing runs."""
        return None if self.running is None else max(0.0, self.running.wait)

    def advance(self) -> None:
        """Make the steps of the run that are due."""
        running = self.running
        if running is None or running.wait > 0.0:
            return
        try:
            running.advance()
        except UuvsimError as error:
            self.failed = error
            self._ended()
            self.moment()
            if running.record is not None:
                self.rows.remove(running.record)
            if running.answer is not None:
                running.answer.set_exception(error)
        else:
            if running.is_over:
                self.pause()

    # ---- reset, restore, replace ----------------------------------------------------------

    def reset(self, seed: int | None, start: Mapping[str, object]) -> None:
        """Go back to the start."""
        if self._replay is not None and seed is not None:
            raise InputInvalid(
                "reset", f"seed {seed}", "no seed, because the server replays a recording"
            )
        starts = self.names.starts(start)  # before anything changes, as it may raise
        self.pause()
        self.rows.fresh()
        try:
            self.master.reset(seed, starts)
        except UuvsimError as error:
            self.failed = error
            raise
        self.failed = None
        self._seed = self._seed if seed is None else seed

    def snapshot(self, owner: str) -> str:
        """Store the state for a client; return the name of the snapshot."""
        self.snapshots.check(owner)
        return self.snapshots.add(self.master.snapshot(), owner)

    def restore(self, name: str) -> None:
        """Restore a snapshot; in a recording, also the time ``t=SECONDS``."""
        sought = None if self._replay is None else self._replay.sought(name)
        state: Any = self.snapshots.find(name) if sought is None else sought
        self.pause()
        self.rows.fresh()
        self.master.restore(state)
        self.failed = None

    def replace(self, component: str, source: str, mapping: Mapping[str, str] | None) -> None:
        """Replace the source of a component and begin again; if that fails, the old one stays."""
        if self._replay is not None:
            raise InputInvalid(
                f"replace {component}", "the server replays a recording", "a running system"
            )
        if self._system is None:
            raise InputInvalid(
                "replace", "the server was started without a system", "one from a system"
            )
        system = self._system.replace(component, _absolute(source), map=mapping)
        plan = flatten(system, self._seed)
        instantiate = prepare(plan, self._backend)
        self.pause()
        old, master = self.master, Master(plan, instantiate, observers=[self.rows])
        try:
            master.initialize()
        except BaseException:
            master.free()
            raise
        self.master = master
        self._system, self.failed, self._components = system, None, None
        self.snapshots.replaced()
        self.names = Names(self.master)
        old.free()

    def close(self) -> None:
        """End the run and complete the recording."""
        if self.is_closed:
            return
        self.moment()
        self.pause()
        self.warnings = self.warned()
        self.is_closed = True
        try:
            if self.failed is None:
                self.master.terminate()
        finally:
            try:
                self.master.free()
            finally:
                self.rows.close()

    def _check_ahead(self, tick: int, call: str) -> None:
        if self._replay is not None:
            self._replay.check_ahead(tick, call)

    def _begun(self, given: Plan | Master) -> Master:
        """Return an initialized master; if that fails, the recording is completed."""
        try:
            if isinstance(given, Master):
                master = given
                master.attach(self.rows)
            else:
                master = Master(given, prepare(given, self._backend), observers=[self.rows])
        except BaseException:
            self.rows.close()
            raise
        try:
            master.initialize()
        except BaseException:
            master.free()
            self.rows.close()
            raise
        return master


def _absolute(source: str) -> str:
    """Return the source with an absolute path if it is a file in the server's folder."""
    name, colon, _ = source.rpartition(":")
    file = name if colon and name.endswith(".py") else source
    path = Path(file)
    here = path.suffix.lower() in (".fmu", ".ssd", ".ssp", ".py") and path.is_file()
    return f"{path.absolute()}{source[len(file) :]}" if here else source
