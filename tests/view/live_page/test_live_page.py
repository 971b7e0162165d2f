"""The page of a system computes the master's bits in a browser, and its controls set the system."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from tests.kernels.web_assembly.test_module import mastered
from tests.view.browser import found_in_page
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.view.live_page.live_page import live_page_html

STEPS = 300


@pytest.fixture(scope="module")
def page() -> str:
    return live_page_html(uuv.load("bluerov2_hold"))


def in_page(folder: Path, page: str, script: str, anchor: str = "") -> object:
    """Run a script in the page once its system has started."""
    ready = "while(!window.uuvsimPage)await wait();const page=window.uuvsimPage;"
    return found_in_page(folder, page, ready + script, anchor=anchor)


def test_a_browser_shows_the_hash_of_the_native_components(page: str, tmp_path: Path) -> None:
    rows, whole = mastered(uuv.load("bluerov2_hold"), STEPS)
    script = (
        f"page.advance({STEPS});"
        "return [document.getElementById('hash').textContent, page.system.outputs()]"
    )
    found = in_page(tmp_path, page, script)
    assert found == [output_hash(rows, whole), rows[-1].tolist()]


@pytest.mark.parametrize(
    ("link", "steps", "read"),
    [("steps=20&theme=dark", 20, ""), ("steps=ten", 0, "steps=ten"),
     ("steps=1e99", 0, "steps=1e99"), ("theme=pink&steps=20", 20, "theme=pink"),
     ("speed=3", 0, "speed=3"), ("stepz=5", 0, "stepz=5"), ("constructor=1", 0, "constructor=1")],
)  # fmt: skip
def test_what_a_link_asks_is_done_and_what_is_damaged_is_named(
    page: str, tmp_path: Path, link: str, steps: int, read: str
) -> None:
    script = """
    await wait();
    return [page.system.steps, document.getElementById("notice").textContent];
    """
    done, notice = in_page(tmp_path, page, script, anchor=f"#{link}")  # type: ignore[misc]
    assert done == steps
    assert (f"“{read}”, which is ignored: expected theme=light" in notice) == bool(read)
    assert ("speed= and one of 0.25, 1, 4, 16, 64, Infinity, or link=" in notice) == bool(read)


def test_a_parameter_s_slider_sets_the_system_and_a_wrong_number_is_refused(
    page: str, tmp_path: Path
) -> None:
    script = """
    const field = document.querySelector("input[type=number][aria-label^='controller.Kp Kp[1]']");
    const unit = field.nextSibling.textContent, found = [];
    for (const text of ["60", "-1", ""]) {
      field.value = text; field.onchange();
      const notice = document.getElementById("notice").textContent;
      found.push(page.system.get("controller.Kp")[0], notice);
    }
    return [...found, unit];
    """
    assert in_page(tmp_path, page, script) == [
        60, "",
        60, "controller.Kp[1] is at least 0.",
        60, "controller.Kp[1] needs a number.",
        "N/m",
    ]  # fmt: skip


def test_a_page_runs_pauses_and_begins_again(page: str, tmp_path: Path) -> None:
    script = """
    const button = document.getElementById("run"), system = page.system, first = system.hash;
    button.click();
    while (system.steps < 30) await wait();
    const text = button.textContent;
    button.click();
    const paused = system.steps;
    await wait(); await wait();
    const still = system.steps === paused;
    document.getElementById("restart").click();
    return [text, button.textContent, still, system.steps, system.hash === first];
    """
    assert in_page(tmp_path, page, script) == ["pause", "run", True, 0, True]


def test_a_pause_shows_the_step_the_hash_and_the_values_that_were_reached(
    page: str, tmp_path: Path
) -> None:
    script = """
    const { system, line } = page, find = s => document.querySelector(s);
    const now = () => `t = ${system.time.toFixed(2)} s, ${system.steps} steps`;
    const seen = () => find("#time").textContent, found = [];
    line.add({ at: 20, name: "controller.Kp", element: 0, value: 60 });
    for (let k = 0; k < 3; k++) {
      find("#run").click();
      while (system.steps < 30 * (k + 1) || seen() === now()) await wait();  // the display is old
      find("#run").click();
      found.push(seen() === now(), find("#hash").textContent === system.hash);
    }
    const field = find("input[type=number][aria-label^='controller.Kp Kp[1]']");
    return [found, field.value];
    """
    assert in_page(tmp_path, page, script) == [[True] * 6, "60"]


def test_a_page_as_fast_as_possible_runs_from_a_picture_that_began_before_the_click(
    page: str, tmp_path: Path
) -> None:
    script = """
    let clock = 1000;
    performance.now = () => clock += 1;  // so that a picture has an end
    window.requestAnimationFrame = f => setTimeout(() => f(clock - 20), 16);
    document.getElementById("speed").value = "Infinity";
    document.getElementById("run").click();
    for (let k = 0; k < 5; k++) await wait();
    page.pause();
    return page.system.steps > 0;
    """
    assert in_page(tmp_path, page, script) is True


def test_a_browser_without_web_assembly_is_told_so(page: str, tmp_path: Path) -> None:
    without = page.replace("<head>", "<head><script>delete window.WebAssembly</script>")
    script = (
        "const notice=document.getElementById('notice');while(!notice.textContent)await wait();"
        "return [notice.textContent, document.getElementById('run').disabled]"
    )
    text, disabled = found_in_page(tmp_path, without, script)
    assert text.startswith("This browser has no WebAssembly, or it is switched off")
    assert disabled


def test_a_page_is_small_and_needs_no_network(page: str) -> None:
    assert len(page) < 400_000
    survey = live_page_html(uuv.load("bluerov2_survey"))
    assert len(survey) < 600_000
    for forbidden in ("http://", "https://", "url(", "@import", "fetch(", "XMLHttpRequest"):
        assert forbidden not in page


def test_the_command_writes_a_page_and_refuses_other_components_by_name(
    uuvsim: Uuvsim, tmp_path: Path
) -> None:
    out = tmp_path / "page.html"
    status, text, _ = uuvsim("export", "bluerov2_hold", "-o", str(out))
    assert status == 0
    assert "page.html" in text
    assert out.read_text("utf-8").startswith("<!doctype html>")
    status, _, error = uuvsim("export", "bluerov2_px4", "-o", str(tmp_path / "no.html"))
    assert status == 2
    assert "in WebAssembly" in error
    assert not (tmp_path / "no.html").exists()


def test_a_parameter_acts_from_the_next_step_as_in_the_master(page: str, tmp_path: Path) -> None:
    script = """
    page.advance(100);
    page.system.set("controller.Kp", 2, 60);
    page.advance(100);
    return page.system.outputs();
    """
    plan = flatten(uuv.load("bluerov2_hold"), seed=0)
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.step(100)
        master.set("controller", "Kp", [80, 80, 60, 14, 14, 6])
        master.step(100)
        outputs = [
            np.ravel(master.get(c.path, v.name)).astype(float)
            for c in plan.components
            for v in c.description.of("output")
        ]
    assert in_page(tmp_path, page, script) == np.concatenate(outputs).tolist()


def test_a_restored_state_goes_on_with_the_same_bits_and_hash(page: str, tmp_path: Path) -> None:
    script = """
    const system = page.system, found = () => [system.steps, system.hash, system.outputs()];
    system.run(50);
    const kept = system.save();
    system.run(70);
    const first = JSON.stringify(found());
    system.restore(kept);
    const back = system.steps;
    system.run(70);
    return [back, JSON.stringify(found()) === first];
    """
    assert in_page(tmp_path, page, script) == [50, True]
