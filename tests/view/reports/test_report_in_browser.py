"""The report in a browser: zoom, values under the pointer, legends, search, comparison, scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.view.browser import found_in_page
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.reports.run_comparison import comparison_html
from uuvsim_cosim.view.reports.run_report import report_html
from uuvsim_cosim.view.scene3d.scene import Body, Scene3D
from uuvsim_cosim.view.scene3d.scene_of_plan import ANYTHING

TOOLS = """
const click = (selector, within) => (within || document).querySelector(selector).click();
const keys = card => [...card.querySelectorAll('.key')];
const values = card => keys(card).map(k => k.querySelector('b').textContent);
const card = document.querySelector('[data-plot="0"]');
"""


def test_values_at_a_time_are_shown_in_every_legend(
    survey: Traces, provenance: dict[str, Any], tmp_path: Path
) -> None:
    script = TOOLS + "return {all: [...document.querySelectorAll('[data-plot]')].map(values)," \
        "clock: document.getElementById('clock').textContent}"  # fmt: skip
    found = found_in_page(tmp_path, report_html(survey, provenance), script, anchor="#t=210")
    assert len(found["all"]) > 15
    assert all(value != "" for values in found["all"] for value in values)
    row = int(np.searchsorted(survey.time, 210.0))
    depth = float(found["all"][0][1])
    assert depth == pytest.approx(survey.values["hull.eta"][row, 2], abs=0.05)
    assert found["clock"] == "t = 210.00 s"


def test_zoom_of_one_plot_is_that_of_all_and_a_double_click_ends_it(
    survey: Traces, provenance: dict[str, Any], tmp_path: Path
) -> None:
    script = (
        TOOLS
        + """
    click('[data-zoom=in]'); await wait(); click('[data-zoom=in]'); await wait();
    const over = card.querySelector('.u-over'), box = over.getBoundingClientRect();
    const at = (kind, x) => over.dispatchEvent(new MouseEvent(kind,
      {bubbles: true, clientX: box.left + x, clientY: box.top + 20, button: 0, view: window}));
    const clock = () => parseFloat(document.getElementById('clock').textContent.slice(4));
    at('mouseenter', 0); at('mousemove', 0.5 * box.width); await wait();
    const middle = clock();
    at('mousemove', box.width - 1); await wait();
    const zoomed = clock();
    at('dblclick', 10); await wait(); at('mousemove', box.width - 1); await wait();
    return [middle, zoomed, clock()];
    """
    )
    middle, zoomed, whole = found_in_page(tmp_path, report_html(survey, provenance), script)
    assert middle == pytest.approx(210.0, abs=2.0)
    assert zoomed == pytest.approx(210.0 + 52.5, abs=2.0)
    assert whole == pytest.approx(420.0, abs=2.0)


def test_a_legend_entry_hides_its_line_and_shows_it_again(
    survey: Traces, provenance: dict[str, Any], tmp_path: Path
) -> None:
    script = (
        TOOLS
        + """
    const key = card.querySelectorAll('.key')[1], canvas = card.querySelector('canvas');
    const drawn = async () => { await wait(); return canvas.toDataURL(); };
    const before = await drawn(); key.click(); const hidden = await drawn();
    const pressed = key.getAttribute('aria-pressed'); key.click(); const again = await drawn();
    return [pressed, before !== hidden, before === again];
    """
    )
    found = found_in_page(tmp_path, report_html(survey, provenance), script)
    assert found == ["false", True, True]


def test_the_search_field_adds_a_signal_by_part_of_its_name_and_a_button_removes_it(
    survey: Traces, provenance: dict[str, Any], tmp_path: Path
) -> None:
    script = (
        TOOLS
        + """
    const search = document.getElementById('search'), added = document.getElementById('added');
    const enter = text => { search.value = text;
      search.dispatchEvent(new KeyboardEvent('keydown', {key: 'Enter', bubbles: true})); };
    enter('TAU_D'); await wait();
    const title = added.querySelector('.name').textContent;
    const lines = keys(added).length, canvas = added.querySelectorAll('canvas').length;
    click('.close', added); enter('nothing like it');
    const hint = document.getElementById('hint').textContent;
    return [title, lines, canvas, added.children.length, hint];
    """
    )
    found = found_in_page(tmp_path, report_html(survey, provenance), script)
    assert found[:4] == ["controller.tau_d", 6, 1, 0]
    assert "nothing like it" in found[4]


def test_a_comparison_has_both_runs_and_their_differences(
    survey: Traces, provenance: dict[str, Any], tmp_path: Path
) -> None:
    time = survey.time[::2] + 0.01  # the second run has other times
    values = {
        name: np.stack([np.interp(time, survey.time, c) for c in v.reshape(len(v), -1).T], axis=1)
        for name, v in survey.values.items()
    }
    values = {k: v[:, 0] if survey.values[k].ndim == 1 else v for k, v in values.items()}
    values["hull.eta"] = values["hull.eta"] + np.array([0, 0, 0.5, 0, 0, 0])
    changed = {**provenance, "seed": 8}
    page = comparison_html([survey, Traces(time, values)], [provenance, changed], ["one", "two"])
    for text in (
        "one and two",
        "cross-track error, RMS [m]",
        "Depth: B − A",
        "<td>7</td><td>8</td>",
    ):
        assert text in page
    script = (
        TOOLS
        + """
    const all = [...document.querySelectorAll('[data-plot]')];
    return all.slice(0, 2).map(c => [c.querySelector('h3').firstChild.textContent.trim(),
      keys(c).map(k => k.childNodes[1].textContent), values(c)]);
    """
    )
    both, difference = found_in_page(tmp_path, page, script, anchor="#t=210&signal=hull.eta")
    assert both[:2] == ["Depth", ["A desired", "A true", "A estimate",
                                  "B desired", "B true", "B estimate"]]  # fmt: skip
    assert difference[:2] == ["Depth: B − A", ["desired", "true", "estimate"]]
    assert float(difference[2][1]) == pytest.approx(0.5, abs=0.02)


def test_the_camera_stays_outside_of_a_hull_a_thousand_kilometres_away(tmp_path: Path) -> None:
    time = np.linspace(0.0, 60.0, 61)
    eta = np.zeros((61, 6))
    eta[:, 0], eta[:, 1], eta[:, 2] = 1e6 + time, 1e6, 5.0
    traces = Traces(time, {"hull.eta": eta})
    page = report_html(traces, {}, Scene3D("far", (Body("hull", ANYTHING, "hull.eta"),)))
    script = (
        TOOLS
        + """
    const {camera, zoom, at} = window.uuvsimScene, follow = document.querySelector('.follow');
    at(30); follow.click(); await wait();
    const start = camera.away;
    for (let i = 0; i < 100; i++) zoom(0.8);
    await wait(); await wait();
    const [[centre, radius]] = camera.hulls;
    return [start, radius, Math.hypot(...camera.eye.map((v, i) => v - centre[i])), centre];
    """
    )
    start, radius, away, centre = found_in_page(tmp_path, page, script)
    corner = float(np.linalg.norm(ANYTHING.vertices, axis=1).max())
    assert radius > corner
    assert start > away >= radius - 1e-6
    assert np.abs(centre).max() < 100.0  # positions are relative to the track


def test_water_and_caustics_are_options_of_the_scene_that_are_off(tmp_path: Path) -> None:
    time = np.linspace(0.0, 10.0, 11)
    eta = np.zeros((11, 6))
    eta[:, 0], eta[:, 2] = time, 3.0
    bed = Terrain(np.full((9, 9), 6.0, np.float32), 5.0, (-20.0, -20.0))
    scene3d = Scene3D("bed", (Body("hull", ANYTHING, "hull.eta"),), terrain=bed)
    page = report_html(Traces(time, {"hull.eta": eta}), {}, scene3d)
    script = (
        TOOLS
        + """
    const canvas = document.querySelector('#scene canvas'), gl = canvas.getContext('webgl2');
    const seen = async box => {
      if (box) { box.click(); await wait(); }
      window.uuvsimScene.camera.away = 12;
      const raw = new Uint8Array(4 * 40 * 40);
      const draw = gl.bindVertexArray.bind(gl);
      gl.bindVertexArray = v => {
        draw(v);
        if (!v) gl.readPixels(canvas.width / 2 - 20, 10, 40, 40, gl.RGBA, gl.UNSIGNED_BYTE, raw);
      };
      window.uuvsimScene.zoom(1); await wait(); await wait();
      delete gl.bindVertexArray;
      const part = c => Array.from(raw).filter((_, i) => i % 4 === c);
      const mean = v => v.reduce((a, b) => a + b, 0) / v.length;
      const green = part(1), middle = mean(green);
      return [mean(part(0)), middle, mean(part(2)), mean(green.map(v => (v - middle) ** 2))];
    };
    const wet = document.querySelector('.wet'), net = document.querySelector('.net');
    const off = [wet.checked, net.checked];
    return [off, await seen(), await seen(wet), await seen(net)];
    """
    )
    off, dry, wet, net = found_in_page(tmp_path, page, script)
    assert off == [False, False]
    assert wet[0] / wet[2] < 0.8 * dry[0] / dry[2]  # red goes first
    assert net[3] > wet[3] + 1.0  # bright lines on an even ground
