import base64
import itertools
import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.plots.plots import TimePanel
from uuvsim_cosim.view.plots.svg import decimate, nice_ticks
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.reports.panels import sections
from uuvsim_cosim.view.reports.picture import picture_svg
from uuvsim_cosim.view.reports.run_report import report_html


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


def data_of(html: str) -> dict[str, Any]:
    """Return the data from which the page's script draws."""
    found = re.search(r'<script id="data"[^>]*>(.*?)</script>', html, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def column_of(data: dict[str, Any], number: int) -> np.ndarray:
    """Return a column as `report.js` decodes it."""
    column = data["columns"][number]
    if "v" not in column:
        value = np.nan if column["c"] is None else column["c"]
        return np.full(column["n"], float(value))
    codes = np.frombuffer(base64.b64decode(column["v"]), "<u2")
    return np.where(codes == 65535, np.nan, column["l"] + column["s"] * codes)


def test_every_plot_has_a_card_and_columns_as_long_as_its_times(
    survey: Traces, provenance: dict[str, Any]
) -> None:
    html = report_html(survey, provenance)
    data = data_of(html)
    numbers = [int(n) for n in re.findall(r'data-plot="(\d+)"', html)]
    assert numbers == list(range(len(data["panels"])))
    sizes = [len(base64.b64decode(t["t"])) // 4 for t in data["times"]]
    for panel in [*data["panels"], *itertools.chain(*data["signals"].values())]:
        for line in panel["lines"]:
            assert len(column_of(data, line["column"])) == sizes[panel["grid"]]


def test_a_recorded_signal_is_in_the_page_with_its_peaks_and_its_gaps() -> None:
    time = np.linspace(0.0, 600.0, 60_000)
    value = np.sin(time / 50.0)
    value[12_345], value[54_321] = 5.0, -7.0
    value[30_000:36_000] = np.nan
    data = data_of(report_html(Traces(time, {"a.x": value}), {}))
    (panel,) = data["signals"]["a.x"]
    found = column_of(data, panel["lines"][0]["column"])
    assert len(found) < 1200
    assert (np.nanmin(found), np.nanmax(found)) == pytest.approx((-7.0, 5.0), abs=1e-3)
    assert np.isnan(found).mean() == pytest.approx(0.1, abs=0.01)


def test_elements_of_different_units_are_plotted_on_axes_of_their_own() -> None:
    eta = np.random.default_rng(0).standard_normal((50, 6))
    units = ("m", "m", "m", "rad", "rad", "rad")
    traces = Traces(np.arange(50.0), {"x.eta": eta}, {"x.eta": "m, rad"}, {"x.eta": units})
    panels = data_of(report_html(traces, {}))["signals"]["x.eta"]
    assert [p["unit"] for p in panels] == ["m", "rad"]
    assert [[line["label"] for line in p["lines"]] for p in panels] == [
        ["[1]", "[2]", "[3]"], ["[4]", "[5]", "[6]"]
    ]  # fmt: skip


def test_arrays_that_do_not_fit_into_the_page_are_named() -> None:
    time = np.arange(20.0)
    random = np.random.default_rng(0)
    values = {"a.image": random.random((20, 4096)), "a.small": random.random((20, 3))}
    html = report_html(Traces(time, values), {})
    assert list(data_of(html)["signals"]) == ["a.small"]
    assert "do not fit into the page: a.image." in Page(html).text


def test_lines_of_a_plot_have_marks_that_differ(survey: Traces, provenance: dict[str, Any]) -> None:
    data = data_of(report_html(survey, provenance))
    assert len(set(data["marks"].values())) == len(data["marks"]) >= 8
    for panel in data["panels"]:
        if "rows" not in panel:
            styles = [line["style"] for line in panel["lines"]]
            assert len(set(styles)) == len(styles)
            assert set(styles) <= set(data["marks"])


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
