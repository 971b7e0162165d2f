"""Recordings and logs of vehicles as signals: Parquet, MCAP and CSV, ArduSub's .BIN and .tlog.

A log gives `eta`, `nu`, `u` and `voltage`: attitude and rates as logged, position and velocity of
the estimator (velocity in body axes), u = (pwm - 1500 us) / 400 us. Each message has its own time.
At other times its values are NaN, except commands and voltage, which are held.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["read_log"]

Array = NDArray[np.float64]
_TIME = ("time", "t", "t_s", "time_s")
# Columns of models/checks/reference_trajectory.py, as elements of what they are.
_REFERENCE = {
    "eta": ("N_m", "E_m", "D_m", "phi_rad", "theta_rad", "psi_rad"),
    "nu": ("u_mps", "v_mps", "w_mps", "p_rps", "q_rps", "r_rps"),
    "tau": ("X_N", "Y_N", "Z_N", "K_Nm", "M_Nm", "N_Nm"),
    "v_c": ("vc_N_mps", "vc_E_mps", "vc_D_mps"),
}
_FACTORS = {
    "deg": pi / 180.0,
    "deg/s": pi / 180.0,
    "km": 1e3,
    "cm": 1e-2,
    "mm": 1e-3,
    "km/h": 1 / 3.6,
}


def read_log(path: str | Path) -> Signals:
    """Read a recording or a log by its suffix; raises InputInvalid or RecordingError."""
    path = Path(path)
    if not path.exists():
        raise InputInvalid(
            path, "no such recording", "a folder of a run, .parquet, .mcap, .csv, .BIN or .tlog"
        )
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return _csv(path)
    if suffix in (".bin", ".tlog"):
        return _ardupilot(path)
    if path.is_file() and suffix not in (".parquet", ".arrows", ".mcap"):
        raise InputInvalid(
            path,
            f"{suffix or 'a file without suffix'!r} is not read",
            "a folder of a run, .parquet, .mcap, .csv, .BIN or .tlog",
        )
    found = read_signals(path)
    return Signals(
        found.time, found.ticks, found.values_by_name, found.units, found.descriptions,
        {**found.metadata, "file": str(path)}, found.element_units,
    )  # fmt: skip


# ---- CSV --------------------------------------------------------------------------------------


def _csv(path: Path) -> Signals:
    """Read names in the first line, units in the second (or none), then numbers."""
    import csv

    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [(n, r) for n, r in enumerate(csv.reader(file), 1)
                    if r and not r[0].lstrip().startswith("#")]  # fmt: skip
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputInvalid(f"{path}: cannot be read as CSV: {error}") from None
    if not rows:
        raise InputInvalid(path, "is empty", "a line of names, first of them time")
    names = [name.strip() for name in rows[0][1]]
    time = next((n for n in _TIME if n in names), None)
    if time is None:
        raise InputInvalid(
            f"{path}:{rows[0][0]}", f"columns {', '.join(names[:8])}", "one named time"
        )
    if len(set(names)) != len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise InputInvalid(f"{path}:{rows[0][0]}", f"two columns {twice!r}", "each name once")
    body = rows[1:]
    units = [""] * len(names)
    if body and not _is_number(body[0][1][0]):
        units = [u.strip() for u in body[0][1]] + units
        body = body[1:]
    table = np.full((len(body), len(names)), np.nan)
    for k, (n, row) in enumerate(body):
        if len(row) != len(names):
            raise InputInvalid(f"{path}:{n}", f"{len(row)} values", len(names))
        for j, cell in enumerate(row):
            if cell.strip():
                if not _is_number(cell):
                    raise InputInvalid(f"{path}:{n}", f"{names[j]} = {cell.strip()!r}", "a number")
                table[k, j] = float(cell)
    for j in range(len(names)):
        table[:, j] *= _FACTORS.get(units[j], 1.0)
    t = table[:, names.index(time)]
    columns = {n: table[:, j] for j, n in enumerate(names) if n != time}
    return _signals(t, _gathered(columns), path)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _gathered(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Put ``hull.eta[1]`` … into one array; reference columns become eta, nu, tau and v_c."""
    groups: dict[str, dict[int, Array]] = {}
    out: dict[str, Array] = {}
    length = len(next(iter(columns.values()))) if columns else 0
    for name, column in columns.items():
        whole, indices = split_element_name(name)
        known = next((k for k, of in _REFERENCE.items() if name in of), None)
        if len(indices) == 1 and indices[0] >= 1:
            groups.setdefault(whole, {})[indices[0] - 1] = column
        elif known is not None:
            groups.setdefault(known, {})[_REFERENCE[known].index(name)] = column
        else:
            out[name] = column
    for name, found in groups.items():
        size = max(max(found) + 1, len(_REFERENCE.get(name, ())))
        lacking = np.zeros(length) if name in ("tau", "v_c") else np.full(length, np.nan)
        out[name] = np.stack([found.get(i, lacking) for i in range(size)], axis=1)
    return out


def _signals(t: Array, values: Mapping[str, Array], path: Path) -> Signals:
    return Signals(t, np.arange(len(t)), dict(values), {}, metadata={"file": str(path)})


# ---- ArduSub ----------------------------------------------------------------------------------


