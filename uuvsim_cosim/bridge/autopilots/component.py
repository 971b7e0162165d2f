"""The part that autopilots as components share: life, commands and motion."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Generic, NamedTuple, NoReturn, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.bridge.autopilots.commands import AutopilotCommands
from uuvsim_cosim.bridge.autopilots.sitl_process import SitlProcess
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, UuvsimError
from uuvsim_cosim.fmus.component import Binding, BindingKind
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.orchestrator.master.slot_row import SlotRow

__all__ = ["RATE", "Autopilot", "Motion", "lowered", "rotation"]

INSTANCES = 10  # that are tried with instance=auto
RATE = 400  # Hz of the steps before the start
_HEARTBEAT, _PILOT, _AGAIN = 1.0, 0.1, 1.0  # s between two messages
_OUTDATED = 1.5  # s from the last report of a target until there is none


class Motion(NamedTuple):
    """Motion that an autopilot's sensors measure: position and velocity in n, the rest in b."""

    gyro: Sequence[float]  # rad/s
    acc: Sequence[float]  # m/s2, specific force at CO
    position: Sequence[float]  # m
    velocity: Sequence[float]  # m/s
    R: Sequence[Sequence[float]]  # from b to n


class _Link(Protocol):
    counts: dict[str, int]

    def close(self) -> None: ...


L = TypeVar("L", bound=_Link)


