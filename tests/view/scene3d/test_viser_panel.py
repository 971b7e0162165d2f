"""Panel of the live page: its camera follows a hull, and its plots have one unit each."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ET
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np

from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.scene3d.viser_panel import Panel, plot_markdown


def test_a_camera_moves_with_a_hull_and_is_placed_anew_after_a_gap() -> None:
    camera = SimpleNamespace(position=np.zeros(3), look_at=np.zeros(3))
    client = SimpleNamespace(camera=camera, atomic=nullcontext)
    panel: Any = object.__new__(Panel)
    panel.server = SimpleNamespace(get_clients=lambda: {0: client})
    panel.follow = SimpleNamespace(value="hull")
    panel._followed = None
    panel.sizes = {"hull": 1.0}
    track = np.array([[0.0, 0, 5], [2, 0, 5], [np.nan, 0, 5], [100, 0, 5], [101, 1, 5]])
    motion: Any = SimpleNamespace(positions={"hull": track})
    offsets = []
    for k in range(len(track)):
        panel.move_camera(motion, k)
        offsets.append(camera.position - camera.look_at)
    assert np.array_equal(camera.look_at, track[-1])
    behind = offsets[0]
    assert behind[0] < 0.0
    assert behind[2] < 0.0
    np.testing.assert_array_equal(offsets, [behind] * 5)
    camera.position = camera.position + np.array([0.0, 7.0, 0.0])  # by the viewer's hand
    panel.move_camera(motion, 3)
    assert np.array_equal(camera.position - camera.look_at, behind + np.array([0.0, 7.0, 0.0]))
    panel.move_camera(motion, 2)  # the hull is lost
    panel.move_camera(motion, 4)
    assert np.array_equal(camera.position - camera.look_at, behind)


def test_a_pose_is_plotted_on_one_axis_for_each_unit_with_marked_lines() -> None:
    units = {"hull.eta": ("m",) * 3 + ("rad",) * 3}
    eta = np.random.default_rng(0).standard_normal((50, 6))
    traces = Traces(np.arange(50.0), {"hull.eta": eta}, element_units=units)
    text = plot_markdown(traces, "hull.eta", 25.0)
    assert re.findall(r"\*\*(.*?)\*\*", text) == ["`hull.eta` in `m`", "`hull.eta` in `rad`"]
    pictures = [base64.b64decode(data).decode() for data in re.findall(r"base64,([^)]*)\)", text)]
    for picture, labels in zip(pictures, ("123", "456"), strict=True):
        ET.fromstring(picture)
        assert "".join(re.findall(r">([1-6])</text>", picture)[-3:]) == labels
        assert picture.count('class="marker truth"') > 3
