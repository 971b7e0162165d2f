"""A component in a process of its own: its crash or hang is an error here, nothing more.

Calls go through pipes. A stepping loop in C goes through shared memory instead, where there is
some (`segment`), once it has been introduced by `serve`.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO, Protocol, final

from uuvsim_cosim.errors import ComponentFailed, FmuError, UuvsimError
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.isolation.watchdog import check_watchdog

__all__ = ["Isolated"]

_GRACE = 2.0  # [s] that a child is given to end by itself
_START = 60.0  # [s] at least, to start Python and import what is needed


class Stepper(Protocol):
    """What steps the child without the pipes."""

    def leave(self) -> None:
        """Let the child answer on its pipe."""

    def close(self) -> None:
        """Release the memory; the child is gone."""

    def messages_wait(self) -> bool:
        """Return whether the component has said something."""


class RemoteState:
    """A state that the child holds, by its number; given up when nobody holds it here.

    `data` are its bytes, if the component can serialise it: they outlive the child.
    """

    def __init__(self, number: int, orphans: list[int], data: bytes | None = None) -> None:
        self.number = number
        self.data = data
        self._orphans = orphans

    def is_of(self, orphans: list[int]) -> bool:
        """Return whether the child whose list this is holds the state."""
        return self._orphans is orphans

    def __del__(self) -> None:
        self._orphans.append(self.number)


@final
class Isolated:
    """The `Component` protocol over pipes to a child, which makes the component by `factory`.

    `factory` is a function at a module's top level. A call that takes longer than `watchdog`
    seconds ends the child. Without `shared`, and where there is no shared memory without a name,
    `segment` is None, and a stepping loop goes through the pipes as well. Without `wait`, the
    child starts while others do, and what keeps it from being made is raised by the first call.
    """

    def __init__(
        self,
        path: str,
        description: Description,
        factory: Callable[..., Component],
        arguments: Sequence[Any],
        *,
        watchdog: float | None = None,
        shared: bool = True,
        wait: bool = True,
    ) -> None:
        if watchdog is not None:
            check_watchdog(watchdog)
        self.path = path
        self.description = description
        self.messages: list[tuple[str, str]] = []
        self.watchdog = watchdog
        self.segment = _segment() if shared else None
        self._stepper: Stepper | None = None
        self._time = 0.0
        self._orphans: list[int] = []
        self._logger = logging.getLogger(f"uuvsim_cosim.{path}")
        self._words = tempfile.TemporaryFile()  # noqa: SIM115
        search = os.pathsep.join(p for p in sys.path if p)
        self._child: subprocess.Popen[bytes] | None = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "uuvsim_cosim.fmus.isolation.isolated_child",
                str(self.segment or 0),
            ],
            pass_fds=() if self.segment is None else (self.segment,),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._words,
            env={**os.environ, "PYTHONPATH": search},
        )
        self._starting = True
        with contextlib.suppress(OSError):  # a child that is gone is noticed by the answer
            _send(self._child.stdin, ("instantiate", (factory, tuple(arguments)), []))
        if wait:
            self._started(self._child)

    # ---- the protocol -------------------------------------------------------------------------

    def get(self, variable: Variable) -> Any:
        """Read a value."""
        return self._call("get", variable.name)

    def set(self, variable: Variable, value: Any) -> None:
        """Set a value of the variable's shape."""
        self._call("set", variable.name, value)

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Enter Initialization Mode."""
        self._time = start_time
        self._call("enter_initialization_mode", start_time, stop_time)

    def exit_initialization_mode(self) -> None:
        """Leave Initialization Mode."""
        self._call("exit_initialization_mode")

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance; raises ComponentFailed, also if the child died or hangs."""
        self._time = current_communication_point
        self._call("do_step", current_communication_point, step_size)

    def get_fmu_state(self) -> RemoteState:
        """Copy the state, which stays with the child, and its bytes, if it has any."""
        number, data = self._call("get_fmu_state")
        return RemoteState(number, self._orphans, data)

    def set_fmu_state(self, state: RemoteState) -> None:
        """Restore a state; one of another process only if it has been serialised."""
        if not state.is_of(self._orphans):
            if state.data is None:
                raise FmuError(
                    f"{self.path}: the state was held by a process that is gone, for "
                    f"{self.description.name} cannot serialise its state"
                )
            state = self.deserialize_fmu_state(state.data)
        self._call("set_fmu_state", state.number)

    def serialize_fmu_state(self, state: RemoteState) -> bytes:
        """Turn a state into bytes."""
        if state.data is not None:
            return state.data
        data: bytes = self._call("serialize_fmu_state", state.number)
        return data

    def deserialize_fmu_state(self, data: bytes) -> RemoteState:
        """Turn bytes into a state."""
        return RemoteState(self._call("deserialize_fmu_state", data), self._orphans)

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: Any
    ) -> Any:
        """Return d(unknowns)/d(knowns) · seed."""
        names = [[v.name for v in group] for group in (unknowns, knowns)]
        return self._call("directional_derivative", *names, seed)

    def reset(self) -> None:
        """Go back to the state after instantiation."""
        self._call("reset")

    def terminate(self) -> None:
        """End stepping; does nothing if the child is gone."""
        if self._child is not None:
            self._call("terminate")

    def free(self) -> None:
        """Free the component and end the child; a second call does nothing."""
        child, self._child = self._child, None
        if child is None:
            return
        stepper, self._stepper = self._stepper, None
        if stepper is not None:
            stepper.leave()
        for pipe in (child.stdin, child.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):  # the child, if alive, ends on end of file
                    pipe.close()
        try:
            child.wait(_GRACE)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        self._words.close()
        if stepper is not None:
            stepper.close()
        if self.segment is not None:
            os.close(self.segment)
            self.segment = None

    def binding(self) -> Binding:
        """Say that a stepping loop in C goes through shared memory, or has to call Python."""
        kind = BindingKind.CALLBACK if self.segment is None else BindingKind.SHARED
        return Binding(kind, 0, {})

    # ---- for a stepping loop ------------------------------------------------------------------

    @property
    def process(self) -> int | None:
        """Return the child's process number; None when it is gone."""
        return None if self._child is None else self._child.pid

    def ask(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function at a module's top level, in the child, with the component first."""
        return self._call("ask", function, arguments)

    def serve(self, stepper: Stepper, make: Callable[..., Any], arguments: Sequence[Any]) -> None:
        """Let the child be stepped through `segment`, by what `make` makes there.

        ``make(component, segment, pipe, *arguments)`` gives an object with `run`, `forget`,
        `error` and `close`.
        """
        self._call("serve", make, tuple(arguments))
        self._stepper = stepper

    def unserved(self, stepper: Stepper) -> None:
        """Let the child make way, and give up the stepper, if it is this one's."""
        if self._stepper is stepper:
            self._stepper = None
            stepper.leave()

    def why(self, time: float) -> BaseException:
        """Return the error that the last step through shared memory ended with."""
        self._time = time
        try:
            self._call("why", time)
        except UuvsimError as error:
            return error
        return ComponentFailed(self.path, time, "it failed, and does not say why")

    def lost(self, time: float, *, late: bool) -> ComponentFailed:
        """Return the error for a child that died in a step, or did not answer."""
        self._time = time
        if self._child is None:
            return ComponentFailed(self.path, time, "its process died before")
        return self._died(self._child, late)

    def drain_messages(self) -> None:
        """Take over what the component has said in steps."""
        if self._stepper is not None and self._child is not None and self._stepper.messages_wait():
            self._call("messages")

    # ---- the wire -----------------------------------------------------------------------------

    def _call(self, method: str, *arguments: Any) -> Any:
        child = self._child
        if child is None:
            raise FmuError(
                f"{self.path}: used after it was freed, or after its process died or a call of it "
                "was interrupted; expected a new instance"
            )
        if self._starting:
            self._started(child)
        if self._stepper is not None:
            self._stepper.leave()
        dropped = [self._orphans.pop() for _ in range(len(self._orphans))]
        imports = method in ("ask", "serve")
        return self._answer(child, (method, arguments, dropped), imports=imports)

    def _started(self, child: subprocess.Popen[bytes]) -> None:
        """Wait until the child has imported what it needs, then until the component is made."""
        self._starting = False
        try:
            self._answer(child, None, imports=True)
            self._answer(child, None)
        except BaseException:
            self.free()
            raise

    def _answer(self, child: subprocess.Popen[bytes], call: Any, *, imports: bool = False) -> Any:
        """Send a call, if there is one, and wait for the next answer."""
        late = threading.Event()
        timer = self._timer(child, late, imports)
        try:
            if call is not None:
                _send(child.stdin, call)
            status, result, messages = _load(child.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise self._died(child, late.is_set()) from None
        except BaseException:  # an interruption: the next call must not read this call's answer
            child.kill()
            self.free()
            raise
        finally:
            if timer is not None:
                timer.cancel()
        for level, text in messages:
            self.messages.append((level, text))
            severe = logging.INFO if level == "ok" else logging.WARNING
            self._logger.log(severe, "%s", text)
        if status == "failed":
            raise ComponentFailed(*result)
        if status == "refused":
            raise FmuError(result)
        return result

    def _timer(
        self, child: subprocess.Popen[bytes], late: threading.Event, imports: bool
    ) -> threading.Timer | None:
        if self.watchdog is None:
            return None

        def end() -> None:
            late.set()
            child.kill()

        limit = max(self.watchdog, _START) if imports else self.watchdog
        timer = threading.Timer(limit, end)
        timer.daemon = True
        timer.start()
        return timer

    def _died(self, child: subprocess.Popen[bytes], late: bool) -> ComponentFailed:
        if late:
            child.kill()
        try:
            status = child.wait(_GRACE)
        except subprocess.TimeoutExpired:
            child.kill()
            status = child.wait()
        self._words.seek(0)
        words = self._words.read().decode(errors="replace").strip().splitlines()[-1:]
        self.free()
        if late:
            reason = f"did not answer within {self.watchdog} s; its process was ended"
        else:
            how = f"signal {-status}" if status < 0 else f"status {status}"
            reason = f"its process died ({how})" + (f": {_own(words[0])[:200]}" if words else "")
        return ComponentFailed(self.path, self._time, reason)


def _own(words: str) -> str:
    """Return a component's last words, or what the guard of its process says of its end."""
    guard = words.removeprefix("uuvsim: ")
    return words if guard == words else guard.partition(", which ends")[0].partition("; in a ")[0]


def _segment() -> int | None:
    """Return memory without a name, which is gone with the last process that has it."""
    make = getattr(os, "memfd_create", None)
    return None if make is None else int(make("uuvsim-exchange"))


def _send(pipe: Any, message: Any) -> None:
    sink: BinaryIO = pipe
    pickle.dump(message, sink, protocol=pickle.HIGHEST_PROTOCOL)
    sink.flush()


def _load(pipe: Any) -> Any:
    source: BinaryIO = pipe
    return pickle.load(source)
