"""A team's policies are loaded whole: each agent acts by its own file, or nothing acts."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.commands.learn.policies import acting_of
from uuvsim_cosim.content import content
from uuvsim_cosim.envs.tasks.evaluation import evaluate
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.deployment.export import export_policy
from uuvsim_cosim.learn.paper.results import Key, read_result
from uuvsim_cosim.learn.policies.policy import Named, Policy
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.loading import acting_in, load_policies
from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED

RESULTS = Path(__file__).parents[3] / "docs" / "results" / "target_tracking"
IPPO = RESULTS / "batched" / "target" / "scratch-ippo-all_steps-0.tracker_1.npz"
EPISODES = 6
KINDS = {  # one kept result of each kind of file, team and network
    "one file for two trackers": "batched/target/stt-masac-0",
    "one file for three trackers": "batched/target/stt-masac-three-0",
    "the only tracker": "paper/target/stt-masac-one-0",
    "the source scenario": "paper/source/stt-masac-0",
    "under harder rules": "batched/careful/stt-masac-0",
    "a file of each, PPO": "batched/target/scratch-ippo-all_steps-0",
    "a file of each, PPO after the schooling": "batched/target/stt-ippo-0",
    "a file of each, DQN after the schooling": "batched/target/stt-idqn-0",
    "a file of each, central PPO": "batched/target/scratch-mappo-all_steps-0",
    "a file of each, DQN": "batched/target/scratch-idqn-all_steps-0",
    "a file of each, SAC": "paper/target/scratch-isac-all_steps-0",
    "a file of each, MASAC": "paper/target/stt-masac-0",
    "a file of each of three": "paper/target/stt-masac-three-0",
    "the second transition": "paper/transition_2/stt-masac-0",
}


@pytest.mark.parametrize("stem", KINDS.values(), ids=KINDS)
def test_a_kept_result_evaluates_to_its_stored_returns(stem: str) -> None:
    budget, scenario, name = stem.split("/")
    way, _, seed = name.rpartition("-")
    stored = read_result(RESULTS, Key(budget, scenario, way, int(seed))).returns[:EPISODES]
    file = sorted((RESULTS / stem).parent.glob(f"{Path(stem).name}*.npz"))[-1]
    found = acting_of([str(file)], None, {})
    (acts,) = found.policies.values()
    judged = evaluate(found.task, acts, EPISODES, seed=JUDGING_SEED)
    assert judged.returns == pytest.approx(stored, rel=1e-3, abs=0.05)


def test_every_kept_policy_belongs_to_a_whole_team() -> None:
    for file in RESULTS.rglob("*.npz"):
        policies = load_policies(file)
        task = make_task(policies[0].task, policies[0].options)
        acts = acting_in(task, policies, policies[0].task)
        if policies[0].agent:
            assert [p.agent for p in policies] == list(acts), file
            assert len({id(act) for act in acts.values()}) == len(acts)


@pytest.mark.parametrize("mark", ["-", "."])
def test_a_missing_file_of_an_agent_is_an_error(
    mark: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = tmp_path / f"best{mark}tracker_1.npz"
    shutil.copy(IPPO, alone)
    for arguments in (
        ["evaluate", str(alone), "--episodes", "1"],
        ["play", "--policy", str(alone), "-o", str(tmp_path / "episode.html")],
        ["collect", "target", "--policy", str(alone), "--episodes", "1", "-o",
         str(tmp_path / "data.npz"), "--task-set", "rules.credit=own"],
    ):  # fmt: skip
        assert status_of(arguments) == 2
        said = capsys.readouterr().err
        assert "none of tracker_2; expected a file of each agent" in said
    assert sorted(tmp_path.iterdir()) == [alone]


def test_a_folder_that_has_lost_an_agents_file_is_not_exported(tmp_path: Path) -> None:
    shutil.copy(IPPO, tmp_path / "best-tracker_1.npz")
    with pytest.raises(InputInvalid, match="policies of tracker_1; expected the file of one"):
        export_policy(tmp_path, tmp_path / "policy.onnx")


def test_the_other_agents_file_under_another_name_is_no_part_of_the_team(tmp_path: Path) -> None:
    shutil.copy(IPPO, tmp_path / "best-tracker_1.npz")
    other = IPPO.with_name(IPPO.name.replace("tracker_1", "tracker_2"))
    shutil.copy(other, tmp_path / "best-old-tracker_2.npz")
    shutil.copy(other, tmp_path / "best-tracker_1-copy.npz")
    for given in (tmp_path, tmp_path / "best-tracker_1.npz"):
        assert [p.agent for p in load_policies(given)] == ["tracker_1"]


def test_policies_that_learned_under_other_options_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One task judges all that are given: the first policy's, with its options."""
    first, other = tmp_path / "first.npz", tmp_path / "other.npz"
    shipped = load_policies("target_masac")[0]
    shipped.save(first)
    replace(shipped, options={"horizon": 8}).save(other)
    found = acting_of([str(first), str(other)], None, {})
    assert found.options == {"rules": {"credit": "own"}}
    assert found.notes == (
        f"{other} was trained with horizon 8 and acts here with the default of horizon",
        f"{other} was trained with the default of rules and acts here with rules "
        "{'credit': 'own'}",
    )
    assert acting_of([str(first)], None, {}).notes == ()
    given = ["evaluate", str(first), str(other), "--episodes", "1", "--task-set", "horizon=8"]
    assert status_of(given) == 0
    said = capsys.readouterr().out
    assert "note: " in said
    assert "trained with the default of rules" in said.replace("\n", " ")
    assert "the default of horizon" not in said


