"""Files of films: animated WebP, PNG and MP4, written frame by frame.

A film that is interrupted leaves a complete file of the frames so far, or none. Memory does not
grow with the number of frames.
"""

from __future__ import annotations

import io
import os
import shutil
import struct
import subprocess
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.cache import whole_file, write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.plots.png import png

__all__ = ["ENDINGS", "FilmFile", "check_target", "film_file"]

Pixels = NDArray[np.uint8]
ENDINGS = (".webp", ".mp4", ".png")  # and a folder
MOST_SIDE = {".webp": 16_383}  # pixels
LARGEST = 2**32 - 2**16  # bytes of a RIFF file, whose sizes have 32 bits


class FilmFile:
    """A file that takes frames (rows, columns, 3) of one size."""

    frames = 0

    @abstractmethod
    def add(self, pixels: Pixels) -> None:
        """Write one more frame."""

    def finish(self) -> None:
        """Complete the file after its last frame."""


def check_target(out: Path, rows: int, columns: int) -> None:
    """Refuse a file that cannot be written, before the first frame is computed.

    Raises InputInvalid for another ending, a size that the format does not have, a folder that is
    not empty, and without the program or the package that the format needs.
    """
    ending = out.suffix.lower()
    if ending and ending not in ENDINGS:
        raise InputInvalid(
            out,
            f"ending {out.suffix!r} was read",
            f"{', '.join(ENDINGS)} (one frame), or a name without ending: a folder of .png",
        )
    if not ending and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputInvalid(out, "it exists and is not an empty folder", "a new folder")
    if ending and out.is_dir():
        raise InputInvalid(out, "it is a folder", "the name of a file")
    if ending and not out.parent.is_dir():
        raise InputInvalid(out, "its folder does not exist", "a file in a folder that exists")
    if max(rows, columns) > MOST_SIDE.get(ending, 2**31):
        raise InputInvalid(
            out, f"{columns} x {rows} pixels", f"at most {MOST_SIDE[ending]:,} a side"
        )
    if ending == ".webp":
        _pillow()
    if ending == ".mp4":
        if rows % 2 or columns % 2:
            raise InputInvalid(out, f"{columns} x {rows} pixels", "even numbers: MP4 halves colour")
        if shutil.which("ffmpeg") is None:
            raise InputInvalid(
                out, "there is no ffmpeg on the PATH", "one that is installed, or a file .webp"
            )


@contextmanager
def film_file(out: Path, rows: int, columns: int, fps: float) -> Iterator[FilmFile]:
    """Yield a file to add frames to. After KeyboardInterrupt it is complete, if it has a frame.

    Raises InputInvalid if it cannot be written, for example if the disk is full.
    """
    ending = out.suffix.lower()
    try:
        if not ending:
            out.mkdir(parents=True, exist_ok=True)
            yield _Sequence(out)
            return
        with whole_file(out) as scratch:
            made: FilmFile
            if ending == ".png":
                made = _Still(scratch)
            elif ending == ".webp":
                made = _WebP(scratch, rows, columns, fps)
            else:
                made = _Mp4(scratch, rows, columns, fps)
            try:
                yield made
            except KeyboardInterrupt:
                if not made.frames:
                    raise
                stopped = True
            else:
                stopped = False
            finally:
                made.finish()
        if stopped:
            raise KeyboardInterrupt
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputInvalid(f"{out}: cannot be written ({reason})") from None


@final
class _Still(FilmFile):
    """One picture."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def add(self, pixels: Pixels) -> None:
        self._path.write_bytes(png(pixels))
        self.frames += 1


@final
class _Sequence(FilmFile):
    """A folder of pictures 00001.png, 00002.png, and so on."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def add(self, pixels: Pixels) -> None:
        write_whole(self._folder / f"{self.frames + 1:05d}.png", png(pixels))
        self.frames += 1


@final
class _WebP(FilmFile):
    """An animation that repeats: a RIFF container of pictures that Pillow compresses.

    https://developers.google.com/speed/webp/docs/riff_container
    """

    def __init__(self, path: Path, rows: int, columns: int, fps: float) -> None:
        self._file: BinaryIO = path.open("wb")
        self._size = _three(columns - 1) + _three(rows - 1)
        self._fps = fps
        head = _chunk(b"VP8X", b"\x02\0\0\0" + self._size) + _chunk(b"ANIM", bytes(6))
        self._file.write(b"RIFF\0\0\0\0WEBP" + head)

    def add(self, pixels: Pixels) -> None:
        out = io.BytesIO()
        _pillow().fromarray(pixels).save(out, "WEBP", quality=82, method=4)
        # Times of frames are rounded to milliseconds as a whole, so that errors do not add up.
        begin, end = (round(1000.0 * (self.frames + k) / self._fps) for k in (0, 1))
        about = bytes(6) + self._size + _three(max(end - begin, 1)) + b"\x02"  # without blending
        frame = _chunk(b"ANMF", about + out.getvalue()[12:])
        if self._file.tell() + len(frame) > LARGEST:
            raise InputInvalid(
                "film", f"more than 4 GiB after {self.frames} frames", "a smaller film, or .mp4"
            )
        self._file.write(frame)
        self.frames += 1

    def finish(self) -> None:
        with self._file as file:
            size = file.tell() - 8
            file.seek(4)
            file.write(struct.pack("<I", size))


@final
class _Mp4(FilmFile):
    """H.264 by the program ffmpeg, which gets raw frames."""

    def __init__(self, path: Path, rows: int, columns: int, fps: float) -> None:
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}", "-r", f"{fps:g}"]
        same = ["-threads", "1", "-map_metadata", "-1", "-fflags", "+bitexact"]
        self._ffmpeg = subprocess.Popen(
            ["ffmpeg", "-y", "-loglevel", "error", *raw, "-i", "-", "-an", "-c:v", "libx264",
             "-pix_fmt", "yuv420p", "-crf", "20", *same, "-flags:v", "+bitexact", "-f", "mp4",
             str(path)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is ours: it completes the file
        )  # fmt: skip

    def add(self, pixels: Pixels) -> None:
        assert self._ffmpeg.stdin is not None
        rest, stopped = memoryview(pixels.tobytes()), False
        while rest:
            try:
                rest = rest[os.write(self._ffmpeg.stdin.fileno(), rest) :]
            except KeyboardInterrupt:  # half a frame would damage the film
                stopped = True
            except OSError:  # it has ended: `finish` reports why
                self.finish()
                raise OSError("ffmpeg ended without a message") from None
        self.frames += 1
        if stopped:
            raise KeyboardInterrupt

    def finish(self) -> None:
        if self._ffmpeg.stdin is None or self._ffmpeg.stdin.closed:
            return
        with suppress(OSError):
            self._ffmpeg.stdin.close()
        assert self._ffmpeg.stderr is not None
        with self._ffmpeg.stderr as errors:
            words = errors.read().decode(errors="replace").strip()
        if self._ffmpeg.wait():
            raise OSError(f"ffmpeg: {words.splitlines()[-1] if words else 'it failed'}")


def _pillow() -> Any:
    try:
        from PIL import Image
    except ImportError:
        raise InputInvalid(
            "WebP", "Pillow is not installed", "pip install 'uuvsim-cosim[sonar]', or .png"
        ) from None
    return Image


def _three(value: int) -> bytes:
    return value.to_bytes(3, "little")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return kind + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2)
