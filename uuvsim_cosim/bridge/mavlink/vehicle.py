"""A vehicle of a running co-simulation: which signals are its state, and its state as messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import cos, degrees, hypot, pi, radians, sin, sqrt
from typing import Any

from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.errors import InputInvalid

__all__ = [
    "ORIGIN",
    "State",
    "Vehicle",
    "global_of",
    "local_of",
    "messages_of",
    "vehicles_of",
    "wrapped",
]

TRIALS = 20  # to read values and the time of one communication point
ORIGIN = (33.810313, -118.393867)  # [deg] of the local frame until SET_GPS_GLOBAL_ORIGIN
_A, _E2 = 6378137.0, 6.69437999014e-3  # WGS 84: semi-major axis [m], first eccentricity squared
_ANTENNA = 0.2  # [m] above CO, if the system has no GPS receiver
_G, _P_0, _RHO = 9.80665, 101325.0, 1025.0  # [m/s2], [Pa], [kg/m3] without a pressure sensor
# Each meaning: outputs (and inputs, with ">") by which its component is recognised.
_SIGNS = {
    "hull": ("eta", "nu", "nu_dot", ">tau"),
    "navigation": ("eta", "nu", "sigma"),
    "imu": ("acc", "gyro"),
    "pressure": ("pressure", "t_sample"),
    "battery": ("voltage", "state_of_charge"),
    "range": ("altitude", "t_sample"),
    "allocation": ("u", ">tau_d"),
    "wrench": ("current_total",),
    "gps": ("position", "velocity", "sigma", "valid"),
}


@dataclass(frozen=True)
class Vehicle:
    """A vehicle: its `prefix` in the system ("" or "name.") and the component of each meaning.

    `others` are the prefixes of vehicles that are nested in the same system. A vehicle whose prefix
    another one shares has only its hull (`is_alone` is false).
    """

    prefix: str
    components: Mapping[str, str]
    others: tuple[str, ...] = ()
    is_alone: bool = True

    def owns(self, path: str) -> bool:
        """Return whether a component is a part of this vehicle."""
        if not self.is_alone:
            return path == self.components["hull"]
        return path.startswith(self.prefix) and not path.startswith(self.others)

    @property
    def signals(self) -> dict[str, str]:
        """The signals of its state by their meaning."""
        at = self.components
        known = at.get("navigation", at["hull"])
        found = {"eta": f"{known}.eta", "nu": f"{known}.nu", "nu_dot": f"{at['hull']}.nu_dot"}
        for meaning, outputs in (
            ("imu", ("acc", "gyro")),
            ("pressure", ("pressure",)),
            ("battery", ("voltage", "state_of_charge")),
            ("range", ("altitude",)),
            ("allocation", ("u",)),
            ("wrench", ("current_total",)),
        ):
            if meaning in at:
                found.update({output: f"{at[meaning]}.{output}" for output in outputs})
        if "gps" in at:
            found |= {f"gps_{name}": f"{at['gps']}.{name}" for name in ("position", "valid")}
        return found

    def read(self, service: Service, client: Client) -> State:
        """Read its state and the communication point that it belongs to.

        A run that is much faster than real time may go on at each trial; its state is then some
        points older than the stated time.
        """
        names = self.signals
        for _ in range(TRIALS):
            before = service.moment()
            values = service.get(client, list(names.values()))
            if (after := service.moment()).tick == before.tick:
                break
        taken: dict[str, Any] = {}
        for meaning, name in names.items():
            value = values[name]
            shape = getattr(value, "shape", ())
            taken[meaning] = tuple(map(float, value)) if shape else float(value)
        return State(after.time, **taken)


@dataclass(frozen=True)
class State:
    """A vehicle's state at `time` [s]: SI units, pose in NED, velocity in the body frame.

    `u` (n,) are the thrusters' commands from -1 to 1. A value that no component has is None.
    """

    time: float
    eta: tuple[float, ...]
    nu: tuple[float, ...]
    nu_dot: tuple[float, ...]
    acc: tuple[float, ...] | None = None
    gyro: tuple[float, ...] | None = None
    pressure: float | None = None
    voltage: float | None = None
    state_of_charge: float | None = None
    altitude: float | None = None
    u: tuple[float, ...] = field(default=())
    current_total: float | None = None
    gps_position: tuple[float, ...] | None = None
    gps_valid: float | None = None

    @property
    def has_fix(self) -> bool:
        """Whether GPS has a fix: as the receiver reports, or with the antenna above the surface."""
        return self.eta[2] < _ANTENNA if self.gps_valid is None else self.gps_valid > 0.5

    @property
    def ms(self) -> int:
        """Time since the start [ms]."""
        return round(self.time * 1e3) & 0xFFFFFFFF

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Velocity in NED [m/s]: R(Theta) of Fossen (2021), eq. 2.31, times the body's."""
        phi, theta, psi = self.eta[3:]
        u, v, w = self.nu[:3]
        cf, sf, ct, st, cp, sp = cos(phi), sin(phi), cos(theta), sin(theta), cos(psi), sin(psi)
        return (
            cp * ct * u + (cp * st * sf - sp * cf) * v + (sp * sf + cp * cf * st) * w,
            sp * ct * u + (cp * cf + sf * st * sp) * v + (st * sp * cf - cp * sf) * w,
            -st * u + ct * sf * v + ct * cf * w,
        )

    @property
    def specific_force(self) -> tuple[float, float, float]:
        """Reading of an ideal accelerometer [m/s2] in the body frame, or that of the IMU."""
        if self.acc is not None:
            return self.acc[0], self.acc[1], self.acc[2]
        phi, theta, _ = self.eta[3:]
        u, v, w, p, q, r = self.nu
        a = self.nu_dot
        return (
            a[0] + q * w - r * v + _G * sin(theta),
            a[1] + r * u - p * w - _G * cos(theta) * sin(phi),
            a[2] + p * v - q * u - _G * cos(theta) * cos(phi),
        )

    @property
    def absolute_pressure(self) -> float:
        """Pressure of the sensor, or of still sea water at this depth [Pa]."""
        return _P_0 + _RHO * _G * self.eta[2] if self.pressure is None else self.pressure

    @property
    def pwm(self) -> tuple[int, ...]:
        """Pulse widths of the thrusters [us]: 1500 + 400 u."""
        return tuple(round(1500.0 + 400.0 * max(-1.0, min(1.0, u))) for u in self.u)


