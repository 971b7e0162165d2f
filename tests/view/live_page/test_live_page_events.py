"""Faults, waypoints and steering on a page are a scenario with the same bits outside of it."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from tests.view.live_page.test_live_page import in_page
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.view.live_page.live_page import live_page_html

BEGIN = """
const line = page.line, find = s => document.querySelector(s);
const told = () => [line.scenario("scenario.yaml"), page.system.hash, line.steps];
const press = (type, code) =>
  document.dispatchEvent(new KeyboardEvent(type, { code, bubbles: true }));
"""


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    names = ("bluerov2_hold", "bluerov2_survey", "bluerov2_task", "target_tracking")
    return {name: live_page_html(uuv.load(name)) for name in names}


def on_page(folder: Path, page: str, script: str, anchor: str = "") -> Any:
    return in_page(folder, page, BEGIN + script, anchor)


def hash_outside(uuvsim: Uuvsim, folder: Path, scenario: str) -> str:
    """Run the command in the first line of a scenario, and return the hash of its recording."""
    (folder / "scenario.yaml").write_text(scenario)
    command = shlex.split(scenario.splitlines()[0].removeprefix("# uuvsim "))
    command[command.index("scenario.yaml")] = str(folder / "scenario.yaml")
    out = folder / "run"
    status, _, error = uuvsim(*command, "--native", "--no-report", "-o", str(out))
    assert (status, error) == (0, "")
    return hash_of_recording(out, command[1])


def hash_of_recording(run: Path, system: str) -> str:
    signals = read_signals(run)
    outputs = [
        (c.path, v)
        for c in flatten(uuv.load(system)).components
        for v in c.description.of("output")
    ]
    rows = [signals[f"{path}.{v.name}"].reshape(len(signals.time), -1) for path, v in outputs]
    whole = [v.type not in ("Float64", "Float32") for _, v in outputs for _ in range(v.size)]
    return output_hash(np.hstack([r.astype(float) for r in rows]), whole)


def test_faults_and_changes_of_a_page_have_the_same_bits_as_the_scenario_that_it_downloads(
    uuvsim: Uuvsim, tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    function fault(signal, kind, value, lasts) {
      find("#fault-signal").value = signal; find("#fault-kind").value = kind;
      find("#fault-value").value = value; find("#fault-lasts").value = lasts;
      find("#fault-add").click();
    }
    const health = find("input[type=number][aria-label^='allocation.health health[2]']");
    const Kp = find("input[type=number][aria-label^='controller.Kp Kp[1]']");
    Kp.value = "60"; Kp.onchange();                    // a start value
    page.advance(50);
    fault("dvl.beam_velocity", "drop", "0.5", "");
    fault("compass.psi", "bias", "1e-7", "0.3");
    page.advance(20);
    fault("navigation.eta[3]", "delay", "0.1", "");
    fault("imu.gyro", "freeze", "", "0.05");
    health.value = "0.25"; health.onchange();
    page.advance(60);
    const list = find("#happens").innerText.split("\\n").filter(Boolean);
    document.querySelector("#happens .now button").click();  // the end of the first active fault
    page.advance(70);
    return [...told(), list, find("#notice").textContent];
    """
    scenario, found, steps, listed, notice = on_page(tmp_path, pages["bluerov2_survey"], script)
    assert (steps, notice) == (200, "")
    assert (
        '{at: 0.51, until: 1.31, signal: "dvl.beam_velocity", fault: drop, value: 0.5}' in scenario
    )
    assert "value: 1.0e-7}" in scenario
    assert 'set: "allocation.health[2]", value: 0.25}' in scenario
    assert "--set 'controller.Kp=[60, " in scenario
    assert f"# hash {found} after 200 steps" in scenario
    assert "navigation.eta[3]: delay 0.1 s" in listed
    assert hash_outside(uuvsim, tmp_path, scenario) == found


