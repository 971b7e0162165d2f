"""Axes of a sonar's image, from the source by which a system names the sonar."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import signature
from urllib.parse import parse_qsl

from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.sensors.imaging_sonar import SONAR, sonar_of
from uuvsim_cosim.models.worlds.sonar_geometry import SonarGeometry

__all__ = ["IMAGING", "options_of", "sonar_axes"]

IMAGING = {"imaging_sonar": SONAR}  # component: preset where none is named
_GEOMETRY = frozenset(signature(sonar_of).parameters) - {"p"}
_BEAMS, _BINS = "16", "24"  # of the component, where its source states none


def options_of(source: str) -> tuple[str, str, Mapping[str, str]]:
    """Return the component's name, its preset ("" where none is named) and its options."""
    name, _, query = source.removeprefix("model:").partition("?")
    name, _, own = name.partition("@")
    options = dict(parse_qsl(query))
    return name, own or options.pop("id", ""), options


def sonar_axes(source: str) -> SonarGeometry | None:
    """Return bearings and ranges of the sonar that a source declares; None for another component.

    Example:

    >>> from uuvsim_cosim.models.sensors.sonar_axes import sonar_axes
    >>> axes = sonar_axes("model:imaging_sonar@p900?beams=5&bins=3")
    >>> axes.bearings.round(2).tolist(), axes.ranges.tolist()
    ([-0.79, -0.39, 0.0, 0.39, 0.79], [11.0, 31.0, 51.0])
    """
    name, own, options = options_of(source)
    if not source.startswith("model:") or name not in IMAGING:
        return None
    given = {"beams": _BEAMS, "bins": _BINS} | {k: v for k, v in options.items() if k in _GEOMETRY}
    return sonar_of(preset("sensors", own or IMAGING[name], name), **given)
