"""DataFlash logs (.BIN) of ArduSub as a vehicle log: which message gives which quantity."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.readers.channels import NONE, Channel, assigned
from uuvsim_cosim.studies.identification.readers.dataflash_reader import DataFlash
from uuvsim_cosim.studies.identification.vehicle_log import (
    BACKWARDS,
    Series,
    VehicleLog,
    check_firmware,
    damaged_times,
    remark_on_times,
    with_depth,
    without_repetitions,
)

__all__ = ["read_dataflash"]

Array = NDArray[np.float64]
_FIRMWARE = re.compile(r"^(Ardu[A-Z]\w+|AntennaTracker|Blimp|Rover)\b.*")
_DEG = pi / 180.0
# Events of ArduPilot (message EV): armed, disarmed, on the surface, off it, on the bottom, off it.
_EVENTS = {"armed": (10, 11), "surfaced": (163, 164), "bottomed": (165, 166)}
# Bits of the estimator's status (XKF4.SS): relative and absolute horizontal position, and
# the constant-position mode of an estimator without a measurement of position or velocity.
_AIDED, _UNAIDED = 1 << 3 | 1 << 4, 1 << 7
_EVENLY = ("ATT", "RCOU", "IMU")  # messages that every log has, at 10 Hz and more
_RARE = ("EV", "ARM")  # messages that no other one replaces
_BESIDE = 0.1  # s that a message's time may lie outside those of its neighbours
_BACKWARDS = 1e-3  # s; messages of one name are written in the order of time
_GOOD_RANGE, _DOWN = 4, 25  # RFND: status, orientation


def read_dataflash(path: Path, channels: Mapping[str, Channel] = NONE) -> VehicleLog:
    """Read a .BIN; raises InputInvalid for a log of another vehicle, or of two.

    `channels` replace the usual messages.
    """
    log = DataFlash(path)
    texts = _texts(log)
    firmware = next((t for t in texts if _FIRMWARE.match(t)), "")
    parameters = _parameters(log)
    check_firmware(path, firmware, parameters)
    if len(log.conflicts) > 3:
        raise InputInvalid(
            path, f"declares {', '.join(log.conflicts[:3])} … again with other fields",
            "one log in a file: this one holds two, of different firmware; split it",
        )  # fmt: skip
    clock = _Clock(log)
    found = _Found(clock)
    found.put("pwm", "RCOU", *_channels(log))
    found.put("attitude", "ATT", "Roll", "Pitch", "Yaw", factor=_DEG)
    _put_rates(found)
    _put_estimate(log, found)
    for name, column in (("CTUN", "BAlt"), ("CTUN", "Alt")):
        if "depth" not in found.series:
            found.put("depth", name, column, factor=-1.0)
    _put_dvl(found)
    _put_range(found)
    found.put("voltage", "BAT", "Volt", first="Inst" if "BAT" in log.names else "")
    _put_events(found, parameters)
    found.series |= assigned(path, channels, partial(_channel, clock))
    remarks = [*clock.remarks.values()]
    if log.lost:
        remarks.append(
            f"{log.lost} bytes at {log.gaps} places are no messages (damaged), and are left out"
        )
    if log.cut:
        remarks.append(f"the log ends within a message: its last {log.cut} bytes are left out")
    return VehicleLog(path, with_depth(found.series), parameters, firmware, tuple(remarks))


def _channel(clock: _Clock, channel: Channel) -> tuple[Array, Array]:
    log = clock.log
    table = clock.timed(channel.topic, *channel.fields)
    if table is None or not channel.fields:
        layout = log.layouts.get(channel.topic)
        names = sorted(log.names) if layout is None else list(layout.columns)
        raise InputInvalid(
            f"{log.path}: {channel}", f"no message or column {channel.place!r}",
            f"MESSAGE:COLUMN with {', '.join(names[:12])} …",
        )  # fmt: skip
    return table[:, 0], table[:, 1:]


class _Clock:
    """Times of a log's messages, each checked by the attitude before and behind it in the file.

    A message is written when it is made, so its time lies between those of its neighbours. In 54
    real logs with 300,000 messages, none differed from that by more than 5 ms.
    """

    def __init__(self, log: DataFlash) -> None:
        self.log, self.remarks = log, dict[str, str]()
        self._places: NDArray[np.int64] = np.zeros(0, np.int64)
        self._times: Array = np.zeros(0)
        name = next((n for n in _EVENLY if n in log), None)
        table = None if name is None else log.table(name, "TimeUS")
        if name is not None and table is not None:
            t = table[:, 0] * 1e-6
            intact = ~damaged_times(log.path, name, t, _BACKWARDS)
            self._places, self._times = log.offsets(name)[intact], t[intact]

    def timed(self, name: str, *columns: str) -> Array | None:
        """Return times [s] and columns of messages; None if the log lacks one of them."""
        table = self.log.table(name, "TimeUS", *columns)
        if table is None:
            return None
        table[:, 0] *= 1e-6
        t = table[:, 0]
        i = np.searchsorted(self._places, self.log.offsets(name))
        ends = np.concatenate([[-np.inf], self._times, [np.inf]])
        # Of the checked messages, those with the same place are the messages themselves.
        last = np.searchsorted(self._places, self.log.offsets(name), side="right")
        damaged = (t < ends[i] - _BESIDE) | (t > ends[last + 1] + _BESIDE)
        if damaged.any() and name in _RARE:
            between = np.where(np.isfinite(ends[i]), ends[i], ends[last + 1])
            self.remarks[name] = (
                f"{int(damaged.sum())} of the {len(t)} messages of {name} have a damaged time: "
                "that of the message before counts "
                f"({', '.join(f'{s:.3f}' for s in between[damaged])} s)"
            )
            t[damaged], damaged = between[damaged], np.zeros(len(t), bool)
        elif damaged.any():
            self.remarks[name] = remark_on_times(name, t, damaged)
        return np.asarray(table[~damaged], dtype=np.float64)


class _Found:
    """Series of a log, each from a message and its columns."""

    def __init__(self, clock: _Clock) -> None:
        self.clock, self.series = clock, dict[str, Series]()

    def put(self, to: str, name: str, *columns: str, factor: float = 1.0, first: str = "") -> None:
        """Add a series; of many instances, numbered by column `first`, only instance 0."""
        if not columns:
            return
        numbered = [first] if first and self.clock.timed(name, first) is not None else []
        table = self.clock.timed(name, *columns, *numbered)
        if table is None:
            return
        if numbered:
            table = table[table[:, -1] == 0, :-1]
        self.add(to, name, table[:, 0], factor * table[:, 1:])

    def add(
        self, to: str, name: str, t: Array, values: Array, backwards: float = _BACKWARDS
    ) -> None:
        """Add a series of a message, if it has any."""
        if len(t):
            self.series[to] = without_repetitions(self.clock.log.path, name, t, values, backwards)


def _channels(log: DataFlash) -> list[str]:
    columns = log.layouts["RCOU"].columns if "RCOU" in log else ()
    return [c for c in columns if re.fullmatch(r"C\d+", c)]


def _texts(log: DataFlash) -> list[str]:
    if "MSG" not in log or "Message" not in log.layouts["MSG"].columns:
        return []
    return [bytes(m).decode("ascii", "replace") for m in log.messages("MSG")["Message"]]


def _parameters(log: DataFlash) -> dict[str, float]:
    if "PARM" not in log or not {"Name", "Value"} <= set(log.layouts["PARM"].columns):
        return {}
    rows = log.messages("PARM")
    return {bytes(r["Name"]).decode("ascii", "replace"): float(r["Value"]) for r in rows}


def _put_rates(found: _Found) -> None:
    """Add the first gyroscope, less the bias that the estimator's first core found."""
    found.put("rates", "IMU", "GyrX", "GyrY", "GyrZ", first="I")
    bias = _Found(found.clock)
    bias.put("bias", "XKF1", "GX", "GY", "GZ", factor=_DEG, first="C")
    if "rates" in found.series and "bias" in bias.series:
        rates, b = found.series["rates"], bias.series["bias"]
        found.series["rates"] = replace(rates, values=rates.values - b.at(rates.t, b.values[0]))


