"""Files of sonar images: PNG and animated WebP for people, NumPy's arrays and XTF for programs."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.view.plots.png import png
from uuvsim_cosim.view.sonar.pictures import SIZE, levels_of, pictures
from uuvsim_cosim.view.sonar.scans import SonarScans
from uuvsim_cosim.view.sonar.xtf import xtf

__all__ = ["ENDINGS", "webp", "write_scans"]

Pixels = NDArray[np.uint8]
ENDINGS = (".png", ".webp", ".npz", ".xtf")
_LONGEST = 60_000  # ms that a picture of an animation is shown


def write_scans(
    scans: SonarScans, out: Path, kind: str = "fan", span: float = 60.0, size: int = SIZE
) -> list[str]:
    """Write recorded pings; return what the file has, as sentences for the user.

    ``.png``: a picture of the last ping. ``.webp``: a picture of each ping, as an animation in the
    time of the recording. ``.npz``: the arrays with their axes. ``.xtf``: a side-scan sonar's
    pings. `kind`, `span` [dB] and `size` [px] are those of `pictures`. Raises `InputInvalid` for
    another ending, and without the package that an ending needs; `RecordingError` if the file
    cannot be written.
    """
    ending = out.suffix.lower()
    if ending not in ENDINGS:
        raise InputInvalid(out, f"ending {out.suffix!r} was read", ", ".join(ENDINGS))
    n, beams, bins = scans.magnitude.shape
    notes = [f"{scans.name}: {n} pings of {beams} beams and {bins} bins"]
    if ending == ".npz":
        data = _arrays(scans)
    elif ending == ".xtf":
        data, count = xtf(scans)
        notes.append(f"one count of a sample is {count:.4g} Pa; time 0 is 1970-01-01")
    else:
        levels = levels_of(scans, span)
        if kind != "labels":
            notes.append(levels.words(scans.unit))
        shown = scans if ending == ".webp" or kind == "waterfall" else scans.at(scans.time[-1])
        drawn = pictures(shown, kind, levels, size)
        data = png(next(drawn)) if ending == ".png" else webp(drawn, _durations(shown, kind))
    try:
        with whole_file(out) as fresh:
            fresh.write_bytes(data)
    except OSError as error:
        raise RecordingError(
            out, f"cannot be written ({error.strerror or error})", "a folder with free space"
        ) from error
    return notes


def webp(frames: Iterator[Pixels], durations: list[int]) -> bytes:
    """Return pictures (height, width, 3) as a lossless WebP animation that repeats.

    `durations` are milliseconds of each. Raises `InputInvalid` without Pillow.
    """
    try:
        from PIL import Image
    except ImportError:
        raise InputInvalid(
            "WebP", "Pillow is not installed", "pip install 'uuvsim-cosim[sonar]', or .png"
        ) from None
    first, *rest = (Image.fromarray(frame) for frame in frames)
    out = io.BytesIO()
    first.save(
        out, "WEBP", save_all=True, append_images=rest, duration=durations, loop=0, lossless=True
    )
    return out.getvalue()


def _durations(scans: SonarScans, kind: str) -> list[int]:
    if kind == "waterfall" or len(scans) == 1:
        return [1000]
    steps = np.diff(scans.time)
    each = np.round(1e3 * np.append(steps, np.median(steps)))
    return [int(ms) for ms in np.clip(each, 1, _LONGEST)]


def _arrays(scans: SonarScans) -> bytes:
    """Return a compressed .npz; each name has its unit."""
    parts = {
        "time_s": scans.time,
        "bearings_rad": scans.bearings,
        "ranges_m": scans.ranges,
        "magnitude_Pa": scans.magnitude,
        "pressure_Pa": scans.pressure,
        "detections_m": scans.detections,
        "labels": scans.labels,
        "shown": np.array(scans.shown),
        "eta_m_rad": scans.eta,
        "frequency_Hz": np.array(scans.frequency),
        "sound_speed_m_s": np.array(scans.sound_speed),
    }
    out = io.BytesIO()
    known = {name: np.asarray(values) for name, values in parts.items() if values is not None}
    np.savez_compressed(out, allow_pickle=False, **known)
    return out.getvalue()
