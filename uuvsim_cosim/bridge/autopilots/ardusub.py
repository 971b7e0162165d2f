"""The source `ardusub:`: the real ArduSub binary as a component, in lockstep with the others.

``ardusub:?binary=PATH&timeout=10``; all options are listed at `source`. In each step from t to
t + dt the component sends the state at t, and gets the pulse widths that follow from it, as
outputs at t + dt:

    u_i = -(w_i - 1500 µs) / 400 µs

Thrusters of the BlueROV2 Heavy here have ArduSub's order (frame `vectored_6dof`: front right, front
left, rear right, rear left; first the horizontal, then the vertical ones). A positive output of
ArduSub pushes against the direction e of each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NoReturn, final
from urllib.parse import parse_qsl, urlencode

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.bridge.autopilots.commands import GUIDED, AutopilotCommands
from uuvsim_cosim.bridge.autopilots.json_interface import JsonLink, ServoPacket, state_line
from uuvsim_cosim.bridge.autopilots.sitl_process import SitlProcess, ardusub_binary
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, UuvsimError
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import (
    Causality,
    Description,
    Variability,
    Variable,
    VariableType,
)
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.master.slot_row import SlotRow
from uuvsim_cosim.orchestrator.system.sources import Backend

__all__ = ["ArduSub", "ArduSubSource", "source", "thruster_commands"]

INSTANCES = 10  # that are tried with instance=auto
RATE = 400  # Hz of ArduSub's loop, in which it starts
_HEARTBEAT, _PILOT, _AGAIN, _STREAMS = 1.0, 0.1, 1.0, 10.0  # s between two messages
# Beside ArduSub's own parameters of simulated submarines (sub.parm in the binary).
_PARAMETERS = {
    "FRAME_CONFIG": 2,  # vectored_6dof
    "SERVO8_FUNCTION": 40,  # motor 8; sub.parm has the camera's tilt there
    "SERVO9_FUNCTION": 181,  # lights
    "SERVO10_FUNCTION": 184,  # gripper: actuator 1
    "SERVO11_FUNCTION": 7,  # tilt of the camera's mount
    "SERVO11_MIN": 1100,
    "SERVO11_MAX": 1900,
    # With the default of 4.5, yaw oscillates by 0.19 rad: small commands of a T200 have little
    # thrust, and the hull has little damping in yaw.
    "ATC_ANG_YAW_P": 1.5,
    "BARO_SPEC_GRAV": 1.024,  # of the sea water in which ArduSub simulates its depth sensor
    "RNGFND1_TYPE": 100,  # rng_1 of the JSON interface
    "RNGFND1_ORIENT": 25,  # down
}
_AIDED = {  # DVL and USBL by MAVLink instead of the simulated GPS
    "GPS1_TYPE": 14,  # MAVLink
    "VISO_TYPE": 1,  # MAVLink
    "SIM_GPS1_ENABLE": 0,
    "EK3_SRC1_VELXY": 6,  # the DVL; the USBL gives no velocity
    "EK3_SRC1_VELZ": 0,
}
_POSE = ("m", "m", "m", "rad", "rad", "rad")
_TWIST = ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s")


def _variable(
    name: str, causality: Causality, start: Any, unit: str | Sequence[str] | None,
    description: str, type: VariableType = "Float64",
) -> Variable:  # fmt: skip
    shape = np.shape(start)
    changes: Variability = "continuous" if type == "Float64" else "discrete"
    return Variable(
        name, type, causality, "fixed" if causality == "parameter" else changes, shape,
        unit if isinstance(unit, str) else None, np.array(start, float) if shape else start,
        description=description, dependencies=() if causality == "output" else None,
        element_units=() if unit is None or isinstance(unit, str) else tuple(unit),
    )  # fmt: skip


def _described() -> Description:
    """Return the interface; it does not depend on the options."""
    zero3, zero6 = [0.0] * 3, [0.0] * 6
    variables = [
        _variable("eta", "input", zero6, _POSE, "pose of the hull in n, N E D phi theta psi"),
        _variable("q", "input", [1.0, 0, 0, 0], "1", "its attitude, from b to n"),
        _variable("nu", "input", zero6, _TWIST, "its velocity over ground, of CO in b"),
        _variable("nu_dot", "input", zero6, ("m/s2",) * 3 + ("rad/s2",) * 3, "derivative of nu"),
        _variable("voltage", "input", 16.0, "V", "of the battery"),
        _variable("current", "input", 0.0, "A", "of the battery"),
        _variable("altitude", "input", 0.0, "m", "range of the altimeter"),
        _variable("dvl_velocity", "input", zero3, "m/s", "of the DVL, body axes"),
        _variable("dvl_valid", "input", False, None, "the DVL has a bottom track", "Boolean"),
        _variable("dvl_t_sample", "input", -1.0, "s", "time of the DVL's reading"),
        _variable("usbl_position", "input", zero3, "m", "of the transponder in NED"),
        _variable("usbl_sigma", "input", [1.0] * 3, "m", "deviations of N, E, D"),
        _variable("usbl_valid", "input", False, None, "the USBL has a fix", "Boolean"),
        _variable("usbl_t_sample", "input", -1.0, "s", "time of the USBL's fix"),
        _variable("arm", "input", False, None, "arm the motors; sent until confirmed", "Boolean"),
        _variable("mode", "input", 0, None, "mode by ArduSub's number: 0 stabilize, 2 depth hold, "
                  "4 guided, 16 position hold, 19 manual", "Int32"),
        _variable("manual", "input", zero6, "1", "pilot: surge, sway, heave, roll, pitch, yaw, "
                  "-1 to 1"),
        _variable("eta_d", "input", zero6, _POSE, "desired pose in mode guided: N E D and psi"),
        _variable("nu_d", "input", zero6, _TWIST, "its velocity, u v w; 0 throughout: a waypoint"),
        _variable("warm_up", "parameter", 45.0, "s", "time at rest before the start, in which the "
                  "autopilot estimates its state"),
        _variable("g", "parameter", 9.80665, "m/s2", "gravity that its accelerometers measure"),
        _variable("setpoint_period", "parameter", 0.1, "s", "between two desired poses"),
        _variable("u", "output", [0.0] * 8, "1", "commands of the thrusters, -1 to 1"),
        _variable("lights", "output", 0.0, "1", "brightness, 0 to 1"),
        _variable("gripper", "output", 0.0, "1", "-1: closing, 1: opening"),
        _variable("tilt", "output", 0.0, "1", "tilt of the camera, -1 to 1"),
        _variable("pwm", "output", [0.0] * 16, "us", "pulse widths of channels 1 to 16"),
        _variable("armed", "output", False, None, "the autopilot is armed", "Boolean"),
        _variable("mode_now", "output", -1, None, "mode of its last heartbeat", "Int32"),
        _variable("frame", "output", 0.0, "1", "packets since its start"),
    ]  # fmt: skip
    return Description(
        "ardusub", "python", {v.name: v for v in variables},
        description="ArduSub in lockstep (SITL binary, JSON interface and MAVLink)",
        can_get_and_set_state=False, can_serialize_state=False,
    )  # fmt: skip


_DESCRIPTION = _described()
_INPUTS, _OUTPUTS = (SlotRow(_DESCRIPTION.of(causality)) for causality in ("input", "output"))
# Inputs that are sent in every step come first; the others are those of commands and of aiding.
_N_STATE = _INPUTS.places["altitude"].stop
_OPTIONS = {
    "binary": "", "instance": "auto", "timeout": "10", "folder": "", "parameters": "",
    "navigation": "gps",
}  # fmt: skip


def source(text: str, base: Path) -> ArduSubSource:
    """Resolve ``ardusub:?option=value&…``; the entry point of the scheme.

    `binary`: path of ArduSub's SITL binary, by default `ardusub` in the PATH. `instance`: its
    number, by which all its ports are raised by 10; `auto` takes the first free one. `timeout` [s]:
    longest wait for a packet. `folder`: a new folder for its logs, by default a temporary one.
    `parameters`: a file of ArduPilot's parameters. `navigation`: `gps` (simulated by the binary, at
    any depth) or `sensors` (DVL and USBL of the system, by MAVLink).
    """
    given = dict(parse_qsl(text.partition("?")[2], keep_blank_values=True))
    unknown = [name for name in given if name not in _OPTIONS]
    if unknown:
        raise InputInvalid(f"source {text!r}", f"option {unknown[0]!r}",
                           expected_names(unknown[0], _OPTIONS))  # fmt: skip
    options = {**_OPTIONS, **given}
    if options["instance"] != "auto" and not options["instance"].isdecimal():
        raise InputInvalid(f"source {text!r}", f"instance {options['instance']!r}", "0 or more")
    if options["navigation"] not in ("gps", "sensors"):
        raise InputInvalid(f"source {text!r}", f"navigation {options['navigation']!r}",
                           "gps or sensors")  # fmt: skip
    try:
        seconds = float(options["timeout"])
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise InputInvalid(f"source {text!r}", f"timeout {options['timeout']!r}", "seconds")
    for name in ("binary", "folder", "parameters"):
        if options[name]:
            options[name] = str((base / Path(options[name]).expanduser()).absolute())
    if options["parameters"] and not Path(options["parameters"]).is_file():
        raise InputInvalid(options["parameters"], "no such file", "a file of parameters")
    return ArduSubSource(tuple(options.items()))


@dataclass(frozen=True)
class ArduSubSource:
    """ArduSub with its options; see `source`."""

    options: tuple[tuple[str, str], ...]
    kind: str = "ArduSub"

    @property
    def text(self) -> str:
        """The whole source, with absolute paths."""
        given = [(n, v) for n, v in self.options if v != _OPTIONS[n]]
        return "ardusub:" + (f"?{urlencode(given, safe='/:~')}" if given else "")

    def describe(self) -> Description:
        """Return the interface; needs no binary."""
        return _DESCRIPTION

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make the component `path`; raises InputInvalid without ArduSub's binary."""
        return ArduSub(dict(self.options), path)


