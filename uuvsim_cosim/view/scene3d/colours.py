"""The colours of a scene, the same in the live view, the report and the exports."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ARROW",
    "BODIES",
    "ESTIMATE",
    "MARKER",
    "PATH",
    "RAY",
    "SOLIDS",
    "TINTS",
    "depth_colours",
    "rgb",
]

BODIES = ("#f2b632", "#35a7c9", "#d8583f", "#7cb356", "#a57fd6", "#e58fb6", "#8d99a8", "#c9a27a")
ARROW, RAY, MARKER = "#ff6b1a", "#7fe3d0", "#e5484d"
PATH, ESTIMATE = "#8d99a8", "#e2622a"
SOLIDS = {"obstacle": "#b98a5e", "basin": "#7fa6bd", "floor": "#b9a888", "surface": "#5fa8cf"}
# From shallow to deep, after the usual hypsometric tints of charts: sand, green, blue.
TINTS = ("#e3d3a4", "#b7cf9b", "#6fb6a4", "#3f8fb0", "#2a6398", "#1d3f73")


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue (0 to 255) of ``#rrggbb``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def depth_colours(z: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return a colour (n, 3) for each depth (n,), from the shallowest to the deepest there is."""
    low, high = (float(np.nanmin(z)), float(np.nanmax(z))) if len(z) else (0.0, 1.0)
    tints = np.array([rgb(c) for c in TINTS], float)
    at = (np.nan_to_num(z, nan=high) - low) / max(high - low, 1e-6) * (len(tints) - 1)
    mixed = [np.interp(at, np.arange(len(tints)), tints[:, i]) for i in range(3)]
    return np.column_stack(mixed).round().astype(np.uint8)
