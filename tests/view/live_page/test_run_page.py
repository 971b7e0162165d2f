"""A run goes on in a browser from any instant of its recording, from its very bits."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from tests.view.browser import found_in_page
from tests.view.live_page.test_live_page import in_page
from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.view.live_page.run_page import write_run_page

SCENARIO = """
name: lost
events:
  - {at: 1, until: 3, signal: dvl.beam_velocity, fault: drop, value: 0.5}
  - {at: 0, signal: compass.psi, fault: bias, value: 0.1}
  - {at: 2, set: guidance.speed, value: 0.3 m/s}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("again")
    (folder / "lost.yaml").write_text(SCENARIO)
    system = uuv.load("bluerov2_survey").set("controller.Kp", [60.0, 60.0, 80.0, 14.0, 14.0, 6.0])
    done = uuv.run(
        system, until=4.0, seed=5, scenario=folder / "lost.yaml", backend="native",
        out=folder / "run", progress=False,
    )  # fmt: skip
    return done.folder


def row_of(run: Path, step: int) -> list[float]:
    signals = read_signals(run)
    outputs = [
        f"{c.path}.{v.name}"
        for c in flatten(uuv.load(run / "system.ssd")).components
        for v in c.description.of("output")
    ]
    return np.concatenate(
        [np.ravel(signals[name][step]).astype(float) for name in outputs]
    ).tolist()


def test_the_page_has_the_recording_s_bits_at_the_instant_and_goes_on_with_other_parameters(
    run: Path, tmp_path: Path
) -> None:
    page = write_run_page(run, tmp_path / "page.html").read_text("utf-8")
    script = """
    const found = [page.line.command("s.yaml"), page.line.steps, page.system.outputs()];
    page.advance(100);
    found.push(page.system.outputs());
    page.seek(250);
    page.line.set("allocation.health", 0, 0);
    page.advance(100);
    return [...found, page.system.outputs(), page.line.steps];
    """
    command, steps, here, later, changed, end = in_page(tmp_path, page, script, "#steps=250")  # type: ignore[misc]
    assert (steps, end) == (250, 350)
    assert command == "uuvsim run run/system.ssd --seed 5 --until 2.5 --scenario s.yaml"
    assert here == row_of(run, 250)
    assert later == row_of(run, 350)
    assert changed != later


def test_the_report_links_the_page_at_the_time_of_the_last_click(
    uuvsim: Uuvsim, run: Path, tmp_path: Path
) -> None:
    out = tmp_path / "report.html"
    status, text, _ = uuvsim("report", str(run), "--page", "-o", str(out))
    assert status == 0
    assert "page.html" in text
    assert (tmp_path / "page.html").is_file()
    script = """
    const find = s => document.querySelector(s);
    const link = find("#again-link"), time = find("#again-time");
    const first = link.getAttribute("href");
    time.value = "2.503"; time.onchange();
    const typed = [link.getAttribute("href"), time.value];
    const over = find(".u-over");
    over.scrollIntoView();
    for (const kind of ["mouseenter", "mousemove", "mousedown", "mouseup", "click"]) {
      const { left, top, width } = over.getBoundingClientRect();
      const at = { bubbles: true, clientX: left + width / 4, clientY: top + 20, view: window };
      over.dispatchEvent(new MouseEvent(kind, at));
      await wait();
    }
    return [first, typed, link.getAttribute("href"), +time.value];
    """
    first, typed, clicked, time = found_in_page(tmp_path, out.read_text("utf-8"), script)
    assert first == "page.html#steps=0"
    assert typed == ["page.html#steps=250", "2.5"]
    assert re.fullmatch(r"page\.html#steps=\d+", clicked)
    assert clicked == f"page.html#steps={round(time * 100)}"
    assert 0.8 < time < 1.2


def test_the_report_without_a_page_names_the_command_and_what_prevents_one(
    uuvsim: Uuvsim, tmp_path: Path, run: Path
) -> None:
    out = tmp_path / "report.html"
    assert uuvsim("report", str(run), "-o", str(out))[0] == 0
    assert f"uuvsim report {run.name} --page" in out.read_text("utf-8")
    law = tmp_path / "law.py"
    law.write_text(
        "class Law:\n    inputs = {}\n    outputs = {'u': '1'}\n\n"
        "    def step(self, t, dt, u):\n        return {'u': 0.0}\n"
    )
    system = uuv.System("mixed").add("law", f"{law}:Law").add("hull", "model:sphere")
    mixed = uuv.run(system, until=0.5, backend="native", out=tmp_path / "mixed", progress=False)
    assert uuvsim("report", str(mixed.folder))[0] == 0
    text = (mixed.folder / "report.html").read_text("utf-8")
    assert "No page can repeat this run" in text
    assert "law: it is no declaration: python, law.py:Law" in text
    assert "hull: it is" not in text
    with pytest.raises(SystemInvalid, match="law: it is no declaration"):
        write_run_page(mixed.folder)


def test_inputs_over_time_and_another_start_prevent_the_page_by_name(
    tmp_path: Path, run: Path
) -> None:
    other = tmp_path / "run"
    other.mkdir()
    (other / "system.ssd").write_bytes((run / "system.ssd").read_bytes())
    (other / "inputs.csv").write_text("time\n")
    provenance = json.loads((run / "run.json").read_text()) | {"start": 2.0}
    del provenance["scenario"]
    provenance["changes"] = {"scenario": {"file": "lost.yaml"}}
    (other / "run.json").write_text(json.dumps(provenance))
    with pytest.raises(SystemInvalid) as caught:
        write_run_page(other)
    text = str(caught.value)
    for expected in ("--start: the run begins at 2 s", "--input:", "--scenario: run.json has no"):
        assert expected in text