def _put_estimate(log: DataFlash, found: _Found) -> None:
    """Add position and velocity of the estimator; horizontal ones only while it was aided."""
    name = "XKF1" if "XKF1" in log else "NKF1"
    core = "C" if name in log and "C" in log.layouts[name].columns else ""
    for to, columns in (("position", ("PN", "PE", "PD")), ("velocity", ("VN", "VE", "VD"))):
        found.put(to, name, *columns, first=core)
    if "position" not in found.series:
        return
    status = _Found(found.clock)
    status.put("status", "XKF4", "SS", first="C")
    if "CTUN" in log and "BAlt" in log.layouts["CTUN"].columns:
        found.put("depth", "CTUN", "BAlt", factor=-1.0)
    if "status" not in status.series:
        return
    for to in ("position", "velocity"):
        s = found.series[to]
        bits = np.nan_to_num(status.series["status"].at(s.t)[:, 0]).astype(np.int64)
        lost = (bits & _AIDED == 0) | (bits & _UNAIDED != 0)
        values = s.values.copy()
        values[lost, :2] = np.nan
        found.series[to] = replace(s, values=values)


def _put_dvl(found: _Found) -> None:
    """Add velocities of visual odometry, by which ArduSub takes a DVL's."""
    table = found.clock.timed("VISO", "dt", "PosDX", "PosDY", "PosDZ", "conf")
    if table is None:
        return
    good = (table[:, 5] > 0) & (table[:, 1] > 0)
    table = table[good]
    if len(table):
        # The displacement over the time before the message. Some firmware writes dt in us.
        dt = table[:, 1:2] * (1e-6 if np.median(table[:, 1]) > 5.0 else 1.0)
        found.add("dvl", "VISO", table[:, 0] - 0.5 * dt[:, 0], table[:, 2:5] / dt, BACKWARDS)