def thruster_commands(widths: Sequence[int]) -> np.ndarray:
    """Return the commands (8,) of the BlueROV2 Heavy's thrusters, -1 to 1, from pulse widths [µs].

    Example:

    >>> from uuvsim_cosim.bridge.autopilots.ardusub import thruster_commands
    >>> thruster_commands([1100, 1500, 1900, 1500, 1500, 1500, 1500, 1500, 1100])[:4].tolist()
    [1.0, 0.0, -1.0, 0.0]
    """
    return np.array([_command(-1.0, w) + 0.0 for w in widths[:8]])


@cache
def _command(sign: float, width: int) -> float:
    """Map 1100 to 1900 µs to -1 to 1; no pulses (0 µs) are no command."""
    return sign * max(-1.0, min(1.0, (width - 1500) / 400.0)) if width else 0.0


@final
class ArduSub:
    """The `Component` protocol around a binary, which runs from initialization to the end."""

    def __init__(self, options: dict[str, str], path: str) -> None:
        """Find the binary; it starts at the end of initialization."""
        self.path = path
        self.description = _DESCRIPTION
        self._options = options
        self._binary = ardusub_binary(options["binary"])
        self._link: JsonLink | None = None
        self._process: SitlProcess | None = None
        self._parameters: dict[str, float] = {}
        self._inputs: tuple[float, ...] = ()
        self.reset()

    def get(self, variable: Variable) -> Any:
        """Read a value; a copy."""
        if variable.causality == "parameter":
            return self._parameters[variable.name]
        row, numbers = (
            (_INPUTS, self._inputs) if variable.causality == "input" else
            (_OUTPUTS, _OUTPUTS.unpack(self._row))
        )  # fmt: skip
        found = numbers[row.places[variable.name]]
        if variable.shape:
            return np.array(found)
        return bool(found[0]) if variable.type == "Boolean" else found[0]

    def set(self, variable: Variable, value: Any) -> None:
        """Set an input or a parameter."""
        if variable.causality == "parameter":
            self._parameters[variable.name] = float(value)
        elif variable.causality == "input":
            numbers = list(self._inputs)
            new = np.asarray(value, float).ravel().tolist() if variable.shape else [value]
            numbers[_INPUTS.places[variable.name]] = new
            self._inputs = tuple(numbers)
        else:
            raise FmuError(f"{self.path}.{variable.name}", f"is {variable.causality}",
                           "an input or a parameter")  # fmt: skip

    def set_row(self, row: bytes) -> None:
        """Set all inputs; see `ExchangesRows`."""
        self._inputs = _INPUTS.unpack(row)

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
            self._link = self._bound()
            self._process = SitlProcess(
                self._binary, (self._link.port - 9002) // 10, self._options["folder"],
                "".join(f"{n} {v}\n" for n, v in (
                    _PARAMETERS | (_AIDED if self._is_aided else {})).items()),
                [Path(p) for p in (self._options["parameters"],) if p], self._timeout,
            )  # fmt: skip
            self._commands = AutopilotCommands(self._process.serial)
            packet = self._link.exchange(b"", self._process.check)
            for k in range(round(warm_up * RATE)):
                packet = self._tick(k / RATE, None)
                self._warm = (k + 1) / RATE
        except UuvsimError as error:
            raise self._failed(error) from None
        self._set_outputs(packet)

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Send the commands and the state of the point, and get the next outputs."""
        self._time = current_communication_point
        try:
            packet = self._tick(
                self._warm + current_communication_point - self._start, current_communication_point
            )
        except UuvsimError as error:
            raise self._failed(error) from None
        self._set_outputs(packet)

    def reset(self) -> None:
        """End the binary, so that the next initialization starts another in an empty folder."""
        self.terminate()
        self._time = self._start = self._warm = 0.0
        self._sent: dict[str, Any] = {}  # commands, and times of messages
        # No message is due until this time, while these inputs stay the same.
        self._quiet: tuple[float, tuple[float, ...]] = (-math.inf, ())
        self._parameters = {v.name: float(v.start) for v in _DESCRIPTION.of("parameter")}
        self._inputs, self._row = _INPUTS.start, _OUTPUTS.pack(_OUTPUTS.start)

    def terminate(self) -> None:
        """End the binary."""
        if self._process is not None:
            self._process.close()
        if self._link is not None:
            self._link.close()
        self._process = self._link = None

    def free(self) -> None:
        """End the binary, if it still runs."""
        self.terminate()

    @property
    def counts(self) -> dict[str, int]:
        """Return the numbers of packets that were ignored, by reason, and of repeated answers."""
        return {} if self._link is None else dict(self._link.counts)

    # ---- what it cannot do ----------------------------------------------------------------

    def get_fmu_state(self) -> NoReturn:
        """Raise FmuError: the state of another program cannot be copied."""
        raise FmuError(
            self.path,
            "the state of ArduSub is in another process, which cannot copy it",
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
        raise FmuError(f"{self.path}: ArduSub gives no directional derivatives")

    def binding(self) -> Binding:
        """Return that the stepping loop in C has to call Python."""
        return Binding(BindingKind.CALLBACK, 0, {})

    # ---- inside ---------------------------------------------------------------------------

    @property
    def _timeout(self) -> float:
        return float(self._options["timeout"])

    @property
    def _is_aided(self) -> bool:
        return self._options["navigation"] == "sensors"

    def _bound(self) -> JsonLink:
        """Return the link of the instance, or of the first free one."""
        wanted = self._options["instance"]
        if wanted != "auto":
            return JsonLink(int(wanted), self._timeout)
        for instance in range(INSTANCES):
            try:
                return JsonLink(instance, self._timeout)
            except InputInvalid:
                if instance == INSTANCES - 1:
                    raise
        raise AssertionError

    def _tick(self, timestamp: float, t: float | None) -> ServoPacket:
        """Write what is due at `timestamp` [s] of the autopilot, then answer with the state.

        `t` is the simulation's time [s]; None before its start, when it is lowered.
        """
        assert self._link is not None
        assert self._process is not None
        self._send(timestamp, t)
        (
            n, e, d, phi, theta, psi, *q, u1, u2, u3, p, q_, r, a1, a2, a3, _, _, _,
            voltage, current, altitude,
        ) = self._inputs[:_N_STATE]  # fmt: skip
        R, g = _rotation(q), self._parameters["g"]
        if t is None:
            p = q_ = r = 0.0
            warm_up = self._parameters["warm_up"]
            d, w, w_dot = _lowered(d, timestamp / warm_up, warm_up)
            velocity, down = [0.0, 0.0, w], w_dot - g
            acc = [down * a for a in R[2]]
        else:
            velocity = [row[0] * u1 + row[1] * u2 + row[2] * u3 for row in R]
            acc = [
                a1 + q_ * u3 - r * u2 - g * R[2][0],
                a2 + r * u1 - p * u3 - g * R[2][1],
                a3 + p * u2 - q_ * u1 - g * R[2][2],
            ]
        line = state_line(
            timestamp, (p, q_, r), acc, (n, e, d), (phi, theta, psi), q, velocity, altitude,
            voltage, current,
        )  # fmt: skip
        packet = self._link.exchange(line, self._process.check)
        if self._commands.read():
            self._quiet = (-math.inf, ())  # its mode may have changed
        return packet

    def _send(self, timestamp: float, t: float | None) -> None:
        """Write the MAVLink messages that are due."""
        x, sent, commands = self._inputs, self._sent, self._commands
        until, inputs = self._quiet
        if timestamp < until and x[_N_STATE:] == inputs:
            return
        self._until = math.inf
        if self._due("heartbeat", timestamp, _HEARTBEAT):
            commands.heartbeat()
        if self._due("no_streams", timestamp, _STREAMS):
            commands.no_streams()  # reading them takes longer than a step
        if t is not None:
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
            wanted, nu_d = self._input("eta_d"), self._input("nu_d")
            moves = any(nu_d) or "moves" in sent
            # For a waypoint, ArduSub plans a new path at each message: only changes are sent. A
            # target that moves is sent regularly, with its velocity, also when it has stopped.
            if (
                mode == GUIDED
                and (moves or sent.get("eta_d") != wanted)
                and self._due("eta_d_at", timestamp, self._parameters["setpoint_period"])
            ):
                sent["eta_d"] = wanted
                if moves:
                    sent["moves"] = True
                commands.position(timestamp, wanted, nu_d if moves else None)
        if self._is_aided:
            self._send_aiding(timestamp, t)
        commands.flush()
        if t is not None:
            self._quiet = (self._until, x[_N_STATE:])

    def _send_aiding(self, timestamp: float, t: float | None) -> None:
        """Send readings of DVL and USBL that are new; at rest before the start, the first pose."""
        sent, of = self._sent, self._input
        if t is None:
            if self._due("usbl", timestamp, 0.2):
                n, e, d = of("eta")[:3]
                warm_up = self._parameters["warm_up"]
                d = _lowered(d, timestamp / warm_up, warm_up)[0]
                self._commands.fix(timestamp, (n, e, d), 0.5)
            return
        (t_usbl,), (t_dvl,) = of("usbl_t_sample"), of("dvl_t_sample")
        if of("usbl_valid")[0] and sent.get("usbl_t") != t_usbl:
            sent["usbl_t"] = t_usbl
            self._commands.fix(timestamp, of("usbl_position"), math.hypot(*of("usbl_sigma")[:2]))
        if of("dvl_valid")[0] and sent.get("dvl_t", -1.0) != t_dvl:
            R = np.array(_rotation(of("q")))
            before, period = sent.get("dvl_R"), t_dvl - sent.get("dvl_t", -1.0)
            if before is not None and 0.0 < period < 1.0:
                S = before.T @ R  # small rotation between the readings
                turned = (S[2, 1] - S[1, 2]) / 2, (S[0, 2] - S[2, 0]) / 2, (S[1, 0] - S[0, 1]) / 2
                moved = [velocity * period for velocity in of("dvl_velocity")]
                self._commands.moved(timestamp, period, [float(x) for x in turned], moved)
            sent["dvl_t"], sent["dvl_R"] = t_dvl, R

    def _input(self, name: str) -> tuple[float, ...]:
        return self._inputs[_INPUTS.places[name]]

    def _due(self, name: str, timestamp: float, period: float) -> bool:
        """Return whether a message is due again, and note it."""
        sent: float = self._sent.get(name, -math.inf)
        if is_due := timestamp - sent >= period - 1e-9:
            self._sent[name] = sent = timestamp
        self._until = min(self._until, sent + period - 2e-9)
        return is_due

    def _set_outputs(self, packet: ServoPacket) -> None:
        w = packet.widths
        self._row = _OUTPUTS.pack((
            *[_command(-1.0, width) + 0.0 for width in w[:8]],
            (_command(1.0, w[8]) + 1.0) / 2.0 if w[8] else 0.0,  # lights
            _command(1.0, w[9]), _command(1.0, w[10]),  # gripper, tilt
            *w[:16], packet.frame, self._commands.mode, self._commands.armed,
        ))  # fmt: skip

    def _failed(self, error: UuvsimError) -> ComponentFailed:
        self.terminate()
        return ComponentFailed(self.path, self._time, str(error))


def _lowered(depth: float, share: float, warm_up: float) -> tuple[float, float, float]:
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


def _rotation(q: Sequence[float]) -> list[list[float]]:
    """Return R from b to n of a unit quaternion."""
    w, x, y, z = q
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
