"""Maps of the seabed from a run: by the true pose, and by the pose of the navigation filter.

Ranges are measured from the true pose of the vehicle. The mapper places them by one of the two
poses. So the first map shows the errors of sensors and gridding, the second also those of
navigation.
"""

from __future__ import annotations

import json
import time as clock
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.scene.mapping.scans import RangeSensor, frames, points
from uuvsim_cosim.scene.shared.ray_casting import SEABED, SOLID, Caster

__all__ = [
    "Figures",
    "HeightGrid",
    "SeabedMap",
    "Track",
    "Window",
    "map_seabed",
    "read_map",
    "run_points",
    "track_of_run",
    "write_map",
]

Array = NDArray[np.float64]
MOST_CELLS = 40_000_000


@dataclass(frozen=True)
class Window:
    """Cells of `cell` [m]; the corner of the first is at (north, east) [m] in `n`."""

    north: float
    east: float
    cell: float
    rows: int
    columns: int

    @staticmethod
    def around(lowest: Array, highest: Array, margin: float, cell: float) -> Window:
        """Return the window, on whole cells, of places (N, E) and a margin [m]."""
        if not (np.isfinite(cell) and cell > 0):
            raise InputInvalid(f"cell {cell} m", "more than 0")
        first = np.floor((lowest - margin) / cell) * cell
        n = np.ceil((highest + margin - first) / cell).astype(int)
        if int(n[0]) * int(n[1]) > MOST_CELLS:
            raise InputInvalid(
                f"a map of {n[0]:,} x {n[1]:,} cells of {cell:g} m",
                f"at most {MOST_CELLS:,} cells: give a larger one",
            )
        return Window(float(first[0]), float(first[1]), cell, int(n[0]), int(n[1]))

    @property
    def centres(self) -> tuple[Array, Array]:
        """Return N (rows,) and E (columns,) of the cells' centres [m]."""
        north: Array = self.north + (np.arange(self.rows, dtype=np.float64) + 0.5) * self.cell
        east: Array = self.east + (np.arange(self.columns, dtype=np.float64) + 0.5) * self.cell
        return north, east


@final
@dataclass(eq=False)
class HeightGrid:
    """Sums over the cells of a window; points are added batch by batch."""

    window: Window
    total: Array = field(init=False)
    count: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        size = self.window.rows * self.window.columns
        self.total, self.count = np.zeros(size), np.zeros(size, np.int64)

    def add(self, north: Array, east: Array, depth: Array) -> None:
        """Add points (n,) each [m]; points outside of the window are ignored."""
        w = self.window
        i = np.floor((north - w.north) * (1.0 / w.cell)).astype(np.int64)
        j = np.floor((east - w.east) * (1.0 / w.cell)).astype(np.int64)
        inside = (i >= 0) & (i < w.rows) & (j >= 0) & (j < w.columns)
        if not inside.all():
            i, j, depth = i[inside], j[inside], depth[inside]
        if len(i) == 0:
            return
        # Only the rows that the batch reaches: a batch is a small part of a large map.
        low, high = int(i.min()), int(i.max()) + 1
        flat = (i - low) * w.columns + j
        size = (high - low) * w.columns
        part = slice(low * w.columns, high * w.columns)
        self.total[part] += np.bincount(flat, weights=depth, minlength=size)
        self.count[part] += np.bincount(flat, minlength=size)

    def mean(self) -> Array:
        """Return the mean depth (rows, columns) [m]; NaN without points."""
        with np.errstate(invalid="ignore", divide="ignore"):
            z = np.where(self.count > 0, self.total / self.count, np.nan)
        return z.reshape(self.window.rows, self.window.columns)


Progress = Callable[[str, float, float], None]
POSES = {"true": "hull.eta", "navigation": "navigation.eta"}
FILE, BATCH = "map.npz", 400_000


@dataclass(frozen=True, eq=False)
class Track:
    """Poses eta (T, 6) by name ("true", "navigation") at `time` (T,) [s]; `seed` of the run."""

    time: Array
    poses: Mapping[str, Array]
    seed: int = 0

    def __post_init__(self) -> None:
        if len(self.time) < 2 or "true" not in self.poses:
            raise InputInvalid(
                (
                    f"a track of {len(self.time)} samples with poses "
                    f"{', '.join(self.poses) or 'none'}"
                ),
                "2 or more, and the true pose (hull.eta)",
            )


@dataclass(frozen=True)
class Figures:
    """Accuracy of a map over `cells` cells: error = mapped minus true depth [m]."""

    pose: str
    rmse: float
    bias: float
    p95: float  # of |error|
    cells: int
    covered: float  # share of the window

    @staticmethod
    def of(pose: str, z: Array, truth: Array) -> Figures:
        """Compare mapped and true depths (rows, columns) [m]; NaN where one is unknown."""
        error = (z - truth)[np.isfinite(z) & np.isfinite(truth)]
        if error.size == 0:
            return Figures(pose, np.nan, np.nan, np.nan, 0, 0.0)
        return Figures(
            pose, float(np.sqrt(np.mean(error**2))), float(error.mean()),
            float(np.percentile(np.abs(error), 95)), int(error.size), error.size / z.size,
        )  # fmt: skip

    def __str__(self) -> str:
        """Return one line."""
        return (f"{self.pose}: RMSE {100 * self.rmse:.2f} cm, bias {100 * self.bias:+.2f} cm, "
                f"95 % within {100 * self.p95:.2f} cm, {self.cells:,} cells")  # fmt: skip