def _put_range(found: _Found) -> None:
    table = found.clock.timed("RFND", "Dist", "Stat", "Orient")
    if table is None:
        return
    table = table[(table[:, 2] == _GOOD_RANGE) & (table[:, 3] == _DOWN)]
    found.add("range", "RFND", table[:, 0], table[:, 1:2])


def _put_events(found: _Found, parameters: dict[str, float]) -> None:
    """Add the times of arming and of contact with surface and bottom.

    Without an event the vehicle was armed all the time if the log is written only while armed.
    """
    events = found.clock.timed("EV", "Id")
    for to, (on, off) in _EVENTS.items():
        if events is not None:
            rows = events[(events[:, 1] == on) | (events[:, 1] == off)]
            if len(rows):
                values = (rows[:, 1:] == on).astype(float)
                found.series[to] = Series(rows[:, 0], values)
    arms = found.clock.timed("ARM", "ArmState")
    if arms is not None and len(arms):
        found.series["armed"] = Series(arms[:, 0], (arms[:, 1:] > 0).astype(float))
    start = 1.0 if parameters.get("LOG_DISARMED", 0.0) == 0.0 else 0.0
    for to in _EVENTS:
        began = start if to == "armed" else 0.0
        changes = found.series.get(to)
        if changes is None:
            if to == "armed":
                found.series[to] = Series(np.array([-np.inf]), np.array([[began]]))
            continue
        # The state before the first change is its opposite.
        t = np.concatenate([[-np.inf], changes.t])
        values = np.concatenate([1.0 - changes.values[:1], changes.values])
        found.series[to] = Series(t, values)
