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
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, final

import numpy as np

from uuvsim_cosim.bridge.autopilots.commands import GUIDED, AutopilotCommands
from uuvsim_cosim.bridge.autopilots.component import RATE, Autopilot, lowered, rotation
from uuvsim_cosim.bridge.autopilots.json_interface import JsonLink, ServoPacket, state_line
from uuvsim_cosim.bridge.autopilots.sitl_process import (
    HOME,
    MAVLINK_PORT,
    SitlProcess,
    ardusub_binary,
)
from uuvsim_cosim.bridge.autopilots.sources import (
    AutopilotSource,
    described,
    read_options,
    variable,
)
from uuvsim_cosim.errors import InputInvalid

__all__ = ["ArduSub", "source", "thruster_commands"]

_STREAMS, _TARGET = 10.0, 0.5  # s between two requests, and between two reports of its target
_LAST_LOOPS = 20  # at most, after the request to end; 4.8-dev needs one
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
_AIDED = {  # DVL, USBL and GPS by MAVLink instead of the simulated GPS
    "GPS1_TYPE": 14,  # MAVLink
    "VISO_TYPE": 1,  # MAVLink
    "SIM_GPS1_ENABLE": 0,
    "EK3_SRC1_VELXY": 6,  # the DVL; fixes give no velocity
    "EK3_SRC1_VELZ": 0,
}
_DESCRIPTION = described(
    "ardusub", "ArduSub in lockstep (SITL binary, JSON interface and MAVLink)",
    "mode by ArduSub's number: 0 stabilize, 2 depth hold, 4 guided, 16 position hold, 19 manual",
    [
        variable("gps_position", "input", [0.0] * 3, "m", "of the antenna in NED"),
        variable("gps_sigma", "input", [1.0] * 3, "m", "deviations of N, E, D"),
        variable("gps_valid", "input", False, None, "the GPS has a fix", "Boolean"),
        variable("gps_t_sample", "input", -1.0, "s", "time of the GPS's fix"),
        variable("pwm", "output", [0.0] * 16, "us", "pulse widths of channels 1 to 16"),
    ],
)  # fmt: skip
_OPTIONS = {
    "binary": "", "instance": "auto", "timeout": "10", "folder": "", "parameters": "",
    "navigation": "gps",
}  # fmt: skip


