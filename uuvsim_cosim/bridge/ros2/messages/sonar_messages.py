"""Messages of sonars that hear over time: images by beam and range, and a detection a beam.

They need the facts `@bearings` and `@ranges` of an instrument (facts.py). Their frame ``…_sonar``
is the one that these messages demand: z ahead, between the beams, x up, y to starboard. Pixels are
float32 of the magnitude [Pa], range after range from the nearest on, each with all beams from port
to starboard.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.messages.conversion import ANY, Conversion, Shape, Values

__all__ = ["SONAR_CONVERSIONS"]

Facts = Mapping[str, Array]
_FLOAT32 = 8  # DTYPE_FLOAT32
_BAD = 1  # DETECT_BAD_SONAR
_NEEDS = frozenset({"@bearings", "@beams", "@ranges", "frequency", "sound_speed"})
_BEARING = frozenset({"bearing"})  # of a scanning sonar, whose ping has one beam


def _info(f: Facts) -> dict[str, Array]:
    return {
        "ping_info.frequency": f["frequency"].reshape(1),
        "ping_info.sound_speed": f["sound_speed"].reshape(1),
    }


def _pixels(v: Values, f: Facts) -> dict[str, Array]:
    beams, bins = len(f["@bearings"]), len(f["@ranges"])
    image = np.asarray(v["magnitude"]).reshape(-1, beams, bins).transpose(0, 2, 1)
    data = np.ascontiguousarray(image, "<f4").view(np.uint8)
    return _info(f) | {
        "image.dtype": np.array([_FLOAT32]),
        "image.beam_count": np.array([beams]),
        "image.data": data.reshape(len(image), -1),
    }


def _step(f: Facts) -> float:
    """Return the length of a bin [m]; of a single one, its range."""
    r = f["@ranges"]
    return float(np.median(np.diff(r))) if len(r) > 1 else float(r[0])


def _projected(v: Values, f: Facts) -> dict[str, Array]:
    if "bearing" in v:
        b = np.asarray(v["bearing"]).reshape(-1, 1)
        directions = np.concatenate([np.zeros_like(b), np.sin(b), np.cos(b)], axis=-1)
    else:
        ahead, starboard, down = f["@beams"].T
        directions = np.stack([-down, starboard, ahead], axis=-1).reshape(1, -1)
    return _pixels(v, f) | {
        "beam_directions": directions,
        "ranges": f["@ranges"].reshape(1, -1),
    }


def _angles(v: Values, f: Facts) -> Array:
    """Return the bearings of the beams; the one of a scanning sonar differs from ping to ping."""
    return np.asarray(v["bearing"]).reshape(-1, 1) if "bearing" in v else f["@bearings"][None]


def _raw(v: Values, f: Facts) -> dict[str, Array]:
    """Return an image whose sample i is at the time (sample0 + i) / sample_rate."""
    step, n = _step(f), len(f["@bearings"])
    return _pixels(v, f) | {
        "sample_rate": f["sound_speed"].reshape(1) / (2.0 * step),
        "samples_per_beam": np.array([len(f["@ranges"])]),
        "sample0": np.array([round(float(f["@ranges"][0]) / step)]),
        "tx_delays": np.zeros((1, n)),
        "tx_angles": np.zeros((1, n)),
        "rx_angles": _angles(v, f),
    }


def _detections(v: Values, f: Facts) -> dict[str, Array]:
    """Return the strongest echo of each beam; NaN where there is none above the noise."""
    n, r = len(f["@bearings"]), np.asarray(v["range"], float)
    strongest = np.asarray(v["magnitude"]).reshape(len(r), n, -1).max(axis=2)
    return _info(f) | {
        "flags": np.where(r > 0, 0, _BAD),
        "two_way_travel_times": np.where(r > 0, 2.0 * r / float(f["sound_speed"]), np.nan),
        "tx_delays": np.zeros((1, n)),
        "intensities": np.where(r > 0, strongest, np.nan),
        "tx_angles": np.zeros((1, n)),
        "rx_angles": _angles(v, f),
    }


def _image_shape(f: Facts, *by_beam: str, by_bin: tuple[str, ...] = ()) -> Shape:
    beams, bins = len(f["@bearings"]), len(f["@ranges"])
    lengths = dict.fromkeys(by_beam, beams) | dict.fromkeys(by_bin, bins)
    return Shape(lengths=lengths | {"image.data": 4 * beams * bins})


SONAR_CONVERSIONS = {
    "marine_acoustic_msgs/msg/ProjectedSonarImage": Conversion(
        {"magnitude": ANY, "bearing": 1},
        _projected,
        _BEARING,
        needs=_NEEDS,
        shape=lambda _, f: _image_shape(f, "beam_directions", by_bin=("ranges",)),
    ),
    "marine_acoustic_msgs/msg/RawSonarImage": Conversion(
        {"magnitude": ANY, "bearing": 1},
        _raw,
        _BEARING,
        needs=_NEEDS,
        shape=lambda _, f: _image_shape(f, "tx_delays", "tx_angles", "rx_angles"),
    ),
    "marine_acoustic_msgs/msg/SonarDetections": Conversion(
        {"range": ANY, "magnitude": ANY, "bearing": 1},
        _detections,
        _BEARING,
        needs=_NEEDS,
        shape=lambda _, f: Shape(
            lengths=dict.fromkeys(
                ("flags", "two_way_travel_times", "tx_delays", "intensities", "tx_angles",
                 "rx_angles"),
                len(f["@bearings"]),
            )
        ),
    ),
}  # fmt: skip
