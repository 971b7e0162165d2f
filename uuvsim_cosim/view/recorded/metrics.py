"""Figures of merit of a run, each by the formula in its docstring, from the recording alone.

All are taken on the *true* state (``hull.eta``), never on the estimate of navigation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.orchestrator.recording.samples import (
    Array,
    Samples,
    blocks,
    computed,
    picked,
    within,
)
from uuvsim_cosim.orchestrator.running.run_folder import write_run_json
from uuvsim_cosim.view.recorded.traces import Elements, Traces, provenance_of

__all__ = [
    "Figure",
    "Navigation",
    "Tracking",
    "cross_track_error",
    "energy",
    "figures",
    "metrics_of",
    "navigation_error",
    "navigation_errors",
    "path_end",
    "tracking",
    "wrapped",
    "write_metrics",
]

APPROACH = 1.0  # m; the approach ends when the vehicle is first this close to the path
Vector = Elements | Sequence[Samples] | Array  # elements (T,) of a vector
AXES = ("north", "east", "down", "roll", "pitch", "heading")


@dataclass(frozen=True)
class Tracking:
    """How well the vehicle followed its path; `error` is (T,), NaN during the approach."""

    error: Samples
    rms: float
    max: float
    depth_rms: float
    approach_ends: float  # s


@dataclass(frozen=True)
class Navigation:
    """Figures of estimate minus truth; `inside` is the share of samples within 3 sigma by axis."""

    horizontal_rms: float  # m
    vertical_rms: float  # m
    heading_rms: float  # rad
    inside: dict[str, float]


@dataclass(frozen=True)
class Figure:
    """One figure of merit: a key for programs, a label, a value, and how to print it."""

    key: str
    label: str
    value: float
    unit: str
    form: str = ".2f"
    note: str = ""

    def __str__(self) -> str:
        """Return the value with its unit."""
        return f"{self.value:{self.form}} {self.unit}".strip()


def wrapped(angle: Array) -> Array:
    """Return the angle in [-pi, pi) [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _rms(x: Samples) -> float:
    total, count = 0.0, 0
    for block in blocks(x):
        known = block[np.isfinite(block)]
        total += float(np.sum(known**2))
        count += known.size
    return float(np.sqrt(total / count)) if count else float("nan")


def _first(*samples: Samples, where: Callable[..., Array]) -> int | None:
    """Return the first row at which a condition holds, or None."""
    row = 0
    for each in zip(*map(blocks, samples), strict=True):
        found = np.flatnonzero(where(*each))
        if found.size:
            return row + int(found[0])
        row += len(each[0])
    return None


def _joined(samples: Sequence[Samples]) -> Iterator[list[Array]]:
    """Yield the blocks of some samples, each with the last row of the block before it."""
    before: list[Array] = [np.empty(0)] * len(samples)
    for each in zip(*map(blocks, samples), strict=True):
        yield [np.concatenate(pair) for pair in zip(before, each, strict=True)]
        before = [block[-1:] for block in each]


def cross_track_error(north: Samples, east: Samples, path: Array) -> Samples:
    """Return the signed horizontal distance (T,) [m] from a position to a path (n, >= 2).

    The path is the polyline through the waypoints. The distance is to its nearest point, over
    all legs, ends included, so it holds for station-keeping at the last waypoint too, and does
    not depend on the active leg of the guidance; it is positive to starboard.
    """
    return computed(lambda n, e: _cross_track_error(np.column_stack([n, e]), path), north, east)


def _cross_track_error(p: Array, path: Array) -> Array:
    nearest = np.full(len(p), np.inf)
    signed = np.zeros(len(p))
    for a, b in zip(path[:-1, :2], path[1:, :2], strict=True):
        leg = b - a
        length2 = float(leg @ leg)
        if length2 == 0.0 and len(path) > 2:
            continue
        along = np.clip((p - a) @ leg / length2, 0.0, 1.0) if length2 else np.zeros(len(p))
        offset = p - (a + along[:, None] * leg)
        distance = np.hypot(offset[:, 0], offset[:, 1])
        side = np.where(leg[0] * (p - a)[:, 1] - leg[1] * (p - a)[:, 0] < 0, -1.0, 1.0)
        closer = distance < nearest
        nearest = np.where(closer, distance, nearest)
        signed = np.where(closer, side * distance, signed)
    return signed


def path_end(traces: Traces) -> int | None:
    """Return the first sample at which a path is flown to its end and the vehicle circles there.

    None: the path is not flown to its end, or the vehicle holds station at the end.
    """
    done, nu_d = traces.scalar("guidance.done"), traces.elements("guidance.nu_d", 6)
    if done is None or nu_d is None:
        return None
    # A station has no wanted speed.
    return _first(done, nu_d[0], where=lambda done, surge: (done > 0.5) & (surge > 0))


def tracking(
    time: Array, eta: Vector, path: Array, down: Samples | None = None, end: int | None = None
) -> Tracking:
    """Return path-following figures; rms = sqrt(mean e^2) and max |e| over all samples after the
    approach, which ends when |e| first is at most 1 m (if it never is, all samples count), and
    before the sample `end` (see `path_end`).

    `eta` has the elements N, E, D, each (T,). The depth error is D minus `down` (T,), the
    guidance's desired one, at the same sample.
    """
    whole = cross_track_error(eta[0], eta[1], path)
    first = _first(whole, where=lambda e: np.abs(e) <= APPROACH) or 0
    error = within(whole, first, end if end is not None and end > first else None)
    depth = None if down is None else computed(np.subtract, eta[2], down)
    rms = _rms(error)
    most = max((float(np.fmax.reduce(np.abs(e), initial=0.0)) for e in blocks(error)), default=0.0)
    return Tracking(
        error=error,
        rms=rms,
        max=most if np.isfinite(rms) else float("nan"),
        depth_rms=float("nan") if depth is None else _rms(within(depth, first)),
        approach_ends=float(time[first]),
    )


def navigation_error(eta_hat: Vector, eta: Vector, axis: int) -> Samples:
    """Return navigation's error (T,) of an axis of eta: estimate minus truth; angles wrapped."""
    error = computed(np.subtract, eta_hat[axis], eta[axis])
    return error if axis < 3 else computed(wrapped, error)


def navigation_errors(eta_hat: Vector, eta: Vector, sigma: Vector | None = None) -> Navigation:
    """Return figures of navigation's error at the same communication point.

    Each vector is given by its elements (T,), which are read for one axis at a time.
    horizontal = sqrt(mean(e_N^2 + e_E^2)), vertical and heading likewise of one axis; inside =
    share of samples with |e_i| <= 3 sigma_i per axis (0.9973 for a Gaussian, consistent filter).
    """
    inside: dict[str, float] = {}
    rms = []
    for i, axis in enumerate(AXES):
        error = navigation_error(eta_hat, eta, i)
        rms.append(_rms(error))
        if sigma is not None and i < len(sigma):
            good, count = 0, 0
            for e, reach in zip(blocks(error), blocks(sigma[i]), strict=True):
                known = np.isfinite(reach) & (reach > 0)
                good += int(np.sum(np.abs(e[known]) <= 3.0 * reach[known]))
                count += int(np.sum(known))
            if count:
                inside[axis] = good / count
    return Navigation(
        horizontal_rms=float(np.sqrt(rms[0] ** 2 + rms[1] ** 2)),
        vertical_rms=rms[2],
        heading_rms=rms[5],
        inside=inside,
    )


def energy(time: Array, voltage: Samples, current: Samples) -> float:
    """Return the electrical energy taken from the battery, integral of V I dt (trapezoids) [J]."""
    used, row = 0.0, 0
    for volts, amperes in _joined([voltage, current]):
        used += float(np.trapezoid(volts * amperes, time[row : row + len(volts)]))
        row += len(volts) - 1
    return used


def figures(traces: Traces, path: Array | None) -> list[Figure]:
    """Return the figures of merit that the recorded signals allow, in the order of the table."""
    found: list[Figure] = []
    eta = traces.elements("hull.eta", 6)
    if eta is not None and path is not None and len(path) > 1:
        eta_d = traces.elements("guidance.eta_d", 6)
        desired = None if eta_d is None else eta_d[2]
        end = path_end(traces)
        track = tracking(traces.time, eta, path, desired, end)
        after = f"after the approach ({track.approach_ends:.0f} s)" if track.approach_ends else ""
        if end is not None:
            after += f"{', ' if after else ''}until the path's end ({traces.time[end]:.0f} s)"
        found += [
            Figure("cross_track_rms", "cross-track error, RMS", track.rms, "m", ".3f", after),
            Figure("cross_track_max", "cross-track error, max", track.max, "m", ".3f"),
        ]
        if np.isfinite(track.depth_rms):
            found.append(Figure("depth_rms", "depth error, RMS", track.depth_rms, "m", ".3f"))
    eta_hat = traces.elements("navigation.eta", 6)
    if eta is not None and eta_hat is not None:
        nav = navigation_errors(eta_hat, eta, traces.elements("navigation.sigma", 1))
        found += [
            Figure("navigation_horizontal_rms", "navigation error, horizontal RMS",
                   nav.horizontal_rms, "m", ".3f"),
            Figure("navigation_vertical_rms", "navigation error, vertical RMS",
                   nav.vertical_rms, "m", ".3f"),
            Figure("navigation_heading_rms", "navigation error, heading RMS",
                   float(np.degrees(nav.heading_rms)), "deg"),
        ]  # fmt: skip
        if nav.inside:
            worst = min(nav.inside, key=lambda axis: nav.inside[axis])
            found.append(
                Figure(
                    "navigation_inside",
                    "navigation error inside 3 sigma",
                    100.0 * float(np.mean(list(nav.inside.values()))),
                    "%",
                    ".1f",
                    f"least: {worst}, {100 * nav.inside[worst]:.1f} %",
                )
            )
    used = energy_of(traces)
    if used is not None:
        duration = float(traces.time[-1] - traces.time[0])
        found.append(Figure("energy", "energy used", used / 3600.0, "Wh"))
        if duration > 0:
            found.append(Figure("power", "mean electrical power", used / duration, "W", ".0f"))
    if eta is not None:
        flown = sum(
            float(np.sum(np.sqrt(np.sum(np.diff(np.column_stack(position), axis=0) ** 2, axis=1))))
            for position in _joined([eta[0], eta[1], eta[2]])
        )
        found.append(Figure("distance", "distance flown", flown, "m", ".1f"))
    return found


def metrics_of(figures: Iterable[Figure]) -> dict[str, dict[str, str | float | None]]:
    """Return figures for programs: by key, the value with its unit, label and note.

    JSON has no NaN and no infinity: such a value is None, and `not_finite` is its text.
    """
    found: dict[str, dict[str, str | float | None]] = {}
    for f in figures:
        value = f.value if math.isfinite(f.value) else None
        found[f.key] = {"value": value, "unit": f.unit, "label": f.label}
        if f.note:
            found[f.key]["note"] = f.note
        if value is None:
            found[f.key]["not_finite"] = f"{f.value}"
    return found


def energy_of(traces: Traces) -> float | None:
    """Return the energy used [J]: the battery's own count, else of voltage and total current.

    None if neither is recorded, or if thrusters push without energy: then they have no electrical
    model, such as a propeller whose torque is not published.
    """
    counted = traces.scalar("battery.energy")
    voltage, current = traces.scalar("battery.voltage"), traces.scalar("wrench.current_total")
    if counted is not None:
        first, last = picked(counted, np.array([0, len(counted) - 1]))
        used = float(last - first)
    elif voltage is None or current is None:
        return None
    else:
        used = energy(traces.time, voltage, current)
    thrusts = (traces.scalar(n) for n in traces.values if n.endswith(".thrust"))
    pushed = used == 0.0 and any(
        np.any(picked(t, np.arange(len(traces.time)))) for t in thrusts if t is not None
    )
    return None if pushed else used


def write_metrics(folder: str | Path, figures: Iterable[Figure]) -> None:
    """Write figures of merit into run.json, as `metrics`: value, unit and label by key.

    Raises RecordingError if it cannot be written; the old file then stays.
    """
    path = Path(folder) / "run.json"
    try:
        write_run_json(path, {**provenance_of(folder), "metrics": metrics_of(figures)})
    except OSError as error:
        raise RecordingError(path, error.strerror, "free space on the disk") from None
