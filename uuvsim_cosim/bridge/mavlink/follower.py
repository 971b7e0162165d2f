"""The source `mavlink:ADDRESS`: a vehicle over MAVLink in the place of a hull.

Its state becomes the outputs of the component. If `allow` permits it, the input `tau` becomes
MANUAL_CONTROL: each element divided by `tau_max`. Without news for `timeout` the output `link` is
0, the outputs keep their last values and no commands are sent, so the vehicle's fail-safe acts.

The acceleration is that of the vehicle's accelerometers, for v, omega and f in the body frame:

    dv/dt = f + R^T(Theta) g - omega x v,    domega/dt = (omega - omega before) / (t - t before).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, isfinite, sin
from pathlib import Path
from time import monotonic
from typing import Any, final

from uuvsim_cosim.bridge.mavlink.codec import KEY, Codec, key_of_environment
from uuvsim_cosim.bridge.mavlink.link import Address, Link, dialect
from uuvsim_cosim.closing import close_at_exit
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.system.resolve import register
from uuvsim_cosim.orchestrator.system.sources import Backend

__all__ = ["MavlinkSource", "allow", "source"]

_SEND = 0.05  # [s] between two commands
_WAIT = 5.0  # [s] for the first state
_G = 9.80665  # [m/s2]

_permitted: dict[str, Any] = {"commands": False, "key": None, "report": None}


def allow(
    *, arm_real: bool, unsigned: bool, report: Callable[[str], None] | None = None
) -> list[str]:
    """Set whether followed vehicles get commands, and their signature; return what to print.

    With a key (see `codec`), messages of the vehicle without a valid signature are refused, unless
    `unsigned`. `report` gets the messages of the component, which are logged as well. Raises
    InputInvalid if the key is needed and missing.
    """
    register("mavlink", source)
    if unsigned and not arm_real:
        raise InputInvalid("--unsigned", "no commands are sent", "--arm-real as well")
    key = None if unsigned else key_of_environment()
    if arm_real and not unsigned and key is None:
        raise InputInvalid(
            "--arm-real",
            f"{KEY} names no file with a pass phrase",
            "one that the vehicle knows too, or --unsigned as well",
        )
    _permitted.update(commands=arm_real, key=key, report=report)
    texts = ["--arm-real: commands are sent to a followed vehicle"] if arm_real else []
    return texts + (["--unsigned: these commands are not signed"] if unsigned else [])


_ETA = (6, ("m", "m", "m", "rad", "rad", "rad"))
_NU = (6, ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s"))


class Followed:
    """A vehicle that is followed over MAVLink: its state, and `link` (1: there are news).

    `nu_dot_measured` is 1 if the vehicle sends accelerations; without them `nu_dot` is 0.
    """

    inputs = {  # noqa: RUF012
        "tau": (6, ("N", "N", "N", "N.m", "N.m", "N.m")),
        "v_c": (3, "m/s"),
    }
    outputs = {  # noqa: RUF012
        "eta": _ETA,
        "q": (4, "1"),
        "nu": _NU,
        "nu_dot": (6, ("m/s2", "m/s2", "m/s2", "rad/s2", "rad/s2", "rad/s2")),
        "nu_r": _NU,
        "link": "1",
        "nu_dot_measured": "1",
    }
    parameters = {  # noqa: RUF012
        "timeout": (2.0, "s"),
        "tau_max_x": (85.0, "N"),
        "tau_max_y": (85.0, "N"),
        "tau_max_z": (120.0, "N"),
        "tau_max_n": (20.0, "N.m"),
    }
    address = Address("udpin", "127.0.0.1", 0)
    path = "hull"
    _receiver: _Receiver | None = None  # of the class: a reset keeps the connection

    def initialize(self, t: float) -> dict[str, object]:
        """Open the address, and wait for the first state for at most 5 s."""
        cls = type(self)
        if cls._receiver is None:
            cls._receiver = _Receiver(self.address, self._report)
        end = monotonic() + _WAIT
        while not cls._receiver.is_complete and monotonic() < end:
            cls._receiver.receive(0.05)
        return self._outputs(cls._receiver, (0.0, 0.0, 0.0))

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, object]:
        """Read the messages that have arrived, and send the command if that is permitted."""
        receiver = type(self)._receiver
        assert receiver is not None
        receiver.receive(0.0)
        if receiver.age < self.timeout and _permitted["commands"]:
            most = (self.tau_max_x, self.tau_max_y, self.tau_max_z, self.tau_max_n)
            tau = [float(u["tau"][i]) / m for i, m in zip((0, 1, 2, 5), most, strict=True)]
            receiver.command(tau)
        return self._outputs(receiver, tuple(map(float, u["v_c"])))

    def close(self) -> None:
        """Close the connection."""
        cls = type(self)
        if cls._receiver is not None:
            cls._receiver.close()
            cls._receiver = None

    def _report(self, text: str) -> None:
        logging.getLogger(f"uuvsim_cosim.{self.path}").warning(text)
        if _permitted["report"] is not None:
            _permitted["report"](f"{self.path}: {text}")

    def _outputs(self, r: _Receiver, v_c: tuple[float, ...]) -> dict[str, object]:
        to_body = _rotation(r.eta[3:])
        current = [sum(to_body[j][i] * v_c[j] for j in range(3)) for i in range(3)]
        measured = r.accelerations(self.timeout)
        phi, theta, psi = (x / 2.0 for x in r.eta[3:])
        cf, sf, ct, st, cp, sp = cos(phi), sin(phi), cos(theta), sin(theta), cos(psi), sin(psi)
        return {
            "eta": r.eta,
            "q": [
                cf * ct * cp + sf * st * sp,
                sf * ct * cp - cf * st * sp,
                cf * st * cp + sf * ct * sp,
                cf * ct * sp - sf * st * cp,
            ],
            "nu": r.nu,
            "nu_dot": measured or [0.0] * 6,
            "nu_r": [v - c for v, c in zip(r.nu, (*current, 0.0, 0.0, 0.0), strict=True)],
            "link": 1.0 if r.age < self.timeout else 0.0,
            "nu_dot_measured": 0.0 if measured is None else 1.0,
        }

    # set as attributes by PythonComponent
    timeout: float
    tau_max_x: float
    tau_max_y: float
    tau_max_z: float
    tau_max_n: float


# To [m/s2]; RAW_IMU has a known unit only if ArduPilot sends it.
_TO_FORCE = {"HIGHRES_IMU": 1.0, "SCALED_IMU": _G * 1e-3, "RAW_IMU": _G * 1e-3}
_ARDUPILOT = 3  # MAV_AUTOPILOT
_GAP = 1000  # [ms] between attitudes, above which no angular acceleration is taken from them


@final
class _Receiver:
    """The connection to one vehicle: the first autopilot that is heard, and no other."""

    def __init__(self, address: Address, report: Callable[[str], None]) -> None:
        self._mav = dialect()
        self._link = Link(address)
        close_at_exit(self._link)
        self._codec = Codec(self._mav, 255, 190, _permitted["key"], report)
        self._report = report
        self.eta, self.nu = [0.0] * 6, [0.0] * 6
        self._velocity = [0.0] * 3
        self._force = [0.0] * 3  # specific force [m/s2] in the body frame
        self._force_at = -1e9
        self._turning = [0.0] * 3  # angular acceleration [rad/s2] in the body frame
        self._attitude_ms: int | None = None
        self._complete_at: float | None = None  # time of the first whole state
        self._is_noted = False  # that there are no accelerations
        self._system = self._autopilot = 0
        self._heard = {"ATTITUDE": -1e9, "LOCAL_POSITION_NED": -1e9}
        self._sent = -1e9

    def close(self) -> None:
        """Close the connection."""
        self._link.close()

    @property
    def age(self) -> float:
        """Time since the older of attitude and position [s]."""
        return monotonic() - min(self._heard.values())

    @property
    def is_complete(self) -> bool:
        """Whether attitude and position have been received."""
        return min(self._heard.values()) > 0.0

    def receive(self, timeout: float) -> None:
        """Take over the messages that have arrived."""
        for peer, data in self._link.receive(timeout):
            for m in self._codec.parsed(peer, data):
                self._take(m)

    def accelerations(self, timeout: float) -> list[float] | None:
        """Return nu_dot (6,); None, which is reported once, without news of them for `timeout`."""
        now = monotonic()
        if now - self._force_at < timeout:
            phi, theta, _ = self.eta[3:]
            u, v, w, p, q, r = self.nu
            f = self._force
            return [
                f[0] - _G * sin(theta) - (q * w - r * v),
                f[1] + _G * cos(theta) * sin(phi) - (r * u - p * w),
                f[2] + _G * cos(theta) * cos(phi) - (p * v - q * u),
                *self._turning,
            ]
        if self.is_complete and not self._is_noted:
            self._complete_at = self._complete_at or now
            if now - self._complete_at >= timeout:
                self._is_noted = True
                self._report(
                    "the vehicle sends no accelerations (RAW_IMU, SCALED_IMU or HIGHRES_IMU), so "
                    "nu_dot is 0 and nu_dot_measured is 0"
                )
        return None

    def command(self, shares: list[float]) -> None:
        """Send surge, sway, heave and yaw, from -1 to 1, as MANUAL_CONTROL."""
        now = monotonic()
        if not self._system or now - self._sent < _SEND or not all(map(isfinite, shares)):
            return
        self._sent = now
        x, y, z, r = (max(-1.0, min(1.0, share)) for share in shares)
        message = self._mav.MAVLink_manual_control_message(
            self._system, round(1e3 * x), round(1e3 * y), round(500.0 - 500.0 * z),
            round(1e3 * r), 0,
        )  # fmt: skip
        self._link.send(self._codec.packed(message))

    def _take(self, m: Any) -> None:
        name = m.get_type()
        if name == "HEARTBEAT" and not self._system and m.autopilot != 8:
            self._system, self._autopilot = m.get_srcSystem(), m.autopilot
        if m.get_srcSystem() != self._system:
            return
        if name in _TO_FORCE and (name != "RAW_IMU" or self._autopilot == _ARDUPILOT):
            force = [_TO_FORCE[name] * x for x in (m.xacc, m.yacc, m.zacc)]
            if all(map(isfinite, force)):
                self._force, self._force_at = force, monotonic()
        if name not in self._heard:
            return
        if name == "ATTITUDE":
            values = [m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed]
        else:
            values = [m.x, m.y, m.z, m.vx, m.vy, m.vz]
        if not all(map(isfinite, values)):
            return
        if name == "ATTITUDE":
            since = m.time_boot_ms - (self._attitude_ms or 0)
            if self._attitude_ms is not None and 0 < since <= _GAP:
                changes = zip(values[3:], self.nu[3:], strict=True)
                self._turning = [1e3 * (now - before) / since for now, before in changes]
            else:
                self._turning = [0.0] * 3
            self._attitude_ms = m.time_boot_ms
            self.eta[3:], self.nu[3:] = values[:3], values[3:]
        else:
            self.eta[:3], self._velocity = values[:3], values[3:]
        turn = _rotation(self.eta[3:])
        self.nu[:3] = [sum(turn[j][i] * self._velocity[j] for j in range(3)) for i in range(3)]
        self._heard[name] = monotonic()


def _rotation(angles: list[float]) -> list[list[float]]:
    """Rotation matrix from body to NED: Fossen (2021), eq. 2.31."""
    phi, theta, psi = angles
    cf, sf, ct, st, cp, sp = cos(phi), sin(phi), cos(theta), sin(theta), cos(psi), sin(psi)
    return [
        [cp * ct, cp * st * sf - sp * cf, sp * sf + cp * cf * st],
        [sp * ct, cp * cf + sf * st * sp, st * sp * cf - cp * sf],
        [-st, ct * sf, ct * cf],
    ]


def source(text: str, base: Path) -> MavlinkSource:
    """Resolve ``mavlink:ADDRESS``; the entry point of the scheme."""
    dialect()
    return MavlinkSource(Address.of(text.partition(":")[2], anyone=True))


@dataclass(frozen=True)
class MavlinkSource:
    """A vehicle that is followed over MAVLink."""

    address: Address
    kind: str = "mavlink"

    @property
    def text(self) -> str:
        """The source string."""
        return f"mavlink:{self.address}"

    def describe(self) -> Description:
        """Return the interface."""
        return PythonComponent(Followed, "mavlink").description

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Follow the vehicle as the component `path`."""
        return PythonComponent(
            type("Followed", (Followed,), {"address": self.address, "path": path}), path
        )
