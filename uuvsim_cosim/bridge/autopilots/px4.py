"""The source `px4:`: the real PX4 binary as a component, in lockstep with the others.

``px4:?binary=PATH&timeout=10``; all options are listed at `source`. In each step from t to t + dt
the component sends HIL_SENSOR of t, and gets the controls that follow from it, as outputs at
t + dt. Sensors measure the true state with white noise: specific force and rates at CO, and

    P = P_atm + rho g D,    m = R^T b,    R from b to n

HIL_GPS is sent at the surface only, and ODOMETRY for each new reading of the DVL and the USBL.
Channels 1 to 8 are the thrusters in the order of PX4's airframe of the BlueROV2 Heavy, which is
that of this package; four of its axes point the other way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import final

import numpy as np

from uuvsim_cosim.bridge.autopilots.commands import AutopilotCommands
from uuvsim_cosim.bridge.autopilots.component import RATE, Autopilot, Motion
from uuvsim_cosim.bridge.autopilots.hil_interface import FIRST, Controls, HilLink
from uuvsim_cosim.bridge.autopilots.json_interface import AutopilotLost
from uuvsim_cosim.bridge.autopilots.sitl_process import HOME, SitlProcess, px4_build
from uuvsim_cosim.bridge.autopilots.sources import (
    AutopilotSource,
    described,
    read_options,
    variable,
)
from uuvsim_cosim.errors import InputInvalid

__all__ = ["PX4", "source", "thruster_commands"]

_SLOW, _GPS, _RANGE = 0.02, 0.2, 0.1  # s between two messages
_SIGNS = np.array([1.0, 1, -1, -1, 1, -1, -1, 1])  # of PX4's axes along the directions e here
_IMU, _ALL = 0x3F, 0x1BFF  # fields_updated; without differential pressure
_RADIUS = 6_371_000.0  # m, of PX4's sphere
_LOCAL_NED, _BODY_FRD, _VISION, _BEST, _DOWN = 1, 12, 2, 100, 25  # MAVLink's numbers
_SIGMA_DVL = 0.02  # m/s
# Beside the parameters of PX4's airframe; PX4 takes them from its environment.
_PARAMETERS: dict[str, float] = {
    "SIM_GZ_EN": 0,
    "IMU_INTEG_RATE": RATE,
    **{f"PWM_MAIN_FUNC{i}": 100 + i for i in range(1, 9)},  # motors
    **{f"PWM_MAIN_FUNC{8 + i}": 300 + i for i in range(1, 4)},  # actuator set: lights, …
    "COM_RC_IN_MODE": 1,  # a joystick by MAVLink, no radio
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 0,
    "COM_ARM_WO_GPS": 1,
    "COM_DISARM_PRFLT": -1,
    "CBRK_SUPPLY_CHK": 894281,
    "EKF2_BARO_CTRL": 0,  # it takes the pressure for that of air
    "EKF2_HGT_REF": 3,  # the position of ODOMETRY
    "EKF2_EV_CTRL": 7,  # its horizontal and vertical position, and its velocity
    "EKF2_EV_DELAY": 0,
}
_DESCRIPTION = described(
    "px4", "PX4 in lockstep (SITL binary, simulator MAVLink)",
    "main mode by PX4's number: 1 manual, 2 altitude, 3 position, 4 auto, 6 offboard, 7 stabilized",
    [
        # World Magnetic Model 2025 at the origin of n (47.3° N, 122.5° W), 2026.0
        variable("field", "parameter", [1.8580e-5, 4.954e-6, 4.8860e-5], "T", "magnetic, in NED"),
        variable("p_atm", "parameter", 101325.0, "Pa", "pressure at the surface"),
        variable("rho", "parameter", 1025.0, "kg/m3", "density of the water"),
        variable("temperature", "parameter", 10.0, "degC", "of the water"),
        variable("gps_depth", "parameter", 0.2, "m", "deepest with a GPS fix"),
        # assumption: a constant reading counts as a sensor that failed, so that noise is needed
        variable("noise", "parameter", [0.02, 1e-3, 2e-7, 10.0], ("m/s2", "rad/s", "T", "Pa"),
                 "deviations of accelerometer, gyro, magnetometer, barometer"),
        variable("seed", "parameter", [0, 0], None, "of the noise", "Int32"),
        variable("controls", "output", [0.0] * 16, "1", "channels 1 to 16, -1 to 1"),
    ],
)  # fmt: skip
_OPTIONS = {
    "binary": "", "instance": "auto", "timeout": "10", "boot": "60", "folder": "", "parameters": "",
}  # fmt: skip


def source(text: str, base: Path) -> AutopilotSource:
    """Resolve ``px4:?option=value&…``; the entry point of the scheme.

    `binary`: PX4's build folder, or its binary in the folder `bin`, by default `px4` in the PATH.
    `instance`: its number, by which all its ports are raised; `auto` takes the first free one.
    `timeout` [s]: longest wait for a connection or an answer. `boot` [s]: longest time until the
    first actuator output, in which the simulation follows the clock. `folder`: a new folder for its
    logs, by default a temporary one. `parameters`: a file with a name and a value of a parameter of
    PX4 in each line.
    """
    options = read_options(
        text, base, _OPTIONS, ["timeout", "boot"], ["binary", "folder", "parameters"]
    )
    if options["parameters"]:
        _parameters(Path(options["parameters"]))
    return AutopilotSource(tuple(options.items()), _OPTIONS, _DESCRIPTION, PX4, "PX4")


def thruster_commands(controls: Sequence[float]) -> np.ndarray:
    """Return the commands (8,) of the BlueROV2 Heavy's thrusters, -1 to 1, from PX4's controls.

    Example:

    >>> from uuvsim_cosim.bridge.autopilots.px4 import thruster_commands
    >>> thruster_commands([1.0, 0, 0.5, 0, 0, 0, 0, 0])[:4].tolist()
    [1.0, 0.0, -0.5, 0.0]
    """
    u: np.ndarray = np.clip(_SIGNS * np.array(controls[:8]), -1.0, 1.0) + 0.0
    return u


@final
class PX4(Autopilot[HilLink]):
    """The `Component` protocol around PX4's binary."""

    name = "PX4"
    guided = 6  # offboard
    streams = True

    def __init__(self, options: dict[str, str], path: str) -> None:
        """Find the binary; it starts at the end of initialization."""
        self._build = px4_build(options["binary"])
        self._booted = 0.0  # s of PX4's clock at its first output
        super().__init__(options, path, _DESCRIPTION)

    # ---- inside ---------------------------------------------------------------------------

    def _begin(self) -> None:
        self._link = link = self._bound(lambda instance: HilLink(instance, self._timeout))
        number, _, model = self._build.airframe.partition("_")
        parameters = {f"PX4_PARAM_{n}": f"{v:g}" for n, v in _PARAMETERS.items()}
        if self._options["parameters"]:
            parameters |= _parameters(Path(self._options["parameters"]))
        self._process = SitlProcess(
            self.name,
            [str(self._build.binary), "-i", str(link.instance), "-d", str(self._build.etc)],
            self._options["folder"], {},
            {"PX4_SYS_AUTOSTART": number, "PX4_SIM_MODEL": model, "PX4_SIMULATOR": "none",
             **parameters},
        )  # fmt: skip
        self._commands = AutopilotCommands(link.onboard, self.name, link.instance + 1, shift=16)
        link.accept(self._process.check)
        self._sent["gps"] = 0.0  # its first message follows HIL_SENSOR, which sets the clock
        self._seed()
        boot = float(self._options["boot"])
        for k in range(math.ceil(boot * RATE)):
            self._sense(k / RATE, self._motion(0.0, None))
            found = link.first(1.0 / RATE, self._process.check)
            if found is not None:
                # The number of steps until now depends on the clock; nothing after them does.
                self._booted = (k + 1) / RATE
                self._sent.clear()
                self._seed()
                self._set_outputs(found)
                return
        raise AutopilotLost(self.name, f"no actuator output for {boot:g} s",
                            "one within this time, or a longer ?boot=")  # fmt: skip

    def _seed(self) -> None:
        self._random = np.random.default_rng(self._parameters["seed"].astype(np.uint32))

    def _tick(self, timestamp: float, t: float | None) -> None:
        assert self._link is not None
        assert self._process is not None
        assert self._commands is not None
        now, motion = self._booted + timestamp, self._motion(timestamp, t)
        self._send(now, t)
        self._aid(now, motion, t)
        self._sense(now, motion)
        found = self._link.exchange(_us(now), self._process.check)
        self._commands.read()
        self._set_outputs(found)

    def _sense(self, now: float, motion: Motion) -> None:
        """Add HIL_SENSOR, with all readings each 20 ms, and HIL_GPS at the surface."""
        assert self._link is not None
        v, d = self._parameters, self._link.dialect
        slow = self._due("slow", now, _SLOW)
        noise = np.repeat(v["noise"], (3, 3, 3, 1)) * self._random.standard_normal(10)
        north, east, depth = motion.position
        field = np.array(motion.R).T @ v["field"]
        pressure = v["p_atm"] + v["rho"] * v["g"] * max(depth, 0.0) + noise[9]
        acc, gyro, mag = motion.acc + noise[:3], motion.gyro + noise[3:6], field + noise[6:9]
        if depth <= v["gps_depth"] and self._due("gps", now, _GPS):
            latitude = HOME[0] + math.degrees(north / _RADIUS)
            longitude = HOME[1] + math.degrees(east / _RADIUS / math.cos(math.radians(HOME[0])))
            vn, ve, vd = (round(100.0 * x) for x in motion.velocity)
            course = math.degrees(math.atan2(ve, vn)) % 360.0
            self._link.add(
                d.MAVLink_hil_gps_message(
                    _us(now), 3, round(1e7 * latitude), round(1e7 * longitude),
                    round(-1e3 * depth), 100, 100, round(math.hypot(vn, ve)), vn, ve, vd,
                    round(100.0 * course) % 36_000, 12,
                )
            )  # fmt: skip
        self._link.add(
            d.MAVLink_hil_sensor_message(
                _us(now), *acc.tolist(), *gyro.tolist(), *(1e4 * mag).tolist(), pressure / 100.0,
                0.0, -depth, v["temperature"], _ALL if slow else _IMU,
            )
        )  # fmt: skip

    def _aid(self, now: float, motion: Motion, t: float | None) -> None:
        """Add new readings of DVL, USBL and altimeter; before the start, those of the lowering."""
        assert self._link is not None
        of, sent = self._input, self._sent
        if t is None:
            if self._due("usbl", now, 0.2):
                body = np.array(motion.R).T @ motion.velocity
                self._odometry(now, motion.position, [0.5] * 3, body.tolist())
            return
        (t_usbl,), (t_dvl,), (altitude,) = map(of, ("usbl_t_sample", "dvl_t_sample", "altitude"))
        if of("usbl_valid")[0] and sent.get("usbl_t", -1.0) != t_usbl:
            sent["usbl_t"] = t_usbl
            self._odometry(now, of("usbl_position"), of("usbl_sigma"), None)
        if of("dvl_valid")[0] and sent.get("dvl_t", -1.0) != t_dvl:
            sent["dvl_t"] = t_dvl
            self._odometry(now, None, None, of("dvl_velocity"))
        if altitude > 0.0 and self._due("range", now, _RANGE):
            self._link.add(
                self._link.dialect.MAVLink_distance_sensor_message(
                    round(1e3 * now), 5, 5000, min(5000, round(100.0 * altitude)), 0, 0,
                    _DOWN, 0,
                )
            )  # fmt: skip

    def _odometry(
        self, now: float, position: Sequence[float] | None, sigma: Sequence[float] | None,
        velocity: Sequence[float] | None,
    ) -> None:  # fmt: skip
        """Add ODOMETRY: a position in n with its deviations, a velocity in b, or both."""
        assert self._link is not None
        unknown = [math.nan] * 3
        self._link.add(
            self._link.dialect.MAVLink_odometry_message(
                _us(now), _LOCAL_NED, _BODY_FRD, *(position or unknown), [math.nan] * 4,
                *(velocity or unknown), *unknown, _covariance(sigma or unknown),
                _covariance([_SIGMA_DVL] * 3 if velocity else unknown), 0, _VISION, _BEST,
            )
        )  # fmt: skip

    def _set_outputs(self, found: Controls) -> None:
        assert self._link is not None
        assert self._commands is not None
        c = found.controls
        self._pack_outputs(
            thruster_commands(c).tolist(), max(0.0, min(1.0, c[8])), max(-1.0, min(1.0, c[9])),
            max(-1.0, min(1.0, c[10])), c, self._link.received, found.armed,
        )  # fmt: skip


def _us(now: float) -> int:
    """Return a time of PX4's clock [µs]."""
    return FIRST + round(1e6 * now)


def _covariance(sigma: Sequence[float]) -> list[float]:
    """Return the upper triangle (21,), by rows, with variances of the first three states."""
    found = [0.0] * 21
    found[0], found[6], found[11] = (s * s for s in sigma)
    return found


def _parameters(file: Path) -> dict[str, str]:
    """Read PX4's parameters as variables of its environment; raises InputInvalid."""
    if not file.is_file():
        raise InputInvalid(file, "no such file", "a file of parameters")
    found = {}
    for number, line in enumerate(file.read_text().splitlines(), start=1):
        words = line.partition("#")[0].split()
        if words and len(words) != 2:
            raise InputInvalid(f"{file}:{number}", repr(line), "a name and a value")
        if words:
            found[f"PX4_PARAM_{words[0]}"] = words[1]
    return found
