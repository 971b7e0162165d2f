"""Recordings and logs of vehicles as signals, each by the reader of its format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.units import parse_unit, value_conversion
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.studies.identification.exclusions import Excluded
from uuvsim_cosim.studies.identification.log_signals import signals_of_log
from uuvsim_cosim.studies.identification.readers.bag_log import is_bag, read_bag
from uuvsim_cosim.studies.identification.readers.channels import (
    NONE,
    QUANTITIES,
    Channel,
    assigned,
)
from uuvsim_cosim.studies.identification.readers.dataflash_log import read_dataflash
from uuvsim_cosim.studies.identification.readers.px4_log import read_px4
from uuvsim_cosim.studies.identification.readers.telemetry_log import read_telemetry
from uuvsim_cosim.studies.identification.vehicle_log import (
    SIZES,
    VehicleLog,
    check_pauses,
    damaged_times,
    remark_on_times,
)

__all__ = ["read_log", "read_parameter_file"]

Array = NDArray[np.float64]
_TIME = ("time", "t", "t_s", "time_s")
# Columns of models/checks/reference_trajectory.py, as elements of what they are.
_REFERENCE = {
    "eta": ("N_m", "E_m", "D_m", "phi_rad", "theta_rad", "psi_rad"),
    "nu": ("u_mps", "v_mps", "w_mps", "p_rps", "q_rps", "r_rps"),
    "tau": ("X_N", "Y_N", "Z_N", "K_Nm", "M_Nm", "N_Nm"),
    "v_c": ("vc_N_mps", "vc_E_mps", "vc_D_mps"),
}
_EXPECTED = "a folder of a run, .parquet, .mcap, .csv, .BIN, .tlog, .ulg, .db3, .bag or a rosbag2"
_MAP = "--map component.variable=signal"
# Quantities of a log that no system has as a signal.
_LOGGED = {"attitude", "rates", "position", "dvl", "depth", "pwm", "armed"}
# Units of a vehicle's signals by element; those of a log's quantities are in channels.py.
_UNITS = {
    "eta": ("m",) * 3 + ("rad",) * 3, "nu": ("m/s",) * 3 + ("rad/s",) * 3,
    "tau": ("N",) * 3 + ("N.m",) * 3,
}  # fmt: skip
_FORCES = ("u", "pwm", "tau", "thrust", "force")  # signals that drive a vehicle
_GAP, _RARE = 1.0, 3.5  # s without a number of such a signal, and times its usual distance


def read_log(
    path: str | Path,
    parameters: Mapping[str, float] | None = None,
    channels: Mapping[str, Channel] = NONE,
) -> Signals:
    """Read a recording or a log by its suffix; raises InputInvalid or RecordingError.

    `parameters` are an autopilot's, in addition to those of its log. `channels` say where a
    quantity of the vehicle is in the log, instead of the usual place.
    """
    path = Path(path)
    if not path.exists():
        raise InputInvalid(path, "no such recording", _EXPECTED)
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return _csv(path, parameters or {}, channels)
    if suffix in (".bin", ".tlog", ".ulg"):
        return _autopilot(path, parameters or {}, channels)
    if is_bag(path):
        return signals_of_log(read_bag(path, parameters or {}, channels))
    if channels:
        raise InputInvalid(f"{path}: {next(iter(channels.values()))}", "a recording of a run", _MAP)
    if path.is_file() and suffix not in (".parquet", ".arrows", ".mcap"):
        raise InputInvalid(path, f"{suffix or 'a file without suffix'!r} is not read", _EXPECTED)
    found = read_signals(path)
    return Signals(
        found.time, found.ticks, found.values_by_name, found.units, found.descriptions,
        {**found.metadata, "file": str(path)}, found.element_units,
    )  # fmt: skip


# ---- CSV --------------------------------------------------------------------------------------


def _csv(path: Path, parameters: Mapping[str, float], channels: Mapping[str, Channel]) -> Signals:
    """Read a table: signals of a system, or the quantities of a vehicle's log.

    It is a log if columns have names of quantities that no signal has, such as ``attitude[1]``, or
    with channels.
    """
    t, columns, units = _columns(path)
    named, filled = _gathered(columns)
    if not channels and not _LOGGED & named.keys():
        finite = t[np.isfinite(t)]
        damaged = damaged_times(path, "the column of time", finite)
        remark = remark_on_times("the column of time", finite, damaged)
        filled = (*filled, remark) if remark else filled
        check_pauses(path, np.maximum.accumulate(finite[~damaged]))
        rows = np.flatnonzero(np.isfinite(t))[~damaged]
        t, named = t[rows], {n: v[rows] for n, v in named.items()}
        metadata = {"file": str(path), "remarks": filled, "excluded": _gaps(t, named)}
        return Signals(t, np.arange(len(t)), named, {}, metadata=metadata)

    def read(channel: Channel) -> tuple[Array, Array]:
        names = [n.strip() for n in channel.place.split(",")]
        for n in names:
            if n not in columns:
                raise InputInvalid(
                    f"{path}: {channel}", f"no column {n!r}", expected_names(n, sorted(columns))
                )
            if channel.unit and units[n]:
                raise InputInvalid(
                    f"{path}: {channel}?unit={channel.unit}",
                    f"the line of units has {units[n]} for {n}, and it is converted already",
                    "unit= or a line of units",
                )
        return t, np.stack([columns[n] for n in names], axis=1)

    own = {n: Channel(n, n) for n in SIZES if n in named and n not in channels}
    series = assigned(path, own, lambda c: (t, named[c.place].reshape(len(t), -1)))
    series |= assigned(path, channels, read)
    unread = sorted(named.keys() - own.keys())
    remarks = (
        (f"columns that are not read: {', '.join(unread)}",) if unread and not channels else ()
    )
    return signals_of_log(VehicleLog(path, series, parameters, "", (*remarks, *filled)))


def _columns(path: Path) -> tuple[Array, dict[str, Array], dict[str, str]]:
    """Read names in the first line, units in the second (or none), then numbers.

    Returns the time, the other columns in SI units, and the units of the file.
    """
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
        units = [u.strip(" []()") for u in body[0][1]] + units
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
    units = ["" if u in ("", "-", "1") else u for u in units[: len(names)]]
    for j, (name, unit) in enumerate(zip(names, units, strict=True)):
        if unit:
            wanted = "s" if name == time else _unit_of(name)
            factor, offset = _conversion(f"{path}:{rows[1][0]}: {name}", unit, wanted)
            table[:, j] = factor * table[:, j] + offset
    t = table[:, names.index(time)]
    others = {n: table[:, j] for j, n in enumerate(names) if n != time}
    return t, others, dict(zip(names, units, strict=True))


def _unit_of(name: str) -> str | None:
    """Return the unit that a column is read in, None if any unit is possible."""
    whole, indices = split_element_name(name)
    last = whole.rpartition(".")[2]
    for signal, names in _REFERENCE.items():
        if name in names and signal in _UNITS:
            return _UNITS[signal][names.index(name)]
    if last in _UNITS:
        return _UNITS[last][indices[0] - 1] if indices and 1 <= indices[0] <= 6 else None
    return "us" if last.startswith("pwm") else QUANTITIES.get(whole)


def _conversion(place: str, text: str, wanted: str | None) -> tuple[float, float]:
    """Return factor and offset from a unit to the wanted one, or to that of SI."""
    expected = f"a unit of {wanted}" if wanted else "a unit such as m/s, deg or N.m, or none"
    known = {"ns": (1e-9, "s"), "nsec": (1e-9, "s"), "msec": (1e-3, "s"), "Nm": (1.0, "N.m")}
    scale, name = known.get(text, (1.0, text.replace("°", "deg")))
    try:
        unit = parse_unit(name)
    except ValueError:
        raise InputInvalid(place, f"unit {text!r} is unknown", expected) from None
    if wanted is None:
        return scale * unit.factor, unit.offset
    found = value_conversion(unit, parse_unit(wanted))
    if found is None:
        raise InputInvalid(place, f"unit {text!r}", expected)
    return scale * found[0], found[1]


def _gaps(t: Array, named: Mapping[str, Array]) -> tuple[Excluded, ...]:
    """Return the spans in which a signal that drives the vehicle holds no number."""
    found: dict[Excluded, None] = {}
    for name, values in named.items():
        if name.rpartition(".")[2] not in _FORCES:
            continue
        for column in values.reshape(len(t), -1).T:
            at = t[np.isfinite(column) & np.isfinite(t)]
            if len(at) < 2:
                continue
            longest = max(_GAP, _RARE * float(np.median(np.diff(at))))
            edges = np.concatenate([[np.nanmin(t)], at, [np.nanmax(t)]])
            for k in np.flatnonzero(np.diff(edges) > longest):
                found[Excluded(float(edges[k]), float(edges[k + 1]), f"no number of {name}")] = None
    return tuple(sorted(found, key=lambda e: e.first))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _gathered(columns: Mapping[str, Array]) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Put ``hull.eta[1]`` … into one array; reference columns become eta, nu, tau and v_c.

    Returns remarks on the elements of tau and v_c that are 0 because no column has them, too.
    """
    remarks = []
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
        zero = [f"{name}[{i + 1}]" for i in range(size) if i not in found]
        if zero and name in ("tau", "v_c"):
            remarks.append(f"not in the file, and 0: {', '.join(zero)}")
    return out, tuple(remarks)


# ---- autopilots -------------------------------------------------------------------------------


def _autopilot(
    path: Path, parameters: Mapping[str, float], channels: Mapping[str, Channel]
) -> Signals:
    suffix = path.suffix.lower()
    if suffix == ".ulg":
        return signals_of_log(read_px4(path, parameters, channels))
    if suffix == ".bin":
        log = read_dataflash(path, channels)
    elif channels:
        channel = next(iter(channels.values()))
        raise InputInvalid(f"{path}: {channel}", "a .tlog has no channels", "a .BIN of the dive")
    else:
        log = read_telemetry(path)
    return signals_of_log(replace(log, parameters={**log.parameters, **parameters}))


def read_parameter_file(path: str | Path) -> dict[str, float]:
    """Read parameters of an autopilot: NAME VALUE, NAME,VALUE, or QGroundControl's five columns."""
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputInvalid(path, f"cannot be read: {error}", "a file of parameters") from None
    found = {}
    for n, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        name, value = words[2:4] if len(words) == 5 else (*words, "")[:2]
        if not _is_number(value):
            raise InputInvalid(f"{path}:{n}", line.strip()[:60], "a name and a number")
        found[name] = float(value)
    return found
