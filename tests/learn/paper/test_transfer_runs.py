"""Figure 11's results are kept one by one, and judged plainly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.paper.transfer_runs import (
    CONDITIONS,
    WAYS,
    Judged,
    _learned,
    read_transfers,
    run_transfers,
)
from uuvsim_cosim.learn.paper.verdicts import cells_of, transfer_verdicts
from uuvsim_cosim.learn.policies.policy import Policy

RNG = np.random.default_rng(0)


def test_what_is_there_is_not_run_again(tmp_path: Path) -> None:
    done = run_transfers(
        2, tmp_path, tmp_path / "work", ways=("scripted",), conditions=("acted",), episodes=3
    )
    assert done == ["scripted-0"]  # a second seed would be the same
    (one,) = read_transfers(tmp_path)
    assert set(one.returns) == {("acted", "as it is"), ("acted", "anticipated")}
    before = (tmp_path / "scripted-0.json").read_bytes()
    assert run_transfers(2, tmp_path, tmp_path / "work", ways=("scripted",)) == []
    assert (tmp_path / "scripted-0.json").read_bytes() == before


def test_spread_over_a_cluster_it_leaves_the_same_files(tmp_path: Path) -> None:
    from uuvsim_cosim.learn.paper.ray_reproduce import transfers_on

    class Here:
        """A cluster's stand-in: what is asked is done in this process."""

        def spread(self, work: Any, pieces: Any) -> Any:
            return ((k, work(piece)) for k, piece in enumerate(pieces))

    here: Any = Here()
    asked: dict[str, Any] = {"ways": ("scripted",), "conditions": ("acted",), "episodes": 2}
    assert transfers_on(here, 2, tmp_path / "there", **asked) == ["scripted-0"]
    assert transfers_on(here, 2, tmp_path / "there", **asked) == []
    run_transfers(1, tmp_path / "here", tmp_path / "work", **asked)
    here_and_there = [tmp_path / k / "scripted-0.json" for k in ("here", "there")]
    assert len({f.read_bytes() for f in here_and_there}) == 1


def test_what_was_learned_before_is_read_with_its_time(tmp_path: Path) -> None:
    shipped = content("models", "policies") / "source_sac.npz"
    (tmp_path / "best.npz").write_bytes(shipped.read_bytes())
    (tmp_path / "cpu.json").write_text('{"cpu": 12.5}')
    (policy,), cpu = _learned(WAYS["sac"], 0, tmp_path, (), None)
    assert (policy.task, cpu) == (Policy.load(shipped).task, 12.5)


def test_an_interruption_keeps_nothing_half(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_transfers(
            1, tmp_path, tmp_path, ways=("scripted",), conditions=("acted",), episodes=2,
            interrupted=lambda: True,
        )  # fmt: skip
    assert list(tmp_path.glob("*.json")) == []


@pytest.mark.parametrize(
    "text", ["", "[]", '{"uuvsim_transfer": 2}', '{"uuvsim_transfer": 1, "judged": {"a/b": 3}}',
             '{"uuvsim_transfer": 1, "judged": {"a/b": {"return": [NaN], "track": [1], "dist": 1, '
             '"viol": 0, "clean": 1}}, "way": "dt", "seed": 0, "cpu": 1}'],
)  # fmt: skip
def test_a_broken_result_is_refused_with_its_path(tmp_path: Path, text: str) -> None:
    (tmp_path / "dt-0.json").write_text(text)
    with pytest.raises(InputInvalid, match=r"dt-0\.json.*expected a result"):
        read_transfers(tmp_path)


# ---- verdicts, on results made up -----------------------------------------------------------


def made_up(**returns: float) -> list[Judged]:
    """Five seeds of every way; `returns` of the transformer by condition, 95 elsewhere."""
    found = []
    for way in WAYS:
        for seed in range(5):
            cells = {}
            for condition in CONDITIONS:
                for how in ("as it is", "anticipated"):
                    mean = returns.get(condition, 95.0) if way == "dt" else 94.0
                    cells[condition, how] = mean + 0.1 * RNG.normal(size=20)
            track = {k: np.full(20, returns.get("track", 1.0)) for k in cells}
            means = {k: {"dist": 0.7, "viol": 0.0, "clean": 1.0} for k in cells}
            found.append(Judged(way, seed, 1.0, cells, track, means))
    return found


def said(claim: str, found: list[Judged]) -> str:
    (row,) = [r for r in transfer_verdicts(cells_of(found)) if r.claim == claim]
    return row.text


def test_nothing_run_is_not_yet_run() -> None:
    assert {r.text for r in transfer_verdicts({})} == {"not yet run"}


def test_a_claim_holds_only_within_its_limit() -> None:
    assert said("with thrust x 0.8", made_up(weak=87.0)) == "holds"
    assert said("with thrust x 0.8", made_up(weak=84.0)) == "does not hold"
    assert said("and as behaviour cloning", made_up()) == "holds"
    assert said("and as behaviour cloning", made_up(nominal=93.0)) == "does not hold"
    teacher = "the transformer is as good as its teacher"
    assert said(teacher, made_up()) == "holds"
    assert said(teacher, made_up(track=0.94)) == "does not hold"


def test_fewer_than_five_seeds_are_so_far() -> None:
    few = [j for j in made_up() if j.seed < 2]
    text = said("with ±7 mm of noise", few)
    assert text == "cannot be decided (2 of 5 seeds; so far: holds)"


def test_a_loss_whose_interval_reaches_over_the_limit_decides_nothing() -> None:
    found = made_up(weak=86.0)  # 0.905 of 95
    for j in (j for j in found if j.way == "dt"):
        j.returns["weak", "as it is"][:] += 2.0 * (j.seed - 2)
    assert said("with thrust x 0.8", found) == "cannot be decided"


def test_the_same_as_behaviour_cloning_is_neither_better_nor_worse() -> None:
    assert said("and as behaviour cloning", made_up(nominal=94.0)) == "cannot be decided"


def test_the_page_shows_every_way_and_condition(tmp_path: Path) -> None:
    from uuvsim_cosim.commands.learn.reproduce_report import FOLDER, transfer_section

    for j in made_up():
        cells = {
            f"{c}/{h}": {"return": list(v), "track": list(j.track[c, h]), **j.means[c, h]}
            for (c, h), v in j.returns.items()
        }
        file = tmp_path / FOLDER / f"{j.way}-{j.seed}.json"
        file.parent.mkdir(exist_ok=True)
        file.write_text(json.dumps({"uuvsim_transfer": 1, "way": j.way, "seed": j.seed,
                                    "cpu": 1.0, "judged": cells}))  # fmt: skip
    rows, text, (picture,) = transfer_section(tmp_path)
    assert {r.figure for r in rows} == {"11"}
    assert all(f"`{way}`" in text for way in WAYS)
    assert all(c.words in text for c in CONDITIONS.values())
    drawn = picture.read_text()
    assert drawn.count("<circle") >= 5 * len(CONDITIONS)
    assert "0.9 of dt" in drawn
