"""Pictures of sonars in the panel of the page: the last ping at a time, a waterfall, a scan."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from uuvsim_cosim.models.sensors.sonar_axes import SonarAxes, sonar_axes
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.scene3d.viser_sonar import SonarPictures, _newest, pings_of
from uuvsim_cosim.view.sonar.pictures import Levels, levels_of, pictures


def _axes(source: str) -> SonarAxes:
    axes = sonar_axes(source)
    assert axes is not None
    return axes


def _traces(axes: SonarAxes, pings: int, **more: np.ndarray) -> Traces:
    """Return two rows of each ping, after a row without one."""
    n = 1 if axes.scans else len(axes.bearings)
    images = np.random.default_rng(3).uniform(0.1, 1.0, (pings, n * len(axes.ranges)))
    sample = np.repeat(0.2 * np.arange(pings), 2)
    values = {"sonar.magnitude": np.repeat(images, 2, axis=0), "sonar.t_sample": sample}
    values |= {f"sonar.{name}": np.repeat(value, 2) for name, value in more.items()}
    begun = {k: np.concatenate([0 * v[:1] - (k == "sonar.t_sample"), v]) for k, v in values.items()}
    return Traces(0.1 * np.arange(2 * pings + 1), begun)


def _server() -> Any:
    made: list[Any] = []

    def add_image(image: np.ndarray, **_: object) -> Any:
        made.append(SimpleNamespace(image=image))
        return made[-1]

    return SimpleNamespace(gui=SimpleNamespace(add_image=add_image), made=made)


def test_the_panel_shows_the_last_ping_at_the_time_of_the_replay() -> None:
    axes = _axes("model:imaging_sonar@p900?beams=9&bins=12")
    traces, server = _traces(axes, 5), _server()
    panel = SonarPictures(server, {"sonar": axes})
    pings = pings_of("sonar", axes, traces)
    assert pings is not None
    white = Levels(levels_of(pings).reference)
    expected = list(pictures(pings, "fan", white, 260))
    for t, k in ((0.5, 2), (0.1, 0), (9.0, 4)):
        panel.show(traces, t)
        assert np.array_equal(server.made[0].image, expected[k])
    panel.show(traces)
    assert len(server.made) == 1


def test_there_is_no_picture_before_the_first_ping_and_without_a_recorded_image() -> None:
    axes = _axes("model:imaging_sonar@p900?beams=9&bins=12")
    traces, server = _traces(axes, 2), _server()
    panel = SonarPictures(server, {"sonar": axes})
    first = Traces(traces.time[:1], {k: v[:1] for k, v in traces.values.items()})
    panel.show(first)
    panel.show(Traces(traces.time, {"sonar.t_sample": traces.values["sonar.t_sample"]}))
    assert not server.made


def test_a_side_scan_sonar_has_a_waterfall_of_the_pings_so_far() -> None:
    axes = _axes("model:side_scan_sonar?bins=12")
    traces = _traces(axes, 6)
    pings = pings_of("sonar", axes, traces)
    assert pings is not None
    assert len(_newest(pings, axes, 4)) == 4
    server = _server()
    SonarPictures(server, {"sonar": axes}).show(traces)
    white = Levels(levels_of(pings).reference)
    assert np.array_equal(server.made[0].image, next(pictures(pings, "waterfall", white, 260)))


def test_a_scan_shows_the_one_before_where_the_head_has_not_come() -> None:
    axes = _axes("model:scanning_sonar?bins=12&sector=40&step=10")
    bearing = np.tile(axes.bearings, 2)[:6]  # one scan of 4 pings, and half of the next
    pings = pings_of("sonar", axes, _traces(axes, 6, bearing=bearing))
    assert pings is not None
    shown = _newest(pings, axes, 6)
    assert np.array_equal(shown.magnitude[0], pings.magnitude[[4, 5, 2, 3], 0])
