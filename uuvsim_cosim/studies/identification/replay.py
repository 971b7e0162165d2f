"""The source ``log:``: a recorded flight in the place of a hull, for a controller beside it.

``log:FILE?from=SECONDS`` reads any recording that `uuvsim identify` reads. Its outputs are those of
a hull (`eta`, `q`, `nu`, `nu_dot`, `nu_r`), the recorded commands `u` or force `tau_d`, and `used`:
1 where the log is a dive, 0 in the parts that identification leaves out and after the log's end.
t = 0 is the log's first command, or `from`. Nothing that the system computes changes the flight.

A measured number has the value of its last sample (``between=held``, default), as the vehicle had
it, or is linear between two (``between=linear``). Before the first sample it has the first value.
`nu_dot` is the difference of two samples of `nu`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import cos, pi, sin
from pathlib import Path
from typing import ClassVar
from urllib.parse import parse_qsl, urlencode

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.models.declaration.files_read import Stamp, stamp
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.studies.identification.exclusions import Excluded
from uuvsim_cosim.studies.identification.logs import read_log, read_parameter_file
from uuvsim_cosim.studies.identification.readers.channels import read_channels

__all__ = ["Flight", "LogSource", "source"]

Array = NDArray[np.float64]
_OPTIONS = ("from", "between", "parameters", "channels")
_ETA = ("m", "m", "m", "rad", "rad", "rad")
_NU = ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s")
_NU_DOT = ("m/s2", "m/s2", "m/s2", "rad/s2", "rad/s2", "rad/s2")
_NAMES = ("N", "E", "D", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")


def source(text: str, base: Path) -> LogSource:
    """Resolve ``log:FILE?option=value&…``; the entry point of the scheme.

    A file is searched in `base`, then in the current folder. `from` [s] is the time of the log that
    is t = 0. `parameters` is a file of the autopilot's parameters, and `channels` a YAML file of
    channels. Raises InputInvalid for an unknown option, and if there is no such file.
    """
    name, _, query = text.removeprefix("log:").partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    place = f"source {text!r}"
    for key in options:
        if key not in _OPTIONS:
            raise InputInvalid(place, f"option {key!r}", expected_names(key, _OPTIONS))
    if options.get("between", "held") not in ("held", "linear"):
        raise InputInvalid(place, f"between={options['between']}", "held or linear")
    try:
        begin = float(options.get("from", 0.0))
    except ValueError:
        raise InputInvalid(place, f"from={options['from']}", "seconds") from None
    files = {}
    for key, value in (("", name), *((k, options.get(k, "")) for k in ("parameters", "channels"))):
        wanted = Path(value).expanduser()
        found = next((p for p in (base / wanted, wanted) if value and p.exists()), None)
        if found is None and (value or not key):
            raise InputInvalid(place, f"no file {value!r}", "a recording of a dive")
        files[key] = None if found is None else found.absolute()
    path = files[""]
    assert path is not None
    return LogSource(
        path, begin, options.get("between") == "linear", files["parameters"], files["channels"]
    )


@dataclass(frozen=True)
class LogSource:
    """A recorded flight; see `source`."""

    path: Path
    begin: float = 0.0  # s
    is_linear: bool = False
    parameters: Path | None = None
    channels: Path | None = None
    kind: str = "log"
    is_recorded: ClassVar[bool] = True

    @property
    def text(self) -> str:
        """The whole source, with absolute paths."""
        options = {
            "from": f"{self.begin:.12g}" if self.begin else None,
            "between": "linear" if self.is_linear else None,
            "parameters": self.parameters,
            "channels": self.channels,
        }
        query = urlencode({k: str(v) for k, v in options.items() if v is not None}, safe="/")
        return f"log:{self.path}" + (f"?{query}" if query else "")

    @property
    def flight(self) -> Flight:
        """The flight, read once until the recording changes; raises InputInvalid."""
        files = [*sorted(self.path.iterdir())] if self.path.is_dir() else [self.path]
        files += [f for f in (self.parameters, self.channels) if f is not None]
        return _flight(self, tuple(stamp(f) for f in files))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about what was read, and what the recording lacks."""
        return tuple(f"{self.path.name}: {r}" for r in self.flight.remarks)

    def describe(self) -> Description:
        """Return the flight as outputs."""
        return self.instantiate("description").description

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make a component of the flight; the stepping loop calls Python for it."""
        flight = self.flight

        class Flown:
            """A recorded flight over time."""

            inputs: ClassVar[dict[str, object]] = {}
            outputs: ClassVar[dict[str, object]] = flight.outputs()

            def initialize(self, t: float) -> dict[str, object]:
                return flight.at(t)

            def step(self, t: float, dt: float, u: dict[str, object]) -> dict[str, object]:
                return flight.at(t + dt)

        made = PythonComponent(Flown, path)
        if flight.vehicle:  # what is made for another vehicle is refused beside it
            made.description = replace(made.description, made_for={"hull": flight.vehicle})
        return made


@cache
def _flight(log: LogSource, stamps: tuple[Stamp, ...]) -> Flight:
    given = {} if log.parameters is None else read_parameter_file(log.parameters)
    channels = read_channels([] if log.channels is None else [str(log.channels)])
    return Flight(log.path, read_log(log.path, given, channels), log.begin, log.is_linear)


class Flight:
    """Pose, velocity and commands of a recording at any time."""

    def __init__(self, path: Path, signals: Signals, begin: float, is_linear: bool) -> None:
        self.is_linear = is_linear
        self.begin = begin
        self.vehicle = str(signals.metadata.get("vehicle") or "")
        self.excluded: tuple[Excluded, ...] = tuple(signals.metadata.get("excluded", ()))
        last = float(signals.time[-1])
        if not signals.time[0] <= begin < last:
            raise InputInvalid(
                f"log:{path}", f"from={begin:g}", f"{signals.time[0]:g} to {last:g} s, as recorded"
            )
        self.remarks = [*signals.metadata.get("remarks", ())]
        self.remarks += [f"left out of a fit: {e}" for e in self.excluded]
        self.end = last
        self.remarks.append(
            f"t = 0 is {begin:g} s of {last:g} s that were recorded; after them, the last "
            "sample holds, and used is 0"
        )
        eta, nu = (_found(signals, n, path, 6) for n in ("eta", "nu"))
        if eta is None and nu is None:
            raise InputInvalid(path, "has neither eta nor nu", "a recording of a hull")
        self._tracks = [
            _track(signals.time, None if s is None else s[:, k], k in (3, 4, 5) and s is eta)
            for s in (eta, nu)
            for k in range(6)
        ]
        missing = [n for n, (t, _) in zip(_NAMES, self._tracks, strict=True) if not len(t)]
        if missing:
            self.remarks.append(f"not recorded, and 0: {', '.join(missing)}")
        self._held: dict[str, tuple[Array, Array]] = {}
        for to, name in (("u", "u"), ("tau_d", "tau")):
            values = _found(signals, name, path, None)
            if values is not None and np.isfinite(values).all(axis=1).any():
                good = np.isfinite(values).all(axis=1)
                self._held[to] = signals.time[good], values[good]

    def outputs(self) -> dict[str, object]:
        """Return the outputs with sizes and units, as a component declares them."""
        found: dict[str, object] = {
            "eta": (6, _ETA), "q": (4, "1"), "nu": (6, _NU), "nu_dot": (6, _NU_DOT),
            "nu_r": (6, _NU), "used": "1",
        }  # fmt: skip
        for name, (_, values) in self._held.items():
            tau = ("N", "N", "N", "N.m", "N.m", "N.m")
            found[name] = (values.shape[1], tau if name == "tau_d" else "1")
        return found

    def at(self, t: float) -> dict[str, object]:
        """Return the outputs at a simulated time [s]."""
        s = t + self.begin
        values = [self._value(track, s) for track in self._tracks]
        eta, nu = values[:6], values[6:]
        eta[3:] = [(a + pi) % (2 * pi) - pi for a in eta[3:]]
        out: dict[str, object] = {
            "eta": eta, "q": _quaternion(eta[3:]), "nu": nu, "nu_r": nu,
            "nu_dot": [_rate(track, s) for track in self._tracks[6:]],
            "used": float(
                s <= self.end + 1e-9 and not any(e.first <= s < e.last for e in self.excluded)
            ),
        }  # fmt: skip
        for name, (times, rows) in self._held.items():
            i = max(int(np.searchsorted(times, s + 1e-9, "right")) - 1, 0)
            out[name] = rows[i].tolist()
        return out

    def _value(self, track: tuple[Array, Array], s: float) -> float:
        t, v = track
        if not len(t):
            return 0.0
        if self.is_linear:
            return float(np.interp(s, t, v))
        return float(v[max(int(np.searchsorted(t, s + 1e-9, "right")) - 1, 0)])


def _found(signals: Signals, name: str, path: Path, size: int | None) -> Array | None:
    """Return the values (n, k) of the one signal of a name; refuses two."""
    own = [n for n in signals if n == name or n.rpartition(".")[2] == name]
    own = [n for n in own if n in (name, f"hull.{name}")] or own
    if size is None and own != [name]:  # commands of all thrusters together, in a recorded run
        own = [n for n in own if np.ndim(signals[n]) == 2 and "hull" not in n]
        own = own if len(own) == 1 else []
    if not own:
        return None
    if len(own) > 1:
        raise InputInvalid(path, f"has {len(own)} signals {name}: {', '.join(own)}", "one hull")
    values = np.asarray(signals[own[0]], float)
    values = values[:, None] if values.ndim == 1 else values
    if size is not None and values.shape[1] != size:
        raise InputInvalid(f"{path}: {own[0]}", f"{values.shape[1]} elements", size)
    return values


def _track(time: Array, values: Array | None, is_angle: bool) -> tuple[Array, Array]:
    """Return the samples of one number; angles without jumps."""
    if values is None:
        return np.zeros(0), np.zeros(0)
    good = np.isfinite(values) & np.concatenate([[True], np.diff(time) > 0])
    v = values[good]
    return time[good], np.unwrap(v) if is_angle else v


def _rate(track: tuple[Array, Array], s: float) -> float:
    t, v = track
    i = int(np.searchsorted(t, s + 1e-9, "right")) - 1
    return float((v[i] - v[i - 1]) / (t[i] - t[i - 1])) if i > 0 else 0.0


def _quaternion(angles: list[float]) -> list[float]:
    phi, theta, psi = (a / 2.0 for a in angles)
    cf, sf, ct, st, cp, sp = cos(phi), sin(phi), cos(theta), sin(theta), cos(psi), sin(psi)
    return [
        cf * ct * cp + sf * st * sp, sf * ct * cp - cf * st * sp,
        cf * st * cp + sf * ct * sp, cf * ct * sp - sf * st * cp,
    ]  # fmt: skip
