"""Sonars that form many beams in a ping: forward-looking, and multibeam with intensity.

The instrument's axes: x between the beams, y along the array, z across the fan. A forward-looking
sonar looks along x, slightly down, with a transmitted beam that is wide along z. A multibeam sonar
looks down, with one that is narrow along the track. Beams run from port to starboard.
"""

from __future__ import annotations

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.sensors.sonar_component import SonarOptions, declare_sonar, sonar_of

__all__ = ["MULTIBEAM", "SONAR", "imaging_sonar", "multibeam_sonar", "sonar_of"]

SONAR, MULTIBEAM = "p900", "norbit_wbms"  # where none is named


def imaging_sonar(
    id: str = SONAR,
    scene: str = "flat",
    period: str = "0.2",
    beams: int | str = 16,
    bins: int | str = 24,
    columns: int | str = 0,
    rays: int | str = 32,
    shading: str = "hann",
    range_max: float | str = 0,
    tvg: int | str = 40,
    complex: bool | str = False,
    labels: bool | str = False,
    seabed: str = "sand",
    solid: str = "steel",
    law: str = "auto",
    absorption: float | str = "francois_garrison",
    others: int | str = 0,
    frequency: float | str = 0,
    water: str = "parameters",
    profile: str = "",
    segments: int | str = 8,
    surface_bounce: float | str = "off",
    bottom_bounce: float | str = "off",
) -> Model:
    """Declare the forward-looking sonar of a preset, which pings every `period` seconds.

    `beams`, `bins` and `range_max` [m] replace the preset's numbers; 0: its own. `columns` times
    `rays` are the rays of a ping; with 0 columns there are four within the width of a beam.
    `shading` of the array is none, hamming or hann. The other options: `SonarOptions`.
    """
    p = preset("sensors", id, "imaging_sonar")
    m = Model("imaging_sonar", "Imaging sonar over a scene")
    g = sonar_of(p, beams, bins, columns, rays, shading, range_max, frequency)
    given = SonarOptions(
        scene, period, tvg, complex, labels, seabed, solid, law, absorption, others, frequency,
        water, profile, segments, surface_bounce, bottom_bounce,
    )  # fmt: skip
    return declare_sonar(m, p, g, given, f"{len(g.bearings)} beams from port to starboard")


def multibeam_sonar(
    id: str = MULTIBEAM,
    scene: str = "flat",
    period: str = "0.2",
    beams: int | str = 16,
    bins: int | str = 24,
    columns: int | str = 0,
    rays: int | str = 8,
    shading: str = "hann",
    range_max: float | str = 0,
    tvg: int | str = 40,
    complex: bool | str = False,
    labels: bool | str = False,
    seabed: str = "sand",
    solid: str = "steel",
    law: str = "auto",
    absorption: float | str = "francois_garrison",
    others: int | str = 0,
    frequency: float | str = 0,
    water: str = "parameters",
    profile: str = "",
    segments: int | str = 8,
    surface_bounce: float | str = "off",
    bottom_bounce: float | str = "off",
) -> Model:
    """Declare the multibeam sonar of a preset: its echoes in the water column, range and level.

    It has the options of `imaging_sonar`. The component `multibeam` has ranges alone, by one ray
    for each beam.
    """
    p = preset("sensors", id, "multibeam_sonar")
    m = Model("multibeam_sonar", "Multibeam sonar with intensity over a scene")
    g = sonar_of(p, beams, bins, columns, rays, shading, range_max, frequency)
    given = SonarOptions(
        scene, period, tvg, complex, labels, seabed, solid, law, absorption, others, frequency,
        water, profile, segments, surface_bounce, bottom_bounce,
    )  # fmt: skip
    return declare_sonar(m, p, g, given, f"{len(g.bearings)} beams from port to starboard")