@dataclass(frozen=True, eq=False)
class SeabedMap:
    """Depth (rows, columns) [m] by pose, NaN where nothing was seen; `truth` likewise."""

    window: Window
    depth: Mapping[str, Array]
    truth: Array
    figures: tuple[Figures, ...]
    frames: int
    points: int
    seconds: float  # of CPU
    sensors: tuple[str, ...]
    scene: str
    crs: str = ""
    northing: float = 0.0  # m, of the local frame's origin in crs
    easting: float = 0.0
    vertical_datum: str = ""


def track_of_run(folder: Path) -> Track:
    """Read the poses of a run; raises RecordingError and InputInvalid."""
    from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

    signals = read_signals(folder)
    found = {}
    for pose, name in POSES.items():
        if name in signals:
            eta = np.ascontiguousarray(signals[name], float)
            if eta.ndim != 2 or eta.shape[1] != 6 or not np.all(np.isfinite(eta)):
                raise RecordingError(folder, f"{name} is {eta.shape}", "(n, 6), finite")
            found[pose] = eta
    if "true" not in found:
        near = ", ".join([n for n in signals if n.endswith(".eta")] or list(signals)[:8])
        raise InputInvalid(folder, f"no hull.eta in the recording ({near})", "a vehicle's")
    return Track(np.asarray(signals.time, float), found, int(signals.metadata.get("seed", 0)))


def map_seabed(
    track: Track, caster: Caster, sensors: Sequence[RangeSensor], cell: float = 0.1,
    scene: str = "", progress: Progress | None = None,
) -> SeabedMap:  # fmt: skip
    """Map the seabed along a track by all sensors, in cells of `cell` [m].

    Raises InputInvalid if no ray meets the seabed: the track
    is then outside of the terrain, or too high above it.
    """
    begun = clock.process_time()
    window = _window(track, caster, sensors, cell)
    grids = {pose: HeightGrid(window) for pose in track.poses}
    n_frames = n_points = 0
    for pose, xyz, made in _placed(track, caster, sensors, progress):
        grids[pose].add(xyz[:, 0], xyz[:, 1], xyz[:, 2])
        if pose == "true":
            n_frames, n_points = n_frames + made, n_points + len(xyz)
    if n_points == 0:
        ranges = ", ".join(f"{s.name} {s.near:g} to {s.far:g} m" for s in sensors)
        raise InputInvalid(
            f"no part of the seabed was seen ({ranges})",
            f"a track above the terrain{f' of scene {scene}' if scene else ''}, within reach",
        )
    # The truth is the first surface below each cell's centre: the seabed or an obstacle on it.
    north, east = (c.ravel() for c in np.meshgrid(*window.centres, indexing="ij"))
    at = 1e-3  # m, just below the surface
    from_surface = np.column_stack([north, east, np.full(len(north), at)])
    down = np.zeros_like(from_surface)
    down[:, 2] = 1.0
    far, kind = caster.cast(from_surface, down)
    met = (kind == SEABED) | (kind >= SOLID)
    truth: Array = np.where(met, at + far, np.nan).reshape(window.rows, window.columns)
    depth = {pose: grid.mean() for pose, grid in grids.items()}
    figures = tuple(Figures.of(pose, z, truth) for pose, z in depth.items())
    return SeabedMap(
        window, depth, truth, figures, n_frames, n_points, clock.process_time() - begun,
        tuple(f"{s.name}: {len(s.directions):,} beams at {1 / s.period:g} Hz" for s in sensors),
        scene,
    )  # fmt: skip


def run_points(
    track: Track, caster: Caster, sensors: Sequence[RangeSensor], pose: str = "true", every: int = 1
) -> Iterator[Array]:
    """Yield the points (n, 3) N E D [m] of every n-th frame of a run, batch by batch."""
    if pose not in track.poses:
        raise InputInvalid(f"pose {pose!r}", f"one of {', '.join(track.poses)}")
    one = Track(track.time, {"true": track.poses["true"], pose: track.poses[pose]}, track.seed)
    for which, xyz, _ in _placed(one, caster, sensors, None, every):
        if which == pose:
            yield xyz


