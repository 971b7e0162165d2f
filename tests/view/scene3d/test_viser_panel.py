"""The camera of the live page follows a hull, and begins anew after a gap."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np

from uuvsim_cosim.view.scene3d.viser_panel import Panel


def test_a_camera_moves_with_a_hull_and_is_placed_anew_after_a_gap() -> None:
    camera = SimpleNamespace(position=np.zeros(3), look_at=np.zeros(3))
    client = SimpleNamespace(camera=camera, atomic=nullcontext)
    panel: Any = object.__new__(Panel)
    panel.server = SimpleNamespace(get_clients=lambda: {0: client})
    panel.follow = SimpleNamespace(value="hull")
    panel._followed = None
    panel._size = lambda _: 1.0
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
