"""Pictures of sonar images: places in metres, brightness in decibels, labels, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from tests.view.sonar.made import forward_looking, side_scan, without
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.sonar.pictures import (
    Levels,
    cartesian,
    label_colours,
    levels_of,
    pictures,
    polar,
    waterfall,
)


def test_brightness_is_decibels_below_one_reference() -> None:
    levels = Levels(2.0, span=40.0)
    magnitude = np.array([2.0, 0.2, 0.02, 0.002, 0.0, 50.0], np.float32)
    assert levels.shares(magnitude) == pytest.approx([1.0, 0.5, 0.0, 0.0, 0.0, 1.0], abs=1e-6)
    assert levels.words() == "white: 126 dB re 1 uPa with gain, black: 40 dB below"


def test_a_file_without_a_unit_has_levels_in_counts() -> None:
    assert Levels(2.0).words("counts") == "white: 2 counts, black: 60 dB below"


def test_all_pings_of_a_recording_have_the_same_scale() -> None:
    scans = forward_looking()
    loud = replace(scans, magnitude=scans.magnitude * np.array([1, 1, 8], "f4")[:, None, None])
    levels = levels_of(loud)
    first, *_, last = (levels.shares(m) for m in loud.magnitude)
    assert last.mean() - first.mean() == pytest.approx(20 * np.log10(8) / 60, abs=0.02)


def test_silence_has_a_scale_too() -> None:
    scans = replace(forward_looking(), magnitude=np.zeros((3, 31, 60), np.float32))
    assert levels_of(scans).shares(scans.magnitude).max() == 0.0


def test_the_fan_has_the_object_where_it_is_in_metres() -> None:
    scans = forward_looking()
    image, inside, across, up = cartesian(
        scans.magnitude[0], scans.bearings, scans.ranges, size=400
    )
    rows, columns = np.nonzero((image == 10.0) & inside)
    height, width = image.shape
    east = across[0] + (columns.mean() + 0.5) / width * (across[1] - across[0])
    ahead = up[1] - (rows.mean() + 0.5) / height * (up[1] - up[0])
    assert (east, ahead) == pytest.approx(
        (12.0 * np.sin(np.radians(15.0)), 12.0 * np.cos(np.radians(15.0))), abs=0.15
    )


def test_the_fan_covers_the_area_of_its_beams() -> None:
    scans = forward_looking()
    _, inside, across, up = cartesian(scans.magnitude[0], scans.bearings, scans.ranges, size=500)
    pixel = (across[1] - across[0]) * (up[1] - up[0]) / inside.size
    sector = 0.5 * np.radians(93.0) * (30.75**2 - 0.75**2)
    assert inside.sum() * pixel == pytest.approx(sector, rel=0.01)


def test_starboard_is_to_the_right_and_far_is_above() -> None:
    image = np.zeros((3, 4))
    image[2, 3] = 1.0
    fan, inside, *_ = cartesian(image, np.radians([-40.0, 0.0, 40.0]), np.arange(1.0, 5.0), 100)
    rows, columns = np.nonzero((fan == 1.0) & inside)
    assert columns.mean() > 60
    assert rows.mean() < fan.shape[0] / 2
    assert polar(image)[0, 2] == 1.0


def test_a_label_keeps_its_number_in_the_fan() -> None:
    scans = forward_looking()
    assert scans.labels is not None
    fan, *_ = cartesian(scans.labels[0], scans.bearings, scans.ranges, 300)
    assert set(np.unique(fan)) == {0, 1, 2}


def test_labels_of_different_things_have_different_colours() -> None:
    colours = label_colours(np.arange(10))
    assert len({tuple(c) for c in colours.tolist()}) == 10
    assert np.array_equal(label_colours(np.array(2)), label_colours(np.array(10)))


def test_the_waterfall_has_the_newest_ping_first_and_port_to_the_left() -> None:
    scans = side_scan()
    rows, slant = waterfall(scans, scans.magnitude)
    assert rows.shape == (20, 100)
    [[row, column]] = np.argwhere(rows == 20.0)
    assert row == 19 - 4
    assert slant[column] == scans.ranges[30]
    assert np.all(np.diff(slant) > 0)
    assert rows[0, 0] == scans.magnitude[-1, 0, -1]


def test_an_object_of_one_pixel_survives_a_smaller_picture() -> None:
    quiet = np.full((1, 31, 6000), 1e-6, np.float32)
    quiet[0, 15, 4321] = 1.0
    scans = replace(
        without(forward_looking(n=1), "labels", "detections"),
        magnitude=quiet, ranges=np.linspace(1.0, 50.0, 6000),
    )  # fmt: skip
    [picture] = pictures(scans, "polar", Levels(1.0), size=100)
    assert (picture[14:-38, 58:-22].min(axis=-1) > 200).any()


@pytest.mark.parametrize("kind", ["fan", "polar", "labels"])
def test_each_ping_has_a_picture_of_the_same_size(kind: str) -> None:
    drawn = list(pictures(forward_looking(), kind, size=120))
    assert len(drawn) == 3
    assert len({p.shape for p in drawn}) == 1
    assert drawn[0].dtype == np.uint8
    assert not np.array_equal(drawn[0], drawn[1])


def test_pictures_of_the_same_pings_are_equal() -> None:
    a, b = (next(pictures(forward_looking(), "fan", size=90)) for _ in range(2))
    assert np.array_equal(a, b)


@pytest.mark.parametrize(
    ("scans", "kind", "size", "expected"),
    [
        (forward_looking(), "sonogram", 100, "one of fan, polar, labels, waterfall"),
        (forward_looking(), "waterfall", 100, "side-scan sonar: one beam to port"),
        (without(forward_looking(), "labels"), "labels", 100, "labels=true"),
        (forward_looking(), "fan", 100_000, "expected 16 to 8000 pixels"),
        (forward_looking(), "fan", 0, "expected 16 to 8000 pixels"),
    ],
)
def test_a_picture_that_cannot_be_is_refused(
    scans: object, kind: str, size: int, expected: str
) -> None:
    with pytest.raises(InputInvalid, match=expected):
        list(pictures(scans, kind, size=size))  # type: ignore[arg-type]


def test_levels_that_are_no_levels_are_refused() -> None:
    for reference, span in ((0.0, 60.0), (1.0, -3.0), (np.inf, 60.0), (np.nan, 60.0)):
        with pytest.raises(InputInvalid, match="numbers above 0"):
            Levels(reference, span)
