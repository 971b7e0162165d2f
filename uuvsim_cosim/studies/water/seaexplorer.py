"""Flight of a SeaExplorer glider by its raw files: navigation (.gli.sub) and payload (.pld1.raw).

Practical salinity by PSS-78, density by the equation of state EOS-80 (Fofonoff and Millard 1983,
UNESCO technical papers in marine science 44).
"""

from __future__ import annotations

import gzip
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["density", "salinity", "write_flight"]

Array = NDArray[np.float64]
_HEAD = "t_s,pressure_bar,pitch_rad,volume_cm3,density_kg_m3,temperature_degC,battery_m,speed_m_s"


def salinity(conductivity: Array, t: Array, p: Array) -> Array:
    """Return practical salinity of conductivity [S/m], temperature [degC, IPTS-68], p [dbar]."""
    ratio: Array = 10.0 * conductivity / 42.914
    r_t = np.polyval([1.0031e-9, -6.9698e-7, 1.104259e-4, 2.00564e-2, 0.6766097], t)
    above = p * np.polyval([3.989e-15, -6.370e-10, 2.070e-5], p)
    below = 1 + 3.426e-2 * t + 4.464e-4 * t**2 + (4.215e-1 - 3.107e-3 * t) * ratio
    root = np.sqrt(np.maximum(ratio / ((1 + above / below) * r_t), 0.0))
    first = np.polyval([2.7081, -7.0261, 14.0941, 25.3851, -0.1692, 0.0080], root)
    second = np.polyval([-0.0144, 0.0636, -0.0375, -0.0066, -0.0056, 0.0005], root)
    return np.asarray(first + (t - 15) / (1 + 0.0162 * (t - 15)) * second, dtype=np.float64)


def density(S: Array, t: Array, p: Array) -> Array:
    """Return the density [kg/m3] in situ of salinity, temperature [degC, IPTS-68] and p [dbar]."""
    fresh = np.polyval(
        [6.536332e-9, -1.120083e-6, 1.001685e-4, -9.095290e-3, 6.793952e-2, 999.842594], t
    )
    A = np.polyval([5.3875e-9, -8.2467e-7, 7.6438e-5, -4.0899e-3, 8.24493e-1], t)
    B = np.polyval([-1.6546e-6, 1.0227e-4, -5.72466e-3], t)
    surface = fresh + A * S + B * S**1.5 + 4.8314e-4 * S**2
    bar = p / 10.0
    K_w = np.polyval([-5.155288e-5, 1.360477e-2, -2.327105, 148.4206, 19652.21], t)
    K_0 = (
        K_w
        + np.polyval([-6.1670e-5, 1.09987e-2, -0.603459, 54.6746], t) * S
        + np.polyval([-5.3009e-4, 1.6483e-2, 7.944e-2], t) * S**1.5
    )
    A_p = (
        np.polyval([-5.77905e-7, 1.16092e-4, 1.43713e-3, 3.239908], t)
        + np.polyval([-1.6078e-6, -1.0981e-5, 2.2838e-3], t) * S
        + 1.91075e-4 * S**1.5
    )
    B_p = np.polyval([5.2787e-8, -6.12293e-6, 8.50935e-5], t) + S * np.polyval(
        [9.1697e-10, 2.0816e-8, -9.9348e-7], t
    )
    found: Array = surface / (1 - bar / (K_0 + A_p * bar + B_p * bar**2))
    return found


def write_flight(folder: Path, out: Path, every: float = 1.0) -> None:
    """Write the flight of a folder of raw files as CSV, a sample every so many seconds."""
    glider = _table(sorted(folder.glob("*.gli.sub.*")), "Timestamp", "%d/%m/%Y %H:%M:%S",
                    ("Pitch", "BallastPos", "LinPos"))  # fmt: skip
    water = _table(sorted(folder.glob("*.pld1.raw.*")), "PLD_REALTIMECLOCK",
                   "%d/%m/%Y %H:%M:%S.%f",
                   ("GPCTD_CONDUCTIVITY", "GPCTD_TEMPERATURE", "GPCTD_PRESSURE"))  # fmt: skip
    start = max(glider[0][0], water[0][0])
    t, (conductivity, temperature, pressure) = water[0], water[1:]
    rho = density(salinity(conductivity, temperature, pressure), temperature, pressure)
    good = (conductivity > 2.0) & (rho > 1000.0)
    pitch, volume, battery = (np.interp(t, glider[0], c) for c in glider[1:])
    rho = np.interp(t, t[good], rho[good])
    kept = np.concatenate([[True], np.diff(np.floor((t - start) / every)) > 0]) & (t >= start)
    rows = zip(
        t[kept] - start, pressure[kept] / 10.0, np.radians(pitch[kept]), volume[kept], rho[kept],
        temperature[kept], battery[kept] / 1e3, strict=True,
    )  # fmt: skip
    lines = [
        f"{a:.2f},{b:.3f},{c:.4f},{d:.1f},{e:.3f},{f:.3f},{g:.4f}," for a, b, c, d, e, f, g in rows
    ]
    out.write_text("\n".join([_HEAD, *lines]) + "\n", encoding="utf-8")


def _table(files: list[Path], clock: str, form: str, names: tuple[str, ...]) -> list[Array]:
    """Read times [s] and columns of files, rows with all of them, in the order of time."""
    rows = []
    for file in files:
        with gzip.open(file, "rt", encoding="utf-8") as text:
            head = text.readline().strip().split(";")
            lacking = [n for n in (clock, *names) if n not in head]
            if lacking:
                raise InputInvalid(file, f"no column {', '.join(lacking)}", "a SeaExplorer's file")
            places = [head.index(n) for n in (clock, *names)]
            for line in text:
                cells = line.rstrip("\n").split(";")
                found = [cells[i] for i in places]
                if all(found):
                    time = datetime.strptime(found[0], form).timestamp()
                    rows.append([time, *map(float, found[1:])])
    table = np.array(sorted(rows))
    table = table[np.concatenate([[True], np.diff(table[:, 0]) > 0])]
    return list(table.T)
