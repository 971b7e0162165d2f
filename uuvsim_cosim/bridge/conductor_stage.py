"""The stage: the master that runs now, its names, its snapshots, and what became of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import ceil, isfinite
from pathlib import Path
from typing import Any, final

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.conductor_calls import Answer
from uuvsim_cosim.bridge.conductor_names import Names, nearest
from uuvsim_cosim.bridge.conductor_run import Record, Running
from uuvsim_cosim.bridge.conductor_tap import Tap
from uuvsim_cosim.bridge.desk import Moment
from uuvsim_cosim.bridge.replay import Replay, is_recording
from uuvsim_cosim.bridge.stepped import Stepped
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.flatten import flatten
from uuvsim_cosim.orchestrator.master import Master
from uuvsim_cosim.orchestrator.plan import Plan
from uuvsim_cosim.orchestrator.prepared import prepare
from uuvsim_cosim.orchestrator.sources import Backend, resolve
from uuvsim_cosim.orchestrator.system import System

__all__ = ["Stage"]

_SNAPSHOTS = 256  # kept; the oldest go first


@final
class Stage:
    """One system's master in the conductor's thread; a step that failed leaves it paused."""

    def __init__(
        self,
        system: System | Plan | Master | Replay | str | Path,
        seed: int,
        backend: Backend,
        record: Path | None,
    ) -> None:
        if isinstance(system, str | Path) and is_recording(system):
            system = Replay(system)
        elif isinstance(system, str | Path):
            from uuvsim_cosim.orchestrator.library import load

            system = load(system)
        self._system = system if isinstance(system, System) else None
        self._seed, self._backend = seed, backend
        self._replay = system if isinstance(system, Replay) else None
        self.name = "plan" if isinstance(system, Plan | Master) else system.name
        record = None if self._replay else record  # there is a recording already
        self.tap = Tap(record, {"system": self.name, "seed": seed})
        self.running: Running | None = None
        self.failed: UuvsimError | None = None
        self.is_closed = False
        self.last = Moment(0, 0.0, False)
        self._snapshots: dict[str, Any] = {}
        self._taken = 0
        self.master: Stepped
        if isinstance(system, Replay):
            system.initialize([self.tap])
            self.master = system
        else:
            if isinstance(system, System):
                system = flatten(system, seed)
            self.master = self._begun(system)
        self.names = Names(self.master)

    def moment(self) -> Moment:
        """Say where it is; where a step failed, the last communication point."""
        if not self.is_closed:
            self.last = Moment(self.master.tick, self.master.time, self.running is not None)
        return self.last

    def describe(self) -> dict[str, Any]:
        """Give system, version, tick and components."""
        plan = self.master.plan
        return {
            "system": self.name,
            "version": __version__,
            "seed": self._seed,
            "tick": float(plan.tick),
            "failed": None if self.failed is None else str(self.failed),
            "real_time_factor": self.running.factor if self.running else None,
            "overruns": self.running.overruns if self.running else 0,
            "busy": self.running.busy if self.running else 0.0,
            "recordings": [folder.name for folder in self.tap.folders],
            **({} if self._replay is None else self._replay.told),
            "components": [
                {
                    "path": c.path,
                    "name": c.description.name,
                    "kind": "recording" if self._replay else resolve(c.source).kind,
                    "step": float(c.step_ticks * plan.tick),
                    "can_snapshot": c.description.can_get_and_set_state,
                }
                for c in plan.components
            ],
        }

    # ---- stepping -------------------------------------------------------------------------

    def check_idle(self, call: str) -> None:
        """Refuse what needs a master that neither streams nor has failed."""
        if self.failed is not None:
            raise InputInvalid(
                f"{call}: the co-simulation is paused, for {self.failed}; expected reset, restore "
                "or replace first"
            )
        if self.running is not None:
            raise InputInvalid(f"{call}: the co-simulation runs; expected pause first")

    def step(self, n: int) -> None:
        """Make n communication steps; after a failure the stage is paused."""
        self._check_ahead(self.master.tick + n, "step")
        try:
            self.master.step(n)
        except UuvsimError as error:
            self.failed = error
            self.moment()
            raise

    def run(
        self, until: float | None, factor: float | None, record: Sequence[str], answer: Answer
    ) -> None:
        """Begin a run; without `until` it is in real time, and its answer is given at once."""
        end = None
        if until is not None:
            if not isfinite(until):
                raise InputInvalid(f"run: until {until:g} s; expected a time")
            end = ceil(Fraction(str(until)) / self.master.plan.tick)
            if end < self.master.tick:
                raise InputInvalid(
                    f"run: until {until:g} s; expected a time after {self.master.time:g} s, where "
                    "the co-simulation is"
                )
        elif record:
            raise InputInvalid("run: record without until; expected a time, or subscribe")
        if until is None and factor is None:
            factor = 1.0
        if end is not None:
            self._check_ahead(end, "run")
        places = {name: self.names.find(name) for name in record}
        kept = Record(places, self.tap.columns, self.names.read)
        kept_or_none = kept if end is not None else None
        last = end if self._replay is None or end is not None else self._replay.last_tick
        self.running = Running(self.master, last, factor, answer, kept_or_none, kept.taken)
        if end is None:
            answer.set_result({})
            self.running.answer = None
            return
        kept.first(self.master.time)
        self.tap.listen(kept)
        if self.running.is_over:
            self.pause()

    def run_for(self, n: int, answer: Answer, finish: Any) -> None:
        """Begin a run of n steps whose answer is what `finish` gives at its end."""
        self._check_ahead(self.master.tick + n, "step")
        self.running = Running(self.master, self.master.tick + n, None, answer, None, finish)

    def pause(self) -> None:
        """Stop the run, which is answered with what it has so far."""
        running, self.running = self.running, None
        if running is None:
            return
        self.moment()
        if running.record is not None:
            self.tap.leave(running.record)
        if running.answer is not None:
            try:
                running.answer.set_result(running.finish())
            except UuvsimError as error:
                running.answer.set_exception(error)

    def abandon(self, answer: Answer) -> None:
        """End the run whose answer nobody waits for any more, at its communication point."""
        if self.running is not None and self.running.answer is answer:
            self.pause()

    @property
    def wait(self) -> float | None:
        """Give the time until the run's next step is due [s]; None if nothing runs."""
        return None if self.running is None else max(0.0, self.running.wait)

    def advance(self) -> None:
        """Make the steps of the run that are due."""
        running = self.running
        if running is None or running.wait > 0.0:
            return
        try:
            running.advance()
        except UuvsimError as error:
            self.failed, self.running = error, None
            self.moment()
            if running.record is not None:
                self.tap.leave(running.record)
            if running.answer is not None:
                running.answer.set_exception(error)
        else:
            if running.is_over:
                self.pause()

    # ---- going elsewhere ------------------------------------------------------------------

    def reset(self, seed: int | None, start: Mapping[str, Any]) -> None:
        """Go back to the start."""
        if self._replay is not None and seed is not None:
            raise InputInvalid(f"reset: seed {seed}; expected none, for this replays a recording")
        starts = self.names.starts(start)
        self.pause()
        self.tap.fresh()
        try:
            self.master.reset(seed, starts)
        except UuvsimError as error:
            self.failed = error
            raise
        self.failed = None
        self._seed = self._seed if seed is None else seed

    def snapshot(self) -> str:
        """Keep the state under a name."""
        taken = self.master.snapshot()
        self._taken += 1
        name = f"s{self._taken}"
        self._snapshots[name] = taken
        while len(self._snapshots) > _SNAPSHOTS:
            del self._snapshots[next(iter(self._snapshots))]
        return name

    def restore(self, name: str) -> None:
        """Go back to a snapshot; in a recording, also to ``t=SECONDS``."""
        sought = None if self._replay is None else self._replay.sought(name)
        if sought is not None:
            self._snapshots[name] = sought
        if name not in self._snapshots:
            raise InputInvalid(f"no snapshot {name!r}; expected {nearest(name, self._snapshots)}")
        self.pause()
        self.tap.fresh()
        self.master.restore(self._snapshots[name])
        self.failed = None

    def replace(self, component: str, source: str, mapping: Mapping[str, str] | None) -> None:
        """Put another source in a component's place, and begin anew; or leave all as it is."""
        if self._replay is not None:
            raise InputInvalid(f"replace {component}: this replays a recording; expected a running "
                               "system")  # fmt: skip
        if self._system is None:
            raise InputInvalid(
                "replace: this was begun without a system; expected one from a system"
            )
        system = self._system.replace(component, _from_here(source), map=mapping)
        plan = flatten(system, self._seed)
        instantiate = prepare(plan, self._backend)
        self.pause()
        old, master = self.master, Master(plan, instantiate, observers=[self.tap])
        try:
            master.initialize()
        except BaseException:
            master.free()
            raise
        self.master = master
        self._system, self.failed = system, None
        self._snapshots.clear()
        self.names = Names(self.master)
        old.free()

    def close(self) -> None:
        """End the run and complete the recording."""
        if self.is_closed:
            return
        self.moment()
        self.pause()
        self.is_closed = True
        try:
            if self.failed is None:
                self.master.terminate()
        finally:
            try:
                self.master.free()
            finally:
                self.tap.close()

    def _check_ahead(self, tick: int, call: str) -> None:
        if self._replay is not None:
            self._replay.check_ahead(tick, call)

    def _begun(self, given: Plan | Master) -> Master:
        try:
            if isinstance(given, Master):
                master = given
                master.attach(self.tap)
            else:
                master = Master(given, prepare(given, self._backend), observers=[self.tap])
        except BaseException:
            self.tap.close()
            raise
        try:
            master.initialize()
        except BaseException:
            master.free()
            self.tap.close()
            raise
        return master


def _from_here(source: str) -> str:
    """Give the file that a client names where the server stands, if there is one; else as it is."""
    name, colon, _ = source.rpartition(":")
    file = name if colon and name.endswith(".py") else source
    path = Path(file)
    here = path.suffix.lower() in (".fmu", ".ssd", ".ssp", ".py") and path.is_file()
    return f"{path.absolute()}{source[len(file) :]}" if here else source
