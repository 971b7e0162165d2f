"""Motion of a scene's parts over the moments of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.orchestrator.recording.samples import (
    Array,
    Samples,
    blocks,
    computed,
    picked,
    track_rows,
)
from uuvsim_cosim.view.recorded.traces import Elements, Traces
from uuvsim_cosim.view.scene3d.scene import Body, Scene3D

__all__ = ["Motion", "echoes", "extent", "motion_of", "quaternions", "turned"]

REACH = 1.5  # of the hull's longest extent: the longest arrow
LEAST = 0.1  # N; that thrust, or the greatest of the recording, has the longest arrow


@dataclass(frozen=True, eq=False)
class Motion:
    """T moments: times [s], and poses and readings by name; NaN where a signal is not finite."""

    time: Array
    positions: Mapping[str, Array]  # (T, 3) in n, of bodies and markers
    attitudes: Mapping[str, Array]  # (T, 4) from n to b, scalar first, of length 1
    thrusts: Mapping[str, Array] = field(default_factory=dict)  # (T, n) [N]
    scales: Mapping[str, float] = field(default_factory=dict)  # m of arrow for a newton
    ranges: Mapping[str, Array] = field(default_factory=dict)  # (T, n) [m]; NaN without an echo
    estimates: Mapping[str, Array] = field(default_factory=dict)  # (T, 3) of bodies

    def moment(self, t: float) -> int:
        """Return the last moment that is not after t [s]."""
        return int(np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 1))


def motion_of(scene3d: Scene3D, traces: Traces, most: int | None = None) -> Motion:
    """Return the recorded motion, thinned to about `most` moments, as `track_rows` chooses them."""
    n = len(traces.time)
    picks = np.arange(n) if most is None else _moments(scene3d, traces, most)
    positions, attitudes, thrusts, scales, ranges, estimates = {}, {}, {}, {}, {}, {}
    for body in scene3d.bodies:
        eta = _picked(traces, body.eta, picks)
        if eta is None or eta.ndim != 2 or eta.shape[1] < 6:
            continue
        positions[body.name] = eta[:, :3]
        q = _picked(traces, body.q, picks)
        if q is None:
            attitudes[body.name] = quaternions(eta[:, 3:6])
        else:
            length = np.linalg.norm(q, axis=1, keepdims=True)
            unit = q / np.where(length > 1e-9, length, 1.0)
            attitudes[body.name] = np.where(length > 1e-9, unit, [1.0, 0.0, 0.0, 0.0])
        columns: list[Array | None] = []
        greatest = LEAST
        for arrow in body.arrows:
            thrust = _column(traces, arrow.signal)
            if thrust is None:
                columns.append(None)
                continue
            known = computed(lambda f: np.where(np.isfinite(f), f, 0.0), thrust)
            greatest = max(greatest, *(float(np.abs(f).max(initial=0.0)) for f in blocks(known)))
            columns.append(picked(known, picks))
        if n and any(c is not None for c in columns):
            some = np.zeros(len(traces.time[picks]))
            thrusts[body.name] = np.column_stack([some if c is None else c for c in columns])
            scales[body.name] = REACH * body.size / greatest
        believed = _picked(traces, body.estimate, picks)
        if believed is not None and believed.ndim == 2 and believed.shape[1] >= 3:
            estimates[body.name] = believed[:, :3]
        for rays in body.rays:
            given, valid = (_picked(traces, s, picks) for s in (rays.signal, rays.valid))
            if given is None or given.size != len(given) * len(rays.directions):
                continue
            distance = given.reshape(len(given), -1)
            heard = np.isfinite(distance) & (distance > 0)
            if valid is not None:
                heard &= valid.reshape(len(valid), -1) > 0.5
            ranges[rays.name] = np.where(heard, distance, np.nan)
    for marker in scene3d.markers:
        at = _picked(traces, marker.signal, picks)
        if at is not None and at.ndim == 2 and at.shape[1] >= 3:
            positions[marker.name] = at[:, :3]
    return Motion(traces.time[picks], positions, attitudes, thrusts, scales, ranges, estimates)


def _moments(scene3d: Scene3D, traces: Traces, most: int) -> NDArray[np.intp]:
    """Return the rows of the moments that show the track of the first body that was recorded."""
    n = len(traces.time)
    for body in scene3d.bodies:
        if body.eta in traces.values and traces.size(body.eta) >= 6:
            eta = Elements(traces, body.eta)
            return track_rows(eta[0], eta[1], most)
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(np.intp))


def _picked(traces: Traces, name: str, picks: NDArray[np.intp]) -> Array | None:
    """Return some samples of a signal, or of an element ``x[2]`` of one; read by element."""
    if name in traces.values and traces.is_array(name):
        return Elements(traces, name).stacked(*range(traces.size(name)), rows=picks)
    column = _column(traces, name)
    return None if column is None else picked(column, picks)


def _column(traces: Traces, name: str) -> Samples | None:
    """Return a signal of one element, or an element ``x[2]`` of an array."""
    if name in traces.values:
        return traces.element(name, 0) if traces.size(name) == 1 else None
    whole, indices = split_element_name(name)
    if whole not in traces.values or not traces.is_array(whole) or len(indices) != 1:
        return None
    k = indices[0]
    return None if k > traces.size(whole) else traces.element(whole, k - 1)


def quaternions(angles: Array) -> Array:
    """Return (T, 4) of Euler angles zyx (T, 3) [rad]; Fossen (2021), section 2.2.2."""
    c, s = np.cos(0.5 * angles).T, np.sin(0.5 * angles).T
    return np.column_stack([
        c[0] * c[1] * c[2] + s[0] * s[1] * s[2], s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
        c[0] * s[1] * c[2] + s[0] * c[1] * s[2], c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
    ])  # fmt: skip


def turned(q: Array, vectors: Array) -> Array:
    """Turn vectors (..., 3) of `b` into `n` by unit quaternions (..., 4)."""
    w, e = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(e, vectors)
    return np.asarray(vectors + w * t + np.cross(e, t))


def echoes(body: Body, motion: Motion, most: int = 60_000) -> Array:
    """Return the points (n, 3) in `n` where rays have ended: each reading once, thinned evenly."""
    if body.name not in motion.positions:
        return np.zeros((0, 3))
    found = []
    at, q = motion.positions[body.name], motion.attitudes[body.name]
    for rays in body.rays:
        distance = motion.ranges.get(rays.name)
        if distance is None:
            continue
        known = np.nan_to_num(distance, nan=-1.0)
        fresh = np.ones(len(known), bool)
        fresh[1:] = (known[1:] != known[:-1]).any(axis=1)
        share = max(1, -(-int(fresh.sum()) * distance.shape[1] // most))
        rows = np.flatnonzero(fresh)[::share]
        inside = rays.r + rays.directions * distance[rows][:, :, None]
        points = at[rows][:, None] + turned(q[rows][:, None], inside)
        points = points.reshape(-1, 3)
        found.append(points[np.isfinite(points).all(axis=1)])
    return np.concatenate(found)[:most] if found else np.zeros((0, 3))


def extent(scene3d: Scene3D, motion: Motion) -> tuple[Array, Array]:
    """Return the least and greatest N, E, D of moving parts, planned paths and basins.

    Obstacles count only near those: a chart has some kilometres away.
    """
    parts = [p for p in motion.positions.values() if len(p)]
    parts += [line.points for line in scene3d.lines]
    parts += [s.mesh.vertices.astype(float) for s in scene3d.solids if s.kind == "basin"]
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points) and scene3d.terrain is not None:
        a, b, c, d = scene3d.terrain.extent
        return np.array([a, c, 0.0]), np.array([b, d, float(np.nanmax(scene3d.terrain.z))])
    if not len(points):
        return -np.ones(3), np.ones(3)
    margin = max((b.size for b in scene3d.bodies), default=0.5)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    near = 0.5 * float(max(high[:2] - low[:2]))
    for solid in scene3d.solids:
        a, b = solid.mesh.vertices.min(axis=0), solid.mesh.vertices.max(axis=0)
        if (a[:2] > low[:2] - near).all() and (b[:2] < high[:2] + near).all():
            low, high = np.minimum(low, a), np.maximum(high, b)
    return low, high
