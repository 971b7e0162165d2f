"""Parts of a recording that the model does not describe, each with its time and its reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.studies.identification.vehicle_log import Series

__all__ = ["Excluded", "exclusions", "kept_spans"]

Array = NDArray[np.float64]
_SURFACE = 0.3  # m: a BlueROV2 above this depth pierces the surface
_BOTTOM = 0.15  # m of range: the frame touches the bottom
_GAP = 1.0  # s without a command or an attitude
_IDLE, _COAST = 0.03, 5.0  # command of a resting thruster; s after which the vehicle has stopped
_TOWED = (0.3, 0.15, 0.5)  # m/s horizontal, m/s vertical, rad/s: faster than a vehicle that drifts
_LASTS = 1.0  # s: a shorter span of contact or tow is no span
_SHORTEST = 3.0  # s: a shorter span between excluded ones is not fitted


@dataclass(frozen=True)
class Excluded:
    """A span [s] that is not fitted, and why."""

    first: float
    last: float
    reason: str

    def __str__(self) -> str:
        """Return the span as it is reported."""
        return f"{self.first:.1f} to {self.last:.1f} s: {self.reason}"


def exclusions(series: Mapping[str, Series], end: float) -> list[Excluded]:
    """Return the spans from 0 to `end` [s] to leave out, without overlaps, in order.

    Where several reasons hold, the first one counts: disarmed, a gap in the log, at the surface, on
    the bottom, under tow.
    """
    found: list[Excluded] = []
    for reason, spans in _reasons(series, end):
        for first, last in spans:
            for a, b in _without(max(first, 0.0), min(last, end), found):
                if b - a > 1e-6:
                    found.append(Excluded(a, b, reason))
    between = [(a, b) for a, b in _without(0.0, end, found) if b - a < _SHORTEST]
    if found:
        found += [Excluded(a, b, "shorter than 3 s between excluded parts") for a, b in between]
    joined: list[Excluded] = []
    for e in sorted(found, key=lambda e: e.first):
        if joined and (joined[-1].reason, joined[-1].last) == (e.reason, e.first):
            joined[-1] = Excluded(joined[-1].first, e.last, e.reason)
        else:
            joined.append(e)
    return joined


def kept_spans(excluded: list[Excluded], first: float, last: float) -> list[tuple[float, float]]:
    """Return the spans between the excluded ones, from `first` to `last` [s]."""
    return list(_without(first, last, excluded))


def _without(first: float, last: float, found: list[Excluded]) -> Iterator[tuple[float, float]]:
    here = first
    for e in sorted(found, key=lambda e: e.first):
        if e.last <= here or e.first >= last:
            continue
        if e.first > here:
            yield here, e.first
        here = e.last
    if here < last:
        yield here, last


def _reasons(
    series: Mapping[str, Series], end: float
) -> Iterator[tuple[str, list[tuple[float, float]]]]:
    if "armed" in series:
        yield "disarmed", _spans(series["armed"].t, series["armed"].values[:, 0] == 0.0)
    for name, what in (("commands", "commands"), ("attitude", "attitude")):
        if name in series:
            t = np.concatenate([[0.0], series[name].t[series[name].t > 0.0], [end]])
            at = np.flatnonzero(np.diff(t) > _GAP)
            yield f"no {what} in the log", [(float(t[k]), float(t[k + 1])) for k in at]
    if "depth" in series:
        depth = series["depth"]
        yield (
            f"at the surface (depth below {_SURFACE:g} m)",
            _joined(_spans(depth.t, depth.values[:, 0] < _SURFACE), _SHORTEST),
        )
    if "surfaced" in series:
        yield (
            "at the surface (reported by the autopilot)",
            _spans(series["surfaced"].t, series["surfaced"].values[:, 0] > 0.0),
        )
    if "bottomed" in series:
        yield (
            "on the bottom (reported by the autopilot)",
            _spans(series["bottomed"].t, series["bottomed"].values[:, 0] > 0.0),
        )
    if "range" in series:
        yield (
            f"on the bottom (range below {_BOTTOM:g} m)",
            _long(_spans(series["range"].t, series["range"].values[:, 0] < _BOTTOM)),
        )
    yield "under tow or held (it moves while its thrusters rest)", _long(_towed(series))


def _towed(series: Mapping[str, Series]) -> list[tuple[float, float]]:
    """Return spans of motion that no thruster made for as long as the vehicle needs to stop."""
    t, u = series["commands"].t, np.abs(series["commands"].values)
    size = max(1.0, float(u.max(initial=0.0)))  # a force in N rests relative to the largest one
    resting = _spans(t, u.max(axis=1) < _IDLE * size)
    idle = [(max(a, float(t[0])) + _COAST, b) for a, b in resting]
    spans = []
    for a, b in [(a, b) for a, b in idle if b > a]:
        moves = []
        for name, columns, limit in (
            ("dvl", slice(0, 2), _TOWED[0]), ("velocity", slice(0, 2), _TOWED[0]),
            ("rates", slice(2, 3), _TOWED[2]),
        ):  # fmt: skip
            s = series.get(name)
            if s is not None:
                size = np.linalg.norm(s.values[:, columns], axis=1)
                moves += _spans(s.t, (s.t >= a) & (s.t <= b) & (np.nan_to_num(size) > limit))
        depth = series.get("depth")
        if depth is not None and len(depth.t) > 10:
            inside = (depth.t >= a) & (depth.t <= b)
            t_d, d = depth.t, depth.values[:, 0]
            rate = np.interp(t_d + 0.5, t_d, d) - np.interp(t_d - 0.5, t_d, d)
            moves += _spans(t_d, inside & (np.abs(rate) > _TOWED[1]))
        spans += [(max(x, a), min(y, b)) for x, y in moves]
    return spans


def _spans(t: Array, holds: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return the spans in which a condition holds, from each sample to the next one.

    What holds at the first sample held before it, and what holds at the last one holds after it.
    """
    if not len(t):
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    return [
        (float(t[a]) if a else float("-inf"), float(t[b]) if b < len(t) else float("inf"))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def _long(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the spans that last long enough, joined over short interruptions."""
    return [(a, b) for a, b in _joined(spans, _LASTS) if b - a > _LASTS]


def _joined(spans: list[tuple[float, float]], gap: float) -> list[tuple[float, float]]:
    joined: list[tuple[float, float]] = []
    for a, b in sorted(spans):
        if joined and a - joined[-1][1] < gap:
            joined[-1] = (joined[-1][0], max(b, joined[-1][1]))
        else:
            joined.append((a, b))
    return joined
