"""Film of a run: each frame is a function of the run, the settings and its number."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.pictures.canvas import Canvas
from uuvsim_cosim.envs.pictures.scale import nice_step
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.view.film.files import check_target, film_file
from uuvsim_cosim.view.film.panels import INK, PAPER, panels_of
from uuvsim_cosim.view.film.paths import CameraPath, Subject, camera_path, keyframes
from uuvsim_cosim.view.film.renderer import NOTHING, SEABED, Look, Renderer, Seen
from uuvsim_cosim.view.scene3d.colours import BODIES, MARKER, PATH
from uuvsim_cosim.view.scene3d.scene_of_run import placed
from uuvsim_cosim.view.scene3d.shapes import cropped

__all__ = ["MOST_FRAMES", "MOST_PIXELS", "Film", "FilmSettings", "write_film"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Progress = Callable[[str, float, float], None]
MOST_PIXELS = 16_000_000  # of a frame, which needs 60 bytes for each
MOST_FRAMES = 1_000_000
LEAST_SIDE = 64  # pixels
TRAIL = 1500  # points of a track in a frame
FAR = 60.0  # m, up to which contours are drawn


@dataclass(frozen=True)
class FilmSettings:
    """What a film shows. Times are those of the run [s]; without them, the film shows all."""

    camera: str = "chase"  # chase, orbit, top, side, fixed:N,E,D
    path: Path | None = None  # file of keyframes, instead of a camera
    follow: str = ""  # vehicle that the camera follows; "": the first
    start: float | None = None  # s
    end: float | None = None  # s
    speed: float = 1.0  # seconds of the run in a second of the film
    fps: float = 20.0  # frames a second
    size: tuple[int, int] = (640, 360)  # px, width and height
    water: str = "II"  # type of Jerlov, or "none"
    caustics: float = 0.0  # strength, 0 to 1
    contours: bool = False  # lines of equal depth on the seabed
    track: bool = True  # tracks so far, and the planned path
    captions: bool = True  # time, depth, scale
    panels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        width, height = self.size
        if not (min(width, height) >= LEAST_SIDE and width * height <= MOST_PIXELS):
            raise InputInvalid(
                "--size", f"{width}x{height} pixels, {width * height * 60 / 2**20:,.0f} MiB",
                f"at least {LEAST_SIDE} a side, and at most {MOST_PIXELS:,} pixels",
            )  # fmt: skip
        for name, value, high in (
            ("--speed", self.speed, 1e6), ("--fps", self.fps, 1000.0),
        ):  # fmt: skip
            if not 0.0 < value <= high:
                raise InputInvalid(name, f"{value:g}", f"above 0, and at most {high:g}")
        if not 0.0 <= self.caustics <= 1.0:
            raise InputInvalid("--caustics", f"{self.caustics:g}", "0 to 1")


@final
class Film:
    """Frames of a run. Raises InputInvalid for a run without a pose, and for settings beyond it.

    `notes` has sentences on what the film leaves out or assumes.

    Example: `Film("runs/dive", FilmSettings(camera="orbit")).frame(0)` are the pixels (height,
    width, 3) of the first frame.
    """

    def __init__(self, run: str | Path, settings: FilmSettings) -> None:
        scene3d, motion, traces = placed(run)
        self.settings = s = settings
        self.scene3d, self._motion = scene3d, motion
        bodies = [b for b in scene3d.bodies if b.name in motion.positions]
        if not bodies:
            raise InputInvalid(run, "no vehicle with a pose was recorded", "such as hull.eta")
        names = [b.name for b in bodies]
        if s.follow and s.follow not in names:
            raise InputInvalid("--follow", f"{s.follow!r}", expected_names(s.follow, names))
        self._subjects = {b.name: Subject(motion, b.name, b.size) for b in bodies}
        body = next(b for b in bodies if b.name == (s.follow or names[0]))
        self.subject = self._subjects[body.name]
        first, last = float(motion.time[0]), float(motion.time[-1])
        start = first if s.start is None else s.start
        end = last if s.end is None else s.end
        if not first - 1e-9 <= start <= end <= last + 1e-9:
            raise InputInvalid(
                f"{run}", f"a film from {start:g} to {end:g} s",
                f"times from {first:g} to {last:g} s, which the run has",
            )  # fmt: skip
        count = max(1, round((end - start) / s.speed * s.fps))
        if count > MOST_FRAMES:
            raise InputInvalid(
                "film", f"{count:,} frames", f"at most {MOST_FRAMES:,}: a greater --speed"
            )
        self.times = np.minimum(start + np.arange(count) * (s.speed / s.fps), end)
        width, height = s.size
        self.renderer = Renderer(scene3d, height, width, s.water, s.caustics)
        caster = self.renderer.caster
        self._path: CameraPath = (
            camera_path(s.camera, self.subject, start, caster)
            if s.path is None
            else keyframes(s.path, self.subject, start, end)
        )
        if self._path.strict:  # a mistake late in the film is reported before its first frame
            for t in self.times[:: max(1, count // 1000)].tolist():
                self._path.look(t, caster, self.subject)
        position = motion.positions[body.name]
        span = (start, max(end, start + 1e-9))
        self.panels = panels_of(list(s.panels), Path(run), traces, body, position, caster, span)
        self._step = self._contour_step() if s.contours else 0.0
        self.notes = list(scene3d.notes)
        if scene3d.terrain is None and scene3d.bottom is None and not scene3d.solids:
            self.notes.append("the run has no seabed: the film shows water alone")
        elif s.contours and not self._step:
            self.notes.append("the seabed is level: it has no contours")
        self.nearer = 0  # frames whose camera was moved nearer to the vehicle

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.times)

    def frames(self) -> Iterator[Pixels]:
        """Yield the frames in their order."""
        for k in range(len(self)):
            yield self.frame(k)

    def frame(self, k: int) -> Pixels:
        """Return frame `k`: pixels (height, width, 3)."""
        t = float(self.times[k])
        poses = {name: s.pose(t) for name, s in self._subjects.items()}
        look, nearer = self._path.look(t, self.renderer.caster, self.subject)
        self.nearer += nearer
        seen = self.renderer.seen(look, poses, t)
        width, height = self.settings.size
        canvas = Canvas(width, height)
        canvas.place(0, 0, self.renderer.picture(seen, float(look.eye[2])))
        size = max(9.0, height / 34.0)
        if self._step:
            self._contours(canvas, seen, size)
        if self.settings.track:
            self._tracks(canvas, seen, look, t)
        self._markers(canvas, seen, look, t)
        if self.settings.captions:
            self._captions(canvas, look, poses[self.subject.name][0], t, size)
        self._insets(canvas, t, size)
        return canvas.pixels()

    def _insets(self, canvas: Canvas, t: float, size: float) -> None:
        width, height = self.settings.size
        wide = int(0.27 * width)
        tall = [int(p.aspect * wide) for p in self.panels]
        share = min(1.0, (height - 8 * (len(tall) + 1)) / max(sum(tall), 1))
        top = 8
        for panel, high in zip(self.panels, tall, strict=True):
            box = (width - wide - 8, top, wide, int(share * high))
            panel.draw(canvas, box, 0.9 * size, t)
            top += int(share * high) + 8

    def _captions(self, canvas: Canvas, look: Look, at: Array, t: float, size: float) -> None:
        height = self.settings.size[1]
        words = [f"t = {t:.1f} s", f"depth {at[2]:.1f} m"]
        if self.settings.speed != 1.0:
            words.append(f"{self.settings.speed:g} x")
        below = f"   contours every {self._step:g} m" if self._step else ""
        for dx, dy, colour in ((1, 1, PAPER), (0, 0, INK)):
            canvas.text((10 + dx, 10 + dy), self.scene3d.name.replace("_", " "), colour, 1.2 * size)
            canvas.text((10 + dx, 16 + 1.3 * size + dy), "   ".join(words), colour, size)
            distance = float(np.linalg.norm(at - look.eye))
            metre = self.renderer.focal_length / max(distance, 0.1)
            scale = nice_step(0.14 * self.settings.size[0] / metre)
            long, y = scale * metre, height - 12.0
            for x in (10.0, 10.0 + long):
                canvas.line([[x + dx, y - 4 + dy], [x + dx, y + dy]], colour, 1.5)
            canvas.line([[10 + dx, y + dy], [10 + long + dx, y + dy]], colour, 1.5)
            text = f"{scale:g} m at the vehicle{below}"
            canvas.text((10 + dx, y - 8 + dy), text, colour, size, anchor=(0.0, 1.0))

    def _hidden(self, seen: Seen, pixels: Array, distance: Array) -> NDArray[np.bool_]:
        """Return which places are outside of the frame, or behind something."""
        rows, columns = self.renderer.shape
        known: NDArray[np.bool_] = np.asarray(np.isfinite(pixels).all(axis=1))
        j, i = np.floor(np.where(known[:, None], pixels, 0.0)).astype(int).T
        inside = known & (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        i, j = i * inside, j * inside
        before = (seen.kind[i, j] != NOTHING) & (seen.distance[i, j] < 0.995 * distance - 0.02)
        return np.asarray(~inside | before)

    def _tracks(self, canvas: Canvas, seen: Seen, look: Look, t: float) -> None:
        lines = [(line.points, PATH, 1.0) for line in self.scene3d.lines]
        upto = int(np.searchsorted(self._motion.time, t, side="right"))
        picks = np.unique(np.linspace(0, max(upto - 1, 0), TRAIL).astype(int))
        for i, name in enumerate(b.name for b in self.scene3d.bodies):
            if name in self._subjects and upto:
                past = self._motion.positions[name][picks]
                lines.append((past, BODIES[i % len(BODIES)], 1.4))
        for points, colour, width in lines:
            if len(points) < 2:
                continue
            # Long segments are cut, so that they vanish behind things and fade where they do.
            cuts = max(1, -(-TRAIL // len(points)))
            at = np.linspace(0, len(points) - 1, cuts * (len(points) - 1) + 1)
            known = np.arange(len(points))
            points = np.column_stack([np.interp(at, known, points[:, i]) for i in range(3)])
            pixels, distance = self.renderer.projected(look, points)
            pixels[self._hidden(seen, pixels, distance)] = np.nan
            fade = 1.0 if self.settings.water == "none" else np.exp(-0.09 * distance[1:])
            canvas.line(pixels, colour, width, np.clip(0.9 * fade, 0.0, 1.0))

    def _markers(self, canvas: Canvas, seen: Seen, look: Look, t: float) -> None:
        k = self._motion.moment(t)
        for marker in self.scene3d.markers:
            if marker.name not in self._motion.positions:
                continue
            at = self._motion.positions[marker.name][[k]]
            pixels, distance = self.renderer.projected(look, at)
            if not self._hidden(seen, pixels, distance)[0]:
                radius = marker.radius * self.renderer.focal_length / max(float(distance[0]), 0.1)
                canvas.disc(pixels[0], max(radius, 2.0), MARKER, 0.8)

    def _contour_step(self) -> float:
        """Return the distance of contours [m] for the seabed around the track; 0 if it is level."""
        terrain = self.scene3d.terrain
        if terrain is None:
            return 0.0
        p = self._motion.positions[self.subject.name]
        p = p[np.isfinite(p).all(axis=1)]
        near = cropped(terrain, p.min(axis=0), p.max(axis=0), 15.0)
        span = float(np.nanmax(near.z) - np.nanmin(near.z))
        return nice_step(span / 12.0) if span > 0.05 else 0.0

    def _contours(self, canvas: Canvas, seen: Seen, size: float) -> None:
        """Darken the pixels at which the seabed crosses a level, and write the levels."""
        bed = (seen.kind == SEABED) & (seen.distance < FAR)
        level = np.where(bed, np.floor(seen.deep / self._step), 0.0).astype(int)
        edge = np.zeros(level.shape, int)  # the level that is crossed, or 0
        for a, b in (
            ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
            ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
        ):
            crossed = bed[a] & bed[b] & (level[a] != level[b])
            edge[a] = np.where(crossed, np.maximum(level[a], level[b]), edge[a])
        # Lines vanish in the fog with the ground that they are on.
        clear = np.exp(-float(self.renderer.optics[0].min()) * seen.distance)
        strength = np.where(edge % 5 == 0, 0.7, 0.45) * clear * (edge != 0)
        ink = np.array([16.0, 32.0, 44.0])
        pixels = canvas.pixels() + strength[..., None] * (ink - canvas.pixels())
        pixels = (pixels + 0.5).astype(np.uint8)
        canvas.place(0, 0, pixels)
        column = int(0.62 * level.shape[1])
        last = -1e9
        for i in np.flatnonzero(edge[:, column])[::-1].tolist():
            if abs(i - last) > 2.5 * size and clear[i, column] > 0.03:
                text = f"{edge[i, column] * self._step:g} m"
                canvas.text((column, i), text, INK, 0.85 * size, anchor=(0.5, 0.5))
                last = i


def write_film(film: Film, out: Path, progress: Progress) -> int:
    """Write a film, and return the number of its frames.

    A `.png` has the first frame alone. After KeyboardInterrupt the file has the frames so far, or
    there is none. Raises InputInvalid if it cannot be written.
    """
    width, height = film.settings.size
    check_target(out, height, width)
    total = 1 if out.suffix.lower() == ".png" else len(film)
    with film_file(out, height, width, film.settings.fps) as file:
        for k in range(total):
            progress("filming", k, total)
            file.add(film.frame(k))
    return total
