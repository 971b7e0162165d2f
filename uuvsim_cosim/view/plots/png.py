"""Pixels as PNG files, still or animated, which every browser shows.

Portable Network Graphics, third edition (W3C 2025), which holds the animated chunks too.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["animated_png", "png"]

Pixels = NDArray[np.uint8]
SIGNATURE = b"\x89PNG\r\n\x1a\n"
UP = 2  # the filter that writes each row as its difference to the one above


def png(pixels: Pixels) -> bytes:
    """Return a picture (height, width, 3) as a file's bytes."""
    return SIGNATURE + _head(pixels) + _chunk(b"IDAT", _data(pixels)) + _chunk(b"IEND", b"")


def animated_png(frames: Sequence[Pixels], seconds: float) -> bytes:
    """Return pictures of one shape as an animation that repeats; `seconds` each is shown."""
    if not frames:
        raise InputInvalid("animation of no pictures", "at least one")
    height, width, _ = frames[0].shape
    parts = [SIGNATURE, _head(frames[0]), _chunk(b"acTL", struct.pack(">II", len(frames), 0))]
    number = 0
    for i, frame in enumerate(frames):
        if frame.shape != frames[0].shape:
            raise InputInvalid("animation", f"{frame.shape} after {frames[0].shape}", "equal")
        control = struct.pack(
            ">IIIIIHHBB", number, width, height, 0, 0, max(round(1000 * seconds), 1), 1000, 0, 0
        )
        parts.append(_chunk(b"fcTL", control))
        number += 1
        if i == 0:
            parts.append(_chunk(b"IDAT", _data(frame)))
        else:
            parts.append(_chunk(b"fdAT", struct.pack(">I", number) + _data(frame)))
            number += 1
    return b"".join([*parts, _chunk(b"IEND", b"")])


def _head(pixels: Pixels) -> bytes:
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
        raise InputInvalid(f"picture of {pixels.dtype} {pixels.shape}", "uint8 (height, width, 3)")
    height, width, _ = pixels.shape
    return _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))


def _data(pixels: Pixels) -> bytes:
    rows = pixels.reshape(len(pixels), -1)
    above = np.vstack([np.zeros((1, rows.shape[1]), np.uint8), rows[:-1]])
    filtered = np.empty((len(rows), rows.shape[1] + 1), np.uint8)
    filtered[:, 0] = UP
    filtered[:, 1:] = rows - above
    return zlib.compress(filtered.tobytes(), 9)


def _chunk(kind: bytes, data: bytes) -> bytes:
    check = zlib.crc32(kind + data)
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)
