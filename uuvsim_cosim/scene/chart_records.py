"""Whether an S-57 file is whole: GDAL ends the process over some that are not."""

from __future__ import annotations

from pathlib import Path

from uuvsim_cosim.errors import InputInvalid

__all__ = ["check_records"]

_COORDINATES = (b"SG2D", b"SG3D")


def check_records(file: Path) -> int:
    """Walk through the ISO 8211 records to the end of the file; gives their number.

    Raises `InputInvalid` with the place of the first that does not hold together.
    """
    data = file.read_bytes()
    at, number = 0, 0
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
                break
            if at + length > len(data):
                raise ValueError(f"it ends {at + length - len(data):,} bytes behind the file")
            if not 24 < base <= length:
                raise ValueError(f"its data begin at {base} of {length} bytes")
            if number > 1:  # the first describes the others
                _check_fields(data[at : at + length], leader, base)
        except ValueError as reason:
            said = str(reason) if str(reason).startswith("it") else "its leader is no leader"
            raise InputInvalid(
                f"{file}: damaged at byte {at:,}, record {number}: {said}; fetch it again"
            ) from None
        at += length
    return number


def _check_fields(record: bytes, leader: bytes, base: int) -> None:
    size_length, size_position, size_tag = (int(leader[k : k + 1]) for k in (20, 21, 23))
    entry = size_tag + size_length + size_position
    if (base - 25) % entry:
        raise ValueError("its directory does not fit")
    for k in range(24, base - 1, entry):
        length = int(record[k + size_tag : k + size_tag + size_length])
        position = int(record[k + size_tag + size_length : k + entry])
        if length < 1 or base + position + length > len(record):
            raise ValueError("its fields reach beyond it")
        if length == 1 and record[k : k + size_tag] in _COORDINATES:
            raise ValueError("it has no coordinates")