def test_waypoints_by_click_and_drag_are_changes_of_the_guidance(
    uuvsim: Uuvsim, tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    const plan = find("#plan"), count = () => line.value("guidance.count", 0);
    const waypoints = () => Array.from({ length: count() }, (_, k) =>
      [0, 1, 2].map(i => line.value("guidance.waypoints", 3 * k + i)));
    plan.setPointerCapture = () => {};
    function pointer(type, x, y, target = plan) {
      const at = { bubbles: true, clientX: x, clientY: y, pointerId: 1 };
      target.dispatchEvent(new PointerEvent(type, at));
    }
    const before = waypoints().length;
    page.advance(100);
    const box = plan.getBoundingClientRect();
    pointer("pointerdown", box.left + box.width / 2, box.top + box.height / 2);
    pointer("pointerup", box.left + box.width / 2, box.top + box.height / 2);
    const added = waypoints(), marks = document.querySelectorAll("#plan .waypoint").length;
    page.advance(1);
    const second = find("#plan [data-number='1']"), at = second.getBoundingClientRect();
    pointer("pointerdown", at.left + 5, at.top + 5, second);
    pointer("pointermove", at.left + 5, at.top + 45);
    pointer("pointerup", at.left + 5, at.top + 45);
    const moved = waypoints();
    page.advance(1);
    document.querySelector("#points button").click();  // the first one is removed
    const removed = waypoints();
    page.advance(500);
    return [...told(), before, added, marks, moved, removed];
    """
    scenario, found, _, before, added, marks, moved, removed = on_page(
        tmp_path, pages["bluerov2_hold"], script
    )
    assert (before, len(added), marks, len(removed)) == (8, 9, 9, 8)
    assert added[8] == [10.0, 7.5, 5.0]  # the middle of the path
    assert moved[1][0] < 20.0
    assert moved[1][1] == pytest.approx(0.0, abs=0.5)
    assert removed == moved[1:]
    assert hash_outside(uuvsim, tmp_path, scenario) == found


@pytest.mark.parametrize(
    ("system", "signal"),
    [("bluerov2_hold", "guidance.eta_d"), ("bluerov2_task", "allocation.tau_d"),
     ("target_tracking", "tracker_1.pilot.a")],
)  # fmt: skip
def test_keys_steer_and_what_they_do_is_a_scenario(
    uuvsim: Uuvsim, tmp_path: Path, pages: dict[str, str], system: str, signal: str
) -> None:
    script = """
    const words = find("#moves").textContent;
    page.advance(100);
    find("#take").click(); page.pause();
    press("keydown", "KeyW"); press("keydown", "KeyD"); page.advance(100);
    const turned = line.events.length;
    press("keyup", "KeyD"); page.advance(100);
    press("keyup", "KeyW"); find("#take").click(); page.advance(50);
    return [...told(), words, turned, find("#take").textContent];
    """
    scenario, found, steps, words, events, button = on_page(tmp_path, pages[system], script)
    assert signal in words
    assert events > 1
    assert (steps, button) == (350, "take the controls")
    assert hash_outside(uuvsim, tmp_path, scenario) == found


def test_a_gamepad_s_stick_drives_the_vehicle_ahead(tmp_path: Path, pages: dict[str, str]) -> None:
    script = """
    page.advance(100);
    const before = page.system.get("hull.nu")[0];
    navigator.getGamepads = () => [{ connected: true, id: "test pad", axes: [0, -1, 0, 0] }];
    window.dispatchEvent(new Event("gamepadconnected"));
    find("#take").click(); page.pause();
    page.advance(200);
    return [before, page.system.get("hull.nu")[0], find("#moves").textContent];
    """
    before, after, words = on_page(tmp_path, pages["bluerov2_hold"], script)
    assert abs(before) < 0.05
    assert after > 0.3
    assert "Gamepad: test pad." in words


def test_steps_back_restore_the_earlier_bits_with_faults_and_the_hash_on_the_way_forth(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    const found = [], system = page.system;
    const now = () => JSON.stringify([line.steps, system.hash, system.outputs()]);
    line.fault({ signal: "dvl.beam_velocity", kind: "drop", value: 0.5, at: 40, until: 300 });
    line.fault({ signal: "navigation.eta", kind: "delay", value: 0.1, at: 60, until: 150 });
    line.add({ at: 120, name: "guidance.speed", element: 0, value: 0.2 });
    const seen = new Map();
    for (let k = 0; k <= 400; k++) { seen.set(k, now()); page.advance(1); }
    const back = find("#back");
    for (const k of [399, 300, 149, 148, 121, 120, 119, 60, 59, 39, 1, 0]) {
      while (line.steps > k + 1 && line.steps - k < 5) back.click();
      page.seek(k + 1); back.click();
      found.push(now() === seen.get(k));
    }
    const off = back.disabled;
    page.advance(400);
    return [found.every(Boolean), now() === seen.get(400), off];
    """
    assert on_page(tmp_path, pages["bluerov2_survey"], script) == [True, True, True]


def test_a_fault_is_listed_with_the_units_of_all_elements_on_which_it_acts(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    const units = [], signals = ["hull.eta", "hull.eta[3]", "hull.eta[4]", "compass.psi"];
    for (const signal of signals) {
      find("#fault-signal").value = signal; find("#fault-signal").oninput();
      find("#fault-value").value = "0.5";
      units.push(find("#fault-unit").textContent);
      find("#fault-add").click();
    }
    find("#fault-signal").value = "hull.eta"; find("#fault-kind").value = "delay";
    find("#fault-add").click();
    const listed = [...document.querySelectorAll("#happens .event span:nth-child(2)")];
    return [units, listed.map(e => e.textContent)];
    """
    units, listed = on_page(tmp_path, pages["bluerov2_survey"], script)
    assert units == ["m, rad", "m", "rad", "rad"]
    assert listed == [
        "hull.eta: bias 0.5 m, 0.5 rad", "hull.eta[3]: bias 0.5 m", "hull.eta[4]: bias 0.5 rad",
        "compass.psi: bias 0.5 rad", "hull.eta: delay 0.5 s",
    ]  # fmt: skip


def test_a_removed_event_leaves_the_run_that_never_had_it(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    page.advance(250);
    const clean = page.system.hash;
    page.seek(100);
    line.fault({ signal: "hull.eta", element: 2, kind: "bias", value: 0.5 });
    page.advance(150);
    const faulty = page.system.hash, plotted = () => page.track()[0].length;
    const before = plotted();
    document.querySelector("#happens button[title^=remove]").click();
    return [faulty === clean, page.system.hash === clean, line.steps, before, plotted(),
      find("#happens").childElementCount];
    """
    assert on_page(tmp_path, pages["bluerov2_hold"], script) == [False, True, 250, 251, 251, 0]


def test_restart_begins_with_the_present_values_and_replay_repeats_the_events(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    const labels = () => ["#restart", "#replay"].map(find).map(e => e.hidden ? "" : e.textContent);
    const before = labels();
    page.advance(50);
    line.set("hull.v_c", 0, 0.3);
    line.fault({ signal: "hull.eta", element: 2, kind: "bias", value: 0.5 });
    page.advance(50);
    const first = page.system.hash, after = labels();
    find("#replay").click();
    const at = [line.steps, line.value("hull.v_c", 0)];
    page.advance(100);
    const again = [page.system.hash === first];
    line.seek(80);
    find("#seed").value = "0"; find("#seed").onchange({ target: find("#seed") });
    again.push(line.steps, line.value("hull.v_c", 0));
    page.advance(100);
    again.push(page.system.hash === first);
    find("#restart").click();
    const kept = line.events.map(e => [e.at, e.kind]);
    page.advance(100);
    const same = page.system.hash === first;
    return [...at, again, line.value("hull.v_c", 0), kept, same, line.startValues,
      [before, after]];
    """
    assert on_page(tmp_path, pages["bluerov2_hold"], script) == [
        0, 0, [True, 0, 0, True], 0.3, [[1, "bias"]], False, [["hull.v_c", 0, 0.3]],
        [["restart", ""], ["restart with present values", "replay all events"]],
    ]  # fmt: skip


MAKE_LINK = """
find("#seed").value = "7"; find("#seed").onchange({ target: find("#seed") });
line.set("controller.Kp", 0, 60);
page.advance(30);
line.fault({ signal: "hull.eta", element: 2, kind: "bias", value: 0.5, until: 90 });
line.set("guidance.speed", 0, 0.3);
page.advance(70);
find("#speed").value = "16";
document.querySelector("#plots .close").click();
find("#search").value = "controller.tau_d"; find("#search").onchange();
find("#link").click();
await until(() => location.hash.startsWith("#link="));
return [location.hash, page.system.hash, page.settings()];
"""


def test_a_link_has_all_settings_and_opens_the_page_at_the_same_point(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    anchor, found, settings = on_page(tmp_path, pages["bluerov2_hold"], MAKE_LINK)
    assert len(anchor) < 900
    script = """
    const notice = find("#notice").textContent, Kp = line.value("controller.Kp", 0);
    return [page.system.hash, page.settings(), notice, Kp, find("#seed").value];
    """
    opened = on_page(tmp_path, pages["bluerov2_hold"], script, anchor)
    assert opened == [found, settings, "", 60, "7"]


def test_a_damaged_link_and_one_of_another_system_are_named_and_do_nothing(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    anchor, _, _ = on_page(tmp_path, pages["bluerov2_hold"], MAKE_LINK)
    k = len(anchor) // 2
    other = "A" if anchor[k] != "A" else "B"
    script = "return [line.steps, line.events.length, find('#notice').textContent]"
    for damaged in (anchor[:-4], anchor[:k] + other + anchor[k + 1 :], "#link=%%%", "#link="):
        steps, events, notice = on_page(tmp_path, pages["bluerov2_hold"], script, damaged)
        assert (steps, events) == (0, 0)
        assert notice.startswith("The link is damaged: its ")
    steps, _, notice = on_page(tmp_path, pages["bluerov2_survey"], script, anchor)
    assert steps == 0
    assert "settings of the system “bluerov2_hold”; expected bluerov2_survey" in notice


def test_a_link_with_an_unknown_variable_or_other_bits_is_reported(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    const settings = { ...page.settings(), hash: "0000000000000000" }, notices = [];
    async function open(more) {
      location.hash = "link=" + await settingsText({ ...settings, ...more });
      for (let k = 0; k < 20; k++) await wait();
      notices.push(find("#notice").textContent);
    }
    await open({});
    await open({ start: [["hull.mass_", 0, 3]] });
    const event = { at: 5, until: null, signal: "hull.eta", element: 9, kind: "bias", value: 1 };
    await open({ events: [event] });
    await open({ events: [{ ...event, element: 0, kind: "twist" }] });
    return notices;
    """
    bits, start, element, kind = on_page(tmp_path, pages["bluerov2_hold"], script)
    assert "with the hash 0000000000000000: by another version" in bits
    assert "hull.mass_ is no input or parameter of this system" in start
    assert "hull.eta[10] does not exist: hull.eta has 6 elements" in element
    assert "the fault “twist” is unknown; expected override, bias" in kind


def test_information_has_the_colour_of_text_and_a_refusal_that_of_a_warning(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    const notice = find("#notice"), seen = [];
    const colour = name => {
      const e = document.createElement("i"); e.style.color = `var(--${name})`; notice.after(e);
      return getComputedStyle(e).color;
    };
    const read = () => seen.push([notice.textContent.slice(0, 8), getComputedStyle(notice).color]);
    find("#fault-add").click(); read();
    find("#download").click(); read();
    find("#step").click(); read();
    find("#fault-add").click(); read();
    find("#link").click();
    await until(() => notice.textContent.startsWith("The link"));
    read();
    return [seen, colour("ink"), colour("estimate")];
    """
    seen, ink, warning = on_page(tmp_path, pages["bluerov2_hold"], script)
    assert seen == [
        ["A fault ", warning], ["The same", ink], ["", warning],
        ["A fault ", warning], ["The link", ink],
    ]  # fmt: skip
    assert ink != warning


def test_wrong_faults_are_refused_with_a_message(tmp_path: Path, pages: dict[str, str]) -> None:
    script = """
    const refused = more => line.fault({ signal: "hull.eta", kind: "bias", value: 1, ...more });
    return [refused({ signal: "hull.eta_" }), refused({ kind: "drop", value: 2 }),
      refused({ value: NaN }), refused({ kind: "delay", value: 0.015 }),
      refused({ signal: "guidance.waypoint", value: 0.5 }), refused({ at: 5, until: 5 }),
      line.events.length];
    """
    assert on_page(tmp_path, pages["bluerov2_hold"], script) == [
        "hull.eta_ is no output of this system.",
        "hull.eta: drop needs a probability from 0 to 1.",
        "hull.eta: bias needs a number.",
        "hull.eta: delay needs a whole number of the component's steps of 0.01 s.",
        "guidance.waypoint: bias needs a whole number.",
        "hull.eta: the fault needs an end after its begin.",
        0,
    ]


def test_a_page_in_the_background_reports_that_it_stood_still(
    tmp_path: Path, pages: dict[str, str]
) -> None:
    script = """
    find("#run").click();
    while (line.steps < 10) await wait();
    let hidden = true;
    Object.defineProperty(document, "hidden", { get: () => hidden });
    document.dispatchEvent(new Event("visibilitychange"));
    await wait(); const at = line.steps; await wait(); await wait();
    const still = line.steps === at;
    hidden = false;
    document.dispatchEvent(new Event("visibilitychange"));
    const notice = find("#notice").textContent;
    while (line.steps <= at + 10) await wait();
    page.pause();  // or the browser draws until its time is over
    return [still, notice];
    """
    still, notice = on_page(tmp_path, pages["bluerov2_hold"], script)
    assert still
    assert notice.startswith("This page was in the background for ")
    assert "It goes on from t = " in notice