def _window(track: Track, caster: Caster, sensors: Sequence[RangeSensor], cell: float) -> Window:
    """Return the area that the sensors may reach: the track, and the reach of the widest beam."""
    places = np.concatenate([eta[:, :2] for eta in track.poses.values()])
    true = track.poses["true"]
    with np.errstate(invalid="ignore"):
        altitude = caster.height(true[:, 0], true[:, 1]) - true[:, 2]
    if not np.any(altitude > 0):
        raise InputInvalid(
            (
                f"the track, N {true[:, 0].min():.0f} to {true[:, 0].max():.0f} m "
                f"and E {true[:, 1].min():.0f} to {true[:, 1].max():.0f} m, is "
                "nowhere above the terrain"
            ),
            "a vehicle within its scene",
        )
    high = float(np.nanmax(altitude[altitude > 0]))
    aside = 0.0
    for s in sensors:
        d = s.in_body
        level = np.hypot(d[:, 0], d[:, 1])
        reach = level * np.minimum(s.far, 1.3 * high / np.maximum(d[:, 2], 1e-3))
        aside = max(aside, float(reach.max()))
    return Window.around(places.min(axis=0), places.max(axis=0), aside, cell)


def _placed(
    track: Track, caster: Caster, sensors: Sequence[RangeSensor], progress: Progress | None,
    every: int = 1,
) -> Iterator[tuple[str, Array, int]]:  # fmt: skip
    """Yield points in batches: pose, (n, 3), and the number of their frames."""
    true = track.poses["true"]
    end = float(track.time[-1]) * len(sensors)
    for number, range_sensor in enumerate(sensors):
        in_body = range_sensor.in_body
        waiting: dict[str, list[Array]] = {pose: [] for pose in track.poses}
        size = made = 0
        seen = frames(range_sensor, track.time, true, caster, track.seed, every)
        for k, frame in enumerate(seen):
            echoes = np.isfinite(frame.range)
            r, beams = frame.range[echoes], in_body[echoes]
            for pose, eta in track.poses.items():
                waiting[pose].append(points(range_sensor, beams, r, eta[frame.row]))
            size, made = size + len(r), made + 1
            if size >= BATCH:
                yield from ((p, np.concatenate(w), made) for p, w in waiting.items())
                waiting, size, made = {pose: [] for pose in track.poses}, 0, 0
            if progress is not None and k % 64 == 0:
                done = float(track.time[frame.row]) + number * float(track.time[-1])
                progress("mapping", done, end)
        if made:
            yield from ((p, np.concatenate(w), made) for p, w in waiting.items())


def write_map(made: SeabedMap, folder: Path) -> Path:
    """Write a map beside its run, compressed; `read_map` reads it."""
    about: dict[str, object] = {
        "version": 1, "window": asdict(made.window), "figures": [asdict(f) for f in made.figures],
        "frames": made.frames, "points": made.points, "seconds": made.seconds,
        "sensors": list(made.sensors), "scene": made.scene, "crs": made.crs,
        "northing": made.northing, "easting": made.easting, "vertical_datum": made.vertical_datum,
    }  # fmt: skip
    layers = {f"depth_{pose}": z.astype(np.float32) for pose, z in made.depth.items()}
    file = folder / FILE
    try:
        with whole_file(file) as scratch:
            np.savez_compressed(
                scratch, allow_pickle=False, about=np.array(json.dumps(about)),
                truth=made.truth.astype(np.float32), **layers,
            )  # type: ignore[arg-type,unused-ignore]  # fmt: skip
    except OSError as error:
        raise InputInvalid(f"{file}: cannot be written ({error.strerror})") from None
    return file


def read_map(folder: Path) -> SeabedMap | None:
    """Read the map of the seabed in the `folder` of a run, None if it has none.

    The depth by pose and the truth are (rows, columns) [m], NaN where nothing was seen. Raises
    InputInvalid for any other file.

    Example: `uuvsim run` makes the map of a system with a survey, `uuvsim map` that of others.

    >>> import subprocess, sys
    >>> from pathlib import Path
    >>> from uuvsim_cosim.scene import read_map
    >>> run = "-m uuvsim_cosim run seabed_mapping --until 2 --no-report --quiet --out survey"
    >>> done = subprocess.run([sys.executable, *run.split()], check=True)
    >>> seabed = read_map(Path("survey"))
    >>> seabed.depth["true"].shape == seabed.truth.shape, seabed.window.cell  # [m]
    (True, 0.1)
    """
    file = folder / FILE
    if not file.is_file():
        return None
    if not zipfile.is_zipfile(file):
        raise InputInvalid(
            f"{file}: no map that `uuvsim map` wrote, or cut short; `uuvsim map {folder}` makes "
            "it again"
        )
    try:
        with np.load(file, allow_pickle=False) as kept:
            about = json.loads(str(kept["about"]))
            depth = {n.removeprefix("depth_"): kept[n].astype(float) for n in kept.files
                     if n.startswith("depth_")}  # fmt: skip
            truth = kept["truth"].astype(float)
        return SeabedMap(
            Window(**about["window"]), depth, truth, tuple(Figures(**f) for f in about["figures"]),
            about["frames"], about["points"], about["seconds"], tuple(about["sensors"]),
            about["scene"], about["crs"], about["northing"], about["easting"],
            about["vertical_datum"],
        )  # fmt: skip
    except Exception as reason:
        raise InputInvalid(f"{file}: no map that `uuvsim map` wrote: {reason}") from None
