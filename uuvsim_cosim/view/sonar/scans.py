"""Images of a sonar by ping, beam and range bin, with their axes in radians and metres."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["SonarScans"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SonarScans:
    """Pings of one sonar: n images of `beams` by `bins`, and where each was taken.

    Bearings are about the z axis of the instrument, from its x axis (ahead) towards y (starboard).
    Raises `InputInvalid` for shapes that do not fit, axes that do not rise, and no ping.
    """

    name: str  # path of the component
    time: Array  # (n,) s, of each ping
    bearings: Array  # (beams,) rad, rising
    ranges: Array  # (bins,) m, middle of each bin, rising
    magnitude: NDArray[np.float32]  # (n, beams, bins) in `unit`, with the time-varying gain
    pressure: NDArray[np.complex64] | None = None  # (n, beams, bins) Pa, where it was recorded
    detections: Array | None = None  # (n, beams) m, range of the strongest echo; 0: none
    labels: NDArray[np.uint16] | None = None  # (n, beams, bins), index into `shown`
    shown: tuple[str, ...] = ()  # what a label stands for
    eta: Array | None = None  # (n, 6) pose of the hull at each ping
    frequency: float = 0.0  # Hz; 0: not known
    sound_speed: float = 0.0  # m/s; 0: not known
    downward: bool = False  # whether the fan looks down, as that of a multibeam
    unit: str = "Pa"  # of the magnitude; counts where a file states none

    def __post_init__(self) -> None:
        n, beams, bins = len(self.time), len(self.bearings), len(self.ranges)
        if not (n and beams and bins):
            raise InputInvalid(
                self.name, f"{n} pings of {beams} beams and {bins} bins", "1 or more of each"
            )
        image = (n, beams, bins)
        shapes = {
            "magnitude": image, "pressure": image, "labels": image, "detections": (n, beams),
            "eta": (n, 6),
        }  # fmt: skip
        for part, expected in shapes.items():
            values = getattr(self, part)
            if values is not None and values.shape != expected:
                raise InputInvalid(f"{self.name}: {part}", f"shape {values.shape}", str(expected))
        for part, unit in (("time", "s"), ("bearings", "rad"), ("ranges", "m")):
            values = getattr(self, part)
            if not (np.isfinite(values).all() and (np.diff(values) > 0).all()):
                raise InputInvalid(f"{self.name}: {part} [{unit}]", "it does not rise", "rising")
        if self.ranges[0] < 0:
            raise InputInvalid(f"{self.name}: range {self.ranges[0]:g} m", "0 or more")

    def __len__(self) -> int:
        """Return the number of pings."""
        return len(self.time)

    @property
    def is_side_scan(self) -> bool:
        """Return whether there is one beam to port and one to starboard."""
        return len(self.bearings) == 2 and self.bearings[0] < 0 < self.bearings[1]

    def at(self, time: float) -> SonarScans:
        """Return the last ping at or before a time [s]; raises `InputInvalid` before the first."""
        if not time >= self.time[0]:
            raise InputInvalid(
                self.name, f"no ping at or before {time:g} s", f"{self.time[0]:g} s or later"
            )
        k = int(np.searchsorted(self.time, time, side="right")) - 1
        return self.between(k, k + 1)

    def between(self, first: int, end: int) -> SonarScans:
        """Return the pings from number `first` to the one before `end`."""
        parts = ("time", "magnitude", "pressure", "detections", "labels", "eta")
        picked = {p: v[first:end] for p in parts if (v := getattr(self, p)) is not None}
        return replace(self, **picked)
