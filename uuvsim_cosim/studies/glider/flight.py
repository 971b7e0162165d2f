"""Recorded flight of a glider: what moved it, and what was measured of its motion.

The shipped recording is of the Slocum `comet` in the Baltic, on 23 June 2016: 248 minutes, 18 dives
to 40 m, a profiling Doppler log during the descents (smerckel/gliderflight, MIT;
models/recordings/slocum_2016). A CTD samples once a second; pitch, volume and battery are sampled
every 4.3 s and interpolated to its times, as the source stores them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid

__all__ = ["GliderFlight", "depth_rate", "read_flight", "second_pressure"]

Array = NDArray[np.float64]
_COLUMNS = {  # name in the file: factor to SI
    "t_s": 1.0,
    "pressure_bar": 1e5,
    "pitch_rad": 1.0,
    "volume_cm3": 1e-6,
    "density_kg_m3": 1.0,
    "temperature_degC": 1.0,
    "battery_m": 1.0,
    "speed_m_s": 1.0,
}


@dataclass(frozen=True)
class GliderFlight:
    """Samples of one flight, each (n,), in SI; `speed` is NaN where it was not measured."""

    t: Array  # s
    pressure: Array  # Pa, gauge
    pitch: Array  # rad, bow up is positive
    volume: Array  # m3, displaced by the buoyancy engine, from its middle
    density: Array  # kg/m3, of the water at the hull
    temperature: Array  # degC, of the water
    battery: Array  # m, place of the moving mass, forward
    speed: Array  # m/s, through the water, of the Doppler log

    @property
    def depth(self) -> Array:
        """Return the depth [m] of water of the flight's mean density."""
        return self.pressure / (float(np.mean(self.density)) * 9.81)

    @property
    def first_half(self) -> NDArray[np.bool_]:
        """Return which samples are in the first half of the time."""
        first: NDArray[np.bool_] = self.t < 0.5 * (self.t[0] + self.t[-1])
        return first

    def until(self, row: int) -> GliderFlight:
        """Return the samples before a row."""
        return GliderFlight(*(getattr(self, f.name)[:row] for f in fields(self)))

    def gliding(self, top: float = 10.0, bottom: float = 35.0) -> NDArray[np.bool_]:
        """Return which samples are between two pressures [dbar], at more than 15 deg of pitch."""
        p = self.pressure / 1e4
        rows: NDArray[np.bool_] = (p > top) & (p < bottom)
        rows &= np.abs(self.pitch) > np.radians(15.0)
        return rows


def read_flight(path: str | Path | None = None) -> GliderFlight:
    """Read a flight from a CSV of the columns above; without `path`, the shipped recording."""
    file = Path(path) if path else content("models", "recordings", "slocum_2016", "flight.csv")
    columns = _read(file, tuple(_COLUMNS))
    values = [factor * column for factor, column in zip(_COLUMNS.values(), columns, strict=True)]
    steps = np.diff(values[0])
    if len(steps) < 2 or not np.all(steps > 0):
        late = int(np.argmin(steps)) + 3 if len(steps) else 2
        raise InputInvalid(f"{file}:{late}", "time does not rise", "t_s that rises in each line")
    for name, column in zip(_COLUMNS, values, strict=True):
        if name != "speed_m_s" and not np.all(np.isfinite(column)):
            line = int(np.argmin(np.isfinite(column))) + 2
            raise InputInvalid(f"{file}:{line}", f"{name} is no number", "a number")
    return GliderFlight(*values)


def second_pressure() -> tuple[Array, Array]:
    """Return times [s] and pressures [Pa] of the flight computer's own sensor."""
    file = content("models", "recordings", "slocum_2016", "second_pressure.csv")
    t, pressure = _read(file, ("t_s", "pressure_bar"))
    return t, 1e5 * pressure


def depth_rate(flight: GliderFlight, samples: int = 1) -> Array:
    """Return the measured rate of depth [m/s], down is positive: a mean over `samples` of them.

    It is the central difference of the depth at the CTD's times, as the source computes it.
    """
    rate = np.gradient(flight.depth, flight.t)
    return smoothed(rate, samples)


def smoothed(x: Array, samples: int) -> Array:
    """Return the running mean over an odd number of samples; the ends are repeated."""
    if samples < 2:
        return x
    padded = np.pad(x, samples // 2, mode="edge")
    total = np.cumsum(np.concatenate(([0.0], padded)))
    mean: Array = (total[samples:] - total[:-samples]) / samples
    return mean[: len(x)]


def _read(file: Path, columns: tuple[str, ...]) -> list[Array]:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputInvalid(file, f"cannot be read ({error})", "a CSV of a flight") from None
    head = tuple(lines[0].split(",")) if lines else ()
    if head != columns:
        raise InputInvalid(f"{file}:1", ",".join(head) or "no line", ",".join(columns))
    rows = []
    for number, line in enumerate(lines[1:], 2):
        try:
            rows.append([float(x) if x else np.nan for x in line.split(",")])
        except ValueError:
            rows.append([])
        if len(rows[-1]) != len(columns):
            raise InputInvalid(f"{file}:{number}", line, f"{len(columns)} numbers")
    return list(np.array(rows).reshape(-1, len(columns)).T)
