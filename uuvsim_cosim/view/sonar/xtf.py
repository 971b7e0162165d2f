"""Pings of a side-scan sonar in the eXtended Triton Format (XTF), by pyxtf.

Samples are whole numbers of 16 bits, proportional to the magnitude, in the order in which they
arrive on both sides. Positions are metres east and north of the local frame's origin.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.sonar.scans import SonarScans

__all__ = ["xtf"]

_COUNTS = 65_535
_INTEGER = 3  # SampleFormat: 2-byte integer
_METRES = 0  # NavUnits
_SAMPLES = ((b"port", -90.0), (b"starboard", 90.0))


def xtf(scans: SonarScans) -> tuple[bytes, float]:
    """Return a file's bytes, and the magnitude [Pa] of one count of a sample.

    Raises `InputInvalid` without pyxtf, and for a sonar that is no side-scan.
    """
    try:
        import pyxtf
    except ImportError:
        raise InputInvalid(
            "XTF", "pyxtf is not installed", "pip install 'uuvsim-cosim[sonar]'"
        ) from None
    if not scans.is_side_scan:
        raise InputInvalid(
            scans.name, f"XTF of {len(scans.bearings)} beams", "a side-scan sonar: one beam a side"
        )
    count = float(scans.magnitude.max()) / _COUNTS or 1.0
    step = float(np.median(np.diff(scans.ranges))) if len(scans.ranges) > 1 else 0.0
    pings = [_ping(pyxtf, scans, k, count, step) for k in range(len(scans))]
    return b"".join([_file_header(pyxtf, scans, count), *pings]), count


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
    p.SoundVelocity = p.ComputedSoundVelocity = scans.sound_speed
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
        p.data.append(np.round(scans.magnitude[k, i] / count).astype("<u2"))
    p.NumChansToFollow = 2
    p.NumBytesThisRecord = len(p.to_bytes())
    return bytes(p.to_bytes())
