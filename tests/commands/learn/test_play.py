"""`uuvsim play` and `uuvsim evaluate`: policies, and the tasks that they were trained in."""

import json
from pathlib import Path

import pytest

from tests.conftest import Uuvsim
from tests.view.browser import found_in_page
from uuvsim_cosim.commands.learn.policies import acting_of
from uuvsim_cosim.errors import InputInvalid


def test_a_policy_of_another_task_is_played_only_if_asked_for() -> None:
    with pytest.raises(InputInvalid, match=r"source_sac: was trained in source, not in target"):
        acting_of(["source_sac"], "target", {}, own_task=True)
    assert acting_of(["source_sac"], "source", {}, own_task=True).name == "source"
    assert acting_of(["source_sac"], "target", {}).name == "target"


def test_the_task_of_a_policy_is_its_own_unless_one_is_named() -> None:
    assert acting_of(["source_sac"], None, {}, own_task=True).name == "source"


def test_a_policy_plays_on_a_page_with_the_return_that_the_command_prints(
    uuvsim: Uuvsim, tmp_path: Path
) -> None:
    out = tmp_path / "episode.html"
    words = ("play", "--policy", "source_sac", "--live", "-o", str(out), "--json")
    status, text, _ = uuvsim(*words, "--task-set", "horizon=4", "--seed", "3")
    assert status == 0
    figures = {row["figure"]: row["value"] for row in json.loads(text)["figures"]}
    played, on_page = float(figures["return"]), float(figures["return on the page"])
    assert on_page == pytest.approx(played, rel=1e-6)  # float64 and float32
    script = """
    await until(() => window.uuvsimPage);
    const page = window.uuvsimPage;
    page.advance(201);
    const plots = [...document.querySelectorAll("#plots .card")].map(e => e.dataset.signal);
    return [page.system.get("task.return")[0], page.system.get("task.ended")[0], plots,
      document.querySelector("details.card:last-of-type").textContent];
    """
    page = out.read_text("utf-8")
    found, ended, plots, about = found_in_page(tmp_path, page, script)
    assert found == pytest.approx(on_page, rel=1e-8)
    assert ended == 1.0
    assert plots[:2] == ["task.return", "task.tracker_1_action"]
    assert "network in float64, uuvsim play in float32" in about
    assert "uuvsim verify" not in about
    # The page pauses at the end, once, and claims nothing about a system that has no name.
    script = """
    await until(() => window.uuvsimPage);
    const page = window.uuvsimPage, find = s => document.querySelector(s), seen = [];
    const now = () => [page.line.steps, find("#run").textContent, find("#notice").textContent];
    find("#speed").value = "64"; find("#run").click();
    while (page.running()) await wait();
    seen.push(now());
    find("#run").click();
    while (page.line.steps < 300) await wait();
    find("#run").click();
    seen.push(now().slice(1));
    page.seek(0); page.advance(250);
    seen.push(now());
    return [...seen, [find("#download"), find("#seed")].map(e => e.checkVisibility())];
    """
    end = "The episode has ended: task.ended is 1. The system itself can run on."
    assert found_in_page(tmp_path, page, script) == [
        [201, "run", end], ["run", ""], [250, "run", end], [False, False],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "reason"),
    [("source --live -o x.html", "--live with --policy scripted: a function in Python"),
     ("source --live -o x.png", "--live and --out x.png; expected a file .html"),
     ("source --live --window", "--live and --window or --view; expected one of them"),
     ("pool_tracking --policy source_sac --other-task --live", "task PoolTracking")],
)  # fmt: skip
def test_a_page_that_cannot_be_made_is_refused_in_one_message(
    uuvsim: Uuvsim, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, reason: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, _, error = uuvsim("play", *words.split())
    assert status == 2
    assert reason in error
    assert not list(tmp_path.iterdir())
