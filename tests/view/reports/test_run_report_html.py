import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.plots.plots import TimePanel
from uuvsim_cosim.view.plots.svg import decimate, nice_ticks
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.reports.panels import sections
from uuvsim_cosim.view.reports.picture import picture_svg, write_picture
from uuvsim_cosim.view.reports.run_report_html import report_html


class Page(HTMLParser):
    """Collects the text and every address that a browser would fetch."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.text = ""
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "srcset", "action")]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_report_fetches_nothing(survey: Traces, provenance: dict[str, Any]) -> None:
    html = report_html(survey, provenance)
    assert Page(html).addresses == []
    for forbidden in ("http://", "https://", "url(", "@import", "fetch(", "XMLHttpRequest"):
        assert forbidden not in html


def test_the_report_of_a_long_run_stays_below_2_mb(provenance: dict[str, Any]) -> None:
    random = np.random.default_rng(0)
    n = 60_000
    time = np.linspace(0, 3600, n)
    values = {name: random.standard_normal((n, 6)) for name in (
        "hull.eta", "hull.nu", "navigation.eta", "navigation.sigma", "guidance.eta_d",
        "controller.tau_d")}  # fmt: skip
    values |= {f"thruster_{i}.thrust": random.standard_normal(n) for i in range(1, 9)}
    values |= {"battery.voltage": random.random(n), "wrench.current_total": random.random(n)}
    values["current.v_c"] = random.standard_normal((n, 3))
    assert len(report_html(Traces(time, values), provenance).encode()) < 2e6


def test_every_panel_of_a_survey_is_there(survey: Traces, provenance: dict[str, Any]) -> None:
    text = Page(report_html(survey, provenance)).text
    for title in ("Track, seen from above", "Depth", "Cross-track error", "Current", "Heading",
                  "Roll and pitch", "Thrusters", "Navigation error", "Battery"):  # fmt: skip
        assert title in text


def test_the_band_of_an_error_reaches_as_far_below_zero_as_above(survey: Traces) -> None:
    panels = [p for s in sections(survey) for p in s.panels if isinstance(p, TimePanel)]
    bands = [b for p in panels for b in p.bands if "3 σ" in b.label]
    assert len(bands) >= 6
    for band in bands:
        np.testing.assert_array_equal(band.low, -band.high)
        assert np.nanmin(band.high) >= 0.0


def test_provenance_is_on_the_page(survey: Traces, provenance: dict[str, Any]) -> None:
    text = Page(report_html(survey, provenance)).text
    for said in ("0.1.0", "current.speed = 0.25", "model:hull", "taken as N", "seed 7"):
        assert said in text


def test_text_from_outside_cannot_become_markup(survey: Traces, provenance: dict[str, Any]) -> None:
    nasty = "</script><script>alert(1)</script>"
    html = report_html(survey, provenance | {"system": nasty, "notes": [nasty]})
    assert nasty not in html
    assert nasty in Page(html).text


def test_hover_data_fit_the_read_outs(survey: Traces, provenance: dict[str, Any]) -> None:
    html = report_html(survey, provenance)
    found = re.search(r'<script id="data"[^>]*>(.*?)</script>', html, re.DOTALL)
    assert found is not None
    data = json.loads(found[1])
    numbers = {int(n) for n in re.findall(r'data-s="(\d+)"', html)}
    assert numbers == set(range(len(data["series"])))
    assert len({len(series["v"]) for series in data["series"]} | {len(data["time"])}) == 1


def test_a_system_without_a_hull_gets_a_panel_for_each_signal() -> None:
    time = np.linspace(0, 1, 50)
    traces = Traces(time, {"tank.level": time**2, "tank.flow": np.ones((50, 3))})
    text = Page(report_html(traces, {"system": "tank"})).text
    assert "level" in text
    assert "flow" in text


def test_the_picture_is_well_formed_and_needs_no_variables(
    survey: Traces, provenance: dict[str, Any]
) -> None:
    svg = picture_svg(survey, provenance)
    assert ET.fromstring(svg).tag.endswith("svg")
    assert "var(" not in svg
    texts = [e.text for e in ET.fromstring(svg).iter() if e.tag.endswith("text")]
    assert {"path", "true", "estimate", "current"} <= set(texts)  # the key of the track


def test_a_picture_is_written_into_a_folder_that_is_not_there_yet(
    survey: Traces, provenance: dict[str, Any], tmp_path: Path
) -> None:
    written = write_picture(survey, provenance, tmp_path / "figures" / "track.svg")
    assert written.read_text(encoding="utf-8") == picture_svg(survey, provenance)


def test_a_picture_of_no_vehicle_is_refused() -> None:
    with pytest.raises(InputInvalid, match=r"hull\.eta"):
        picture_svg(Traces(np.arange(3.0), {"tank.level": np.arange(3.0)}), {})


def test_decimation_keeps_the_peaks_and_the_ends() -> None:
    time = np.arange(100_000.0)
    value = np.zeros(100_000)
    value[12_345], value[54_321] = 5.0, -7.0
    t, v = decimate(time, value, 400)
    assert len(t) <= 802
    assert (v.max(), v.min(), t[0], t[-1]) == (5.0, -7.0, 0.0, 99_999.0)
    assert np.all(np.diff(t) > 0)


@pytest.mark.parametrize(
    ("low", "high"), [(0, 1), (-0.08, 0.08), (1e-9, 3e-9), (-5e6, 7e6), (3, 3.1)]
)
def test_ticks_are_inside_and_at_least_two(low: float, high: float) -> None:
    ticks = nice_ticks(low, high)
    assert len(ticks) >= 2
    assert low <= ticks[0] < ticks[-1] <= high
