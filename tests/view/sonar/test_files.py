"""Files of sonar images, read back by the libraries that define them."""

from __future__ import annotations

import errno
import io
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Uuvsim
from tests.view.sonar.made import forward_looking, side_scan
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.view.sonar.files import write_scans
from uuvsim_cosim.view.sonar.pictures import levels_of, pictures
from uuvsim_cosim.view.sonar.xtf import read_xtf

pyxtf = pytest.importorskip("pyxtf")
Image = pytest.importorskip("PIL.Image")


def test_the_webp_animation_has_the_picture_and_the_duration_of_each_ping(tmp_path: Path) -> None:
    scans = forward_looking()
    notes = write_scans(scans, tmp_path / "a.webp", size=80)
    assert notes[0] == "rov.sonar: 3 pings of 31 beams and 60 bins"
    assert notes[1] == levels_of(scans).words()
    with Image.open(tmp_path / "a.webp") as film:
        assert film.n_frames == 3
        for k, drawn in enumerate(pictures(scans, "fan", levels_of(scans), 80)):
            film.seek(k)
            assert np.array_equal(np.asarray(film.convert("RGB")), drawn)
            film.load()
            assert film.info["duration"] == 200


def test_the_png_is_the_last_ping(tmp_path: Path) -> None:
    scans = forward_looking()
    write_scans(scans, tmp_path / "a.png", "polar", size=80)
    with Image.open(tmp_path / "a.png") as picture:
        *_, last = pictures(scans, "polar", levels_of(scans), 80)
        assert np.array_equal(np.asarray(picture), last)


def test_the_arrays_come_back_with_their_axes(tmp_path: Path) -> None:
    scans = forward_looking()
    write_scans(scans, tmp_path / "a.npz")
    data = np.load(tmp_path / "a.npz", allow_pickle=False)
    assert np.array_equal(data["magnitude_Pa"], scans.magnitude)
    assert np.array_equal(data["bearings_rad"], scans.bearings)
    assert np.array_equal(data["ranges_m"], scans.ranges)
    assert np.array_equal(data["labels"], scans.labels)
    assert data["shown"].tolist() == ["no echo", "seabed", "mine"]
    assert "pressure_Pa" not in data


def test_the_xtf_file_is_read_back_by_pyxtf(tmp_path: Path) -> None:
    scans = side_scan()
    notes = write_scans(scans, tmp_path / "a.xtf")
    head, packets = pyxtf.xtf_read(str(tmp_path / "a.xtf"))
    pings = packets[pyxtf.XTFHeaderType.sonar]
    assert list(packets) == [pyxtf.XTFHeaderType.sonar]
    assert len(pings) == 20
    assert head.NumberOfSonarChannels == 2
    kinds = [head.ChanInfo[i].TypeOfChannel for i in range(2)]
    assert kinds == [pyxtf.XTFChannelType.port.value, pyxtf.XTFChannelType.stbd.value]
    count = float(scans.magnitude.max()) / 65_535
    assert f"{count:.4g} Pa" in notes[1]
    for k, ping in enumerate(pings):
        port, starboard = ping.data
        assert port[::-1] * count == pytest.approx(scans.magnitude[k, 0], abs=count / 2)
        assert starboard * count == pytest.approx(scans.magnitude[k, 1], abs=count / 2)
    assert pings[4].data[1].argmax() == 30


def test_the_xtf_pings_have_time_place_attitude_and_ranges(tmp_path: Path) -> None:
    write_scans(side_scan(), tmp_path / "a.xtf")
    _, packets = pyxtf.xtf_read(str(tmp_path / "a.xtf"))
    ping = packets[pyxtf.XTFHeaderType.sonar][3]
    assert ping.get_time() == np.datetime64("1970-01-01T00:00:11.500")
    assert (ping.SensorYcoordinate, ping.SensorXcoordinate) == (3.0, 7.0)
    assert ping.SensorDepth == 3.0
    assert ping.SensorHeading == pytest.approx(330.0)
    assert ping.SoundVelocity == 750.0
    channel = ping.ping_chan_headers[1]
    assert (channel.SlantRange, channel.NumSamples, channel.Frequency) == (50.0, 50, 450)
    assert channel.TimeDuration == pytest.approx(2.0 * 50.0 / 1500.0)
    assert channel.TimeDuration * ping.SoundVelocity == pytest.approx(channel.SlantRange)
    assert channel.SecondsPerPing == pytest.approx(0.5)


def test_a_forward_looking_sonar_has_no_xtf(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="XTF of 31 beams; expected a side-scan sonar"):
        write_scans(forward_looking(), tmp_path / "a.xtf")
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_written_is_refused_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RecordingError, match="No such file or directory"):
        write_scans(forward_looking(), tmp_path / "missing" / "a.png")

    def full(path: Path, data: bytes) -> int:
        path.open("wb").close()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(RecordingError, match=r"a\.npz: cannot be written.*free space"):
        write_scans(forward_looking(), tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"'.jsf' was read; expected .png, .webp, .npz, .xtf"):
        write_scans(side_scan(), tmp_path / "a.jsf")


@pytest.mark.parametrize(("ending", "package"), [("xtf", "pyxtf"), ("webp", "PIL")])
def test_a_missing_package_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputInvalid, match=r"not installed; expected pip install .*\[sonar\]"):
        write_scans(side_scan(), tmp_path / f"a.{ending}", "waterfall")


def test_a_webp_of_one_waterfall_is_one_picture(tmp_path: Path) -> None:
    write_scans(side_scan(), tmp_path / "a.webp", "waterfall", size=60)
    with Image.open(io.BytesIO((tmp_path / "a.webp").read_bytes())) as film:
        assert getattr(film, "n_frames", 1) == 1


def test_a_written_xtf_file_is_read_as_the_same_pings(tmp_path: Path) -> None:
    scans = side_scan()
    write_scans(scans, tmp_path / "a.xtf")
    found = read_xtf(tmp_path / "a.xtf")
    count = float(scans.magnitude.max()) / 65_535
    assert found.magnitude * count == pytest.approx(scans.magnitude, abs=count / 2)
    assert found.ranges == pytest.approx(scans.ranges)
    assert found.time == pytest.approx(scans.time - scans.time[0], abs=1e-4)
    assert found.is_side_scan
    assert (found.frequency, found.sound_speed) == (450e3, 1500.0)


def test_a_file_that_is_no_side_scan_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.xtf").write_bytes(b"nothing")
    for name in ("a.xtf", "none.xtf"):
        with pytest.raises(InputInvalid, match="expected an XTF file with a port and a starboard"):
            read_xtf(tmp_path / name)
    write_scans(side_scan(), tmp_path / "b.xtf")
    (tmp_path / "c.xtf").write_bytes((tmp_path / "b.xtf").read_bytes()[:1024])
    with pytest.raises(InputInvalid, match="expected an XTF file"):
        read_xtf(tmp_path / "c.xtf")


def test_a_recorded_xtf_file_becomes_a_waterfall(uuvsim: Uuvsim, tmp_path: Path) -> None:
    write_scans(side_scan(), tmp_path / "b.xtf")
    status, text, err = uuvsim("export", str(tmp_path / "b.xtf"), "-o", str(tmp_path / "b.png"))
    assert (status, err) == (0, "")
    assert "b: 20 pings of 2 beams and 50 bins" in text
