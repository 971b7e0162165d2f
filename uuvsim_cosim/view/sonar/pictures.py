"""Pictures of sonar images: by beam and range, as a fan in metres, as a waterfall, and of labels.

Levels are decibels below a reference that is the same for all pings of a recording, so that a ping
is not brighter because its greatest echo is weaker. Zero magnitude is the floor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.pictures.canvas import Canvas
from uuvsim_cosim.envs.pictures.scale import label, nice_step, ticks
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.sonar.scans import SonarScans

__all__ = [
    "KINDS",
    "MOST_PIXELS",
    "Levels",
    "cartesian",
    "label_colours",
    "levels_of",
    "pictures",
    "polar",
    "waterfall",
]

Pixels = NDArray[np.uint8]
Floats = NDArray[np.float64]

KINDS = ("fan", "polar", "labels", "waterfall")
MOST_PIXELS = 64_000_000  # of one picture
SIZE = 600  # pixels of the longer side of an image, without its axes
_EDGES = (58, 22, 14, 38)  # pixels at the left, top, right and bottom of an image
_INK, _PAPER, _BACKGROUND = "#e8e4da", "#14181d", (20, 24, 29)
_SHADES = np.array(  # from the floor to the reference
    [(0, 0, 0), (42, 22, 8), (112, 62, 16), (196, 128, 38), (246, 202, 98), (255, 250, 220)], float
)
_LABELS = np.array(
    [
        (20, 24, 29), (139, 115, 85), (31, 119, 180), (255, 127, 14), (44, 160, 44),
        (214, 39, 40), (148, 103, 189), (227, 119, 194), (188, 189, 34), (23, 190, 207),
    ],
    np.uint8,
)  # fmt: skip


@dataclass(frozen=True)
class Levels:
    """Scale of brightness: `reference` [Pa] is white, `span` [dB] below it is black."""

    reference: float
    span: float = 60.0

    def __post_init__(self) -> None:
        if not (0 < self.reference < np.inf and 0 < self.span < np.inf):
            raise InputInvalid(
                "levels of a picture", f"reference {self.reference:g} Pa, span {self.span:g} dB",
                "numbers above 0",
            )  # fmt: skip

    def shares(self, magnitude: NDArray[np.float32]) -> Floats:
        """Return brightness from 0 to 1."""
        with np.errstate(divide="ignore"):
            below = 20.0 * np.log10(np.asarray(magnitude, float) / self.reference)
        return np.asarray(np.clip(1.0 + below / self.span, 0.0, 1.0))

    def words(self, unit: str = "Pa") -> str:
        """Return the scale in words."""
        if unit != "Pa":
            return f"white: {self.reference:.4g} {unit}, black: {self.span:g} dB below"
        white = 20.0 * np.log10(self.reference / 1e-6)
        return f"white: {white:.0f} dB re 1 uPa with gain, black: {self.span:g} dB below"


def levels_of(scans: SonarScans, span: float = 60.0) -> Levels:
    """Return levels whose white is exceeded by one pixel of a thousand in the recording."""
    heard = scans.magnitude[scans.magnitude > 0]
    if not heard.size:
        return Levels(1.0, span)
    return Levels(float(np.quantile(heard, 0.999)), span)


def pictures(
    scans: SonarScans, kind: str = "fan", levels: Levels | None = None, size: int = SIZE
) -> Iterator[Pixels]:
    """Yield a picture (height, width, 3) with axes of each ping; a waterfall is one picture.

    `size` is the length of the longer side of the image in pixels. Raises `InputInvalid` for a
    kind that the recording does not have, and for a picture beyond `MOST_PIXELS`.
    """
    if kind not in KINDS:
        raise InputInvalid(f"picture {kind!r}", f"one of {', '.join(KINDS)}")
    if not 16 <= size <= MOST_PIXELS**0.5:
        raise InputInvalid(
            "picture", f"{size} pixels a side", f"16 to {MOST_PIXELS**0.5:.0f} pixels"
        )
    if kind == "labels" and scans.labels is None:
        raise InputInvalid(scans.name, "no labels were recorded", "the sonar's option labels=true")
    levels = levels or levels_of(scans)
    if kind == "waterfall":
        yield _drawn_waterfall(scans, levels, size)
        return
    # The pixels of each beam and bin are the same for all pings.
    numbers = np.arange(scans.magnitude[0].size).reshape(scans.magnitude.shape[1:])
    if kind != "polar":
        which, inside, across, up = cartesian(numbers, scans.bearings, scans.ranges, size)
    for k in range(len(scans)):
        title = f"{scans.name}  t = {scans.time[k]:.2f} s"
        if kind == "labels":
            assert scans.labels is not None
            values: NDArray[np.generic] = scans.labels[k]
            colours: Callable[[NDArray[np.generic]], Pixels] = label_colours
        else:
            values, colours = levels.shares(scans.magnitude[k]), _shaded
        if kind == "polar":
            image = _fitted(polar(values), size)
            across, up = _edges(np.degrees(scans.bearings)), _edges(scans.ranges)
            yield _framed(colours(image), across, up, ("bearing [deg]", "range [m]"), title)
        else:
            pixels = colours(values).reshape(-1, 3)[which]
            pixels[~inside] = _BACKGROUND
            names = ("starboard [m]", "down [m]" if scans.downward else "ahead [m]")
            if scans.downward:
                yield _framed(pixels[::-1], across, up[::-1], names, title)
            else:
                yield _framed(pixels, across, up, names, title)


def polar(image: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return an image (beams, bins) as (bins, beams), with the farthest range in the first row."""
    return np.asarray(image.T[::-1])


