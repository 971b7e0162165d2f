"""Figures of merit of a run, each by the formula in its docstring, from the recording alone.

All are taken on the *true* state (``hull.eta``), never on the estimate of navigation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.view.recorded.traces import Array, Traces

__all__ = [
    "Figure",
    "Navigation",
    "Tracking",
    "cross_track_error",
    "energy",
    "figures",
    "metrics_of",
    "navigation_errors",
    "tracking",
    "wrapped",
]

APPROACH = 1.0  # m; the approach ends when the vehicle is first this close to the path
AXES = ("north", "east", "down", "roll", "pitch", "heading")


@dataclass(frozen=True)
class Tracking:
    """How well the vehicle followed its path; `error` is (T,), NaN during the approach."""

    error: Array
    depth_error: Array | None
    rms: float
    max: float
    depth_rms: float
    approach_ends: float  # s


@dataclass(frozen=True)
class Navigation:
    """Estimate minus truth, (T, 6), angles wrapped; `inside` is the share within 3 sigma."""

    error: Array
    sigma: Array | None  # (T, 6); NaN where navigation gives none
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


def _rms(x: Array) -> float:
    x = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(x**2))) if x.size else float("nan")


def cross_track_error(position: Array, path: Array) -> Array:
    """Return the signed horizontal distance (T,) [m] from position (T, >= 2) to path (n, >= 2).

    The path is the polyline through the waypoints. The distance is to its nearest point, over
    all legs, ends included, so it holds for station-keeping at the last waypoint too, and does
    not depend on the active leg of the guidance; it is positive to starboard.
    """
    p = position[:, :2]
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


def tracking(time: Array, eta: Array, path: Array, eta_d: Array | None = None) -> Tracking:
    """Return path-following figures; rms = sqrt(mean e^2) and max |e| over all samples after the
    approach, which ends when |e| first is at most 1 m (if it never is, all samples count).

    The depth error is down minus the guidance's desired down at the same sample.
    """
    error = cross_track_error(eta, path)
    close = np.flatnonzero(np.abs(error) <= APPROACH)
    first = int(close[0]) if close.size else 0
    error = error.copy()
    error[:first] = np.nan
    depth = None if eta_d is None else eta[:, 2] - eta_d[:, 2]
    return Tracking(
        error=error,
        depth_error=depth,
        rms=_rms(error),
        max=float(np.nanmax(np.abs(error))),
        depth_rms=float("nan") if depth is None else _rms(depth[first:]),
        approach_ends=float(time[first]),
    )


def navigation_errors(eta_hat: Array, eta: Array, sigma: Array | None = None) -> Navigation:
    """Return navigation's error: estimate minus truth at the same communication point.

    horizontal = sqrt(mean(e_N^2 + e_E^2)), vertical and heading likewise of one axis; inside =
    share of samples with |e_i| <= 3 sigma_i per axis (0.9973 for a Gaussian, consistent filter).
    """
    error = eta_hat - eta
    error = np.column_stack([error[:, :3], wrapped(error[:, 3:6])])
    inside: dict[str, float] = {}
    if sigma is not None:
        for i, axis in enumerate(AXES):
            known = np.isfinite(sigma[:, i]) & (sigma[:, i] > 0)
            if known.any():
                inside[axis] = float(np.mean(np.abs(error[known, i]) <= 3.0 * sigma[known, i]))
    return Navigation(
        error=error,
        sigma=sigma,
        horizontal_rms=float(np.sqrt(_rms(error[:, 0]) ** 2 + _rms(error[:, 1]) ** 2)),
        vertical_rms=_rms(error[:, 2]),
        heading_rms=_rms(error[:, 5]),
        inside=inside,
    )


def energy(time: Array, voltage: Array, current: Array) -> float:
    """Return the electrical energy taken from the battery, integral of V I dt (trapezoids) [J]."""
    return float(np.trapezoid(voltage * current, time))


def figures(traces: Traces, path: Array | None) -> list[Figure]:
    """Return the figures of merit that the recorded signals allow, in the order of the table."""
    found: list[Figure] = []
    eta = traces.vector("hull.eta", 6)
    if eta is not None and path is not None and len(path) > 1:
        track = tracking(traces.time, eta, path, traces.vector("guidance.eta_d", 6))
        after = f"after the approach ({track.approach_ends:.0f} s)" if track.approach_ends else ""
        found += [
            Figure("cross_track_rms", "cross-track error, RMS", track.rms, "m", ".3f", after),
            Figure("cross_track_max", "cross-track error, max", track.max, "m", ".3f"),
        ]
        if np.isfinite(track.depth_rms):
            found.append(Figure("depth_rms", "depth error, RMS", track.depth_rms, "m", ".3f"))
    eta_hat = traces.vector("navigation.eta", 6)
    if eta is not None and eta_hat is not None:
        nav = navigation_errors(eta_hat, eta, sigma_of(traces))
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
        steps = np.diff(eta[:, :3], axis=0)
        flown = float(np.sum(np.sqrt(np.sum(steps**2, axis=1))))
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


def sigma_of(traces: Traces) -> Array | None:
    """Return navigation's sigma as (T, 6) in eta's order, NaN for the elements that it lacks."""
    sigma = traces.find("navigation.sigma")
    if sigma is None or sigma.ndim != 2:
        return None
    full = np.full((len(sigma), 6), np.nan)
    width = min(6, sigma.shape[1])
    full[:, :width] = sigma[:, :width]
    return full


def energy_of(traces: Traces) -> float | None:
    """Return the energy used [J]: the battery's own count, else of voltage and total current."""
    counted = traces.scalar("battery.energy")
    if counted is not None:
        return float(counted[-1] - counted[0])
    voltage, current = traces.scalar("battery.voltage"), traces.scalar("wrench.current_total")
    if voltage is None or current is None:
        return None
    return energy(traces.time, voltage, current)
