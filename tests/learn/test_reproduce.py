"""Results of the benchmark are kept one by one, gone on with, and judged plainly."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn import reproduce_ways as ways
from uuvsim_cosim.learn.policy import Policy
from uuvsim_cosim.learn.reproduce import reproduce
from uuvsim_cosim.learn.reproduce_results import Key, Result, read_result, read_results
from uuvsim_cosim.learn.reproduce_verdicts import Verdict, verdicts
from uuvsim_cosim.learn.reproduce_ways import BUDGETS, CAREFUL, SCENARIOS, Budget, chains_of

EVERY = dict.fromkeys((*SCENARIOS, CAREFUL), 80)
TINY = Budget(
    "batched", "as small as can be", 8, EVERY, EVERY,
    {"hidden": 16, "batch": 16, "buffer": 1000, "shared": True},
    {"rules": {"credit": "own"}, "horizon": 4}, of={CAREFUL: {"lr": 1e-3}},
    under={CAREFUL: {"w_p": 0.5}},
)  # fmt: skip


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Figure 7 without those from scratch, of one seed."""
    folder = tmp_path_factory.mktemp("reproduced")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ways.NEEDS, "fig8", (ways.STT,))
        reproduce("fig8", TINY, 1, folder / "results", folder / "work", episodes=3)
    return folder / "results", folder / "work"


def test_a_run_leaves_numbers_a_curve_an_episode_and_a_policy(ran: tuple[Path, Path]) -> None:
    stem = ran[0] / "batched" / "target" / "stt-masac-0"
    read = read_result(ran[0], Key("batched", "target", "stt-masac", 0))
    assert read.returns.shape == read.scripted.shape == (3,)
    assert list(read.curve["step"]) == [0, 80]
    assert read.about["settings"]["shared"] is True
    rows = stem.with_name("stt-masac-0.episode.csv").read_text().splitlines()
    assert len(rows) == 12  # names, the start, ten actions
    assert "x_o2" in rows[0]
    assert Policy.load(stem.with_name("stt-masac-0.npz")).task == "target"


def test_what_was_learned_under_other_rules_is_judged_by_the_same(ran: tuple[Path, Path]) -> None:
    first, careful = (
        read_result(ran[0], Key("batched", s, "stt-masac", 0)) for s in ("target", "careful")
    )
    assert careful.about["learned under"] == {"w_p": 0.5}
    assert careful.about["options"] == first.about["options"]
    assert np.array_equal(careful.scripted, first.scripted)
    policy = Policy.load(ran[0] / "batched" / "careful" / "stt-masac-0.npz")
    assert policy.options["rules"] == {"credit": "own"}


def test_what_is_there_is_not_run_again(ran: tuple[Path, Path]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ways.NEEDS, "fig8", (ways.STT,))
        assert reproduce("fig8", TINY, 1, *ran, episodes=3) == []
        lost = ran[0] / "batched" / "source" / "stt-masac-0.json"
        before = lost.read_bytes()
        lost.unlink()
        assert [k.scenario for k in reproduce("fig8", TINY, 1, *ran, episodes=3)] == ["source"]
    assert lost.read_bytes() == before  # from the work folder, without training


class Here:
    """A cluster's stand-in: what is asked is done in this process."""

    def spread(self, work: Any, pieces: Any, follow: Any) -> Iterator[tuple[int, Any]]:
        for number, piece in enumerate(pieces):
            after = piece
            while after is not None:
                result = work(after)
                after = follow(number, result)
                yield number, result


