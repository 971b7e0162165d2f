"""PNG files that another library reads to the same pixels, still and animated."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.plots.png import animated_png, png

FRAMES = np.random.default_rng(0).integers(0, 256, (3, 5, 7, 3)).astype(np.uint8)


def test_another_library_reads_the_same_pixels() -> None:
    with Image.open(io.BytesIO(png(FRAMES[0]))) as read:
        assert np.array_equal(np.asarray(read), FRAMES[0])


def test_an_animation_has_all_its_pictures_at_their_pace() -> None:
    with Image.open(io.BytesIO(animated_png(list(FRAMES), 0.4))) as read:
        assert read.n_frames == 3
        for k in range(3):
            read.seek(k)
            assert read.info["duration"] == pytest.approx(400)
            assert np.array_equal(np.asarray(read.convert("RGB")), FRAMES[k])


def test_what_is_no_picture_is_refused() -> None:
    with pytest.raises(InputInvalid, match="expected uint8"):
        png(np.zeros((4, 4), np.uint8))
    with pytest.raises(InputInvalid, match="expected at least one"):
        animated_png([], 1.0)
    with pytest.raises(InputInvalid, match="expected equal"):
        animated_png([FRAMES[0], FRAMES[1][:3]], 1.0)
