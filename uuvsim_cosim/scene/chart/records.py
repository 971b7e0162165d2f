"""Checks that an S-57 file is complete: some damaged files make GDAL end the process."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid

__all__ = ["check_records"]

_COORDINATES = (b"SG2D", b"SG3D")
_DSSI = struct.Struct("<3B8I")
_KINDS = {"FRID": "feature", "VRID": "spatial"}


def check_records(file: Path) -> int:
    """Check the ISO 8211 records up to the end of the file and return their number.

    The numbers of feature and spatial records are compared with those that the file states in its
    field DSSI (S-57 part 3, 7.3.1.2), so that a file cut between two records is found. Raises
    `InputInvalid` with the place of the first record that is damaged, or with the numbers.
    """
    data = file.read_bytes()
    at, number = 0, 0
    records: Counter[str] = Counter()
    stated: dict[str, int] = {}
    while at < len(data):
        leader = data[at : at + 24]
        if not leader.strip(b"\0 \r\n\x1a"):  # padding at the end
            break
        number += 1
        try:
            if len(leader) < 24:
                raise ValueError("its leader is cut")
            length, base = int(leader[:5]), int(leader[12:17])
            if length == 0:  # longer than five digits can say: GDAL finds its end
                return number
            if at + length > len(data):
                raise ValueError(f"it ends {at + length - len(data):,} bytes behind the file")
            if not 24 < base <= length:
                raise ValueError(f"its data begin at {base} of {length} bytes")
            if number > 1:  # the first describes the others
                for tag, field in _fields(data[at : at + length], leader, base):
                    records[tag] += 1
                    if tag == "DSSI":
                        stated = _stated(field)
        except ValueError as reason:
            what = str(reason) if str(reason).startswith("it") else "its leader is no leader"
            raise InputInvalid(
                f"{file}: damaged at byte {at:,}, record {number}: {what}; fetch it again"
            ) from None
        at += length
    for kind, expected in stated.items():
        if records[kind] < expected:
            raise InputInvalid(
                f"{file}: incomplete: its DSSI field states {expected:,} {_KINDS[kind]} records "
                f"and the file has {records[kind]:,}; fetch it again"
            )
    return number


def _stated(field: bytes) -> dict[str, int]:
    """Return the stated numbers of feature and spatial records, by the tag of their first field.

    Some producers count connected nodes as isolated, so only the sums are compared.
    """
    if len(field) < _DSSI.size:
        raise ValueError("its counts are cut")
    counts = _DSSI.unpack_from(field)[3:]  # after three levels of text and structure
    return {"FRID": sum(counts[:4]), "VRID": sum(counts[4:])}


def _fields(record: bytes, leader: bytes, base: int) -> list[tuple[str, bytes]]:
    """Return tag and data of each field of a record; raises ValueError if it is damaged."""
    size_length, size_position, size_tag = (int(leader[k : k + 1]) for k in (20, 21, 23))
    entry = size_tag + size_length + size_position
    if (base - 25) % entry:
        raise ValueError("its directory does not fit")
    found = []
    for k in range(24, base - 1, entry):
        length = int(record[k + size_tag : k + size_tag + size_length])
        position = int(record[k + size_tag + size_length : k + entry])
        if length < 1 or base + position + length > len(record):
            raise ValueError("its fields reach beyond it")
        if length == 1 and record[k : k + size_tag] in _COORDINATES:
            raise ValueError("it has no coordinates")
        start = base + position
        found.append((record[k : k + size_tag].decode("latin-1"), record[start : start + length]))
    return found
