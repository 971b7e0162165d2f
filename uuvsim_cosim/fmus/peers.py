"""The peers of a component in its FMU: a CSV of inputs, and the source of each in its system."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from io import StringIO
from pathlib import Path

__all__ = ["PEERS", "peers_text", "read_peers"]

PEERS = "extra/org.uuvsim.cosim/peers.csv"
_HEAD = ["input", "from"]


def peers_text(peers: Mapping[str, str]) -> str:
    """Write peers as CSV."""
    out = StringIO()
    csv.writer(out, lineterminator="\n").writerows([_HEAD, *peers.items()])
    return out.getvalue()


def read_peers(folder: Path) -> dict[str, str]:
    """Read the peers in an unpacked FMU; empty if it has none, or they have another format."""
    try:
        rows = list(csv.reader(StringIO((folder / PEERS).read_text(encoding="utf-8"))))
    except (OSError, ValueError):
        return {}
    if not rows or rows[0] != _HEAD:
        return {}
    return {row[0]: row[1] for row in rows[1:] if len(row) == 2}
