"""Codes of S-57 and their meanings: datums, units, nature of the seabed, confidence.

Source: IHO S-57 edition 3.1, appendix A chapter 2 (attributes) and part 3 (DSPM).
"""

from __future__ import annotations

__all__ = ["NATURES", "UNITS", "VERTICAL_DATUMS", "ZONES_OF_CONFIDENCE"]

VERTICAL_DATUMS = {
    1: "MLWS", 2: "mean lower low water springs", 3: "MSL", 4: "lowest low water", 5: "MLW",
    6: "lowest low water springs", 7: "approximate MLWS", 8: "Indian spring low water",
    9: "low water springs", 10: "approximate LAT", 11: "nearly lowest low water", 12: "MLLW",
    13: "low water", 14: "approximate MLW", 15: "approximate MLLW", 16: "MHW", 17: "MHWS",
    18: "high water", 19: "approximate MSL", 20: "high water springs", 21: "MHHW",
    22: "equinoctial spring low water", 23: "LAT", 24: "local datum", 25: "IGLD 1985",
    26: "mean water level", 27: "lower low water large tide", 28: "higher high water large tide",
    29: "nearly highest high water", 30: "HAT",
}  # fmt: skip

UNITS = {1: ("m", 1.0), 3: ("ft", 0.3048)}
"""DUNI, HUNI: name, and metres in one; 2 and 4 mix fathoms with feet or fractions."""

NATURES = {
    1: "mud", 2: "clay", 3: "silt", 4: "sand", 5: "stone", 6: "gravel", 7: "pebbles", 8: "cobbles",
    9: "rock", 11: "lava", 14: "coral", 17: "shells", 18: "boulder",
}  # fmt: skip

ZONES_OF_CONFIDENCE = {
    1: ("A1", 0.5, 0.01),
    2: ("A2", 1.0, 0.02),
    3: ("B", 1.0, 0.02),
    4: ("C", 2.0, 0.05),
    5: ("D", 4.0, 0.10),
    6: ("U", 4.0, 0.10),
}
"""CATZOC: name, and a, b of the depth accuracy a + b·depth (m, at 95 % confidence).

D ("worse than C") and U ("unassessed") have no figure in S-57: twice C's is assumed.
"""
