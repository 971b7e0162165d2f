"""Frames of a range sensor along a run: cast from the true pose, or recorded by a component.

If no component needs the frames during the run, they are computed afterwards: a frame is a
function of pose, scene and seed, and has the same bits whenever it is computed. A beam's point is

    p_n = eta[:3] + R(phi, theta, psi) (r_s + R_bs d range)

with the unit direction d in the sensor's axes, r_s and R_bs its place and attitude in `b`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import exp, sqrt
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.sensors.multibeam_and_camera import PRESETS, beams_of
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.scene.shared.ray_casting import SEABED, SOLID, Caster

__all__ = [
    "Frame",
    "RangeSensor",
    "RecordedFrames",
    "frames",
    "points",
    "range_sensor",
    "recorded_sensor",
    "rotation",
]

Array = NDArray[np.float64]
OUTPUTS = {"multibeam": "range", "depth_camera": "image"}


@dataclass(frozen=True, eq=False)
class RecordedFrames:
    """Frames of a component: samples at t (k,) [s], ranges (k, n) [m], NaN without an echo."""

    t: Array
    range: Array


@dataclass(frozen=True, eq=False)
class RangeSensor:
    """A range sensor: beams (n, 3) in its axes, place r_s (3,) [m] and attitude R_bs in `b`.

    `period` [s] between frames; echoes from `near` to `far` [m]. A range r reads
    r + b_k + sqrt(sigma² + (sigma_relative r)²) w, and is lost by chance (`dropout`); b_k is of
    all beams of a frame, a Gauss-Markov process of `bias_sigma` [m] and `bias_tau` [s]. Where
    frames were `recorded` in the loop, they are given as they are.
    """

    name: str
    directions: Array
    period: float
    near: float
    far: float
    sigma: float = 0.0
    sigma_relative: float = 0.0
    bias_sigma: float = 0.0
    bias_tau: float = 1.0
    dropout: float = 0.0
    r_s: Array = field(default_factory=lambda: np.zeros(3))
    R_bs: Array = field(default_factory=lambda: np.eye(3))
    recorded: RecordedFrames | None = None

    def __post_init__(self) -> None:
        if not self.period > 0:
            raise InputInvalid(self.name, f"period {self.period} s", "more than 0")

    @property
    def in_body(self) -> Array:
        """The beams (n, 3) in `b`."""
        return np.ascontiguousarray(self.directions @ self.R_bs.T)

    def biases(self, count: int, seed: int) -> Array:
        """Return b_k (count,) of the first frames [m], exact for every period."""
        if self.bias_sigma == 0:
            return np.zeros(count)
        w = _random(seed, self.name, -1).standard_normal(count)
        phi = exp(-self.period / self.bias_tau)
        b = np.empty(count)
        b[0] = w[0]
        for k in range(1, count):
            b[k] = phi * b[k - 1] + sqrt(1.0 - phi * phi) * w[k]
        return self.bias_sigma * b


def range_sensor(kind: str, preset_id: str, period: float, **options: Any) -> RangeSensor:
    """Return the `multibeam` or `depth_camera` of a preset (models/sensors), by its figures.

    `options` are `beams`, or `columns` and `rows`. The preset's figures of incidence are ignored,
    since the slopes of a map are gentle.
    """
    rays = beams_of(kind, preset_id, **options)
    p = preset("sensors", preset_id, kind)
    return RangeSensor(
        f"{kind}@{preset_id}", rays.directions, period, p.number("range_min", "m"),
        p.number("range_max", "m"), p.number("sigma_range", "m"),
        p.number("sigma_range_relative", "1"), p.number("bias_sigma", "m"),
        p.number("bias_tau", "s"), p.number("dropout", "1"), rays.r_s, rays.R_bs,
    )  # fmt: skip


def recorded_sensor(run: Path, component: str, signals: Signals) -> RangeSensor:
    """Return a multibeam or depth camera of a run's system, with its recorded frames.

    The directions of its beams follow from its source and its mounting in the run's `system.ssd`.
    Raises InputInvalid if there is no such instrument, or its readings were not recorded.
    """
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.running.library import load

    components = {c.path: c for c in flatten(load(run / "system.ssd"), loops="delay").components}
    planned = components.get(component)
    if planned is None:
        known = ", ".join(components)
        raise InputInvalid(run, f"its system has no component {component!r}", f"one of {known}")
    name, _, query = planned.source.removeprefix("model:").partition("?")
    kind, _, preset = name.partition("@")
    options = dict(parse_qsl(query))
    if kind not in OUTPUTS:
        raise InputInvalid(
            run, f"{component} is {planned.source}", f"model:{' or model:'.join(OUTPUTS)}"
        )
    size = {k: options[k] for k in ("beams", "columns", "rows") if k in options}
    found = range_sensor(kind, preset or options.get("id", PRESETS[kind]), 1.0, **size)
    if "r_s" in planned.start:
        found = replace(found, r_s=np.array(planned.start["r_s"], float))
    if "Theta_s" in planned.start:
        found = replace(found, R_bs=rotation(*np.array(planned.start["Theta_s"], float)))
    reading, sample = f"{component}.{OUTPUTS[kind]}", f"{component}.t_sample"
    if reading not in signals or sample not in signals:
        raise InputInvalid(run, f"{reading} was not recorded", "a run of this system")
    t, first = np.unique(signals[sample], return_index=True)
    first, t = first[t >= 0], t[t >= 0]  # before the first sample it is -1
    ranges = np.asarray(signals[reading], float)[first]
    ranges = np.where(ranges > 0, ranges, np.nan)  # NaN without an echo
    if kind == "depth_camera" and options.get("reading", "depth") == "depth":
        ranges = ranges / found.directions[:, 2]
    period = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    recorded = RecordedFrames(t, ranges)
    return replace(found, name=f"{component}, in the loop", period=period, recorded=recorded)


@dataclass(frozen=True, eq=False)
class Frame:
    """One sample: `row` of the recording, and the range of each beam [m], NaN without an echo."""

    row: int
    range: Array


def rotation(phi: float, theta: float, psi: float) -> Array:
    """Return R from `b` to `n` of Euler angles [rad] (Fossen 2021, equation 2.31)."""
    c, s = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
    return np.array(
        [
            [c[2] * c[1], -s[2] * c[0] + c[2] * s[1] * s[0], s[2] * s[0] + c[2] * c[0] * s[1]],
            [s[2] * c[1], c[2] * c[0] + s[0] * s[1] * s[2], -c[2] * s[0] + s[1] * s[2] * c[0]],
            [-s[1], c[1] * s[0], c[1] * c[0]],
        ]
    )


def frames(
    sensor: RangeSensor,
    time: Array,
    eta: Array,
    caster: Caster,
    seed: int = 0,
    every: int = 1,
) -> Iterator[Frame]:
    """Yield every n-th frame of a sensor along a track: eta (T, 6) at `time` (T,) [s].

    Its error is drawn from `seed` and the number of the frame: a frame alone has the same bits.
    """
    if (recorded := sensor.recorded) is not None:
        rows = np.clip(np.searchsorted(time, recorded.t - 1e-9), 0, len(time) - 1)
        seen = np.abs(time[rows] - recorded.t) < 1e-6
        if len(recorded.t) and not seen.any():
            raise InputInvalid(
                sensor.name,
                f"no pose was recorded when it took a sample (every {sensor.period:g} s)",
                "a run without --record-every",
            )
        for k in np.flatnonzero(seen)[::every].tolist():
            yield Frame(int(rows[k]), recorded.range[k])
        return
    sample_times = np.arange(0.0, time[-1] + 1e-9, sensor.period)
    rows = np.clip(np.searchsorted(time, sample_times - 1e-9), 0, len(time) - 1)
    in_body, biases = sensor.in_body, sensor.biases(len(rows), seed)
    n = len(in_body)
    out = (np.empty(n), np.empty(n, np.int32))
    for k, row in list(enumerate(rows.tolist()))[::every]:
        R = rotation(*eta[row, 3:])
        caster.cast(eta[row, :3] + R @ sensor.r_s, in_body @ R.T, sensor.far, out)
        r = np.where((out[1] == SEABED) | (out[1] >= SOLID), out[0], np.nan)
        random = _random(seed, sensor.name, k)
        w = random.standard_normal(n, np.float32)
        if sensor.sigma_relative > 0:
            r += biases[k] + np.hypot(sensor.sigma, sensor.sigma_relative * r) * w
        else:
            r += biases[k] + sensor.sigma * w
        if sensor.dropout > 0:
            r[random.random(n, np.float32) < sensor.dropout] = np.nan
        r[~((r >= sensor.near) & (r <= sensor.far))] = np.nan
        yield Frame(row, r)


def _random(seed: int, name: str, k: int) -> np.random.Generator:
    return np.random.default_rng((seed & 0xFFFFFFFF, crc32(name.encode()), k + 1))


def points(sensor: RangeSensor, in_body: Array, r: Array, eta: Array) -> Array:
    """Return the points (n, 3) N E D [m] of ranges at a pose; `in_body` are the beams in `b`."""
    R = rotation(*eta[3:])
    world: Array = r[:, None] * (in_body @ R.T) + (eta[:3] + R @ sensor.r_s)
    return world
