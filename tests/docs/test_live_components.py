"""Each component's page computes its response in the browser, with the bits of the master."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "extensions"))

import live_components
from components import names, page
from live_pages import NEEDS_NODE, built, in_node
from live_stimuli import stimulus_of

import uuvsim_cosim as uuv
from tests.kernels.web_assembly.test_module import Kept
from tests.view.browser import found_in_page
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten

# A random one, a sampled one, one with inputs that follow the time, a law and a hull.
SOME = ("current_gauss_markov", "dvl", "navigation", "lqr", "bluerov2", "thruster")


def mastered(name: str, **parameters: float) -> str:
    """Return the hash of a component's response, computed by the native component in a master."""
    stimulus = stimulus_of(name)
    system = live_components.system_of(name, stimulus)
    for parameter, value in parameters.items():
        system = system.set(f"c.{parameter}", value)
    plan = flatten(system, seed=0)
    kept, steps = Kept(), round(stimulus.seconds / float(plan.tick))
    with Master(plan, prepare(plan), observers=[kept]) as master:
        master.initialize()
        for k in range(steps):
            if k == steps // 10:
                for element, value in stimulus.after.items():
                    set_element(master, plan, element, value)
            for clock in stimulus.clocks:
                set_element(master, plan, clock, k * float(plan.tick))
            master.step(1)
    return output_hash(np.concatenate(kept.parts), kept.whole)


def set_element(master: Master, plan: Any, element: str, value: float) -> None:
    """Set one element of an input, "tau[1]", of the only component."""
    whole, _, k = element.rstrip("]").partition("[")
    values = np.array(master.get("c", whole), float)
    values[int(k) - 1 if k else ...] = value
    master.set("c", whole, values)


def pages_of(name: str) -> dict[str, str]:
    """Return the page of a component, and its plot."""
    return {f"{name}.md": page(name, uuv.declare(name)), f"{name}.svg": "<svg/>"}


@pytest.fixture(scope="module")
def files() -> dict[str, str]:
    live = {name: live_components.live_of(name) for name in names()}
    texts = {f"{name}.js": found.file for name, found in live.items() if not found.reason}
    return {"live.js": live_components.script(), **texts}


def test_all_components_but_optimisers_have_a_live_response() -> None:
    reasons = {name: live_components.live_of(name).reason for name in names()}
    without = {name: reason for name, reason in reasons.items() if reason}
    assert list(without) == ["mpc"]
    assert "an optimiser" in without["mpc"]


@NEEDS_NODE
def test_every_stimulus_changes_the_response_and_is_stated(
    files: dict[str, str], tmp_path: Path
) -> None:
    tasks = [{"name": Path(name).stem} for name in files if name != "live.js"]
    found = in_node(tmp_path, files, tasks)
    for name, response in found.items():
        stimulus = stimulus_of(name)
        assert response["failure"] == "", name
        assert response["again"] == response["hash"], name
        moving = set(response["changed" if stimulus.after else "moving"])
        assert moving - {"valid", "t_sample"}, name
        text = live_components.live_of(name).text
        assert all(f"`{element}` to {value:g}" in text for element, value in stimulus.after.items())


@NEEDS_NODE
def test_a_page_computes_the_bits_of_the_master(files: dict[str, str], tmp_path: Path) -> None:
    found = in_node(tmp_path, files, [{"name": name} for name in SOME])
    assert {name: found[name]["hash"] for name in SOME} == {name: mastered(name) for name in SOME}


@NEEDS_NODE
def test_a_parameter_that_is_changed_changes_the_response_as_in_the_master(
    files: dict[str, str], tmp_path: Path
) -> None:
    tasks = [{"name": "thruster", "set": {"T_n": 0.2}}, {"name": "pool", "set": {"K": -1.0}}]
    found = in_node(tmp_path, files, tasks)
    assert found["thruster"]["refused"] == ""
    assert found["pool"]["refused"] == "K is at least 0."
    assert found["pool"]["other"] == found["pool"]["hash"]
    assert found["thruster"]["other"] == mastered("thruster", T_n=0.2)


def test_a_page_in_a_browser_follows_its_sliders(tmp_path: Path) -> None:
    html = built(tmp_path / "docs", pages_of("thruster"))
    script = """
    const place = document.querySelector("[data-live]");
    await until(() => place.view);
    const hash = () => place.querySelector(".live-hash code").textContent, found = [hash()];
    const field = place.querySelector("input[type=number][aria-label^='T_n']");
    for (const text of ["0.2", "-1", "0.0287"]) {
      field.value = text; field.onchange(); await wait(); await wait();
      found.push(hash(), place.querySelector(".live-notice").textContent);
    }
    const outputs = [...place.querySelectorAll(".live-card")].map(e => e.dataset.output);
    const resources = [...document.querySelectorAll("script[src], link[rel=stylesheet]")]
      .map(e => new URL(e.src || e.href).protocol);
    return [found, outputs, field.nextSibling.textContent, [...new Set(resources)]];
    """
    text = (html / "thruster.html").read_text(encoding="utf-8")
    found, outputs, unit, resources = found_in_page(html, text, script)
    first, changed, no_notice, after_refusal, refusal, restored, _ = found
    assert first == restored == mastered("thruster")
    assert changed == after_refusal == mastered("thruster", T_n=0.2)
    assert (no_notice, refusal) == ("", "T_n is at least 0.004.")
    assert outputs == ["thrust", "n", "current"]
    assert unit == "s"
    assert resources == ["file:"]


def test_a_component_that_cannot_run_in_a_browser_says_why(tmp_path: Path) -> None:
    html = built(tmp_path / "docs", pages_of("mpc"))
    text = (html / "mpc.html").read_text(encoding="utf-8")
    assert "This component does not run in a browser: an optimiser, model:mpc" in text
    assert "live.js" not in text


def test_a_browser_without_webassembly_is_named(tmp_path: Path) -> None:
    html = built(tmp_path / "docs", pages_of("thruster"))
    text = (html / "thruster.html").read_text(encoding="utf-8")
    text = text.replace("<head>", "<head><script>delete window.WebAssembly</script>")
    script = """
    const place = document.querySelector("[data-live]");
    await until(() => /browser/.test(place.textContent));
    return place.textContent;
    """
    assert "This browser has no WebAssembly" in found_in_page(html, text, script)


def test_the_files_of_the_pages_are_small(files: dict[str, str]) -> None:
    assert len(files["live.js"]) < 100_000
    for name, text in files.items():
        assert len(text) < (500_000 if name == "policy.js" else 120_000), name  # its network