def test_a_chain_in_pieces_leaves_the_same_policies(ran: tuple[Path, Path], tmp_path: Path) -> None:
    from uuvsim_cosim.learn.ray_reproduce import reproduce_on

    here: Any = Here()
    told: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ways.NEEDS, "fig8", (ways.STT,))
        keys = reproduce_on(
            here, "fig8", TINY, 1, tmp_path / "results", tmp_path / "work", seconds=0.1,
            episodes=3, progress=lambda _, done, __: told.append(done),
        )  # fmt: skip
    assert {k.scenario for k in keys} == {*SCENARIOS, CAREFUL}
    assert len(told) > 2  # in pieces
    for policy in ran[0].rglob("*.npz"):
        other = tmp_path / "results" / policy.relative_to(ran[0])
        assert other.read_bytes() == policy.read_bytes()


def test_the_page_says_what_was_not_run(ran: tuple[Path, Path]) -> None:
    from uuvsim_cosim.commands.reproduce_report import write_report

    rows, files = write_report(ran[0])
    page = files[0].read_text()
    assert "Nothing has been run with this budget" in page
    assert "so far (1 of 5 seeds)" in page
    assert {r.text for r in rows["paper"]} == {"not yet run"}
    assert [f.name for f in files[1:]] == ["fig7_batched.svg", "fig8_batched.svg"]


@pytest.mark.parametrize(
    "broken", ["", "{}", '{"uuvsim_result": 2}', "[1]", '{"uuvsim_result": 1}']
)
def test_a_broken_result_is_refused_with_its_path(
    ran: tuple[Path, Path], tmp_path: Path, broken: str
) -> None:
    path = tmp_path / "batched" / "target" / "stt-masac-0.json"
    path.parent.mkdir(parents=True)
    path.write_text(broken)
    with pytest.raises(InputInvalid, match=r"stt-masac-0\.json.*expected a result"):
        read_results(tmp_path, "batched")


def test_unknown_figures_are_refused_and_all_is_every_one() -> None:
    with pytest.raises(InputInvalid, match="expected one of fig7"):
        chains_of("fig77")
    assert {c.way for f in ("fig7", "fig8", "fig9") for c in chains_of(f)} == {
        c.way for c in chains_of("all")
    }
    assert BUDGETS["paper"].steps["source"] == 200 * 50


def test_ways_without_schooling_have_as_many_steps_as_its_four_scenarios() -> None:
    for chain in chains_of("fig9")[1:]:
        plan = ways.plan_of(chain, BUDGETS["batched"])
        steps = plan["steps"] if isinstance(plan, dict) else plan.stages[0].steps
        assert steps == 32_000 + 25_600 + 83_200 + 256_000


# ---- verdicts, on results made up ---------------------------------------------------------


def made_up(scenario: str, way: str, seed: int, good: float, **changes: float) -> Result:
    random = np.random.default_rng(seed)
    metrics = {"track": 1.0, "dist": 0.6, "viol": 0.0, "clean": 1.0, **changes}
    step = np.arange(11.0) * 100
    curve = {"step": step, "return": 100 * good * np.minimum(step / 300, 1.0)}
    curve |= {"r_t": np.full(11, 2.0), "r_a": np.zeros(11), "p_2": np.zeros(11)}
    return Result(
        Key("batched", scenario, way, seed), {"cpu": 100.0},
        100 * good + random.normal(size=20), np.full(20, 100.0),
        {k: np.full(20, v) for k, v in metrics.items()}, {}, curve,
    )  # fmt: skip


def judged(way: str, good: float, seeds: int = 5, **changes: float) -> list[Result]:
    return [made_up("target", way, s, good, **changes) for s in range(seeds)]


def row(rows: list[Verdict], claim: str) -> Verdict:
    (found,) = [r for r in rows if claim in r.claim]
    return found


def test_nothing_run_is_not_yet_run() -> None:
    assert {v.text for v in verdicts({})} == {"not yet run"}


def test_figure_8_holds_only_if_every_limit_is_kept() -> None:
    def said(**changes: float) -> str:
        runs = {("target", "stt-masac"): judged("stt-masac", 1.0, 5, **changes)}
        return row(verdicts(runs), "two trackers track").text

    assert said() == "holds"
    for worse in ({"track": 0.94}, {"dist": 0.95}, {"dist": 0.3}, {"viol": 0.02}, {"clean": 0.99}):
        assert said(**worse) == "does not hold"