Extent = tuple[float, float]


def cartesian(
    image: NDArray[np.generic], bearings: Floats, ranges: Floats, size: int = SIZE
) -> tuple[NDArray[np.generic], NDArray[np.bool_], Extent, Extent]:
    """Return an image (beams, bins) over metres, which pixels it covers, and both extents [m].

    Rows run from the farthest point ahead backwards, columns from port to starboard. Each pixel has
    the value of the beam and the bin that are nearest to it, so that labels stay whole numbers.
    """
    (low, high), (near, far) = _edges(bearings), _edges(ranges)
    near = max(near, 0.0)
    angles = np.linspace(low, high, 721)
    x, y = np.outer((near, far), np.sin(angles)), np.outer((near, far), np.cos(angles))
    across, up = (float(x.min()), float(x.max())), (float(y.min()), float(y.max()))
    step = max(across[1] - across[0], up[1] - up[0]) / size
    columns = max(1, round((across[1] - across[0]) / step))
    rows = max(1, round((up[1] - up[0]) / step))
    east = across[0] + (np.arange(columns) + 0.5) * (across[1] - across[0]) / columns
    ahead = up[1] - (np.arange(rows) + 0.5) * (up[1] - up[0]) / rows
    r = np.hypot(ahead[:, None], east[None, :])
    bearing = np.arctan2(east[None, :], ahead[:, None])
    inside = (r >= near) & (r <= far) & (bearing >= low) & (bearing <= high)
    return image[_nearest(bearings, bearing), _nearest(ranges, r)], inside, across, up


def waterfall(scans: SonarScans, image: NDArray[np.generic]) -> tuple[NDArray[np.generic], Floats]:
    """Return the pings (n, 2 bins) of a side-scan sonar, newest first, and the slant ranges [m].

    `image` are values (n, beams, bins). Slant ranges are negative to port. Raises `InputInvalid`
    for a sonar that has not one beam to port and one to starboard.
    """
    if not scans.is_side_scan:
        degrees = ", ".join(f"{b:.0f}" for b in np.degrees(scans.bearings[:3]))
        raise InputInvalid(
            scans.name,
            f"a waterfall of {len(scans.bearings)} beams at {degrees} … deg",
            "a side-scan sonar: one beam to port and one to starboard",
        )
    rows = np.concatenate([image[:, 0, ::-1], image[:, 1]], axis=1)[::-1]
    return rows, np.concatenate([-scans.ranges[::-1], scans.ranges])