def source(text: str, base: Path) -> AutopilotSource:
    """Resolve ``ardusub:?option=value&…``; the entry point of the scheme.

    `binary`: path of ArduSub's SITL binary, by default `ardusub` in the PATH. `instance`: its
    number, by which all its ports are raised by 10; `auto` takes the first free one. `timeout` [s]:
    longest wait for a packet. `folder`: a new folder for its logs, by default a temporary one.
    `parameters`: a file of ArduPilot's parameters. `navigation`: `gps` (simulated by the binary, at
    any depth) or `sensors` (DVL, USBL and GPS of the system, by MAVLink).
    """
    options = read_options(text, base, _OPTIONS, ["timeout"], ["binary", "folder", "parameters"])
    if options["navigation"] not in ("gps", "sensors"):
        raise InputInvalid(f"source {text!r}", f"navigation {options['navigation']!r}",
                           "gps or sensors")  # fmt: skip
    if options["parameters"] and not Path(options["parameters"]).is_file():
        raise InputInvalid(options["parameters"], "no such file", "a file of parameters")
    return AutopilotSource(tuple(options.items()), _OPTIONS, _DESCRIPTION, ArduSub, "ArduSub")


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
class ArduSub(Autopilot[JsonLink]):
    """The `Component` protocol around ArduSub's binary."""

    name = "ArduSub"
    guided = GUIDED

    def __init__(self, options: dict[str, str], path: str) -> None:
        """Find the binary; it starts at the end of initialization."""
        self._binary = ardusub_binary(options["binary"])
        self._is_aided = options["navigation"] == "sensors"
        self._state: tuple[float, tuple[Any, ...]] | None = None  # the last one, and its time
        super().__init__(options, path, _DESCRIPTION)

    # ---- inside ---------------------------------------------------------------------------

    def _begin(self) -> None:
        self._state = None
        self._link = self._bound(lambda instance: JsonLink(instance, self._timeout))
        number = (self._link.port - 9002) // 10
        parameters = _PARAMETERS | (_AIDED if self._is_aided else {})
        files = ["vehicle.parm", *filter(None, [self._options["parameters"]])]
        self._process = SitlProcess(
            self.name,
            [str(self._binary), "-S", "-w", "--model", "JSON:127.0.0.1", "--speedup", "1000",
             "--slave", "0", f"-I{number}", "--home", f"{HOME[0]},{HOME[1]},0,0",
             "--defaults", ",".join(("@ROMFS/default_params/sub.parm", *files))],
            self._options["folder"],
            {"vehicle.parm": "".join(f"{n} {v}\n" for n, v in parameters.items())},
        )  # fmt: skip
        self._commands = AutopilotCommands(
            self._process.connected(MAVLINK_PORT + 10 * number, self._timeout)
        )
        self._set_outputs(self._link.exchange(b"", self._process.check))

    def _tick(self, timestamp: float, t: float | None) -> None:
        assert self._link is not None
        assert self._process is not None
        assert self._commands is not None
        self._send(timestamp, t)
        x, m = self._inputs, self._motion(timestamp, t)
        voltage, current, altitude = x[self._n_state - 3 : self._n_state]
        self._state = timestamp, (
            m.gyro, m.acc, m.position, x[3:6], x[6:10], m.velocity, altitude, voltage, current,
        )  # fmt: skip
        packet = self._link.exchange(state_line(timestamp, *self._state[1]), self._process.check)
        self._commands.read()
        self._set_outputs(packet)

    def _let_end(self) -> None:
        """Send the last state with further times: ArduSub ends between two of its loops."""
        if self._link is not None and self._state is not None:
            timestamp, state = self._state
            self._link.release(
                state_line(timestamp + k / RATE, *state) for k in range(1, _LAST_LOOPS)
            )

    def _command(self, timestamp: float, t: float | None) -> None:
        assert self._commands is not None
        if self._due("no_streams", timestamp, _STREAMS):
            self._commands.no_streams()  # reading them takes longer than a step
            self._commands.report_target(_TARGET)
        super()._command(timestamp, t)
        if self._is_aided:
            self._send_aiding(timestamp, t)

    def _send_aiding(self, timestamp: float, t: float | None) -> None:
        """Send new readings of DVL, USBL and GPS; at rest before the start, the first pose."""
        of, sent, commands = self._input, self._sent, self._commands
        assert commands is not None
        if t is None:
            if self._due("usbl", timestamp, 0.2):
                n, e, d = of("eta")[:3]
                warm_up = self._parameters["warm_up"]
                d = lowered(d, timestamp / warm_up, warm_up)[0]
                commands.fix(timestamp, (n, e, d), 0.5)
            return
        for sensor in ("usbl", "gps"):
            (t_sample,) = of(f"{sensor}_t_sample")
            if of(f"{sensor}_valid")[0] and sent.get(f"{sensor}_t") != t_sample:
                sent[f"{sensor}_t"] = t_sample
                sigma = math.hypot(*of(f"{sensor}_sigma")[:2])
                commands.fix(timestamp, of(f"{sensor}_position"), sigma)
        (t_dvl,) = of("dvl_t_sample")
        if of("dvl_valid")[0] and sent.get("dvl_t", -1.0) != t_dvl:
            R = np.array(rotation(of("q")))
            before, period = sent.get("dvl_R"), t_dvl - sent.get("dvl_t", -1.0)
            if before is not None and 0.0 < period < 1.0:
                S = before.T @ R  # small rotation between the readings
                turned = (S[2, 1] - S[1, 2]) / 2, (S[0, 2] - S[2, 0]) / 2, (S[1, 0] - S[0, 1]) / 2
                moved = [velocity * period for velocity in of("dvl_velocity")]
                commands.moved(timestamp, period, [float(x) for x in turned], moved)
            sent["dvl_t"], sent["dvl_R"] = t_dvl, R

    def _set_outputs(self, packet: ServoPacket) -> None:
        assert self._commands is not None
        w = packet.widths
        self._pack_outputs(
            [_command(-1.0, width) + 0.0 for width in w[:8]],
            (_command(1.0, w[8]) + 1.0) / 2.0 if w[8] else 0.0,  # lights
            _command(1.0, w[9]), _command(1.0, w[10]),  # gripper, tilt
            w[:16], packet.frame, self._commands.armed,
        )  # fmt: skip
