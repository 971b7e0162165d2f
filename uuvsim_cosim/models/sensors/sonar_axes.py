"""Axes of a sonar's image, from the source by which a system names the sonar."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import signature
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.sensors.imaging_sonar import imaging_sonar, multibeam_sonar
from uuvsim_cosim.models.sensors.scanning_sonar import scanning_sonar, side_scan_sonar
from uuvsim_cosim.models.sensors.sonar_component import sonar_of

__all__ = ["SonarAxes", "options_of", "sonar_axes"]

Array = NDArray[np.float64]

_DECLARED = {
    f.__name__: f for f in (imaging_sonar, multibeam_sonar, scanning_sonar, side_scan_sonar)
}
_GEOMETRY = frozenset(signature(sonar_of).parameters) - {"p"}


@dataclass(frozen=True, eq=False)
class SonarAxes:
    """Axes of an image, about z of the instrument, from its x towards its y (starboard).

    A scanning sonar has one beam in a ping, and the bearings of a whole scan.
    """

    kind: str  # name of the component
    bearings: Array  # (beams,) rad
    ranges: Array  # (bins,) m, middle of each bin
    beams: Array  # (beams, 3) unit vectors in the instrument's axes
    scene: str  # option of the component

    @property
    def scans(self) -> bool:
        """Return whether an image is made of many pings, each with one beam."""
        return self.kind == "scanning_sonar"


def options_of(source: str) -> tuple[str, Mapping[str, str]]:
    """Return a component's name and its options, with the preset as `id` if it is named."""
    name, _, query = source.removeprefix("model:").partition("?")
    name, _, own = name.partition("@")
    return name, ({"id": own} if own else {}) | dict(parse_qsl(query))


def sonar_axes(source: str) -> SonarAxes | None:
    """Return the axes of the sonar that a source declares; None for another component.

    Example:

    >>> from uuvsim_cosim.models.sensors.sonar_axes import sonar_axes
    >>> axes = sonar_axes("model:imaging_sonar@p900?beams=5&bins=3")
    >>> axes.bearings.round(2).tolist(), axes.ranges.tolist()
    ([-0.79, -0.39, 0.0, 0.39, 0.79], [11.0, 31.0, 51.0])
    """
    name, options = options_of(source)
    if not source.startswith("model:") or name not in _DECLARED:
        return None
    usual = {k: v.default for k, v in signature(_DECLARED[name]).parameters.items()}
    given = usual | dict(options)
    p = preset("sensors", str(given["id"]), name)
    g = sonar_of(p, **({"beams": 1} | {k: v for k, v in given.items() if k in _GEOMETRY}))
    bearings, down = g.bearings, 0.0
    if name == "side_scan_sonar":
        bearings, down = np.array([-0.5, 0.5]) * np.pi, p.number("depression", "rad")
    elif name == "scanning_sonar":
        step = np.radians(float(given["step"])) or p.number("step", "rad")
        pings = max(1, round(np.radians(float(given["sector"])) / step))
        bearings = (np.arange(pings) + 0.5) * step - 0.5 * pings * step
    level = np.cos(down)
    beams = np.stack(
        [level * np.cos(bearings), level * np.sin(bearings), np.full(len(bearings), np.sin(down))],
        axis=-1,
    )
    return SonarAxes(name, bearings, g.ranges, beams, str(given["scene"]))