def _ardupilot(path: Path) -> Signals:
    try:
        from pymavlink import mavutil
    except ImportError:
        raise InputInvalid(
            path, "logs of ArduSub are read by pymavlink", "`pip install 'uuvsim-cosim[mavlink]'`"
        ) from None
    wanted = ["ATTITUDE", "LOCAL_POSITION_NED", "SERVO_OUTPUT_RAW", "SYS_STATUS",
              "ATT", "XKF1", "NKF1", "IMU", "RCOU", "BAT"]  # fmt: skip
    kept: dict[str, list[tuple[float, list[float]]]] = {}
    names: set[str] = set()
    with path.open("rb") as file:
        head = file.read(9)
    if path.suffix.lower() == ".bin":
        good, expected = head[:2] == b"\xa3\x95", "a dataflash log of ArduPilot"
    else:
        good, expected = head[8:9] in (b"\xfe", b"\xfd", b"\x55"), "a telemetry log of MAVLink"
    if not good:
        raise InputInvalid(path, f"begins with {head.hex(' ') or 'nothing'}", expected)
    log: Any = None
    try:
        log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
        while (message := log.recv_match()) is not None:
            kind = message.get_type()
            names.add(kind)
            if kind in wanted:
                _keep(kept, kind, message)
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputInvalid(
            path, f"is no log that pymavlink reads ({reason})", ".BIN or .tlog"
        ) from None
    finally:
        if log is not None:
            log.close()
    lacking = []
    if not {"att", "rates", "state"} & kept.keys():
        lacking.append("attitude or position (ATT, XKF1; ATTITUDE, LOCAL_POSITION_NED)")
    if "pwm" not in kept:
        lacking.append("the thrusters' commands (RCOU; SERVO_OUTPUT_RAW)")
    if lacking:
        there = ", ".join(sorted(names - {"BAD_DATA", "FMT"})[:12]) or "nothing"
        raise InputInvalid(f"{path}: lacks {' and '.join(lacking)}; there are {there}")
    return _merged(kept, path)


def _keep(kept: dict[str, list[tuple[float, list[float]]]], kind: str, m: Any) -> None:
    def put(name: str, t: float, values: list[float]) -> None:
        kept.setdefault(name, []).append((t, values))

    if kind == "ATTITUDE":
        t = m.time_boot_ms / 1e3
        put("att", t, [m.roll, m.pitch, m.yaw])
        put("rates", t, [m.rollspeed, m.pitchspeed, m.yawspeed])
    elif kind == "LOCAL_POSITION_NED":
        put("state", m.time_boot_ms / 1e3, [m.x, m.y, m.z, m.vx, m.vy, m.vz])
    elif kind == "SERVO_OUTPUT_RAW" and m.port == 0:
        pwm = [float(getattr(m, f"servo{i}_raw", 0) or 0) for i in range(1, 17)]
        put("pwm", m.time_usec / 1e6, pwm)
    elif kind == "SYS_STATUS" and kept.get("att") and m.voltage_battery < 65535:
        put("voltage", kept["att"][-1][0], [m.voltage_battery / 1e3])
    elif kind == "ATT":
        put("att", m.TimeUS / 1e6, [v * pi / 180.0 for v in (m.Roll, m.Pitch, m.Yaw)])
    elif kind in ("XKF1", "NKF1") and getattr(m, "C", 0) == 0:
        put("state", m.TimeUS / 1e6, [m.PN, m.PE, m.PD, m.VN, m.VE, m.VD])
    elif kind == "IMU" and getattr(m, "I", 0) == 0:
        put("rates", m.TimeUS / 1e6, [m.GyrX, m.GyrY, m.GyrZ])
    elif kind == "RCOU":
        pwm = [float(getattr(m, f"C{i}", 0) or 0) for i in range(1, 15)]
        put("pwm", m.TimeUS / 1e6, pwm)
    elif kind == "BAT" and getattr(m, "Inst", 0) == 0:
        put("voltage", m.TimeUS / 1e6, [m.Volt])


def _merged(kept: Mapping[str, list[tuple[float, list[float]]]], path: Path) -> Signals:
    """Merge the times of all messages, in seconds since the first command."""
    series: dict[str, tuple[Array, Array]] = {}
    for name, rows in kept.items():
        t = np.array([r[0] for r in rows])
        order = np.argsort(t, kind="stable")
        series[name] = (np.round(t[order], 4), np.array([r[1] for r in rows], dtype=float)[order])
    time = np.unique(np.concatenate([t for t, _ in series.values()]))
    begin = series["pwm"][0][0]
    time = time[time >= begin]
    eta, nu = np.full((len(time), 6), np.nan), np.full((len(time), 6), np.nan)

    def place(name: str) -> tuple[NDArray[np.intp], Array]:
        t, values = series[name]
        t, first = np.unique(t, return_index=True)
        inside = t >= begin
        return np.searchsorted(time, t[inside]), values[first][inside]

    for name, to in (("att", eta), ("rates", nu)):
        if name in series:
            at, values = place(name)
            to[at, 3:] = values
    if "state" in series:
        at, values = place("state")
        eta[at, :3] = values[:, :3]
        if "att" in series:
            from scipy.spatial.transform import Rotation

            t, angles = series["att"]  # interpolated between the samples of attitude
            unwrapped = np.unwrap(angles, axis=0)
            euler = np.stack([np.interp(time[at], t, unwrapped[:, k]) for k in range(3)], axis=1)
            nu[at, :3] = Rotation.from_euler("ZYX", euler[:, ::-1]).inv().apply(values[:, 3:])
    pwm = _held(time, *series["pwm"])
    used = [i for i in range(pwm.shape[1]) if np.any(pwm[:, i] > 0)]
    pwm = pwm[:, : max(used, default=0) + 1]
    u = np.where(pwm > 0, np.clip((pwm - 1500.0) / 400.0, -1.0, 1.0), 0.0)
    values_by_name: dict[str, Array] = {"eta": eta, "nu": nu, "u": u}
    if "voltage" in series:
        values_by_name["voltage"] = _held(time, *series["voltage"])[:, 0]
    return _signals(time - begin, values_by_name, path)


def _held(time: Array, t: Array, values: Array) -> Array:
    i = np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 1)
    held: Array = values[i]
    return held
