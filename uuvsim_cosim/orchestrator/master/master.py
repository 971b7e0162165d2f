"""Master of a run: executes a plan, one communication step after another, with the loop in C."""

from __future__ import annotations

import ctypes
import logging
from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from functools import partial
from operator import index
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, final

import numpy as np

from uuvsim_cosim.errors import (
    ComponentFailed,
    FmuError,
    InputInvalid,
    LoopNotConverged,
    UuvsimError,
)
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.isolation.guard import AtComponentExit
from uuvsim_cosim.orchestrator.master import snapshot as snapshots
from uuvsim_cosim.orchestrator.master.clocks import cause_of, start_clocks
from uuvsim_cosim.orchestrator.master.core_library import (
    Failure,
    Outcome,
    Type,
    decode,
    encode,
    library,
)
from uuvsim_cosim.orchestrator.master.core_tables import Tables, tables_of
from uuvsim_cosim.orchestrator.master.coupling import Residual, loop_remarks, residuals_of
from uuvsim_cosim.orchestrator.master.event_log import Event
from uuvsim_cosim.orchestrator.master.failure import error_of
from uuvsim_cosim.orchestrator.master.faults import Faults, hash_of_seeds
from uuvsim_cosim.orchestrator.master.initial_values import propagate
from uuvsim_cosim.orchestrator.master.observer import Column, Observer, Watch, rows_of
from uuvsim_cosim.orchestrator.master.replacement import (
    copy_values,
    plan_with,
    set_inputs,
    state_of_new_instance,
    transferable_state,
)
from uuvsim_cosim.orchestrator.master.restart import InstancePool, Restart, is_pooled
from uuvsim_cosim.orchestrator.master.serving import serve
from uuvsim_cosim.orchestrator.master.snapshot import LoopState, Snapshot
from uuvsim_cosim.orchestrator.master.step_report import VariableStepReport
from uuvsim_cosim.orchestrator.plan.algebraic_loops import delay_remark, hops_of, loop_gain
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.plan.start import Starts, enter_initialization, variable_of
from uuvsim_cosim.orchestrator.values.values import Misfit, as_array, fit

__all__ = ["Master", "Starts"]

_NEVER = 2**64 - 1  # a tick
_SECONDS = 0.2  # longest wall time of one call into C, so that Ctrl-C is prompt
log = logging.getLogger("uuvsim_cosim.master")