def test_two_of_three_do_not_stand_for_the_third() -> None:
    three = load_policies(RESULTS / "paper/target/stt-masac-three-0.tracker_2.npz")
    task = make_task("target", three[0].options)
    assert list(acting_in(task, three, "target")) == ["tracker_1", "tracker_2", "tracker_3"]
    for lost in range(3):
        rest = [p for k, p in enumerate(three) if k != lost]
        with pytest.raises(InputInvalid, match=rf"none of tracker_{lost + 1}; expected"):
            acting_in(task, rest, "target")


def test_one_agents_own_policy_acts_where_it_is_the_only_one() -> None:
    (own,) = [p for p in load_policies(IPPO) if p.agent == "tracker_1"]
    assert list(acting_in(make_task("source"), [own], "source")) == ["tracker_1"]
    other = replace(own, agent="tracker_2")
    with pytest.raises(InputInvalid, match="none of tracker_1"):
        acting_in(make_task("source"), [other], "source")


def test_policies_that_stand_for_the_same_agent_are_refused() -> None:
    own = load_policies(IPPO)[0]
    task = make_task("target", own.options)
    for pair in ([own, own], [own, replace(own, agent="")]):
        with pytest.raises(InputInvalid, match="expected one of each agent, or one for all"):
            acting_in(task, pair, "target")


def test_of_a_team_none_acts_in_a_task_for_one() -> None:
    task = make_task("uuvsim/StationKeeping-v0")
    from uuvsim_cosim.learn.training.agents import widths

    observed, acted = widths(task)
    seen, acts = (tuple(Named(f"{c}[{k}]", -1, 1) for k in range(w))
                  for c, w in (("o", observed), ("a", acted)))  # fmt: skip
    tensors = {"0.weight": np.zeros((acted, observed), np.float32),
               "0.bias": np.zeros(acted, np.float32)}  # fmt: skip
    team = [Policy("tanh", tensors, seen, acts, "toy", agent=a) for a in ("left", "right")]
    with pytest.raises(InputInvalid, match="policies of left, right; expected one"):
        acting_in(task, team, "station keeping")


def test_the_policies_that_ship_act_in_their_own_tasks() -> None:
    for file in sorted(content("models", "policies").glob("*.npz")):
        policies = load_policies(file.stem)
        acting_in(make_task(policies[0].task, policies[0].options), policies, policies[0].task)
