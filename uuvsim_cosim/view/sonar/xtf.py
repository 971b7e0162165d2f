"""Pings of a side-scan sonar in the eXtended Triton Format (XTF), by pyxtf.

Samples are whole numbers of 16 bits, proportional to the magnitude. Those of the port side begin
with the farthest one, those of the starboard side with the nearest one, as the format demands, so
that both sides side by side are an image. Its speed of sound is half of that of the water, which
turns a time into a range. Positions are metres east and north of the local frame's origin.
"""

from __future__ import annotations

import warnings
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.sonar.scans import SonarScans

__all__ = ["read_xtf", "xtf"]

_COUNTS = 65_535
_INTEGER = 3  # SampleFormat: 2-byte integer
_METRES = 0  # NavUnits
_SAMPLES = ((b"port", -90.0), (b"starboard", 90.0))


def xtf(scans: SonarScans) -> tuple[bytes, float]:
    """Return a file's bytes, and the magnitude [Pa] of one count of a sample.

    Raises `InputInvalid` without pyxtf, and for a sonar that is no side-scan.
    """
    pyxtf = _pyxtf()
    if not scans.is_side_scan:
        raise InputInvalid(
            scans.name, f"XTF of {len(scans.bearings)} beams", "a side-scan sonar: one beam a side"
        )
    count = float(scans.magnitude.max()) / _COUNTS or 1.0
    step = float(np.median(np.diff(scans.ranges))) if len(scans.ranges) > 1 else 0.0
    pings = [_ping(pyxtf, scans, k, count, step) for k in range(len(scans))]
    return b"".join([_file_header(pyxtf, scans, count), *pings]), count


def read_xtf(file: str | Path) -> SonarScans:
    """Read the pings of a side-scan sonar from a file that any program recorded.

    The magnitudes are the samples of the file, whose unit it does not state. Raises `InputInvalid`
    for a file that cannot be read, and for one without a port and a starboard channel.
    """
    pyxtf = _pyxtf()
    wanted = "an XTF file with a port and a starboard channel of a side-scan sonar"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # packets of other kinds
            head, packets = pyxtf.xtf_read(str(file))
        pings = packets.get(pyxtf.XTFHeaderType.sonar, [])
        kinds = [head.ChanInfo[i].TypeOfChannel for i in range(head.NumberOfSonarChannels)]
        port, starboard = (
            kinds.index(kind.value)
            for kind in (pyxtf.XTFChannelType.port, pyxtf.XTFChannelType.stbd)
        )
        bins = max((len(p.data[port]) for p in pings), default=0)
        whole = [p for p in pings if len(p.data[port]) == len(p.data[starboard]) == bins > 0]
        magnitude = [[p.data[port][::-1], p.data[starboard]] for p in whole]
        far = float(whole[0].ping_chan_headers[starboard].SlantRange)
        begin = whole[0].get_time()
    except (OSError, RuntimeError, NotImplementedError, ValueError, IndexError) as error:
        raise InputInvalid(file, f"{error or type(error).__name__}", wanted) from None
    seconds = np.array([(p.get_time() - begin) / np.timedelta64(1, "s") for p in whole])
    # Hundredths of a second are too coarse for some rates: equal times are spread.
    seconds = np.maximum.accumulate(seconds) + 1e-6 * np.arange(len(seconds))
    speed = float(whole[0].SoundVelocity)
    ranges = np.linspace(0.5, bins - 0.5, bins, dtype=np.float64) * (far / bins)
    return SonarScans(
        Path(file).stem, seconds, np.radians([-90.0, 90.0]), ranges,
        np.array(magnitude, np.float32), frequency=1e3 * float(head.ChanInfo[port].Frequency),
        sound_speed=2.0 * speed if speed < 1000.0 else speed, unit="counts",
    )  # fmt: skip


def _pyxtf() -> Any:
    try:
        import pyxtf
    except ImportError:
        raise InputInvalid(
            "XTF", "pyxtf is not installed", "pip install 'uuvsim-cosim[sonar]'"
        ) from None
    return pyxtf


def _file_header(pyxtf: Any, scans: SonarScans, count: float) -> bytes:
    head = pyxtf.XTFFileHeader()
    head.RecordingProgramName = b"uuvsim"
    head.RecordingProgramVersion = b""
    head.SonarName = scans.name.encode("ascii", "replace")[:15]
    head.NoteString = f"1 count = {count:.6g} Pa; time 0 = 1970-01-01".encode()[:63]
    head.NavUnits = _METRES
    head.NumberOfSonarChannels = 2
    for i, (side, tilt) in enumerate(_SAMPLES):
        info = head.ChanInfo[i]
        info.TypeOfChannel = (pyxtf.XTFChannelType.port, pyxtf.XTFChannelType.stbd)[i].value
        info.SubChannelNumber = i
        info.UniPolar = 1
        info.BytesPerSample = 2
        info.SampleFormat = _INTEGER
        info.ChannelName = side
        info.VoltScale = 1.0
        info.Frequency = scans.frequency / 1e3
        info.HorizBeamAngle = tilt
    return bytes(head)


def _ping(pyxtf: Any, scans: SonarScans, k: int, count: float, step: float) -> bytes:
    p = pyxtf.XTFPingHeader()
    when = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=float(scans.time[k]))
    p.Year, p.Month, p.Day = when.year, when.month, when.day
    p.Hour, p.Minute, p.Second = when.hour, when.minute, when.second
    p.HSeconds = when.microsecond // 10_000
    p.JulianDay = when.timetuple().tm_yday
    p.PingNumber = k
    p.SoundVelocity = scans.sound_speed / 2.0
    p.ComputedSoundVelocity = scans.sound_speed
    if scans.eta is not None:
        north, east, down, roll, pitch, yaw = scans.eta[k].tolist()
        p.SensorYcoordinate = p.ShipYcoordinate = north
        p.SensorXcoordinate = p.ShipXcoordinate = east
        p.SensorDepth = down
        p.SensorRoll, p.SensorPitch = np.degrees(roll), np.degrees(pitch)
        p.SensorHeading = p.ShipGyro = np.degrees(yaw) % 360.0
    c = scans.sound_speed or 1500.0
    near = max(float(scans.ranges[0]) - step / 2, 0.0)
    far = float(scans.ranges[-1]) + step / 2
    seconds = np.diff(scans.time).mean() if len(scans) > 1 else 0.0
    p.ping_chan_headers, p.data = [], []
    for i in range(2):
        channel = pyxtf.XTFPingChanHeader()
        channel.ChannelNumber = i
        channel.SlantRange = far
        channel.TimeDelay = 2.0 * near / c
        channel.TimeDuration = 2.0 * (far - near) / c
        channel.SecondsPerPing = seconds
        channel.Frequency = round(scans.frequency / 1e3)
        channel.NumSamples = len(scans.ranges)
        p.ping_chan_headers.append(channel)
        samples = scans.magnitude[k, i, :: 1 if i else -1]
        p.data.append(np.round(samples / count).astype("<u2"))
    p.NumChansToFollow = 2
    p.NumBytesThisRecord = len(p.to_bytes())
    return bytes(p.to_bytes())