def vehicles_of(service: Service) -> list[Vehicle]:
    """Return the vehicles of a system; raises InputInvalid if there is none."""
    outputs: dict[str, set[str]] = {}
    for info in service.schema():
        path, _, name = info.name.rpartition(".")
        if info.causality in ("output", "input"):
            outputs.setdefault(path, set()).add((">" if info.causality == "input" else "") + name)

    hulls = [path for path, names in outputs.items() if set(_SIGNS["hull"]) <= names]
    prefixes = [hull[: hull.rfind(".") + 1] for hull in hulls]
    vehicles = []
    for hull, prefix in zip(hulls, prefixes, strict=True):
        others = tuple(p for p in prefixes if p != prefix and p.startswith(prefix))
        vehicle = Vehicle(prefix, {"hull": hull}, others, prefixes.count(prefix) == 1)
        at = {
            meaning: next((p for p, names in outputs.items()
                           if set(signs) <= names and vehicle.owns(p)), None)
            for meaning, signs in _SIGNS.items()
        }  # fmt: skip
        known = {meaning: path for meaning, path in at.items() if path is not None}
        vehicles.append(replace(vehicle, components={**known, "hull": hull}))
    if not vehicles:
        raise InputInvalid(
            f"--mavlink: {service.describe()['system']}",
            "no component has outputs eta, nu and nu_dot and an input tau",
            "a system with a hull",
        )
    return vehicles


def global_of(north: float, east: float, origin: tuple[float, float]) -> tuple[float, float]:
    """Return latitude and longitude [deg] of a place near the origin (first order)."""
    meridian, normal = _radii(origin)
    latitude = origin[0] + degrees(north / meridian)
    return latitude, origin[1] + degrees(east / (normal * cos(radians(origin[0]))))


def local_of(latitude: float, longitude: float, origin: tuple[float, float]) -> tuple[float, float]:
    """Return north and east [m] of a place near the origin; the inverse of `global_of`."""
    meridian, normal = _radii(origin)
    north = radians(latitude - origin[0]) * meridian
    return north, radians(longitude - origin[1]) * normal * cos(radians(origin[0]))


