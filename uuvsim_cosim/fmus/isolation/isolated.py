"""A component in its own process, so that its crash or hang is only an error here.

Calls go through pipes. A stepping loop in C uses shared memory (`segment`) instead, if there is
any, once `serve` has started its counterpart in the child.
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
from threading import TIMEOUT_MAX
from typing import IO, TYPE_CHECKING, Any, Protocol, final

from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, UuvsimError
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.isolation.answers import load_answer
from uuvsim_cosim.fmus.isolation.confinement import Rules

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

    from uuvsim_cosim.fmus.isolation.refusals import Refusals

__all__ = ["NO_SANDBOX", "Isolated", "check_watchdog"]

NO_SANDBOX = "an isolated FMU may use files, sockets, processes and memory"


def check_watchdog(seconds: float, what: str = "watchdog") -> None:
    """Check a time limit; raises InputInvalid."""
    if not 0.0 < seconds <= TIMEOUT_MAX:
        raise InputInvalid(f"{what} {seconds:g}: expected more than 0 seconds, such as 30")


_GRACE = 2.0  # [s] until a child that was asked to end is killed
_START = 60.0  # [s] at least, for a child to start Python and import its modules


class Stepper(Protocol):
    """A stepping loop's access to the child without the pipes."""

    def leave(self) -> None:
        """Let the child answer on its pipe again."""

    def close(self) -> None:
        """Release the memory, after the child's end."""

    def messages_wait(self) -> bool:
        """Return whether the component has messages."""


class RemoteState:
    """A state that the child holds, by its number; released with its last reference here.

    `data` are its bytes, if the component can serialise it: they outlive the child.
    """

    def __init__(self, number: int, orphans: list[int], data: bytes | None = None) -> None:
        self.number = number
        self.data = data
        self._orphans = orphans

    def is_of(self, orphans: list[int]) -> bool:
        """Return whether the state is held by the child with this list of orphans."""
        return self._orphans is orphans

    def __del__(self) -> None:
        self._orphans.append(self.number)  # the next call tells the child to release it