class Autopilot(ABC, Generic[L]):
    """The `Component` protocol around a program, which runs from initialization to the end.

    A subclass connects by a link of type L, and exchanges one packet in each `_tick`.
    """

    name: str  # in messages
    guided: int  # number of the mode in which it follows `eta_d`
    streams = False  # whether it needs `eta_d` regularly, also if it rests
    _inputs: tuple[float, ...]
    _setpoint: tuple[float, ...]  # pose and velocity that were sent

    def __init__(self, options: dict[str, str], path: str, description: Description) -> None:
        """Keep the options; the program starts at the end of initialization."""
        self.path = path
        self.description = description
        self._in, self._out = (SlotRow(description.of(c)) for c in ("input", "output"))
        # Inputs that are sent in every step come first; commands and readings follow.
        self._n_state = self._in.places["altitude"].stop
        self._options = options
        self._timeout = float(options["timeout"])
        self._link: L | None = None
        self._process: SitlProcess | None = None
        self._commands: AutopilotCommands | None = None
        self.reset()

    def get(self, variable: Variable) -> Any:
        """Read a value; a copy."""
        if variable.causality == "parameter":
            value = self._parameters[variable.name]
            return value.copy() if isinstance(value, np.ndarray) else value
        row, numbers = (
            (self._in, self._inputs) if variable.causality == "input" else
            (self._out, self._out.unpack(self._row))
        )  # fmt: skip
        found = numbers[row.places[variable.name]]
        if variable.shape:
            return np.array(found)
        return bool(found[0]) if variable.type == "Boolean" else found[0]

    def set(self, variable: Variable, value: Any) -> None:
        """Set an input or a parameter."""
        if variable.causality == "parameter":
            self._parameters[variable.name] = np.array(value, float) if variable.shape else value
        elif variable.causality == "input":
            numbers = list(self._inputs)
            new = np.asarray(value, float).ravel().tolist() if variable.shape else [value]
            numbers[self._in.places[variable.name]] = new
            self._inputs = tuple(numbers)
        else:
            raise FmuError(f"{self.path}.{variable.name}", f"is {variable.causality}",
                           "an input or a parameter")  # fmt: skip

    def set_row(self, row: bytes) -> None:
        """Set all inputs; see `ExchangesRows`."""
        self._inputs = self._in.unpack(row)

    def get_row(self) -> bytes:
        """Read all outputs."""
        return self._row

    # ---- life -----------------------------------------------------------------------------

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Note the start."""
        self._start = self._time = start_time

    def exit_initialization_mode(self) -> None:
        """Start the binary, and let it estimate its state for `warm_up`.

        It calibrates its depth sensor at the surface; then it is lowered to the start, straight
        down and without rotation, and rests there.
        """
        warm_up = self._parameters["warm_up"]
        if not 0.0 <= warm_up <= 3600.0:
            raise FmuError(f"{self.path}.warm_up", f"{warm_up} s", "0 to 3600 s")
        try:
            self._begin()
            for k in range(round(warm_up * RATE)):
                self._tick(k / RATE, None)
                self._warm = (k + 1) / RATE
        except UuvsimError as error:
            raise self._failed(error) from None

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Send the commands and the state of the point, and get the next outputs."""
        self._time = current_communication_point
        try:
            self._tick(
                self._warm + current_communication_point - self._start, current_communication_point
            )
        except UuvsimError as error:
            raise self._failed(error) from None

    def reset(self) -> None:
        """End the binary, so that the next initialization starts another in an empty folder."""
        self.terminate()
        self._time = self._start = self._warm = 0.0
        self._sent: dict[str, Any] = {}  # commands, and times of messages
        # No command is due until this time, while the mode, `armed` and these inputs stay the same.
        self._until = -math.inf
        self._quiet: tuple[float, tuple[Any, ...]] = (-math.inf, ())
        self._parameters: dict[str, Any] = {
            v.name: np.array(v.start) if v.shape else v.start
            for v in self.description.of("parameter")
        }
        self._inputs = self._in.start
        self._setpoint, self._setpoint_kind = (0.0,) * 7, 0
        self._reports, self._target_until = 0, -math.inf
        self._pilot: tuple[float, ...] = (0.0,) * 6
        self._row = self._out.pack(self._out.start)

    def terminate(self) -> None:
        """End the binary."""
        if self._process is not None:
            self._process.ask_to_end()
            self._let_end()
            self._process.close()
        if self._commands is not None:
            self._commands.close()
        if self._link is not None:
            self._link.close()
        self._process = self._commands = self._link = None

    def free(self) -> None:
        """End the binary, if it still runs."""
        self.terminate()

    @property
    def counts(self) -> dict[str, int]:
        """Return the numbers of packets that were ignored, by reason."""
        return {} if self._link is None else dict(self._link.counts)

    @property
    def messages(self) -> list[tuple[str, str]]:
        """Return notes on the run: commands that the autopilot refused, and ignored packets."""
        refused = {} if self._commands is None else self._commands.refused
        notes = [
            f"{self.name} refused {command} {times} times ({result}): it is not ready, or its "
            "parameters do not permit it"
            for (command, result), times in refused.items()
        ]
        ignored = [f"{n} {reason}" for reason, n in self.counts.items() if n and reason != "other"]
        if ignored:
            notes.append(f"packets that were not used: {', '.join(ignored)}")
        return [("note", text) for text in notes]

    # ---- what it cannot do ----------------------------------------------------------------

    def get_fmu_state(self) -> NoReturn:
        """Raise FmuError: the state of another program cannot be copied."""
        raise FmuError(
            self.path,
            f"the state of {self.name} is in another process, which cannot copy it",
            "a run from the start, by reset, instead of a snapshot",
        )

    def set_fmu_state(self, state: object) -> NoReturn:
        """Raise FmuError."""
        self.get_fmu_state()

    def serialize_fmu_state(self, state: object) -> NoReturn:
        """Raise FmuError."""
        self.get_fmu_state()

    def deserialize_fmu_state(self, data: bytes) -> NoReturn:
        """Raise FmuError."""
        self.get_fmu_state()

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: ArrayLike
    ) -> NoReturn:
        """Raise FmuError: another program has no derivatives."""
        raise FmuError(f"{self.path}: {self.name} gives no directional derivatives")

    def binding(self) -> Binding:
        """Return that the stepping loop in C has to call Python."""
        return Binding(BindingKind.CALLBACK, 0, {})

    # ---- for subclasses -------------------------------------------------------------------

    @abstractmethod
    def _begin(self) -> None:
        """Start the binary and connect to it; the outputs are those of its first packet."""

    def _let_end(self) -> None:
        """Do what the program needs to end when it has been asked to."""

    @abstractmethod
    def _tick(self, timestamp: float, t: float | None) -> None:
        """Send the state at `timestamp` [s] of the autopilot, and set the outputs that follow.

        `t` is the simulation's time [s]; None before its start, when it is lowered.
        """

    def _bound(self, link: Callable[[int], L]) -> L:
        """Return the link of the instance, or of the first free one."""
        wanted = self._options["instance"]
        if wanted != "auto":
            return link(int(wanted))
        for instance in range(INSTANCES - 1):
            try:
                return link(instance)
            except InputInvalid:
                continue
        return link(INSTANCES - 1)

    def _motion(self, timestamp: float, t: float | None) -> Motion:
        """Return the motion of the hull, or of the lowering before the start."""
        n, e, d, _, _, _, q1, q2, q3, q4, u1, u2, u3, p, q, r, a1, a2, a3 = self._inputs[:19]
        R, g = rotation((q1, q2, q3, q4)), self._parameters["g"]
        if t is None:
            whole = self._parameters["warm_up"]
            d, w, w_dot = lowered(d, timestamp / whole, whole) if whole else (d, 0.0, 0.0)
            down = w_dot - g
            return Motion((0.0,) * 3, [down * a for a in R[2]], (n, e, d), (0.0, 0.0, w), R)
        velocity = [row[0] * u1 + row[1] * u2 + row[2] * u3 for row in R]
        acc = (
            a1 + q * u3 - r * u2 - g * R[2][0],
            a2 + r * u1 - p * u3 - g * R[2][1],
            a3 + p * u2 - q * u1 - g * R[2][2],
        )
        return Motion((p, q, r), acc, (n, e, d), velocity, R)

    def _send(self, timestamp: float, t: float | None) -> None:
        """Write the commands that are due; most steps have none, which one comparison shows."""
        commands = self._commands
        assert commands is not None
        if commands.reports != self._reports:
            self._reports, self._target_until = commands.reports, timestamp + _OUTDATED
        elif timestamp > self._target_until:
            commands.target = None
        now = commands.mode, commands.armed, self._inputs[self._n_state :]
        until, before = self._quiet
        if timestamp < until and now == before:
            return
        self._until = math.inf
        self._command(timestamp, t)
        commands.flush()
        if t is not None:
            self._quiet = self._until, now

    def _command(self, timestamp: float, t: float | None) -> None:
        """Collect the commands that are due; see `_due` for those that wait for a time."""
        sent, commands = self._sent, self._commands
        assert commands is not None
        if self._due("heartbeat", timestamp, _HEARTBEAT):
            commands.heartbeat()
        if t is None:
            return
        mode, arm = int(self._input("mode")[0]), bool(self._input("arm")[0])
        wishes: tuple[tuple[str, int, int, Callable[[Any], None]], ...] = (
            ("mode", mode, commands.mode, commands.change_mode),
            ("arm", arm, commands.armed, commands.arm),
        )
        for name, wish, now, command in wishes:
            if sent.get(name, False) != wish:
                sent[name], sent[f"{name}_open"] = wish, True
                sent.pop(f"{name}_at", None)
            if sent.get(f"{name}_open") and now == wish:
                # Not sent again from here on: a fail-safe of the autopilot may change it.
                sent[f"{name}_open"] = False
            if sent.get(f"{name}_open") and self._due(f"{name}_at", timestamp, _AGAIN):
                sent.pop("eta_d", None)
                command(wish)
        if self._due("manual", timestamp, _PILOT):
            commands.manual(self._input("manual"))
            self._pilot = self._input("manual")
        wanted, nu_d = self._input("eta_d"), self._input("nu_d")
        moves = any(nu_d) or "moves" in sent
        # For a waypoint, ArduSub plans a new path at each message: only changes are sent. A
        # target that moves is sent regularly, with its velocity, also when it has stopped.
        if (
            mode == self.guided
            and (moves or self.streams or sent.get("eta_d") != wanted)
            and self._due("eta_d_at", timestamp, self._parameters["setpoint_period"])
        ):
            sent["eta_d"] = wanted
            if moves:
                sent["moves"] = True
            velocity = commands.position(timestamp, wanted, nu_d if moves else None)
            self._setpoint = (*wanted[:3], wanted[5], *velocity)
            self._setpoint_kind = 2 if moves else 1
        elif mode != self.guided:
            self._setpoint, self._setpoint_kind = (0.0,) * 7, 0

    def _due(self, name: str, timestamp: float, period: float) -> bool:
        """Return whether a message is due again, and note it."""
        sent: float = self._sent.get(name, -math.inf)
        if is_due := timestamp - sent >= period - 1e-9:
            self._sent[name] = sent = timestamp
        self._until = min(self._until, sent + period - 2e-9)
        return is_due

    def _input(self, name: str) -> tuple[float, ...]:
        return self._inputs[self._in.places[name]]

    def _pack_outputs(
        self, u: Sequence[float], lights: float, gripper: float, tilt: float,
        channels: Sequence[float], frame: int, armed: bool,
    ) -> None:  # fmt: skip
        """Set all outputs; `channels` are those that an autopilot has for itself."""
        assert self._commands is not None
        mode, target = self._commands.mode, self._commands.target
        self._row = self._out.pack((
            *u, lights, gripper, tilt, *channels, frame, *self._setpoint, *self._pilot,
            *(target or (0.0, 0.0, 0.0)), mode, self._setpoint_kind, armed, target is not None,
        ))  # fmt: skip

    def _failed(self, error: UuvsimError) -> ComponentFailed:
        self.terminate()
        return ComponentFailed(self.path, self._time, str(error))


def lowered(depth: float, share: float, warm_up: float) -> tuple[float, float, float]:
    """Return D [m], its first and second derivative, at a `share` of the time before the start.

    From 0.4 to 0.7 of the time it is D = depth (s - sin(2 pi s) / (2 pi)), with s from 0 to 1.
    """
    s = min(max((share - 0.4) / 0.3, 0.0), 1.0)
    rate, angle = 1.0 / (0.3 * warm_up), 2.0 * math.pi * s
    return (
        depth * (s - math.sin(angle) / (2.0 * math.pi)),
        depth * rate * (1.0 - math.cos(angle)),
        depth * rate**2 * 2.0 * math.pi * math.sin(angle),
    )


def rotation(q: Sequence[float]) -> list[list[float]]:
    """Return R from b to n of a unit quaternion."""
    w, x, y, z = q
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
