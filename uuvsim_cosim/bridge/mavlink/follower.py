"""The source `mavlink:ADDRESS`: a vehicle over MAVLink in the place of a hull.

Its state becomes the outputs of the component. If `allow` permits it, the input `tau` becomes
MANUAL_CONTROL: each element divided by `tau_max`. Without news for `timeout` the output `link` is
0, the outputs keep their last values and no commands are sent, so the vehicle's fail-safe acts.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from math import cos, isfinite, sin
from pathlib import Path
from time import monotonic, time
from typing import Any, final

from uuvsim_cosim.bridge.mavlink.link import Address, Link, dialect
from uuvsim_cosim.closing import close_at_exit
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.system.resolve import register
from uuvsim_cosim.orchestrator.system.sources import Backend

__all__ = ["MavlinkSource", "allow", "source"]

KEY = "UUVSIM_MAVLINK_KEY"  # environment variable: path of the file with the pass phrase
_SIGNED_SINCE = 1420070400  # [s] 2015-01-01, from which signatures count time in units of 10 us
_SEND = 0.05  # [s] between two commands
_WAIT = 5.0  # [s] for the first state

_permitted: dict[str, object] = {"commands": False, "key": None}


def allow(*, arm_real: bool, unsigned: bool) -> list[str]:
    """Set whether followed vehicles get commands, and their signature; return what to print.

    The key is the SHA-256 of the pass phrase in the file that the environment variable
    UUVSIM_MAVLINK_KEY names. Raises InputInvalid if it is needed and missing.
    """
    register("mavlink", source)
    key = None
    if unsigned and not arm_real:
        raise InputInvalid("--unsigned", "no commands are sent", "--arm-real as well")
    if arm_real and not unsigned:
        path = os.environ.get(KEY)
        phrase = Path(path).read_bytes().strip() if path and Path(path).is_file() else b""
        if not phrase:
            raise InputInvalid(
                "--arm-real",
                f"{KEY} names no file with a pass phrase",
                "one that the vehicle knows too, or --unsigned as well",
            )
        key = hashlib.sha256(phrase).digest()
    _permitted.update(commands=arm_real, key=key)
    texts = ["--arm-real: commands are sent to a followed vehicle"] if arm_real else []
    return texts + (["--unsigned: these commands are not signed"] if unsigned else [])


_ETA = (6, ("m", "m", "m", "rad", "rad", "rad"))
_NU = (6, ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s"))


class Followed:
    """A vehicle that is followed over MAVLink: its state, and `link` (1: there are news)."""

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
    }
    parameters = {  # noqa: RUF012
        "timeout": (2.0, "s"),
        "tau_max_x": (85.0, "N"),
        "tau_max_y": (85.0, "N"),
        "tau_max_z": (120.0, "N"),
        "tau_max_n": (20.0, "N.m"),
    }
    address = Address("udpin", "127.0.0.1", 0)
    _receiver: _Receiver | None = None  # of the class: a reset keeps the connection

    def initialize(self, t: float) -> dict[str, object]:
        """Open the address, and wait for the first state for at most 5 s."""
        cls = type(self)
        if cls._receiver is None:
            cls._receiver = _Receiver(self.address)
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

    def _outputs(self, r: _Receiver, v_c: tuple[float, ...]) -> dict[str, object]:
        to_body = _rotation(r.eta[3:])
        current = [sum(to_body[j][i] * v_c[j] for j in range(3)) for i in range(3)]
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
            "nu_dot": [0.0] * 6,
            "nu_r": [v - c for v, c in zip(r.nu, (*current, 0.0, 0.0, 0.0), strict=True)],
            "link": 1.0 if r.age < self.timeout else 0.0,
        }

    # set as attributes by PythonComponent
    timeout: float
    tau_max_x: float
    tau_max_y: float
    tau_max_z: float
    tau_max_n: float


@final
class _Receiver:
    """The connection to one vehicle: the first autopilot that is heard, and no other."""

    def __init__(self, address: Address) -> None:
        self._mav = dialect()
        self._link = Link(address)
        close_at_exit(self._link)
        self._parser = self._mav.MAVLink(None, srcSystem=255, srcComponent=190)
        self._parser.robust_parsing = True
        key = _permitted["key"]
        if key is not None:  # only what is sent is signed
            self._parser.signing.secret_key = key
            self._parser.signing.link_id = 1
            self._parser.signing.timestamp = int((time() - _SIGNED_SINCE) * 1e5)
            self._parser.signing.sign_outgoing = True
            self._parser.signing.allow_unsigned_callback = lambda mav, number: True
        self.eta, self.nu = [0.0] * 6, [0.0] * 6
        self._velocity = [0.0] * 3
        self._system = 0
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
        for _, data in self._link.receive(timeout):
            for m in self._parser.parse_buffer(data) or []:
                self._take(m)

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
        data = bytes(message.pack(self._parser))
        self._parser.seq = (self._parser.seq + 1) % 256
        self._link.send(data)

    def _take(self, m: Any) -> None:
        name = m.get_type()
        if name == "HEARTBEAT" and not self._system and m.autopilot != 8:
            self._system = m.get_srcSystem()
        if name not in self._heard or m.get_srcSystem() != self._system:
            return
        if name == "ATTITUDE":
            values = [m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed]
        else:
            values = [m.x, m.y, m.z, m.vx, m.vy, m.vz]
        if not all(map(isfinite, values)):
            return
        if name == "ATTITUDE":
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
        return PythonComponent(type("Followed", (Followed,), {"address": self.address}), path)