@final
class Master:
    """One run of a plan: initialize, then step; frees everything at the end, also after a failure.

    `plan` is what `flatten` returns, and `instantiate` makes a component of it: what `prepare`
    returns. `record` names the variables that `observers` get, as (path, name); by default all
    outputs. They get every `record_every`-th communication point. `live` names variables, and
    `held` unconnected inputs, whose present values can be read and set in the arrays of `slots`,
    without a call. Without `measured`, no coupling residuals are measured, and steps are a little
    faster.

    Order of calls: `initialize`; then `step`, `run_until`, `get`, `set`, `snapshot`, `restore` and
    `reset` in any order; then `terminate` and `free`, which a ``with`` block calls.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.orchestrator import flatten, prepare
    >>> plan = flatten(uuv.load("bluerov2_hold"), seed=0)
    >>> with uuv.Master(plan, prepare(plan)) as master:
    ...     master.initialize()
    ...     master.step(100)
    ...     master.set("controller", "Kp", [60, 60, 80, 14, 14, 6])  # N/m, N.m/rad
    ...     master.run_until(2.0)
    ...     print(master.tick, master.time, master.get("hull", "eta")[2].round(2))  # depth [m]
    200 2.0 1.21

    Example: save the state and go back to it, without a ``with`` block.

    >>> from pathlib import Path
    >>> master = uuv.Master(plan, prepare(plan))
    >>> master.initialize()
    >>> kept = master.snapshot()
    >>> master.step(100)
    >>> worst = master.largest_residual
    >>> worst == master.residuals[0], worst.source, worst.unit, master.remarks
    (True, 'wrench.tau[3]', 'N', ())
    >>> master.save_snapshot(Path("1s.snapshot"))
    >>> master.restore(kept)
    >>> master.time
    0.0
    >>> master.load_snapshot(Path("1s.snapshot"))
    >>> master.time
    1.0
    >>> master.make_ahead(10)  # needed only for the components of `without_state`
    >>> master.without_state
    ()
    >>> master.stop_at([500])  # a communication point also with a variable step
    >>> master.variable_step is None  # this system has a fixed one
    True
    >>> master.reset(seed=7, start={"hull": {"eta_0": [0, 0, 3, 0, 0, 0]}})
    >>> float(master.get("hull", "eta")[2])  # depth [m]
    3.0
    >>> master.terminate()
    >>> master.free()
    """

    def __init__(
        self,
        plan: Plan,
        instantiate: Callable[[PlannedComponent], Component],
        *,
        observers: Sequence[Observer] = (),
        record: Sequence[tuple[str, str]] | None = None,
        record_every: int = 1,
        live: Sequence[tuple[str, str]] = (),
        held: Sequence[tuple[str, str]] = (),
        measured: bool = True,
    ) -> None:
        self.plan = plan
        self._measured = measured
        self._index = {c.path: i for i, c in enumerate(plan.components)}
        self._watch = Watch(plan, observers)
        self._record, self._every = record, record_every
        self._live, self._held = live, held
        self._tables: Tables | None = None
        self._faults: Faults | None = None
        self._loop_state: LoopState | None = None
        self._remarks: list[str] = []  # of delayed loops that do not converge
        self.events: list[Event] = []  # of a plan with events, since the master was made
        self.recorded = 0  # scalars that observers get at each recorded point
        self._first: Snapshot | None = None  # in Initialization Mode, for `reset`
        self._start_tick = 0
        self._times: tuple[float, float | None] = (0.0, None)
        self._hash = snapshots.plan_hash(plan)
        self._instantiate = instantiate
        self._last: Snapshot | None = None  # the snapshot that was taken last
        self._stops: list[int] = []  # ticks that no step of variable length passes
        self._retired: list[Tables] = []  # of earlier plans; freed last, as views of them may exist
        self._recorded: list[tuple[int, Variable]] = []
        self._pools = [InstancePool(partial(instantiate, planned)) for planned in plan.components]
        self._restart: Restart | None = None
        self._at_exit: AtComponentExit | None = None
        self.components: list[Component] = []
        try:
            for planned in plan.components:
                self.components.append(instantiate(planned))
        except BaseException:
            self.free()
            raise
        self._find_drains()

    # ---- life -----------------------------------------------------------------------------

    def attach(self, observer: Observer) -> None:
        """Add an `observer`; before `initialize`.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.orchestrator import flatten, prepare
        >>> class Counter:
        ...     rows = 0
        ...     def begin(self, plan, columns):
        ...         print("first column:", columns[0].name)
        ...     def observe(self, chunk):
        ...         self.rows += len(chunk.time)
        ...     def end(self):
        ...         print("rows:", self.rows)
        >>> plan = flatten(uuv.System("tank").add("hull", "model:sphere"))
        >>> with uuv.Master(plan, prepare(plan)) as master:
        ...     master.attach(Counter())
        ...     master.initialize()
        ...     master.step(100)
        first column: hull.eta[1]
        rows: 101
        """
        if self._tables is not None:
            raise InputInvalid("attach", "the run has begun", "before initialize()")
        self._watch.observers.append(observer)

    def initialize(self, start_time: float | None = None, stop_time: float | None = None) -> None:
        """Set start values and seeds, solve Initialization Mode, and leave it.

        The run begins at `start_time` [s], by default at the system's own start time; components
        get `stop_time` [s]. Raises InputInvalid for a start time between two ticks,
        LoopNotConverged for an algebraic loop without a solution.
        """
        if self._tables is not None:
            raise InputInvalid("initialize", "the run has begun", "reset()")
        for warning in self.plan.warnings:
            log.warning("%s", warning)
        begin = self.plan.start if start_time is None else start_time
        ticks = Fraction(str(begin)) / self.plan.tick
        if ticks.denominator != 1 or ticks < 0:
            tick = float(self.plan.tick)
            near = max(0.0, float(round(ticks) * self.plan.tick))
            raise InputInvalid(
                "start_time",
                f"{float(begin):.12g} s is no multiple of the tick of {tick:g} s",
                f"one, such as {near:g} s",
            )
        self._start_tick = int(ticks)
        self._times = (self._seconds(self._start_tick), stop_time)
        for planned, component in zip(self.plan.components, self.components, strict=True):
            enter_initialization(planned, component, {}, None, self._times)
        states = tuple(
            c.get_fmu_state() if c.description.can_get_and_set_state else None
            for c in self.components
        )
        self._first = Snapshot(self._hash, states)
        self._leave_initialization()

    def reset(self, seed: int | None = None, start: Starts | None = None) -> None:
        """Go back to Initialization Mode, with another `seed` or other `start` values; no reload.

        `start` has the values by path and name.
        """
        self._ready()
        first = self._first
        assert first is not None
        self.faults.clear()
        for path, values in (start or {}).items():
            component = self.components[self._component(path)]
            for name in values:
                variable_of(component, name)
        if self._restart is None:
            self._restart = Restart(
                self.plan, self._ready(), self.components, self._pools, self._times
            )
        self._restart.enter(first.states, seed, start or {})
        self._ready().forget_inputs()
        self._find_drains()
        self._leave_initialization()

    def make_ahead(self, resets: int) -> None:
        """Instantiate the FMUs that cannot copy their state in advance, for a number of `resets`.

        Otherwise each reset makes a new instance of them.
        """
        for pool, component in zip(self._pools, self.components, strict=True):
            if is_pooled(component):
                pool.fill(resets, component)

    @property
    def without_state(self) -> tuple[str, ...]:
        """Components that cannot copy their state: reset instantiates them; snapshots fail."""
        return tuple(c.path for c in self.components if not c.description.can_get_and_set_state)

    def terminate(self) -> None:
        """End the run: components terminate, observers close."""
        try:
            for component in self.components:
                component.terminate()
        finally:
            self._end_watch()

    def free(self) -> None:
        """Free everything; a second call does nothing. Observers get the rows up to now."""
        if self._at_exit is not None:
            self._at_exit.close()
        try:
            self._end_watch()
        finally:
            tables, self._tables = self._tables, None
            self._first = None
            # The core frees copied states while the components still live; then the components are
            # freed, the last one first; then the memory to which they and observers had views.
            if tables is not None:
                tables.core.forget()
            for component in reversed(self.components):
                component.free()
            self.components.clear()
            for pool in self._pools:
                pool.free()
            self._last = None
            for used in [*self._retired, *([] if tables is None else [tables])]:
                used.core.free()
            self._retired.clear()

    def __enter__(self) -> Self:
        """Return the master."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Terminate if all went well, and free everything."""
        try:
            if kind is None and self._tables is not None:
                self.terminate()
        finally:
            self.free()

    # ---- stepping -------------------------------------------------------------------------

    @property
    def residuals(self) -> list[Residual]:
        """Coupling residuals of the delayed connections, the largest first (see `coupling`).

        Each is the largest of its connection since `initialize`, or since the last `reset`.
        """
        return residuals_of(self._ready())

    @property
    def largest_residual(self) -> Residual | None:
        """The first of `residuals`; None if no connection delays."""
        return next(iter(residuals_of(self._ready(), 1)), None)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings about delayed loops: a gain with which one diverges, or a large residual."""
        of_step = () if self.variable_step is None else self.variable_step.remarks()
        return (*self._remarks, *loop_remarks(self._ready()), *of_step)

    @property
    def tick(self) -> int:
        """The communication point that has been reached."""
        return self._ready().core.tick

    @property
    def time(self) -> float:
        """Time at the communication point that has been reached [s]."""
        return self._seconds(self.tick)

    def step(self, n: int = 1) -> None:
        """Make `n` communication steps; raises ComponentFailed, LoopNotConverged.

        With a variable communication step, `n` is a number of ticks, and the last step may end
        later.
        """
        try:
            steps = index(n)
        except TypeError:
            steps = -1
        if steps < 0:
            raise InputInvalid("step", f"{n!r} steps", "a whole number, 0 or more")
        core = self._ready().core
        tick = core.tick
        end = tick + steps
        while tick < end:
            stop = end
            if self.plan.variable is not None:
                later = bisect_right(self._stops, tick)
                horizon = self._stops[later] if later < len(self._stops) else _NEVER
                core.horizon(horizon)
                stop = min(end, horizon)
            # C returns when the steps are made, rows are full, or time has passed. Rows are passed
            # on before a failure is raised, so that a recording has all steps before it.
            failure = core.run(stop - tick, _SECONDS)
            self._emit()
            if failure is not None:
                self._fail(failure)
            tick = core.tick

    def stop_at(self, ticks: Iterable[int]) -> None:
        """Let no step of variable length go beyond these ticks, which become communication points.

        A fixed step reaches every tick anyway.
        """
        self._stops = sorted({*self._stops, *ticks})

    @property
    def variable_step(self) -> VariableStepReport | None:
        """How many steps of variable length were made, and how long; None: steps are fixed."""
        if self.plan.variable is None:
            return None
        counts, tick = self._ready().core.step_counts(), float(self.plan.tick)
        return VariableStepReport(
            steps=counts.steps, rejected=counts.rejected, unsatisfied=counts.unsatisfied,
            shortest=min(counts.least, counts.most) * tick, longest=counts.most * tick,
            largest_estimate=counts.worst, time_of_largest=self._seconds(counts.worst_tick),
        )  # fmt: skip

    def run_until(self, time: float | Fraction | str) -> None:
        """Step to the first communication point at or after `time` [s]; errors as of `step`."""
        try:
            ticks = Fraction(str(time)) / self.plan.tick
        except ValueError:
            raise InputInvalid("run_until", f"{time!r}", "seconds") from None
        self.step(max(0, -int(-ticks // 1) - self.tick))

    # ---- values ---------------------------------------------------------------------------

    def get(self, path: str, name: str) -> Any:
        """Read the variable `name` of the component at `path`, in its unit.

        The value of a connected or recorded output is the one visible to others. Raises
        InputInvalid for a name that does not exist.
        """
        tables = self._ready()
        i, variable = self._variable(path, name)
        placed = tables.outputs.get((i, name))
        if placed is not None:
            return decode(variable, tables.raw(placed))
        return self.components[i].get(variable)

    def set(self, path: str, name: str, value: object) -> None:
        """Set an unconnected input, or a tunable parameter, between steps.

        The `value` of the variable `name` of the component at `path` counts from the next step on.
        Raises InputInvalid as `fitted` does.
        """
        tables = self._ready()
        value = self.fitted(path, name, value)
        i, variable = self._settable(path, name)
        self.components[i].set(variable, value)
        placed = tables.inputs.get((i, name))
        if placed is not None:  # the loop sets this input in each step, from its slot
            encode(variable, value, tables.raw(placed))

    def fitted(self, path: str, name: str, value: object) -> Any:
        """Return a `value`, also nested lists or a text with a unit, in the form that `set` needs.

        `path` and `name` are those of `set`. Raises InputInvalid for a value that does not fit, and
        for a variable that cannot be set between steps.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.orchestrator import flatten, prepare
        >>> plan = flatten(uuv.System("bench").add("battery", "model:battery"))
        >>> with uuv.Master(plan, prepare(plan)) as master:
        ...     master.initialize()
        ...     print(float(master.fitted("battery", "current", "0.5 A")))
        0.5
        """
        i, variable = self._settable(path, name)
        try:
            return as_array(
                variable, fit(variable, value, units=self.components[i].description.units)
            )
        except Misfit as misfit:
            raise InputInvalid(str(misfit.at(f"{path}.{name}"))) from None

    def _settable(self, path: str, name: str) -> tuple[int, Variable]:
        i, variable = self._variable(path, name)
        tunable = variable.causality == "parameter" and variable.variability == "tunable"
        if variable.causality != "input" and not tunable:
            raise InputInvalid(
                f"{path}.{name}",
                f"is a {variable.variability} {variable.causality}",
                "an input or a tunable parameter (others: at initialize() or reset())",
            )
        sources = [
            f"{self.plan.components[t.source].path}.{t.source_variable.name}"
            for t in self.plan.transfers
            if (t.target, t.target_variable.name) == (i, name)
        ]
        if sources and len(self.plan.connected[i, name]) == variable.size:
            raise InputInvalid(
                f"{path}.{name}", f"is connected to {sources[0]}", "an unconnected input"
            )
        return i, variable

    def slots(self, path: str, name: str) -> np.ndarray | None:
        """Return a view of the variable `name` of the component at `path`, of `live` or `held`.

        Its numbers change with the run. Its shape is (size,), its type float64, int64 or uint64.
        Writing to that of a held input sets the input, without the checks of `set`. None for a
        variable that the loop does not read or set.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.orchestrator import flatten, prepare
        >>> plan = flatten(uuv.System("tank").add("hull", "model:sphere"))
        >>> tau, eta = ("hull", "tau"), ("hull", "eta")
        >>> with uuv.Master(plan, prepare(plan), live=[eta], held=[tau]) as master:
        ...     master.initialize()
        ...     north = master.slots(*eta)[:1]
        ...     master.slots(*tau)[0] = 10.0  # N, forward
        ...     master.step(100)
        ...     print(f"{north[0]:.2f} m")
        0.10 m
        """
        tables = self._ready()
        i, variable = self._variable(path, name)
        placed = tables.inputs.get((i, name)) if (path, name) in self._held else None
        placed = placed or tables.outputs.get((i, name))
        type_ = Type.of(variable)
        if placed is None or type_.is_blob:
            return None
        return tables.raw(placed).view(type_.dtype)

    @property
    def all_slots(self) -> np.ndarray:
        """View of all values of the loop as float64; the arrays of `slots` are parts of it.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.orchestrator import flatten, prepare
        >>> pushed = {"tau": [10, 0, 0, 0, 0, 0]}  # N, N.m
        >>> plan = flatten(uuv.System("tank").add("hull", "model:sphere", pushed))
        >>> with uuv.Master(plan, prepare(plan), live=[("hull", "eta")]) as master:
        ...     master.initialize()
        ...     before = master.all_slots.copy()
        ...     master.step(10)
        ...     print(any(master.all_slots != before))
        True
        """
        return self._ready().core.slots.view(np.float64)

    @property
    def faults(self) -> Faults:
        """Active faults of signals; a reset clears all.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.orchestrator import Fault, flatten, prepare
        >>> plan = flatten(uuv.load("bluerov2_hold"))
        >>> with uuv.Master(plan, prepare(plan)) as master:
        ...     master.initialize()
        ...     number = master.faults.add(Fault("hull.eta[3]", "bias", 0.5))  # [m]
        ...     master.step(10)
        ...     master.faults.clear(number)
        """
        self._ready()
        assert self._faults is not None
        return self._faults

    # ---- snapshots ------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """Copy the whole state at this communication point.

        Raises FmuError if a component cannot copy its state.
        """
        self._last = self._state.take()
        return self._last

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a `snapshot` of this master; the steps after it are repeated bit for bit.

        Raises InputInvalid for a snapshot of another system.
        """
        if not isinstance(snapshot, Snapshot):
            raise InputInvalid(
                "restore", f"a {type(snapshot).__name__}", "a snapshot that snapshot() returned"
            )
        self._state.restore(snapshot)

    def save_snapshot(self, path: str | Path) -> None:
        """Write the state at this communication point to the file `path`.

        Raises FmuError if a component cannot save its state, InputInvalid if the file cannot be
        written.
        """
        snapshots.save_snapshot(self.snapshot(), Path(path), self.plan, self.components)

    def load_snapshot(self, path: str | Path) -> None:
        """Restore the file `path` that `save_snapshot` wrote, of an equal plan.

        Raises InputInvalid for any other file.
        """
        self.restore(snapshots.load_snapshot(Path(path), self.plan, self.components))

    def restart(
        self,
        path: str,
        snapshot: Snapshot | Literal["start"] | None = None,
        source: str | None = None,
    ) -> None:
        """Continue after the component at `path` failed, from a `snapshot` (default: the last one).

        A new instance replaces it, with its state from the snapshot; or, with `source`, a component
        of another source, which is initialized at the snapshot's time. Without a snapshot, or from
        "start", the whole run is reset. Recorded rows stay, and recording continues after them.
        Raises InputInvalid if the state was lost with the instance, SystemInvalid if a source does
        not fit.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.orchestrator import flatten, prepare
        >>> plan = flatten(uuv.load("bluerov2_hold"))
        >>> with uuv.Master(plan, prepare(plan)) as master:
        ...     master.initialize()
        ...     master.run_until(1.0)
        ...     kept = master.snapshot()
        ...     master.restart("controller", kept, source="model:sliding_mode")
        ...     master.run_until(2.0)
        """
        self._ready()
        i = self._component(path)
        kept = self._last if snapshot is None else None if snapshot == "start" else snapshot
        if source is None:
            self._restart_component(i, kept)
        else:
            self._replace_component(i, kept, source)

    def _restart_component(self, i: int, snapshot: Snapshot | None) -> None:
        """Instantiate component i again, and continue from a snapshot, or from the start."""
        old, planned = self.components[i], self.plan.components[i]
        was_last = snapshot is not None and snapshot is self._last
        # First of all: it raises if the state was lost, and nothing has been changed then.
        states = [] if snapshot is None else [transferable_state(old, snapshot.states[i])]
        fresh = self._instantiate(planned)
        try:
            if snapshot is not None:
                enter_initialization(planned, fresh, {}, None, self._times)
                fresh.exit_initialization_mode()
                snapshot = snapshot.with_state(i, state_of_new_instance(fresh, states[0]))
            tables = self._ready()
            next_row = tables.core.next_row
            tables.replace(tables.order.index(i), fresh)
        except BaseException:
            fresh.free()
            raise
        self._exchange(i, fresh)
        old.free()  # after the new instance has taken its place in the tables
        if snapshot is None:
            self.reset()
            return
        self.restore(snapshot)
        if was_last:  # the state of the freed instance was freed with it
            self._last = snapshot
        self._ready().core.next_row = next_row

    def _replace_component(self, i: int, snapshot: Snapshot | None, source: str) -> None:
        """Replace component i by a component of another source, and continue.

        It passes Initialization Mode at the snapshot's time, with the inputs of that time.
        """
        plan = plan_with(self.plan, i, source)
        old, before = self.components[i], self._ready()
        next_row = before.core.next_row
        if snapshot is not None:
            self._state.restore(snapshot, without=i)
            image = before.core.get_image()
        fresh = self._instantiate(plan.components[i])
        try:
            times = (self.time, self._times[1]) if snapshot is not None else self._times
            enter_initialization(plan.components[i], fresh, {}, None, times)
            set_inputs(fresh, before, i)
            fresh.exit_initialization_mode()
            self._exchange(i, fresh, plan)
        except BaseException:
            fresh.free()
            raise
        old.free()
        if snapshot is None:
            self.reset()
            return
        after = self._ready()
        copy_values(before, after, i, fresh)
        # Only the clock is restored: values and states are in the new tables already.
        clock = 8 * (1 + after.core.n_members)  # the image begins with it
        after.core.set_image(image[:clock] + after.core.get_image()[clock:])
        self.faults.restore(snapshot.faults)
        after.core.next_row = next_row

    def _exchange(self, i: int, fresh: Component, plan: Plan | None = None) -> None:
        """Put a component in another's place; with another `plan`, build tables for that plan."""
        first = self._first
        assert first is not None
        self.components[i] = fresh
        states = tuple(None if j == i else state for j, state in enumerate(first.states))
        self._restart = None
        if plan is not None:
            tables = self._ready()
            if self._record is None:  # the recorded columns must stay the same
                self._record = [(self.plan.components[j].path, v.name) for j, v in self._recorded]
            self.plan, self._hash, self._last = plan, snapshots.plan_hash(plan), None
            self._pools[i] = InstancePool(partial(self._instantiate, plan.components[i]))
            self._build_tables(begin=False)
            tables.core.forget()
            self._retired.append(tables)
        self._first = Snapshot(self._hash, states)
        self._find_drains()

    # ---- inside: Initialization Mode ------------------------------------------------------

    def _leave_initialization(self) -> None:
        """Solve Initialization Mode, leave it, and read the outputs at the start.

        The order matters. Inputs are set first, because outputs and derivatives depend on them. The
        tables are made once all components have left the mode: only then does C call them. Slots of
        unconnected inputs are filled before `begin`, which reads outputs and writes the first row.
        """
        if self._restart is None:
            propagate(self.plan, self.components, self._times[0])
        elif failed := self._restart.propagate(self._start_tick, self._times[0]):
            self._fail(failed)
        self._check_loops()  # needs derivatives at the initial values, so before the mode ends
        for component in self.components:
            component.exit_initialization_mode()
        if self._tables is None:
            self._build_tables()
        tables = self._ready()
        tables.show_unconnected(self.components)
        start_clocks(tables.core, self.plan.tick, self.components, tables.order, tables.clocks,
                     self._start_tick)  # fmt: skip
        failure = tables.core.begin(self._start_tick)
        self._emit()
        if failure is not None:
            self._fail(failure)

    def _check_loops(self) -> None:
        """Refuse an iterated loop of gain 1, and warn of a delayed one that diverges."""
        for loop in self.plan.algebraic_loops:
            if loop.undeclared:
                continue
            try:
                gain = loop_gain(self.plan, loop, self.components, self._times[0])
            except FmuError:  # a member gives no derivative here
                log.debug("the gain of a loop is not known", exc_info=True)
                continue
            hops = hops_of(self.plan, loop)
            if gain is not None and loop.iterated and gain.is_singular:
                raise LoopNotConverged(
                    f"algebraic loop {hops}: its gain is 1 at t = {self._times[0]:.9g} s, so it "
                    "has no single solution; expected another gain, or a component with a state "
                    "in the loop"
                )
            remark = "" if loop.iterated else delay_remark(hops, gain)
            if remark and remark not in self._remarks:  # a reset finds it a second time
                self._remarks.append(remark)
                log.warning("%s", remark)

    def _build_tables(self, *, begin: bool = True) -> None:
        recorded: list[tuple[int, Variable]] = []
        if self._watch.observers and self._record is not None:
            recorded = [self._variable(path, name) for path, name in self._record]
        elif self._watch.observers:
            outputs = [(i, c.description.of("output")) for i, c in enumerate(self.components)]
            recorded = [(i, v) for i, vs in outputs for v in vs if v.type != "Clock"]
        self._recorded = recorded
        columns = [c for i, v in recorded for c in Column.of(self.plan.components[i].path, v)]
        self.recorded = len(columns)
        n_rows = rows_of(len(columns))
        live, held = ([self._variable(*n) for n in names] for names in (self._live, self._held))
        self._tables = tables_of(
            self.plan, self.components, recorded, self._every, n_rows, live, held, serve
        )
        if not self._measured:
            self._tables.core.measure_nothing()
        self._faults = Faults(self._tables, hash_of_seeds(self.plan))
        self._loop_state = LoopState(self._hash, self._tables, self.components, self._faults)
        if begin:
            self._watch.begin(columns)
            if self._watch.observers:
                self._at_exit = AtComponentExit(self._end_watch)

    # ---- inside: the rest -----------------------------------------------------------------

    def _find_drains(self) -> None:
        """Find the components whose messages are fetched after steps.

        A loop over all of them in Python costs more than a step, so C looks at their numbers.
        """
        self._drains: list[Callable[[], None]] = []
        self._counted: list[Callable[[], None]] = []
        known: list[int] = []
        for component in self.components:
            drain = getattr(component, "drain_messages", None)
            count = getattr(component, "waiting_messages", None)
            if drain is not None:
                (self._counted if count else self._drains).append(drain)
                known += [count] if count else []
        self._counts = (ctypes.c_void_p * len(known))(*known)

    @property
    def _state(self) -> LoopState:
        self._ready()
        assert self._loop_state is not None
        return self._loop_state

    def _emit(self) -> None:
        for drain in self._drains:
            drain()
        if library().uuv_core_any(self._counts, len(self._counts)):
            for drain in self._counted:
                drain()
        tables = self._ready()
        if self.plan.events:
            self.events += [
                Event(
                    self.plan.components[tables.order[e.member]].path, e.tick, e.offset,
                    self._seconds(e.tick) + e.offset, cause_of(e, tables.clocks),
                )
                for e in tables.core.take_events()
            ]  # fmt: skip
        self._watch.emit(tables.core)

    def _end_watch(self) -> None:
        """Close the observers, after the rows that an interrupted step has not passed on."""
        try:
            if self._tables is not None:
                self._watch.emit(self._tables.core)
        except UuvsimError:
            # The failure itself has been raised already.
            log.debug("the last rows are lost", exc_info=True)
        finally:
            self._watch.end()

    def _fail(self, failure: Failure) -> None:
        """Raise the error of a failure.

        If the component has made its whole step and asks to end the simulation there, the step
        counts: the others make it too, and it is recorded.
        """
        tables, time = self._ready(), self._seconds(failure.tick)
        error = error_of(failure, tables, self.components, time)
        if not (isinstance(error, ComponentFailed) and error.asks_to_end):
            raise error
        ticks = self.plan.components[tables.order[failure.member]].step_ticks
        begin, end = self._seconds(failure.tick), self._seconds(failure.tick + ticks)
        in_c = failure.outcome == Outcome.ENDED
        if self.plan.variable is not None:  # the others would make a step of another length
            raise error
        whole = failure.status == 1 if in_c else error.time >= end - 1e-6 * (end - begin)
        if whole and tables.core.accept_step(failure.member):
            self.step(ticks)
            raise ComponentFailed(error.path, self.time, error.reason, asks_to_end=True)
        raise error

    def _ready(self) -> Tables:
        if self._tables is None:
            raise InputInvalid("the master has not been initialized, or is freed")
        return self._tables

    def _component(self, path: str) -> int:
        if path not in self._index:
            raise InputInvalid(f"no component {path!r}", f"one of {', '.join(sorted(self._index))}")
        return self._index[path]

    def _variable(self, path: str, name: str) -> tuple[int, Variable]:
        i = self._component(path)
        return i, variable_of(self.components[i], name)

    def _seconds(self, tick: int) -> float:
        return float(tick * self.plan.tick.numerator) / float(self.plan.tick.denominator)