def _radii(origin: tuple[float, float]) -> tuple[float, float]:
    """Radii of curvature of WGS 84 [m] in the meridian and in the prime vertical."""
    root = 1.0 - _E2 * sin(radians(origin[0])) ** 2
    return _A * (1.0 - _E2) / root**1.5, _A / sqrt(root)


def messages_of(
    mav: Any, s: State, origin: tuple[float, float], *, can_arm: bool = True
) -> dict[str, Any]:
    """Return the messages of a state by name; `mav` is pymavlink's dialect."""
    phi, theta, psi = s.eta[3:]
    p, q, r = s.gyro if s.gyro is not None else s.nu[3:]
    n, e, d = s.eta[:3]
    vn, ve, vd = s.velocity
    f = s.specific_force
    latitude, longitude = global_of(n, e, origin)
    lat, lon, up = round(latitude * 1e7), round(longitude * 1e7), round(-d * 1e3)
    heading = round(degrees(psi) % 360.0 * 100.0) % 36000
    us = round(s.time * 1e6)
    milli = [round(x / 9.80665 * 1e3) for x in f]
    rates = [round(x * 1e3) for x in (p, q, r)]
    volts = 65535 if s.voltage is None else round(s.voltage * 1e3)
    current = -1 if s.current_total is None else round(s.current_total * 100.0)
    percent = -1 if s.state_of_charge is None else round(s.state_of_charge * 100.0)
    sensors = 1 | 2 | 8 | 1024 | 32768  # gyro, accelerometer, pressure, rates, motors
    checked = sensors | mav.MAV_SYS_STATUS_PREARM_CHECK
    healthy = checked if can_arm else sensors
    pwm = (*s.pwm, *([0] * 16))[:16]
    speed = hypot(vn, ve)
    up_to = [volts] + [65535] * 9
    found = [
        mav.MAVLink_attitude_message(s.ms, phi, theta, psi, p, q, r),
        mav.MAVLink_local_position_ned_message(s.ms, n, e, d, vn, ve, vd),
        mav.MAVLink_global_position_int_message(
            s.ms, lat, lon, up, up, round(vn * 100), round(ve * 100), round(vd * 100), heading
        ),
        _gps(mav, s, us, origin, heading),
        mav.MAVLink_sys_status_message(
            checked, checked, healthy, 0, volts, current, percent, 0, 0, 0, 0, 0, 0
        ),
        mav.MAVLink_scaled_pressure2_message(s.ms, s.absolute_pressure / 100.0, 0.0, 0),
        mav.MAVLink_vfr_hud_message(speed, speed, heading // 100, 0, -d, -vd),
        mav.MAVLink_servo_output_raw_message(us & 0xFFFFFFFF, 0, *pwm[:8], *pwm[8:]),
        mav.MAVLink_raw_imu_message(us, *milli, *rates, 0, 0, 0),
        mav.MAVLink_battery_status_message(0, 0, 0, 32767, up_to, current, -1, -1, percent),
        mav.MAVLink_system_time_message(us, s.ms),
    ]
    if s.altitude is not None:
        found.append(mav.MAVLink_rangefinder_message(s.altitude, 0.0))
        cm = max(0, min(65535, round(s.altitude * 100.0)))
        found.append(mav.MAVLink_distance_sensor_message(s.ms, 5, 5000, cm, 0, 0, 25, 0))
    return {message.get_type(): message for message in found}


def _gps(mav: Any, s: State, us: int, origin: tuple[float, float], heading: int) -> Any:
    """Return GPS_RAW_INT; without a fix (under water), its values are those of unknown."""
    if not s.has_fix:
        unknown = 65535
        return mav.MAVLink_gps_raw_int_message(us, 1, 0, 0, 0, *(unknown,) * 4, 0)
    n, e, d = s.eta[:3] if s.gps_position is None else s.gps_position
    lat, lon = (round(x * 1e7) for x in global_of(n, e, origin))
    speed = hypot(*s.velocity[:2])
    return mav.MAVLink_gps_raw_int_message(
        us, 3, lat, lon, round(-d * 1e3), 100, 100, round(speed * 100), heading, 10
    )


def wrapped(angle: float) -> float:
    """Return an angle from -pi to pi."""
    return (angle + pi) % (2.0 * pi) - pi