def test_the_costs_of_the_target_scenario_are_of_both_times() -> None:
    target = judged("stt-masac", 1.0)
    again = [replace(r, key=replace(r.key, scenario="careful")) for r in target]
    rows = verdicts({("target", "stt-masac"): target, ("careful", "stt-masac"): again})
    assert row(rows, "the cost").measured.startswith("at most 200 CPU s (careful")
    assert row(rows, "learned to be careful").text == "holds"


def test_a_few_bad_episodes_are_not_left_out() -> None:
    """An interquartile mean of viol would not see one episode in five."""
    runs = judged("stt-masac", 1.0)
    for r in runs:
        r.metrics["viol"][:4] = 0.5
    said = row(verdicts({("target", "stt-masac"): runs}), "two trackers track")
    assert said.text == "does not hold"


def test_fewer_than_five_seeds_are_so_far() -> None:
    runs = {("target", "stt-masac"): judged("stt-masac", 1.0, seeds=2)}
    assert row(verdicts(runs), "two trackers track").text == "holds so far (2 of 5 seeds)"


def test_figure_9_wants_intervals_apart() -> None:
    def said(other: float) -> str:
        runs = {("target", "stt-masac"): judged("stt-masac", 1.0),
                ("target", "scratch-ippo-all_steps"): judged("x", other)}  # fmt: skip
        return row(verdicts(runs), "IPPO").text

    assert said(0.8) == "holds"
    assert said(1.0) == "does not hold"


def test_transfer_helps_where_its_curve_lies_above() -> None:
    fast, slow = judged("stt-masac", 1.0), judged("scratch-masac", 0.5)
    for r in slow:
        r.curve["return"][:] = np.linspace(0, 95, 11)
    rows = verdicts({("target", "stt-masac"): fast, ("target", "scratch-masac"): slow})
    assert row(rows, "STT helps in target").text == "holds"
    quick = row(rows, "STT is quicker in target")
    assert quick.text == "holds"
    assert quick.measured == "300 steps against 1,000 steps (medians)"


def test_continuity_compares_the_terms_that_both_have() -> None:
    before = [replace(r, key=replace(r.key, scenario="transition_2")) for r in judged("x", 1.0)]
    after = judged("x", 1.0)
    for r in after:
        r.curve["r_t"][0] = 1.7
    rows = verdicts({("transition_2", "stt-masac"): before, ("target", "stt-masac"): after})
    said = row(rows, "first of target")
    assert said.measured.startswith("0.85")
    assert said.text == "does not hold"


def test_a_name_without_a_seed_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "batched" / "target" / "stt.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps({}))
    with pytest.raises(InputInvalid, match=r"expected WAY-SEED\.json"):
        read_results(tmp_path, "batched")


@pytest.mark.slow
def test_one_seed_of_the_source_scenario_reaches_nine_tenths_of_the_scripted_return(
    tmp_path: Path,
) -> None:
    """What CI runs again of figure 7; stops as soon as it is reached twice running."""
    from uuvsim_cosim.learn.curriculum import Curriculum, Promotion, Stage, train_curriculum

    budget = BUDGETS["batched"]
    stage = Stage(
        "source", budget.steps["source"], settings={**budget.alone, **budget.of["source"]},
        promotion=Promotion(), evaluate_every=1_600,
    )  # fmt: skip
    curriculum = Curriculum(
        "source", (stage,), settings=budget.settings, options=budget.options, evaluation_episodes=30
    )
    (done,) = train_curriculum(curriculum, tmp_path / "source", seed=0)
    assert done.promoted
    assert done.scripted is not None
    assert done.evaluations[-1]["return"] >= 0.9 * done.scripted
    assert done.evaluations[-1]["track"] >= 0.95
