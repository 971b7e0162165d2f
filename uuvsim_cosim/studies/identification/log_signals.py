"""Signals of a vehicle's log: commands, what was measured, and the parts that are not fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.studies.identification.exclusions import exclusions
from uuvsim_cosim.studies.identification.readers.ardusub import motors_of
from uuvsim_cosim.studies.identification.vehicle_log import (
    COMMANDS,
    Series,
    VehicleLog,
    check_pauses,
)

__all__ = ["signals_of_log"]

Array = NDArray[np.float64]
_TURN = 300.0  # between two samples of an angle: a full turn in degrees
_TWO_TURNS = 4.0 * pi  # rad
_ROLL, _PITCH = 3.3, 1.65  # rad: more than pi and pi/2 with noise
_SLOW = 0.05  # s between commands: ArduSub computes them each 2.5 ms
_STATES = ("armed", "surfaced", "bottomed")
# Each series' place: signal and columns; later ones replace earlier ones.
_PLACES = (
    ("eta", "position", slice(0, 3)), ("eta", "depth", slice(2, 3)),
    ("eta", "attitude", slice(3, 6)), ("nu", "rates", slice(3, 6)), ("range", "range", slice(0, 1)),
)  # fmt: skip


def signals_of_log(log: VehicleLog) -> Signals:
    """Return `eta`, `nu`, `u` or `tau`, `voltage` and `range` at the times of all messages.

    Values are NaN at times of other messages, except commands and voltage, which are held. The
    metadata has `vehicle`, `frame`, `remarks`, and `excluded`: first and last time and reason of
    each span that is not fitted. Time is from the first command on.
    """
    _complete(log)
    remarks = [*log.remarks, *dict.fromkeys(s.remark for s in log.series.values() if s.remark)]
    vehicle, frame = log.vehicle, log.frame
    name, *others = [n for n in ("u", "pwm", "tau") if n in log.series]
    if others:
        remarks.append(f"{' and '.join(others)} in the log: not read, because {name} is there")
    commands = log.series[name]
    if name == "pwm":
        motors = motors_of(log)
        remarks += motors.remarks
        vehicle, frame = motors.vehicle, motors.frame
        commands = Series(commands.t, motors.commands(commands.values))
    if name == "u":
        _check_commands(log.path, commands)
    between = float(np.median(np.diff(commands.t))) if len(commands.t) > 1 else 0.0
    if between >= _SLOW:
        remarks.append(
            f"commands are in the log every {1e3 * between:.0f} ms: if they changed faster, "
            "numbers, above all added masses, may be wrong by more than their intervals"
        )
    begin = float(commands.t[0])
    shifted = {n: Series(s.t - begin, s.values) for n, s in log.series.items()}
    shifted["commands"] = Series(commands.t - begin, commands.values)
    timed = [s.t for n, s in shifted.items() if n not in _STATES]
    time: Array = np.unique(np.round(np.concatenate(timed), 4)).astype(np.float64)
    time = time[time >= 0.0]
    check_pauses(log.path, time + begin)
    _check_angles(log.path, log.series)
    eta, nu, range_ = (np.full((len(time), k), np.nan, np.float64) for k in (6, 6, 1))
    for to, measured, columns in _PLACES:
        s = shifted.get(measured)
        if s is None:
            continue
        at = np.round(s.t, 4)
        inside = at >= 0.0
        target = {"eta": eta, "nu": nu, "range": range_}[to]
        target[np.searchsorted(time, at[inside]), columns] = s.values[inside]
    remarks += _velocities(time, nu, shifted)
    held = shifted["commands"].at(time)
    values: dict[str, Array] = {"eta": eta, "nu": nu, "tau" if name == "tau" else "u": held}
    if "voltage" in shifted:
        first = float(shifted["voltage"].values[0, 0])
        values["voltage"] = shifted["voltage"].at(time, first)[:, 0]
    if "range" in shifted:
        values["range"] = range_[:, 0]
    if "armed" not in shifted:
        remarks.append("the log does not state when the vehicle was armed: all of it is used")
    excluded = exclusions(shifted, float(time[-1]))
    kept = float(time[-1]) - sum(e.last - e.first for e in excluded)
    if kept <= 0.0:
        raise InputInvalid(
            log.path,
            f"has no part to fit: {'; '.join(map(str, excluded))}",
            "armed time under water",
        )
    sampled = {"tau" if name == "tau" else "u": shifted["commands"].t}
    if "voltage" in shifted:
        sampled["voltage"] = shifted["voltage"].t
    metadata: dict[str, object] = {
        "sampled": sampled,  # at all other times, these are held
        "file": str(log.path), "firmware": log.firmware, "vehicle": vehicle, "frame": frame,
        "remarks": tuple(remarks), "excluded": tuple(excluded), "start": begin,
    }  # fmt: skip
    return Signals(time, np.arange(len(time)), values, {}, metadata=metadata)


# By the suffix of a log: messages with attitude or position, and with commands.
_MESSAGES = {
    ".bin": ("ATT, XKF1", "RCOU"), ".tlog": ("ATTITUDE, LOCAL_POSITION_NED", "SERVO_OUTPUT_RAW"),
    ".ulg": ("vehicle_attitude, vehicle_local_position", "actuator_motors, actuator_outputs"),
}  # fmt: skip
_OTHERS = ("--channel attitude=…", "--channel u=… or tau=…")


def _complete(log: VehicleLog) -> None:
    lacking = []
    measured, commanded = _MESSAGES.get(log.path.suffix.lower(), _OTHERS)
    if not {"attitude", "rates", "position"} & log.series.keys():
        lacking.append(f"attitude or position ({measured})")
    if not COMMANDS & log.series.keys():
        lacking.append(f"the thrusters' commands ({commanded})")
    if lacking:
        there = ", ".join(sorted(log.series)) or "nothing of use"
        more = "".join(f"; {r}" for r in log.remarks if " that are not read: " in r)
        raise InputInvalid(f"{log.path}: lacks {' and '.join(lacking)}; it has {there}{more}")


def _check_commands(path: Path, commands: Series) -> None:
    """Refuse commands that are no shares of the full command, such as percent."""
    size = np.abs(np.nan_to_num(commands.values))
    if size.max(initial=0.0) <= 1.0 + 1e-6:
        return
    row, column = np.unravel_index(int(size.argmax()), size.shape)
    raise InputInvalid(
        path,
        f"u[{column + 1}] is {commands.values[row, column]:.4g} at {commands.t[row]:.3f} s",
        "commands from -1 to 1, such as 0.37 for 37 percent; pulses are pwm",
    )


def _check_angles(path: Path, series: Mapping[str, Series]) -> None:
    """Refuse an attitude in degrees: beyond pi and pi/2, or with turns of 360."""
    if "attitude" not in series:
        return
    s = series["attitude"]
    for k, (name, most) in enumerate((("roll", _ROLL), ("pitch", _PITCH), ("yaw", np.inf))):
        values = s.values[:, k]
        finite = np.isfinite(values)
        size = np.abs(values[finite])
        jumps = np.abs(np.diff(values[finite]))
        if name == "yaw" and len(size) and size.min(initial=np.inf) > _TWO_TURNS:
            raise InputInvalid(
                path,
                f"yaw is {size.min():.4g} to {size.max():.4g} all the time, as if it were in "
                "degrees",
                "radians, less than two turns at some time; unit=deg, or deg in the line of units "
                "of a CSV, converts it",
            )
        if size.max(initial=0.0) <= most and jumps.max(initial=0.0) < _TURN:
            continue
        at = float(s.t[finite][int(np.argmax(size))])
        raise InputInvalid(
            path,
            f"{name} reaches {size.max():.4g} at {at:.3f} s, as if it were in degrees",
            f"radians, at most {pi if k == 0 else pi / 2:.3g}; unit=deg, or deg in the line of "
            "units of a CSV, converts it",
        )


def _velocities(time: Array, nu: Array, series: Mapping[str, Series]) -> Sequence[str]:
    """Write u, v and w: of the DVL, else of the estimator, turned into the vehicle's axes."""
    if "dvl" in series:
        s = series["dvl"]
        inside = s.t >= 0.0
        nu[np.searchsorted(time, np.round(s.t[inside], 4)), :3] = s.values[inside]
        return ["u, v and w are those of the DVL (visual odometry)"]
    if "velocity" not in series or "attitude" not in series:
        return []
    from scipy.spatial.transform import Rotation

    s, attitude = series["velocity"], series["attitude"]
    good = np.isfinite(s.values).all(axis=1) & (s.t >= 0.0)
    if not good.any():
        return ["the estimator had no measurement of horizontal position or velocity: only "
                "attitude, rates and depth are used"]  # fmt: skip
    unwrapped = np.unwrap(attitude.values, axis=0)
    euler = np.stack([np.interp(s.t[good], attitude.t, c) for c in unwrapped.T], axis=1)
    at = np.searchsorted(time, np.round(s.t[good], 4))
    nu[at, :3] = Rotation.from_euler("ZYX", euler[:, ::-1]).inv().apply(s.values[good])
    return []
