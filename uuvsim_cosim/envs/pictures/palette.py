"""The colours of pictures, which colour-blind viewers can distinguish too."""

from __future__ import annotations

__all__ = ["HULLS", "INK", "LINE", "MUTED", "PAGE"]

PAGE, CARD = "#f4f6f9", "#ffffff"
INK, MUTED = "#13202f", "#5d6b7c"
LINE, GRID = "#d8dfe8", "#e6ecf3"
WATER, SHALLOW, DEEP, FLOOR = "#f7fafc", "#eaf3fa", "#bcd3e6", "#b3a58f"
WALL, STONE, STONE_RIM = "#7d8a9a", "#c3ccd6", "#8592a1"
PATH, GOAL, TARGET, FLOW = "#7d8a9a", "#12907f", "#c2334d", "#4f8fc4"
HULLS = ("#1268b3", "#e2622a", "#8257c5", "#b8860b", "#12907f", "#5d6b7c", "#c45a9a", "#3b9cc9")
