"""A Model Exchange FMU as a component: it is integrated here, and its events are located.

Inputs are constant during a communication step. The integrator starts again at each communication
point. A step therefore depends only on the FMU's state, and a replay from a snapshot is identical.
"""

from __future__ import annotations

import math
import struct
from typing import final

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import Binding, BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.fmu_binary import FmuState, Phase
from uuvsim_cosim.fmus.importer.versions import AnyFmu
from uuvsim_cosim.fmus.model_exchange.calls import Calls, calls_of
from uuvsim_cosim.fmus.model_exchange.solver import Solver

__all__ = ["ModelExchange"]

_EVENTS = 10_000  # in one communication step, before it counts as endless
_ROUNDS = 100  # of one event iteration
_IMPLICIT = "while they are stiff, an implicit solver (CVODE) integrates them"
_State = tuple[FmuState, float]


@final
class ModelExchange:
    """The `Component` protocol over an FMU that computes derivatives instead of steps."""

    def __init__(self, fmu: AnyFmu) -> None:
        self.path = fmu.path
        self.description = fmu.description
        self.messages = fmu.messages
        self._fmu = fmu
        self.get, self.directional_derivative = fmu.get, fmu.directional_derivative
        self.enter_initialization_mode = fmu.enter_initialization_mode
        self.terminate, self.drain_messages = fmu.terminate, fmu.drain_messages
        self._calls: Calls | None = None
        self._solver: Solver | None = None
        self._next_event = math.inf
        self._stiff_before = False  # and this has been reported

    # ---- values and life cycle ----------------------------------------------------------------

    def set(self, variable: Variable, value: object) -> None:
        """Set a value; between steps, only continuous inputs are set outside of Event Mode."""
        event = self._fmu.phase is Phase.STEP and not (
            variable.causality == "input" and variable.variability == "continuous"
        )
        if not event:
            self._fmu.set(variable, value)
            return
        self._live().enter_event_mode()
        self._fmu.set(variable, value)
        self._iterate_event(self._fmu.time)

    def exit_initialization_mode(self) -> None:
        """Leave Initialization Mode, which ends in Event Mode; stepping may begin."""
        self._fmu.exit_initialization_mode()
        self._calls = calls_of(self._fmu)
        self._solver = None
        self._iterate_event(self._fmu.time)

    def reset(self) -> None:
        """Go back to the state after instantiation."""
        self._solver = self._calls = None
        self._fmu.reset()

    def free(self) -> None:
        """Free the instance; a second call does nothing."""
        self._solver = self._calls = None
        self._fmu.free()

    def get_fmu_state(self) -> _State:
        """Copy the state."""
        return self._fmu.get_fmu_state(), self._next_event

    def set_fmu_state(self, state: _State) -> None:
        """Restore a state of this instance."""
        self._fmu.set_fmu_state(state[0])
        self._next_event = state[1]

    def serialize_fmu_state(self, state: _State) -> bytes:
        """Convert a state to bytes."""
        return struct.pack("<d", state[1]) + self._fmu.serialize_fmu_state(state[0])

    def deserialize_fmu_state(self, data: bytes) -> _State:
        """Convert bytes to a state of this instance."""
        if len(data) < 8:
            raise FmuError(f"{self.path}: {len(data)} bytes that are no serialised state")
        return self._fmu.deserialize_fmu_state(data[8:]), struct.unpack("<d", data[:8])[0]

    def binding(self) -> Binding:
        """Return that the stepping loop in C has to call Python."""
        return Binding(BindingKind.CALLBACK, 0, {})

    # ---- integration --------------------------------------------------------------------------

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Integrate to the end of the step, with an event wherever there is one."""
        time, end = current_communication_point, current_communication_point + step_size
        self._fmu.time = time
        calls = self._live()
        calls.set_time(time)
        for _ in range(_EVENTS):
            time, crossed = self._integrate(time, min(end, self._next_event))
            self._fmu.time = time
            calls.set_time(time)
            wanted, ends = calls.completed_integrator_step()
            if ends:
                raise ComponentFailed(self.path, time, "it asks to end the simulation", True)
            if crossed or wanted or time >= self._next_event:
                calls.enter_event_mode()
                self._iterate_event(time)
            if time >= end:
                return
        raise ComponentFailed(
            self.path, time,
            f"more than {_EVENTS} events in a communication step of {step_size:g} s; expected "
            "a model whose events do not accumulate",
        )  # fmt: skip

    def _integrate(self, time: float, until: float) -> tuple[float, bool]:
        """Go to `until` [s] or to the first event indicator that crosses zero."""
        calls = self._live()
        if until - time <= 4e-16 * max(1.0, abs(until)) or not (calls.states or calls.indicators):
            return until, False
        if self._solver is None:
            self._solver = Solver(calls, self._fmu.archive.tolerance)
        try:
            reached = self._solver.integrate(time, until)
        except RuntimeError as error:
            raise ComponentFailed(self.path, time, f"integration stopped: {error}") from error
        if self._solver.stiff and not self._stiff_before:
            self._stiff_before = True
            self._fmu.remark(f"its equations are stiff at t = {time:.6g} s: {_IMPLICIT}")
        return reached

    def _iterate_event(self, time: float) -> None:
        """Repeat until the discrete states do not change, then enter Continuous-Time Mode."""
        calls = self._live()
        for _ in range(_ROUNDS):
            event = calls.update_discrete_states()
            if event.ends:
                raise ComponentFailed(self.path, time, "it asks to end the simulation", True)
            if not event.again:
                self._next_event = event.next_time
                calls.enter_continuous_time_mode()
                return
        raise ComponentFailed(
            self.path, time, f"its event iteration does not end within {_ROUNDS} rounds"
        )

    def _live(self) -> Calls:
        if self._calls is None:
            raise FmuError(f"{self.path}: stepped before Initialization Mode was left")
        return self._calls
