"""Panels over time: what is drawn of a band."""

from __future__ import annotations

import re

import numpy as np
import pytest

from uuvsim_cosim.view.plots.plots import Band, Frame, Line, TimePanel


def test_a_band_is_an_area_between_its_limits_inside_the_axis() -> None:
    time = np.linspace(0.0, 1.0, 11)
    value, frame = np.zeros(11), Frame()
    band = Band("95 %", value - 1.0, value + 1.0)
    drawn = TimePanel("error", "m", (Line("e", value, "truth"),), (band,)).draw(time, frame)
    (area,) = re.findall(r'<path class="band" d="M([^"]*)Z"/>', drawn)
    y = [float(point.split()[1]) for point in area.split("L")]
    assert len(y) == 22
    assert np.mean(y) == pytest.approx(0.5 * (frame.top + frame.height - frame.bottom), abs=0.1)
    assert max(y) > max(y[:11]) == min(y[:11]) >= frame.top  # the upper limit comes first