@final
class Isolated:
    """The `Component` protocol over pipes to a child, which makes the component by `factory`.

    `factory` is a function at a module's top level. A call that takes longer than `watchdog`
    seconds ends the child. Without `shared`, and on systems without anonymous shared memory,
    `segment` is None, and a stepping loop uses the pipes as well. Without `wait`, several children
    can start at the same time, and an error of the start is raised by the first call.

    `rules` are the sandbox of an FMU, which the child applies before it loads the FMU's library.
    Refused accesses are notes among the messages; `lacking` has a sentence for each protection that
    this system does not have, once the component is made.
    """

    def __init__(
        self,
        path: str,
        description: Description,
        factory: Callable[..., Component],
        arguments: Sequence[object],
        *,
        watchdog: float | None = None,
        shared: bool = True,
        wait: bool = True,
        rules: Rules | None = None,
    ) -> None:
        if watchdog is not None:
            check_watchdog(watchdog)
        self.path = path
        self.description = description
        self.messages: list[tuple[str, str]] = []
        self.watchdog = watchdog
        # Memory without a name, which is freed with the last process that has it open.
        make = getattr(os, "memfd_create", None) if shared else None
        self.segment = None if make is None else _shared_memory(make)
        self._stepper: Stepper | None = None
        self._time = 0.0
        self._orphans: list[int] = []
        self._logger = logging.getLogger(f"uuvsim_cosim.{path}")
        self._output = tempfile.TemporaryFile()  # noqa: SIM115
        self.lacking: list[str] = []
        self._refusals: Refusals | None = None
        module, more, given = "isolated_child", [], [] if self.segment is None else [self.segment]
        if rules is not None and sys.platform == "linux":
            from uuvsim_cosim.fmus.isolation.refusals import Refusals

            self._refusals = Refusals(path, rules, self._note)
            descriptor = self._refusals.given.fileno()
            given.append(descriptor)
            module, more = "confined_child", [str(descriptor), rules.to_text()]
        elif rules is not None:
            self.lacking.append(f"{sys.platform} is not Linux: {NO_SANDBOX}")
        search = os.pathsep.join(p for p in sys.path if p)
        self._child: subprocess.Popen[bytes] | None = subprocess.Popen(
            [
                sys.executable,
                *(["-P"] if more else []),  # the current folder may not be read
                "-m",
                f"uuvsim_cosim.fmus.isolation.{module}",
                str(self.segment or 0),
                *more,
            ],
            pass_fds=given,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._output,
            env={**os.environ, "PYTHONPATH": search},
        )
        if self._refusals is not None:
            self._refusals.start()
        self._starting = True
        with contextlib.suppress(OSError):  # if the child is gone, waiting for the answer raises
            _send(self._child.stdin, ("instantiate", (factory, tuple(arguments)), []))
        if wait:
            self._started(self._child)

    # ---- the protocol -------------------------------------------------------------------------

    def get(self, variable: Variable) -> Any:
        """Read a value."""
        return self._call("get", variable.name)

    def set(self, variable: Variable, value: object) -> None:
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
        """Copy the state, which stays in the child, and its bytes if it can be serialised."""
        number, data = self._call("get_fmu_state")
        return RemoteState(number, self._orphans, data)

    def set_fmu_state(self, state: RemoteState) -> None:
        """Restore a state; a state of another process must have been serialised."""
        if not state.is_of(self._orphans):
            if state.data is None:
                raise FmuError(
                    f"{self.path}: the state was held by a process that has ended, because "
                    f"{self.description.name} cannot serialise its state"
                )
            state = self.deserialize_fmu_state(state.data)
        self._call("set_fmu_state", state.number)

    def serialize_fmu_state(self, state: RemoteState) -> bytes:
        """Convert a state to bytes."""
        if state.data is not None:
            return state.data
        data: bytes = self._call("serialize_fmu_state", state.number)
        return data

    def deserialize_fmu_state(self, data: bytes) -> RemoteState:
        """Convert bytes to a state."""
        return RemoteState(self._call("deserialize_fmu_state", data), self._orphans)

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: ArrayLike
    ) -> np.ndarray:
        """Return d(unknowns)/d(knowns) · seed."""
        names = [[v.name for v in group] for group in (unknowns, knowns)]
        result: np.ndarray = self._call("directional_derivative", *names, seed)
        return result

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
                with contextlib.suppress(OSError):  # a living child ends at the end of its input
                    pipe.close()
        try:
            child.wait(_GRACE)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        self._output.close()
        if self._refusals is not None:
            self._refusals.close()
        if stepper is not None:
            stepper.close()
        if self.segment is not None:
            os.close(self.segment)
            self.segment = None

    def binding(self) -> Binding:
        """Return that a stepping loop in C uses shared memory, or else has to call Python."""
        return Binding(BindingKind.CALLBACK if self.segment is None else BindingKind.SHARED, 0, {})

    # ---- for a stepping loop ------------------------------------------------------------------

    @property
    def process(self) -> int | None:
        """The child's process number; None if it is gone."""
        return None if self._child is None else self._child.pid

    def ask(self, function: Callable[..., object], *arguments: object) -> Any:
        """Call a function at a module's top level, in the child, with the component first."""
        return self._call("ask", function, arguments)

    def serve(
        self, stepper: Stepper, make: Callable[..., object], arguments: Sequence[object]
    ) -> None:
        """Let a stepping loop step the child through `segment`.

        ``make(component, segment, pipe, *arguments)`` returns the counterpart in the child, a
        `Serving` (see `isolated_child`).
        """
        self._call("serve", make, tuple(arguments))
        self._stepper = stepper

    def unserved(self, stepper: Stepper) -> None:
        """Let the child answer on its pipe again, and release the stepper if it is in use."""
        if self._stepper is stepper:
            self._stepper = None
            stepper.leave()

    def why(self, time: float) -> BaseException:
        """Return the error of the last step through shared memory."""
        self._time = time
        try:
            self._call("why", time)
        except UuvsimError as error:
            return error
        return ComponentFailed(self.path, time, "it failed without a message")

    def lost(self, time: float, *, late: bool) -> ComponentFailed:
        """Return the error for a child that died in a step, or did not answer."""
        self._time = time
        if self._child is None:
            return ComponentFailed(self.path, time, "its process died before")
        return self._died(self._child, late)

    def drain_messages(self) -> None:
        """Fetch the messages of the component's steps."""
        if self._stepper is not None and self._child is not None and self._stepper.messages_wait():
            self._call("messages")

    # ---- the pipes ----------------------------------------------------------------------------

    def _call(self, method: str, *arguments: object) -> Any:
        """Call a method of the component in the child; return its result."""
        child = self._child
        if child is None:
            raise FmuError(
                self.path,
                (
                    "used after it was freed, or after its process died or a call of "
                    "it was interrupted"
                ),
                "a new instance",
            )
        if self._starting:
            self._started(child)
        if self._stepper is not None:
            self._stepper.leave()
        dropped = [self._orphans.pop() for _ in range(len(self._orphans))]
        imports = method in ("ask", "serve")
        return self._answer(child, (method, arguments, dropped), imports=imports)

    def _started(self, child: subprocess.Popen[bytes]) -> None:
        """Wait until the child has imported its modules, then until the component is made."""
        self._starting = False
        try:
            self._answer(child, None, imports=True)
            self._answer(child, None)
        except BaseException:
            self.free()
            raise
        if self._refusals is not None:
            self._refusals.wait_until_told()
            self.lacking += self._refusals.lacking
        for sentence in self.lacking:
            self._logger.warning("%s", sentence)

    def _answer(
        self, child: subprocess.Popen[bytes], call: object, *, imports: bool = False
    ) -> Any:
        """Send a call, unless it is None, and wait for the next answer."""
        late = threading.Event()

        def end() -> None:
            late.set()
            child.kill()

        timer = None
        if self.watchdog is not None:
            limit = max(self.watchdog, _START) if imports else self.watchdog
            timer = threading.Timer(limit, end)
            timer.daemon = True
            timer.start()
        try:
            if call is not None:
                _send(child.stdin, call)
            assert child.stdout is not None
            status, result, messages = load_answer(child.stdout)
        except (EOFError, OSError):
            raise self._died(child, late.is_set()) from None
        except pickle.UnpicklingError as error:  # an FMU wrote into the pipe
            self.free()
            reason = f"its process sent what is no answer ({error}), and was ended"
            raise ComponentFailed(self.path, self._time, self._explained(reason)) from None
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
            failed, time, reason, *asks = result
            raise ComponentFailed(failed, time, self._explained(reason), *asks)
        if status == "refused":
            raise FmuError(self._explained(result))
        return result

    def _died(self, child: subprocess.Popen[bytes], late: bool) -> ComponentFailed:
        """Free the child; return the error with its exit status and its last line of output."""
        if late:
            child.kill()
        try:
            status = child.wait(_GRACE)
        except subprocess.TimeoutExpired:
            child.kill()
            status = child.wait()
        self._output.seek(0)
        lines = self._output.read().decode(errors="replace").strip().splitlines()
        self.free()
        if late:
            reason = f"did not answer within {self.watchdog} s; its process was ended"
        else:
            how = f"signal {-status}" if status < 0 else f"status {status}"
            last = lines[-1] if lines else ""
            report = last.removeprefix("uuvsim: ")
            if report != last:  # the guard's report, without the name of the component
                last = report.partition(", which ends")[0].partition("; in a ")[0]
            reason = f"its process died ({how})" + (f": {last[:200]}" if lines else "")
        return ComponentFailed(self.path, self._time, self._explained(reason))

    # ---- the sandbox --------------------------------------------------------------------------

    def _note(self, text: str) -> None:
        """Report a refused access; called in a thread of its own."""
        self.messages.append(("note", text))
        self._logger.warning("%s", text)

    def _explained(self, reason: str) -> str:
        """Return the reason of a failure with the last access that was refused."""
        last = "" if self._refusals is None else self._refusals.last
        return f"{reason}; {last}" if last else reason


def _shared_memory(make: Callable[[str, int], int]) -> int:
    """Return memory without a name, which the child cannot make smaller: reading it would fail."""
    import fcntl

    made = make("uuvsim-exchange", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    fcntl.fcntl(made, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)
    return made


def _send(pipe: IO[bytes] | None, message: object) -> None:
    assert pipe is not None
    pickle.dump(message, pipe, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.flush()
