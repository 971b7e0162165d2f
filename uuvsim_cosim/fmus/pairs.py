"""Pairs of texts about a component in its FMU: CSV files of two columns.

`PEERS` are inputs, and the source of each in its system. `MADE_FOR` are the vehicles whose figures
the component has: a row ``figures,bluerov2_heavy@von_benzon_2022`` names vehicle and parameter set.
The hull has a row ``hull``, and the gains of a preset have one of their own.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from io import StringIO
from pathlib import Path

__all__ = ["MADE_FOR", "PEERS", "pairs_text", "read_pairs"]

PEERS = "extra/org.uuvsim.cosim/peers.csv"
MADE_FOR = "extra/org.uuvsim.cosim/made_for.csv"
_HEADS = {PEERS: ["input", "from"], MADE_FOR: ["what", "vehicle"]}


def pairs_text(file: str, pairs: Mapping[str, str]) -> str:
    """Write the pairs of a `file` as CSV."""
    out = StringIO()
    csv.writer(out, lineterminator="\n").writerows([_HEADS[file], *pairs.items()])
    return out.getvalue()


def read_pairs(file: str, folder: Path) -> dict[str, str]:
    """Read a `file` of an unpacked FMU; empty if there is none, or it has another format."""
    try:
        rows = list(csv.reader(StringIO((folder / file).read_text(encoding="utf-8"))))
    except (OSError, ValueError):
        return {}
    if not rows or rows[0] != _HEADS[file]:
        return {}
    return {row[0]: row[1] for row in rows[1:] if len(row) == 2}