def label_colours(labels: NDArray[np.generic]) -> Pixels:
    """Return the colour (…, 3) of each label: 0 is the background, 1 the seabed."""
    k = np.asarray(labels, int)
    return np.asarray(_LABELS[np.where(k < 2, k, 2 + (k - 2) % (len(_LABELS) - 2))])


def _drawn_waterfall(scans: SonarScans, levels: Levels, size: int) -> Pixels:
    rows, _ = waterfall(scans, levels.shares(scans.magnitude))
    far = _edges(scans.ranges)[1]
    across, up = (-far, far), _edges(scans.time)
    title = f"{scans.name}  {len(scans)} pings"
    return _framed(_shaded(_fitted(rows, size)), across, up, ("slant range [m]", "time [s]"), title)


def _edges(axis: Floats) -> Extent:
    """Return both ends of an axis, half a step beyond the middles that it has."""
    half = 0.5 * float(np.median(np.diff(axis))) if len(axis) > 1 else 0.5
    return float(axis[0]) - half, float(axis[-1]) + half


def _nearest(axis: Floats, values: Floats) -> NDArray[np.intp]:
    """Return the index of the element of a rising axis that is nearest to each value."""
    return np.searchsorted(0.5 * (axis[1:] + axis[:-1]), values)


def _shaded(shares: NDArray[np.generic]) -> Pixels:
    at = np.asarray(shares, float) * (len(_SHADES) - 1)
    known = np.arange(len(_SHADES))
    each = [np.interp(at, known, _SHADES[:, i]) for i in range(3)]
    return np.round(np.stack(each, axis=-1)).astype(np.uint8)


def _fitted(image: NDArray[np.generic], size: int) -> NDArray[np.generic]:
    """Return an image whose sides are `size` pixels at most, and repeated up to half of it.

    Where several rows or columns fall on one pixel, the greatest value is shown: a small bright
    object does not vanish.
    """
    for axis in (0, 1):
        n = image.shape[axis]
        if n > size:
            first = np.arange(size) * n // size
            image = np.maximum.reduceat(image, first, axis=axis)
        else:
            image = np.repeat(image, max(1, round(size / n)), axis=axis)
    return image


def _framed(
    image: Pixels, across: Extent, up: Extent, names: tuple[str, str], title: str
) -> Pixels:
    """Return an image with axes; `across` is left and right, `up` is bottom and top."""
    left, top, right, bottom = _EDGES
    height, width, _ = image.shape
    canvas = Canvas(left + width + right, top + height + bottom, _PAPER)
    base = top + height
    for low, high, length, drawn in (
        (*across, width, _at_bottom(canvas, left, base)),
        (*up, height, _at_left(canvas, left, base)),
    ):
        least, most = min(low, high), max(low, high)
        step = nice_step(max((most - least) / max(length / 70.0, 1.0), 1e-6))
        for value in ticks(least, most, step).tolist():
            share = (value - least) / max(most - least, 1e-9)
            drawn((share if low <= high else 1.0 - share) * length, label(value, step))
    canvas.text((left + width / 2, base + 22), names[0], _INK, 11, anchor=(0.5, 0.0))
    canvas.text((4, 6), names[1], _INK, 11)
    canvas.text((left + width, 6), title, _INK, 11, anchor=(1.0, 0.0))
    pixels = canvas.pixels()
    pixels[top:base, left : left + width] = image
    return pixels


def _at_bottom(canvas: Canvas, left: int, base: int) -> Callable[[float, str], None]:
    def drawn(at: float, text: str) -> None:
        canvas.line([[left + at, base], [left + at, base + 4]], _INK)
        canvas.text((left + at, base + 7), text, _INK, 10, anchor=(0.5, 0.0))

    return drawn


def _at_left(canvas: Canvas, left: int, base: int) -> Callable[[float, str], None]:
    def drawn(at: float, text: str) -> None:
        canvas.line([[left - 4, base - at], [left, base - at]], _INK)
        canvas.text((left - 7, base - at), text, _INK, 10, anchor=(1.0, 0.5))

    return drawn
